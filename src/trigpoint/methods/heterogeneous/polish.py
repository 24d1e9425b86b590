"""A structured gain made quiet: the least steady variance that descent finds from a stabilising one."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import BoolArray, FloatArray
from trigpoint.methods.heterogeneous.abscissa import filled, minimise_nonsmooth
from trigpoint.methods.heterogeneous.proof import lyapunov_solution

_STEPS = 100


def quiet_gain(A: FloatArray, C: FloatArray, mask: BoolArray, start: FloatArray) -> FloatArray:
    """Descend on ``trace W``, ``H W + W H' + I + L L' = 0`` and ``H = A + L C``, over L with zeros outside ``mask``.

    W is the steady covariance of the error under process and measurement noise of unit intensity, so that for a full
    mask the minimum is the Kalman filter. Gains that stabilise but amplify, as a search may leave them, come down by
    orders of magnitude. With ``H' X + X H + I = 0`` the gradient is ``2 X (W C' + L)``.

    Args:
        A: (n, n), of norm about 1.
        C: (p, n), rows of norm about 1.
        mask: (n, p) where L may have entries.
        start: (n, p) with A + start C Hurwitz; it comes back where rounding leaves no equation to solve.

    Cost O(n^3) for each of up to 100 steps. Source: G16, Section 4; 000-21.
    """

    def objective(entries: FloatArray) -> tuple[float, FloatArray]:
        L = filled(mask, entries)
        H = A + L @ C
        wall = np.inf, np.zeros(entries.shape)
        if not np.isfinite(H).all() or np.linalg.eigvals(H).real.max() >= 0.0:
            return wall
        W, X = lyapunov_solution(H.T, np.eye(A.shape[0]) + L @ L.T), lyapunov_solution(H)
        if W is None or X is None or not np.trace(W) > 0.0:
            return wall
        slope = 2.0 * X @ (W @ C.T + L) / np.trace(W)
        return float(np.log(np.trace(W))), slope[mask]

    return filled(mask, minimise_nonsmooth(objective, start[mask], -np.inf, _STEPS)[0])
