"""Is ``M_0 + s M_1`` a contraction for every s of an interval? Proved piece by piece, or left undecided."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.linalg.balls import Ball, contracts, is_negative_along
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.verified import is_positive_definite

_DEPTH = 60
_PIECES = 4000


@dataclass(frozen=True, eq=False)
class IntervalVerdict:
    """Whether the spectral radius is below 1 on the whole interval.

    Attributes:
        stable: True (proved), False (a point with a radius above 1 was proved) or None (neither).
        radius: largest computed spectral radius seen.
        at: where it was seen.
        pieces: subintervals used by the proof.
        edges: (m + 1,) ends of the pieces, where it was proved; empty otherwise.
        P: (m, n, n) the matrix of each piece.
    """

    stable: bool | None
    radius: float
    at: float
    pieces: int
    edges: FloatArray = field(default_factory=lambda: np.zeros(0))
    P: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))


def contraction_on_interval(M0: Ball, M1: Ball, low: float, high: float) -> IntervalVerdict:
    """Decide whether every ``M(s) = M0 + s M1`` with ``low <= s <= high`` has spectral radius below 1.

    For a fixed P > 0 the matrix ``M(s)' P M(s) - P`` is convex in s, so that its being negative definite at both ends
    of a piece proves the piece. P solves the Lyapunov equation of the piece's middle; pieces are halved until each is
    proved, a point with radius above 1 is met, or there are too many.

    Args:
        M0, M1: (n, n), known up to their rounding errors.
        low, high: ends of the interval.

    Cost: O(n^3) a piece. Source: convexity; Rump2006 for the definiteness.
    """
    samples = np.linspace(low, high, 65)
    radii = [_radius(M0.middle + s * M1.middle) for s in samples]
    worst = int(np.argmax(radii))
    radius, at = float(radii[worst]), float(samples[worst])
    if radius >= 1.0:
        return IntervalVerdict(False if expands(M0 + M1.times(at)) else None, radius, at, 0)
    waiting, pieces, proved = [(low, high, 0)], 0, []
    while waiting:
        left, right, depth = waiting.pop()
        pieces += 1
        if pieces > _PIECES or depth > _DEPTH:
            return IntervalVerdict(None, radius, at, pieces)
        middle = 0.5 * (left + right)
        here = _radius(M0.middle + middle * M1.middle)
        if here > radius:
            radius, at = here, middle
        if here >= 1.0:
            return IntervalVerdict(False if expands(M0 + M1.times(middle)) else None, radius, at, pieces)
        P = _lyapunov(M0.middle + middle * M1.middle)
        if P is not None and all(contracts(P, M0 + M1.times(s)) for s in (left, right)):
            proved.append((right, P))
            continue
        waiting += [(middle, right, depth + 1), (left, middle, depth + 1)]  # the left one is taken first
    edges = np.array([low, *(right for right, _ in proved)])
    return IntervalVerdict(True, radius, at, pieces, edges, np.stack([P for _, P in proved]))


def expands(M: Ball) -> bool:
    """Prove that every matrix of the ball has a spectral radius above 1; False means *not proved*.

    ``P - M' P M > 0`` with ``v' P v < 0``: no eigenvalue has modulus 1, and were all inside the circle, P would be the
    sum of ``M'^k (P - M' P M) M^k``, hence positive. By Stein's inertia theorem.
    """
    n = M.middle.shape[0]
    try:
        with near_singular_allowed():
            P = la.solve_discrete_lyapunov(M.middle.T, np.eye(n))
    except (np.linalg.LinAlgError, ValueError):
        return False
    P = 0.5 * (P + P.T)
    if not np.isfinite(P).all():
        return False
    P = P / (float(np.abs(P).max(initial=0.0)) or 1.0)
    return is_negative_along(P, np.linalg.eigh(P)[1][:, 0]) and contracts(P, M)


def _radius(M: FloatArray) -> float:
    return float(np.abs(np.linalg.eigvals(M)).max(initial=0.0))


def _lyapunov(M: FloatArray) -> FloatArray | None:
    try:
        P = la.solve_discrete_lyapunov(M.T, np.eye(M.shape[0]))
    except (np.linalg.LinAlgError, ValueError):
        return None
    P = 0.5 * (P + P.T)
    return P if is_positive_definite(P) else None
