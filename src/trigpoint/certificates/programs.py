"""Rigorous facts about an observer given by programs: its error obeys ``e' = H e``, and how accurately H is known."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.linalg.blocks import Ranges
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.verified import gam, is_positive_definite
from trigpoint.observers.assembled import AssembledObserver

DENSE_LIMIT = 600
_SHARES = (1.0 - 1e-9, 1.0 - 1e-6, 0.999, 0.99, 0.95, 0.9, 0.8, 0.65, 0.5, 0.3, 0.1)
_HALVINGS, _QUICK = 6, 200


def error_is_autonomous(observer: AssembledObserver) -> bool:
    """Prove ``e' = H e`` exactly, arc by arc: no part of the truth drives the error.

    Every program has the problem's own dynamics, ``A_i V_i = V_i A`` on what it estimates, and every innovation
    vanishes in agreement: ``sign C_k = output V_i - sum rows V_j`` entry by entry, in exact arithmetic (the targets
    V have entries 0 and 1 only). False means *not proved*.
    """
    if observer.is_discrete and observer.period is not None:
        return False
    channels = observer.channels
    V = [
        np.asarray(observer.target(k) @ target.toarray())
        for k, target in enumerate(channels.targets)
    ]  # fmt: skip
    if not all(np.isin(matrix, (0.0, 1.0)).all() and (matrix.sum(axis=1) <= 1.0).all() for matrix in V):
        return False
    A, C = channels.A.toarray(), channels.C.toarray()
    position = {name: k for k, name in enumerate(observer.names)}
    for k, node in enumerate(observer.nodes):
        if not np.array_equal(node.A @ V[k], V[k] @ A):
            return False
        for arc in node.arcs:
            seen = arc.output @ V[k]
            for name, rows in arc.heard:
                seen = seen - rows @ V[position[name]]
            read = 0.0 * seen if arc.label is None else arc.sign * C[channels.readings.slice(arc.label)]
            if not np.array_equal(seen, read):
                return False
    return True


def error_magnitude(observer: AssembledObserver) -> tuple[FloatArray, FloatArray]:
    """H as computed, and a bound of its rounding error entry by entry."""
    total = observer.states.total
    size, terms = np.zeros((total, total)), np.ones(total)
    ranges: Ranges = observer.states
    position = {name: k for k, name in enumerate(observer.names)}
    for k, node in enumerate(observer.nodes):
        own = ranges.slice(k)
        size[own, own] += np.abs(node.A)
        for arc in node.arcs:
            gain = np.abs(arc.gain)
            size[own, own] += gain @ np.abs(arc.output)
            terms[own] += arc.gain.shape[1] + 2
            for name, rows in arc.heard:
                size[own, ranges.slice(position[name])] += gain @ np.abs(rows)
    return observer.error_matrix().toarray(), np.asarray(gam(4.0 * terms + 32.0))[:, None] * size


def decreases(P: FloatArray, H: FloatArray, radius: FloatArray, rate: float) -> bool:
    """Prove ``P H + H' P + 2 rate P < 0`` for every H within ``radius``: P must be symmetric.

    Source: theory 8-G5; Rump (2006), key Rump2006.
    """
    product = P @ H
    decrease = -(product + product.T) - 2.0 * rate * P
    size = np.abs(P) @ np.abs(H)
    spread = np.abs(P) @ radius
    slack = gam(8.0 * P.shape[0] + 64.0) * (size + size.T + 2.0 * rate * np.abs(P))
    slack = slack + (spread + spread.T) * (1.0 + float(gam(P.shape[0] + 8.0)))
    return is_positive_definite(0.5 * (decrease + decrease.T), slack * (1.0 + 1e-12))


def lyapunov_rate(H: FloatArray, radius: FloatArray, wanted: float | None) -> tuple[float, FloatArray] | None:
    """A rate a and P > 0 with ``P H + H' P + 2 a P < 0`` proved, or None.

    The wanted rate if one is given; otherwise the largest of eleven shares of the computed abscissa that can be
    proved, and up to 200 states what six halvings of the gap above it add. P solves the Lyapunov equation of
    ``H + a' I`` with a' between the rate and the abscissa.
    """
    abscissa = float(np.linalg.eigvals(H).real.max(initial=-np.inf))
    if not abscissa < 0.0:
        return None
    if wanted is not None:
        return _proved(H, radius, wanted, abscissa)
    refused = -abscissa
    for share in _SHARES:
        found = _proved(H, radius, -abscissa * share, abscissa)
        if found is not None:
            return _pushed(H, radius, found, refused, abscissa)
        refused = -abscissa * share
    return None


def _pushed(
    H: FloatArray, radius: FloatArray, found: tuple[float, FloatArray], refused: float, abscissa: float
) -> tuple[float, FloatArray]:
    """Halve the gap between the proved rate and one that could not be proved."""
    for _ in range(_HALVINGS if H.shape[0] <= _QUICK and found[0] < 0.999 * refused else 0):
        middle = 0.5 * (found[0] + refused)
        better = _proved(H, radius, middle, abscissa)
        if better is None:
            refused = middle
        else:
            found = better
    return found


def _proved(H: FloatArray, radius: FloatArray, rate: float, abscissa: float) -> tuple[float, FloatArray] | None:
    for lift in (0.5, 0.0, 0.9):
        P = _solution(H, rate + lift * (-abscissa - rate))
        if P is not None and is_positive_definite(P) and decreases(P, H, radius, rate):
            return rate, P
    return None


def _solution(H: FloatArray, rate: float) -> FloatArray | None:
    shifted = H + rate * np.eye(H.shape[0])
    try:
        with near_singular_allowed():
            P = la.solve_continuous_lyapunov(shifted.T, -np.eye(H.shape[0]))
    except (np.linalg.LinAlgError, ValueError):
        return None
    P = 0.5 * (P + P.T)
    largest = float(np.abs(P).max(initial=0.0))
    return P / largest if np.isfinite(largest) and largest > 0.0 else None
