"""Entries of the inverse of a sparse positive definite matrix inside the pattern of its factor (Takahashi's method)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.linalg.sparse import Factorization

_CHUNK_ENTRIES = 20_000_000
_BY_SOLVES = 1500
"""Up to this many unknowns, solving for all columns is faster than selected inversion."""


@dataclass(frozen=True, eq=False)
class SelectedInverse:
    """The inverse on the pattern of ``L + L'``, in the factor's own order.

    Attributes:
        place: (n,) position of each row of the matrix in the factor's order.
        start, rows: the pattern of the unit lower triangular factor, column by column, rows ascending.
        below: values of the inverse on that pattern (the diagonal included).
    """

    place: IntArray
    start: IntArray
    rows: IntArray
    below: FloatArray

    def entries(self, first: IntArray, second: IntArray) -> FloatArray | None:
        """``(A^-1)[first[k], second[k]]`` for positions in the pattern; None when one of them is not."""
        a, b = self.place[first], self.place[second]
        column, row = np.minimum(a, b), np.maximum(a, b)
        n = np.int64(self.place.shape[0])
        keys = np.repeat(np.arange(n), np.diff(self.start)) * n + self.rows
        wanted = column * n + row
        found = np.minimum(np.searchsorted(keys, wanted), keys.shape[0] - 1)
        return self.below[found] if np.array_equal(keys[found], wanted) else None


def entries_of_inverse(factor: Factorization, count: int, rows: IntArray, columns: IntArray) -> FloatArray:
    """``(A^-1)[rows[k], columns[k]]`` of a factored matrix with ``count`` rows.

    Above 1500 rows by selected inversion, where the entries lie in the pattern of the factor; else by solving for the
    needed columns in chunks of 20 million numbers.
    """
    if count > _BY_SOLVES and isinstance(factor, SuperLU):
        inverse = selected_inverse(factor)
        found = None if inverse is None else inverse.entries(rows, columns)
        if found is not None:
            return found
    return _by_solves(factor, count, rows, columns)


def _by_solves(factor: Factorization, count: int, rows: IntArray, columns: IntArray) -> FloatArray:
    entries = np.zeros(rows.shape[0])
    order = np.argsort(columns, kind="stable")
    width = max(1, _CHUNK_ENTRIES // max(count, 1))
    for start in range(0, count, width):
        stop = min(start + width, count)
        here = order[slice(*np.searchsorted(columns[order], [start, stop]))]
        if not here.size:
            continue
        unit = np.zeros((count, stop - start))
        unit[np.arange(start, stop), np.arange(stop - start)] = 1.0
        block = factor.solve(unit)
        entries[here] = block[rows[here], columns[here] - start]
    return entries


def selected_inverse(factor: SuperLU) -> SelectedInverse | None:
    """Compute the inverse on the pattern of the factor, exactly up to rounding; None where the method does not apply.

    With ``P A P' = L D L'`` and S the rows below the diagonal in column j of L, going from the last column to the
    first: ``Z_Sj = -Z_SS l_S`` and ``Z_jj = 1/d_j - l_S' Z_Sj``. Cost: the sum over columns of |S|^2, with one Python
    step an entry of L.

    We assume:
        * the matrix is symmetric and was factored with diagonal pivots (checked), without dropping entries (checked).

    Source: Takahashi, Fagan, Chen (1973), key Takahashi1973.
    """
    if not np.array_equal(factor.perm_r, factor.perm_c):
        return None
    lower = sp.csc_array(factor.L)
    lower.sort_indices()
    start, rows, entries = lower.indptr.astype(np.int64), lower.indices.astype(np.int64), lower.data
    n = lower.shape[0]
    if not np.array_equal(rows[start[:-1]], np.arange(n)):
        return None
    pivots = factor.U.diagonal()
    below = np.zeros_like(entries)
    for j in range(n - 1, -1, -1):
        first, last = start[j] + 1, start[j + 1]
        support = rows[first:last]
        if not support.size:
            below[start[j]] = 1.0 / pivots[j]
            continue
        block = _dense_block(support, start, rows, below)
        if block is None:
            return None
        column = -(block @ entries[first:last])
        below[first:last] = column
        below[start[j]] = 1.0 / pivots[j] - float(entries[first:last] @ column)
    return SelectedInverse(factor.perm_c.astype(np.int64), start, rows, below)


def _dense_block(support: IntArray, start: IntArray, rows: IntArray, below: FloatArray) -> FloatArray | None:
    """``Z_SS`` from the columns computed before; None when a needed position is missing from the pattern."""
    size = support.shape[0]
    block = np.zeros((size, size))
    for k in range(size):
        low, high = start[support[k]], start[support[k] + 1]
        there = low + np.searchsorted(rows[low:high], support[k:])
        if there[-1] >= high or not np.array_equal(rows[there], support[k:]):
            return None
        block[k:, k] = below[there]
    return np.asarray(block + np.tril(block, -1).T)
