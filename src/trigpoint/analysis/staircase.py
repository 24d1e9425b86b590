"""The unobservable subspace of one small pair (A, C) by an orthogonal staircase."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray

_STAIR = 1e-8  # about the root of eps: a direction seen more weakly would bring errors larger than this with it


def unobservable_basis(A: FloatArray, C: FloatArray) -> FloatArray:
    """Orthonormal basis (n, k) of ``{x : C A^j x = 0 for j = 0, 1, ...}``.

    With ``V_1`` spanning the rows of C, each stair adds what ``A' V_k`` shows beyond the directions already seen.

    Args:
        A: (n, n).
        C: (p, n); p = 0 allowed.

    We assume:
        * singular values below 1e-8 (relative to C in the first stair, to A in the others) count as not seen.

    Cost O(n^3 + p n^2). Source: 001-02.
    """
    n = A.shape[0]
    size = float(np.linalg.norm(A, 2)) or 1.0
    seen = np.zeros((n, 0))
    stair = _range(C.T / (float(np.linalg.norm(C, 2)) if C.any() else 1.0))
    while stair.shape[1]:
        seen = np.hstack([seen, stair])
        step = A.T @ stair / size
        for _ in range(2):
            step -= seen @ (seen.T @ step)
        stair = _range(step) if seen.shape[1] < n else np.zeros((n, 0))
    return np.asarray(la.qr(seen)[0][:, seen.shape[1] :]) if seen.shape[1] else np.eye(n)


def _range(columns: FloatArray) -> FloatArray:
    left, values, _ = la.svd(columns, full_matrices=False)
    return np.asarray(left[:, values > _STAIR])
