"""A decay rate that is proved: a Lyapunov matrix for the error of the programs as they are."""

from __future__ import annotations

import warnings

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.linalg.verified import gam, is_positive_definite

_SHARES = (0.999, 0.99, 0.95, 0.9, 0.75, 0.5, 0.2, 0.0)
_MARGINS = (1e-9, 1e-6, 1e-3, 0.1)


def proved_decay(H: FloatArray, spread: FloatArray) -> tuple[float, FloatArray] | None:
    """A rate a > 0 and P > 0 with ``P H + H' P + 2 a P < 0``, for every matrix within ``spread`` of H; or None.

    H is first balanced: states are scaled by powers of two, which rounds nothing and is undone in P. P solves the
    Lyapunov equation of ``H + s I`` for the shares s = 0.999, 0.99, ... of the computed abscissa until one can be
    used. The rate is the smallest generalized eigenvalue of ``-(P H + H' P) / 2`` and P, less a margin with
    which the inequality survives all rounding errors.

    We assume:
        * H and ``spread`` are (n, n); ``spread`` bounds the error of each entry of H.

    Cost O(n^3). Source: theory 8-G5; Rump (2006), key Rump2006.
    """
    abscissa = float(la.eigvals(H).real.max(initial=-np.inf))
    if not -np.inf < abscissa < 0.0:
        return None
    scale = _balance(H)
    H, spread = H * scale / scale[:, None], spread * scale / scale[:, None]
    for share in _SHARES:
        P = lyapunov_solution(H + share * -abscissa * np.eye(H.shape[0]))
        if P is None or not is_positive_definite(P):
            continue
        P = P / float(np.abs(P).max())
        rate = 0.5 * float(la.eigh(-_motion(P, H), P, eigvals_only=True, subset_by_index=(0, 0))[0])
        for margin in _MARGINS:
            if rate > 0.0 and _decreases(P, H, spread, rate * (1.0 - margin)):
                return rate * (1.0 - margin), P / scale / scale[:, None]
    return None


def _balance(H: FloatArray) -> FloatArray:
    """Powers of two d for which rows and columns of ``d^{-1} H d`` are of like size."""
    with np.errstate(all="ignore"):
        scale = np.asarray(la.matrix_balance(H, permute=False, separate=True)[1][0], dtype=np.float64)
    exact = np.isfinite(scale) & (scale > 0.0) & (np.frexp(scale)[0] == 0.5)
    return scale if exact.all() else np.ones(H.shape[0])


def lyapunov_solution(H: FloatArray, Q: FloatArray | None = None) -> FloatArray | None:
    """Symmetric P with ``H' P + P H = -Q`` (Q = I unless given); None where rounding leaves nothing to use."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # SciPy's way to say that the equation is singular
            P = la.solve_continuous_lyapunov(H.T, -np.eye(H.shape[0]) if Q is None else -Q)
    except (np.linalg.LinAlgError, ValueError, RuntimeWarning):
        return None
    return np.asarray(0.5 * (P + P.T)) if np.isfinite(P).all() else None


def _motion(P: FloatArray, H: FloatArray) -> FloatArray:
    product = P @ H
    return np.asarray(product + product.T)


def _decreases(P: FloatArray, H: FloatArray, spread: FloatArray, rate: float) -> bool:
    """Prove the inequality with every rounding error counted."""
    decrease = -_motion(P, H) - 2.0 * rate * P
    rounding = gam(8.0 * P.shape[0] + 64.0) * (np.abs(P) @ np.abs(H) + rate * np.abs(P))
    radius = (rounding + np.abs(P) @ spread) * (1.0 + float(gam(P.shape[0] + 64.0)))
    return is_positive_definite(0.5 * (decrease + decrease.T), radius + radius.T)
