"""Observability and detectability of one small pair (A, C), decided with a margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from scipy.optimize import minimize

from trigpoint.arrays import FloatArray

_UNOBSERVABLE = 1e-12
_OBSERVABLE = 1e-9
_SUSPICIOUS = 1e-3
_NEWTON_STEPS = 20


@dataclass(frozen=True, eq=False)
class PairMargin:
    """Distance of a pair (A, C) from an unobservable one, relative to the size of (A, C).

    Attributes:
        margin: ``min_s sigma_min([s I - A; C]) / ||(A, C)||`` over the modes considered.
        mode: the complex s where it is attained.
        direction: (n,) complex unit vector that the outputs see least at that mode.
        verdict: True (margin clearly positive), False (zero to rounding), None (cannot be decided).
    """

    margin: float
    mode: complex
    direction: np.ndarray
    verdict: bool | None


def pair_margin(A: FloatArray, C: FloatArray, *, unstable_only: bool = False, size: float = 0.0) -> PairMargin:
    """Decide observability (or detectability, with ``unstable_only``) of a small pair by the refined PBH margin.

    The value of sigma_min at a computed eigenvalue misleads inside Jordan blocks, since the eigenvalue itself is only
    known to eps^(1/size); so it is minimized over complex s near each computed eigenvalue.

    The margin is relative to the norm of (A, C), or to ``size`` where that is larger: a part cut out of a larger system
    carries that system's rounding errors, and may itself be all rounding.

    We assume:
        * A is (n, n), C is (p, n), n small (dense SVDs are taken).

    Verdict: True above 1e-9 relative, False below 1e-12, None between. Cost O(n^4).
    Source: R23, Theorem 6 with s complex (E-001-1); theory 001-05.
    """
    size = max(float(np.linalg.norm(np.vstack([A, C]), 2)), size) or 1.0
    best = PairMargin(np.inf, 0j, np.zeros(A.shape[0], dtype=complex), True)
    for eigenvalue in np.linalg.eigvals(A):
        s, value = _refined(A, C, complex(eigenvalue), size)
        if unstable_only and s.real < -1e-9 * size:
            continue
        if value / size < best.margin:
            direction = la.svd(_pencil(A, C, s))[2][-1].conj()
            best = PairMargin(value / size, s, direction, None)
    if best.margin <= _UNOBSERVABLE:
        verdict: bool | None = False
    else:
        verdict = True if best.margin >= _OBSERVABLE else None
    return PairMargin(best.margin, best.mode, best.direction, verdict)


def _pencil(A: FloatArray, C: FloatArray, s: complex) -> np.ndarray:
    return np.vstack([s * np.eye(A.shape[0]) - A, C])


def _refined(A: FloatArray, C: FloatArray, start: complex, size: float) -> tuple[complex, float]:
    """Local minimum of sigma_min over s, from a computed eigenvalue: Newton steps, then a simplex where they stall."""
    s, value = _newton(A, C, start)
    if _UNOBSERVABLE * size < value < _SUSPICIOUS * size:
        found = minimize(
            lambda point: float(la.svdvals(_pencil(A, C, complex(point[0], point[1])))[-1]),
            [s.real, s.imag],
            method="Nelder-Mead",
            options={
                "xatol": 1e-17 * size,
                "fatol": 1e-18 * size,
                "maxiter": 400,
                "initial_simplex": _simplex(s, size),
            },
        )
        if found.fun < value:
            return complex(found.x[0], found.x[1]), float(found.fun)
    return s, value


def _newton(A: FloatArray, C: FloatArray, start: complex) -> tuple[complex, float]:
    """Towards a zero of sigma_min: with singular vectors u, v it changes by ``Re(u_1' v ds)``, u_1 the first n of u.

    A step is kept while it lowers the value, so that a minimum that is not zero stops it at once.
    """
    n = A.shape[0]
    s, (left, values, right) = start, la.svd(_pencil(A, C, start), full_matrices=False)
    for _ in range(_NEWTON_STEPS):
        slope = left[:n, -1].conj() @ right[-1].conj()
        if values[-1] == 0.0 or abs(slope) == 0.0:
            break
        trial = s - values[-1] / slope
        candidate = la.svd(_pencil(A, C, trial), full_matrices=False)
        if not candidate[1][-1] < 0.5 * values[-1]:
            break
        s, (left, values, right) = trial, candidate
    return s, float(values[-1])


def _simplex(start: complex, size: float) -> FloatArray:
    step = 1e-4 * size
    return np.array([[start.real, start.imag], [start.real + step, start.imag], [start.real, start.imag + step]])
