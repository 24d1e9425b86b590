"""Verified Lyapunov pairs: a rate, and the matrix or the pair of factors that proves it of every H within a ball."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.certificates.base import witness
from trigpoint.linalg.balls import Ball, decays, is_negative_along
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.fine import Fine, between, decays_between, decreases_between
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.observers.certificate import ClaimRecord

_SHARES = (1.0 - 1e-9, 1.0 - 1e-6, 0.999, 0.99, 0.95, 0.9, 0.8, 0.65, 0.5, 0.3, 0.1)
_HALVINGS, _QUICK = 6, 200
_ENOUGH = 0.98
_CLIMBS, _WORST_STEP, _WORTHWHILE = 20, 1e10, 2e-3
_CLIMB_SHARES = (1.0 - 1e-6, 0.99, 0.9, 0.7, 0.4, 0.15)
_LEVELS = (1.0, 0.5, 0.2, 0.05, 0.01)
_BELOW = (1e-9, 1e-6, 1e-4, 3e-3)


@dataclass(frozen=True, eq=False)
class Pair:
    """``P H + H' P + 2 rate P < 0`` with P > 0, or ``P = R' R`` by its factor R and an approximate inverse T.

    Attributes:
        rate: 1/s.
        arrays: ``P``, or ``R`` and ``T``, each (n, n).
    """

    rate: float
    arrays: dict[str, FloatArray]


def proves(record: ClaimRecord, H: Ball, fine: Callable[[], Fine], rate: float) -> bool:
    """Prove ``rate`` again from the witness of a ``Pair``; ``fine`` gives H to more digits."""
    if "R" in record.witness:
        return decays_between(witness(record, "R", H.middle.shape), witness(record, "T", H.middle.shape), fine(), rate)
    if "P" not in record.witness:
        return False
    P = witness(record, "P", H.middle.shape)
    return is_positive_definite(P) and decays(P, H, rate)


def lyapunov_pair(H: Ball, fine: Callable[[], Fine] | None, wanted: float | None) -> Pair | None:
    """A pair for the ``wanted`` rate; for the largest rate that can be proved where none is given; or None.

    Args: ``H`` the matrix up to its rounding errors; ``fine`` gives it to more digits where needed (None: P only).

    First P solves the Lyapunov equation of ``H + a' I`` with a' between the rate and the computed abscissa. Where its
    condition is too large for that (deep cascades: 1e15 and more), the coordinates are changed instead, step by step,
    and the pair of their factors is the witness.
    """
    if not _is_finite(H):
        return None
    abscissa = float(np.linalg.eigvals(H.middle).real.max(initial=-np.inf))
    found = _direct(H, wanted, abscissa) if abscissa < 0.0 else None
    if fine is None or (found is not None and (wanted is not None or found.rate > _ENOUGH * -abscissa)):
        return found
    climbed = _climbed(fine(), wanted)
    best = max((pair for pair in (found, climbed) if pair is not None), key=lambda pair: pair.rate, default=None)
    return None if best is not None and wanted is not None and best.rate < wanted else best


def _is_finite(H: Ball) -> bool:
    return bool(np.isfinite(H.middle).all() and np.isfinite(H.radius).all())


def _direct(H: Ball, wanted: float | None, abscissa: float) -> Pair | None:
    """The largest of eleven shares of the abscissa, and up to 200 states what six halvings of the gap above it add."""
    if wanted is not None:
        return _solved(H, wanted, abscissa)
    refused, found = -abscissa, None
    for share in _SHARES:
        found = _solved(H, -abscissa * share, abscissa)
        if found is not None:
            break
        refused = -abscissa * share
    for _ in range(_HALVINGS if found is not None and H.middle.shape[0] <= _QUICK else 0):
        if found is None or found.rate >= 0.999 * refused:
            break
        better = _solved(H, 0.5 * (found.rate + refused), abscissa)
        refused = 0.5 * (found.rate + refused) if better is None else refused
        found = found if better is None else better
    return found


def _solved(H: Ball, rate: float, abscissa: float) -> Pair | None:
    for lift in (0.5, 0.0, 0.9):
        P = lyapunov_solution(H.middle, rate + lift * (-abscissa - rate))
        if P is not None and is_positive_definite(P) and decays(P, H, rate):
            return Pair(rate, {"P": P})
    return None


def lyapunov_solution(H: FloatArray, rate: float) -> FloatArray | None:
    """P of ``P (H + rate I) + (H + rate I)' P = -I``, largest entry 1; None where there is none."""
    shifted = H + rate * np.eye(H.shape[0])
    try:
        with near_singular_allowed():
            P = la.solve_continuous_lyapunov(shifted.T, -np.eye(H.shape[0]))
    except (np.linalg.LinAlgError, ValueError):
        return None
    P = 0.5 * (P + P.T)
    largest = float(np.abs(P).max(initial=0.0))
    return P / largest if np.isfinite(largest) and largest > 0.0 else None


def growing_witness(H: Ball, fine: Callable[[], Fine], rate: float) -> dict[str, FloatArray] | None:
    """P and a direction v that prove an eigenvalue of H to the right of ``-rate``; None where there are none.

    They may do so for a smaller rate, ``at``: an equation is singular where two eigenvalues add up to -2 rate. Where H
    is too far from normal, they are taken in the coordinates of a pair (see ``lyapunov_pair``).
    """
    true = -float(np.linalg.eigvals(H.middle).real.max(initial=-np.inf)) if _is_finite(H) else np.inf
    if not true < rate:
        return None
    levels = [min(true + share * (rate - true), rate) for share in _LEVELS]
    for level in levels:
        plain = _indefinite(H.middle, level)
        if plain is not None and grows(*plain, H, level):
            return {"P": plain[0], "growing": plain[1], "at": np.array([level])}
    exact = fine()
    pair = _climbed(exact, None)
    if pair is None:
        return None
    R, T = pair.arrays["R"], pair.arrays["T"]
    inner = between(R, exact, T).middle
    for level in levels:
        inside = _indefinite(inner, level)
        if inside is not None and _grows_between(R, T, *inside, exact, level):
            return {"R": R, "T": T, "P": inside[0], "growing": inside[1], "at": np.array([level])}
    return None


def _indefinite(H: FloatArray, rate: float) -> tuple[FloatArray, FloatArray] | None:
    P = lyapunov_solution(H, rate)
    return None if P is None else (P, np.asarray(np.linalg.eigh(P)[1][:, 0]))


def refutes(record: ClaimRecord, H: Ball, fine: Callable[[], Fine], rate: float) -> bool:
    """Prove again what ``growing_witness`` found."""
    shape = H.middle.shape
    P, v = witness(record, "P", shape), witness(record, "growing", shape[:1])
    level = witness(record, "at", (1,)).item()
    if not level <= rate:
        return False
    if "R" not in record.witness:
        return grows(P, v, H, level)
    return _grows_between(witness(record, "R", shape), witness(record, "T", shape), P, v, fine(), level)


def _grows_between(R: FloatArray, T: FloatArray, Q: FloatArray, v: FloatArray, H: Fine, rate: float) -> bool:
    """``grows`` for ``P = R' Q R``, negative along ``R^-1 v``."""
    return bool(np.array_equal(Q, Q.T)) and is_negative_along(Q, v) and decreases_between(R, T, Q, H, rate)


def grows(P: FloatArray, v: FloatArray, H: Ball, rate: float) -> bool:
    """Prove that every H of the ball has an eigenvalue with a real part above ``-rate``.

    ``P (H + rate I) + (H + rate I)' P < 0`` with ``v' P v < 0``: as many eigenvalues are on the right as P has negative
    ones (Lyapunov's inertia theorem). Source: theory 8-G5.
    """
    return bool(np.array_equal(P, P.T)) and is_negative_along(P, v) and decays(P, H, rate)


def _climbed(H: Fine, wanted: float | None) -> Pair | None:
    """Change the coordinates so that H decays in them at a small rate, from there at a larger one, and so on.

    One Lyapunov solution has the condition of the whole way, each step only that of its own; their product R is never
    squared. Only steps that are proved are taken.
    """
    R, best = np.eye(H.middle.shape[0]), None
    S = H.middle
    for _ in range(_CLIMBS):
        step = _next(H, R, S, best, wanted)
        if step is None:
            break
        gained = step.rate - (best.rate if best is not None else 0.0)
        best, R = step, step.arrays["R"]
        if gained < _WORTHWHILE * step.rate or (wanted is not None and best.rate >= wanted):
            break
        S = between(R, H, step.arrays["T"]).middle
    return best


def _next(H: Fine, R: FloatArray, S: FloatArray, best: Pair | None, wanted: float | None) -> Pair | None:
    """The next pair on the way: the largest share of what is left whose step can be solved and whose pair is proved."""
    goal, reached = -float(np.linalg.eigvals(S).real.max()), 0.0 if best is None else best.rate
    if wanted is not None and wanted < goal:
        goal = wanted + 0.5 * (goal - wanted)
    schur, basis = la.schur(S)
    for share in _CLIMB_SHARES if goal > reached else ():
        rate = reached + share * (goal - reached)
        factor = _factor(schur, basis, rate)
        pair = None if factor is None else _between(H, factor @ R, rate, wanted)
        if pair is not None:
            return pair
    return None


def _factor(schur: FloatArray, basis: FloatArray, rate: float) -> FloatArray | None:
    """F with ``F' F`` the Lyapunov solution of ``basis schur basis' + rate I``; None where that is ill-conditioned."""
    n = schur.shape[0]
    shifted = schur + rate * np.eye(n)
    (trsyl,) = la.get_lapack_funcs(("trsyl",), (schur,))
    solution, scale, _ = trsyl(shifted, shifted, -np.eye(n), trana="T")
    if not (scale > 0.0 and np.isfinite(solution).all()):
        return None
    values, vectors = np.linalg.eigh(0.5 * (solution + solution.T))
    if not 0.0 < values[-1] < _WORST_STEP * values[0]:
        return None
    return np.asarray((np.sqrt(values / values[-1])[:, None] * vectors.T) @ basis.T)


def _between(H: Fine, R: FloatArray, reached: float, wanted: float | None) -> Pair | None:
    """R with its inverse, if they prove the ``wanted`` rate or one just below the rate ``reached``."""
    R = np.asarray(R / np.abs(R).max())
    try:
        T = np.asarray(np.linalg.inv(R), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    rates = [wanted] if wanted is not None and reached > wanted else []
    rates += [(1.0 - share) * reached for share in _BELOW]
    found = next((rate for rate in rates if np.isfinite(T).all() and decays_between(R, T, H, rate)), None)
    return None if found is None else Pair(found, {"R": R, "T": T})
