"""Agents that move and whose innovations are late: a functional that decreases, piece by piece of the spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.linalg.balls import Ball, is_positive, stacked
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.observers.network import DiffusiveObserver

_PIECES = 96
_BALANCES = (1.0, 0.5, 2.0)
_SHARES = (1e-3, 1e-2, 0.1, 1.0, 1e-4, 10.0)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Adjoining pieces of an interval of ``g = gain lambda``, each with P > 0 and R > 0.

    Attributes:
        edges: (m + 1,) ascending.
        P, R: (m, n, n).
    """

    edges: FloatArray
    P: FloatArray
    R: FloatArray


def decreases_late(observer: DiffusiveObserver, P: FloatArray, R: FloatArray, delay: float, g: float) -> bool:
    """Prove that ``V = e' P e + h int int e_dot' R e_dot`` decreases along ``e' = A e(t) - g K C e(t - h)``.

    With Jensen's inequality ``V' <= (e, e_h)' F (e, e_h)``, ``h`` the ``delay`` and

        F = [P A + A' P - R, R - g P K C; *, -R] + h^2 [A, -g K C]' R [A, -g K C].

    F is convex in g: negative definite at both ends of a piece, it is so on the piece. Source: Fridman 2014, key
    Fridman2014.
    """
    A, r = Ball.exact(observer.agent.A), Ball.exact(R)
    B = (Ball.exact(observer.injection) @ Ball.exact(observer.agent.C)).times(-g)
    drift, corner = Ball.exact(P) @ A, r + Ball.exact(P) @ B
    flow = stacked([[A, B]])
    rest = stacked([[drift + drift.T - r, corner], [corner.T, -r]])
    return is_positive(-(rest + (flow.T @ (r @ flow)).times(delay).times(delay)))


def _seems_late(observer: DiffusiveObserver, P: FloatArray, R: FloatArray, delay: float, g: float) -> bool:
    """The same in plain floats: what fails here need not be tried in earnest."""
    A, B = observer.agent.A, -g * (observer.injection @ observer.agent.C)
    drift, corner, flow = P @ A, R + P @ B, np.hstack([A, B])
    F = np.block([[drift + drift.T - R, corner], [corner.T, -R]]) + delay * delay * (flow.T @ R @ flow)
    return bool(np.isfinite(F).all()) and float(np.linalg.eigvalsh(0.5 * (F + F.T))[-1]) < 0.0


def prove(observer: DiffusiveObserver, delay: float, low: float, high: float) -> Pieces | None:
    """Cover ``[low, high]``; a piece that cannot be proved is halved, at most 96 pieces in all. None: not proved."""
    waiting, done, count = [(low, high)], [], 0
    while waiting:
        left, right = waiting.pop()
        count += 1
        if count > _PIECES:
            return None
        pair = _pair(observer, delay, left, right)
        if pair is not None:
            done.append((left, right, *pair))
            continue
        middle = float(np.sqrt(left * right))
        if not left < middle < right:
            return None
        waiting += [(middle, right), (left, middle)]
    edges = np.array([low, *(piece[1] for piece in done)])
    return Pieces(edges, np.stack([piece[2] for piece in done]), np.stack([piece[3] for piece in done]))


def covers(observer: DiffusiveObserver, pieces: Pieces, delay: float, low: float, high: float) -> bool:
    """Prove it again from the pieces."""
    edges = pieces.edges
    if not (edges[0] <= low and high <= edges[-1] and (np.diff(edges) > 0.0).all() and edges[0] > 0.0):
        return False
    triples = zip(edges[:-1], edges[1:], pieces.P, pieces.R, strict=True)
    return all(_proved(observer, P, R, delay, float(left), float(right)) for left, right, P, R in triples)


def _proved(observer: DiffusiveObserver, P: FloatArray, R: FloatArray, delay: float, left: float, right: float) -> bool:
    if not (is_positive_definite(P) and is_positive_definite(R)):
        return False
    return all(decreases_late(observer, P, R, delay, g) for g in (left, right))


def _pair(observer: DiffusiveObserver, delay: float, left: float, right: float) -> tuple[FloatArray, FloatArray] | None:
    """P of the undelayed mode in the middle, R from what couples the two: ``R = sym(g P K C)+ + a part of P``."""
    g = float(np.sqrt(left * right))
    A, pull = observer.agent.A, g * (observer.injection @ observer.agent.C)
    for P in _functions(A - pull):
        corner = P @ pull
        values, vectors = np.linalg.eigh(0.5 * (corner + corner.T))
        part = (vectors * np.maximum(values, 0.0)) @ vectors.T
        unit = float(np.abs(values).max(initial=0.0)) or 1.0
        for balance in _BALANCES:
            for share in _SHARES:
                R = balance * part + share * unit * P / float(np.linalg.norm(P, 2))
                R = 0.5 * (R + R.T)
                ends = (left, right)
                if all(_seems_late(observer, P, R, delay, end) for end in ends) and _proved(
                    observer, P, R, delay, left, right
                ):
                    return P, R
    return None


def _functions(M: FloatArray) -> list[FloatArray]:
    n = M.shape[0]
    found = []
    for dual in (False, True):
        try:
            with near_singular_allowed():
                X = la.solve_continuous_lyapunov(M if dual else M.T, -np.eye(n))
                X = np.linalg.inv(X) if dual else X
        except (np.linalg.LinAlgError, ValueError):
            continue
        X = 0.5 * (X + X.T)
        if np.isfinite(X).all() and is_positive_definite(X):
            found.append(X / float(np.abs(X).max()))
    return found
