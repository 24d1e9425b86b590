"""Matrix functions of a sparse symmetric matrix by Chebyshev series: products only, no factorization.

``F(M) b`` for functions F of one number with small matrices as values: ``sum_k u_k (x) F(lambda_k) (u_k' b)``, with
``F(x) = sum_j C_j T_j(2 x / ceiling - 1)`` the sum is ``sum_j C_j (T_j b)``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.sparse as sp

from trigpoint.arrays import FloatArray

_FIRST = 32
_BUFFER = 2**24  # numbers in the buffer of one block product

Function = Callable[[FloatArray], FloatArray]
"""(k,) points to (k, q, n) values."""


@dataclass(frozen=True, eq=False)
class Series:
    """A function as ``sum_j coefficients[j] T_j`` over ``[0, ceiling]``.

    Attributes:
        coefficients: (degree + 1, q, n).
        tail: sum of the 2-norms of the coefficients left out; with a rounding floor. ``|F(M) b|`` is right to
            ``tail |b|`` (Frobenius norms), as far as twice as many samples tell.
    """

    coefficients: FloatArray
    tail: float

    @property
    def degree(self) -> int:
        """Number of products with the matrix."""
        return int(self.coefficients.shape[0]) - 1


def series(function: Function, ceiling: float, tolerance: float, limit: int) -> Series | None:
    """The shortest series of ``function`` on ``[0, ceiling]`` with a tail below ``tolerance`` (or rounding).

    None where its degree would be above ``limit``. Samples at ``d + 1`` Chebyshev points with d doubled until the upper
    half of the coefficients is below the
    tolerance. Cost: 2 limit evaluations at most. Source: Trefethen 2013, key Trefethen2013.
    """
    degree = _FIRST
    while degree <= 2 * limit:
        # The square of a sine: points near 0, where functions are steep, keep their relative accuracy.
        values = function(ceiling * np.sin(0.5 * np.pi * np.arange(degree, -1, -1) / degree) ** 2)
        coefficients = scipy.fft.dct(values, type=1, axis=0) / degree
        coefficients[[0, -1]] *= 0.5
        sizes = np.linalg.norm(coefficients, axis=(1, 2))
        tails = np.append(np.cumsum(sizes[::-1])[::-1][1:], 0.0)
        floor = np.finfo(float).eps * (degree + 1.0) * float(sizes.max())
        goal = max(tolerance, floor)
        if tails[degree // 2] < goal:
            last = int(np.argmax(tails < goal))
            return None if last > limit else Series(coefficients[: last + 1], float(tails[last]) + floor)
        degree *= 2
    return None


def applied(matrix: sp.csr_array, ceiling: float, start: FloatArray, several: list[Series]) -> list[FloatArray]:
    """``F(matrix) start`` (N, q) for each of ``several`` series, from one recurrence of products.

    Args:
        matrix: (N, N) sparse symmetric, spectrum within ``[0, ceiling]``.
        ceiling: an upper bound of the spectrum, positive.
        start: (N, n).

    Cost: n products a degree of the longest series; memory N (3 n + T q) numbers and a buffer.
    """
    order = sorted(range(len(several)), key=lambda k: -several[k].degree)
    ordered = [several[k] for k in order]
    twice = (4.0 / ceiling) * matrix
    n, size = start.shape[1], start.shape[0]
    width = max(1, min(32, _BUFFER // max(1, n * size)))
    sums = np.zeros((sum(one.coefficients.shape[1] for one in ordered), size))
    buffer = np.empty((width, n, size))
    now, before = np.ascontiguousarray(start.T), np.zeros((n, size))
    first = 0
    for j in range(ordered[0].degree + 1):
        buffer[j - first] = now
        if j - first + 1 == width or j == ordered[0].degree:
            _add(sums, ordered, buffer[: j - first + 1], first)
            first = j + 1
        ahead = np.stack([twice @ row for row in now])
        ahead -= 2.0 * now
        if j == 0:
            ahead *= 0.5
        ahead -= before
        before, now = now, ahead
    rows, found = 0, {}
    for k, one in zip(order, ordered, strict=True):
        q = one.coefficients.shape[1]
        found[k] = np.ascontiguousarray(sums[rows : rows + q].T)
        rows += q
    return [found[k] for k in range(len(several))]


def _add(sums: FloatArray, ordered: list[Series], block: FloatArray, first: int) -> None:
    """Add the terms ``first`` and on, of the series that are long enough: they stand in front."""
    count, n, size = block.shape
    parts = []
    for one in ordered:
        if one.degree < first:
            break
        given = one.coefficients[first : first + count]
        padded = np.zeros((count, *given.shape[1:]))
        padded[: given.shape[0]] = given
        parts.append(padded.transpose(1, 0, 2).reshape(given.shape[1], count * n))
    rows = np.concatenate(parts)
    sums[: rows.shape[0]] += rows @ block.reshape(count * n, size)
