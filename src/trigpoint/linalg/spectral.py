"""Smallest eigenpair of a sparse symmetric positive definite matrix."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from trigpoint.arrays import FloatArray
from trigpoint.linalg.sparse import factorize

DENSE_LIMIT = 500
"""Below this size a dense eigensolver is faster than any sparse one."""


def smallest_eigenpair(matrix: sp.sparray) -> tuple[float, FloatArray]:
    """Smallest eigenvalue and a unit eigenvector of a symmetric positive definite matrix.

    Dense up to 500 rows, above by Lanczos on the inverse (one sparse factorization). The sign is chosen so that the
    entries sum to something positive. Deterministic: the start vector is positive and irregular.
    """
    n = matrix.shape[0]
    if n <= DENSE_LIMIT:
        values, vectors = la.eigh(matrix.toarray(), subset_by_index=(0, 0))
        vector: FloatArray = vectors[:, 0]
        value = float(values[0])
    else:
        value, vector = _inverse_lanczos(sp.csc_array(matrix))
    return value, vector if vector.sum() >= 0 else -vector


def _inverse_lanczos(matrix: sp.csc_array) -> tuple[float, FloatArray]:
    n = matrix.shape[0]
    inverse = LinearOperator((n, n), matvec=factorize(matrix).solve, dtype=np.float64)
    try:
        values, vectors = eigsh(matrix, k=1, sigma=0.0, OPinv=inverse, v0=_start(n), which="LM", tol=0.0, maxiter=500)
    except ArpackNoConvergence as error:
        # A value without full convergence is still a value: the caller's rigorous bounds say how good it is.
        vector = _inverse_iteration(inverse, error.eigenvectors[:, 0] if error.eigenvectors.size else _start(n))
        return float(vector @ (matrix @ vector)), vector
    return float(values[0]), vectors[:, 0]


def _start(n: int) -> FloatArray:
    """A positive vector without any regularity: not orthogonal to a ground state, of weight blocks either."""
    return 1.0 + 0.5 * np.cos(np.arange(n, dtype=np.float64) ** 2)


def _inverse_iteration(inverse: LinearOperator, start: FloatArray, steps: int = 50) -> FloatArray:
    vector = start / np.linalg.norm(start)
    for _ in range(steps):
        vector = inverse @ vector
        vector /= np.linalg.norm(vector)
    return vector
