"""The positive left null vector of an irreducible Laplacian, without a subtraction."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray


def stationary_vector(rates: FloatArray) -> FloatArray:
    """Positive r (m,) with ``r' L = 0`` and mean 1, for ``L = diag(rates 1) - rates``.

    Args:
        rates: (m, m) nonnegative; the diagonal is not looked at.

    States are eliminated one after another, each sum taken from nonnegative terms (Grassmann, Taksar and Heyman 1985),
    so that every entry is right to a few units of rounding times m, however small it is.

    We assume:
        * the digraph of the positive entries is strongly connected.

    Cost O(m^3). Source: theory 4b-B1 (the left Perron vector).
    """
    m = rates.shape[0]
    work = np.array(rates, dtype=np.float64)
    np.fill_diagonal(work, 0.0)
    for last in range(m - 1, 0, -1):
        leaving = float(work[last, :last].sum())
        work[:last, last] /= leaving
        work[:last, :last] += np.outer(work[:last, last], work[last, :last])
    r = np.ones(m)
    for k in range(1, m):
        r[k] = r[:k] @ work[:k, k]
    return np.asarray(r / r.mean())
