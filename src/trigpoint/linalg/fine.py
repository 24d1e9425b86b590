"""Matrices known to about twice the digits of a float: two floats and a radius an entry, products without rounding.

A float is cut into slices of few bits: products of slices, and their sums, are whole numbers below 2^53 times a power
of two, which every BLAS adds without rounding, in any order. Source: Ozaki2012.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.linalg.balls import Ball, is_positive
from trigpoint.linalg.verified import gam

_SLICES = 4
_FLOOR = 2.0**-1000
_WIDEST = 300  # exponents beyond it might let a slice under- or overflow
_OUTWARD = 1.0 + 2.0**-40


@dataclass(frozen=True, eq=False)
class Fine:
    """Every matrix M with ``|M - middle - low| <= radius``, entry by entry.

    Attributes:
        middle: (r, c) computed values.
        low: (r, c) what rounding took from them, as far as it is known.
        radius: (r, c) nonnegative bounds of the rest.
    """

    middle: FloatArray
    low: FloatArray
    radius: FloatArray

    @staticmethod
    def of(ball: Ball) -> Fine:
        """A ball is what it is."""
        return Fine(ball.middle, np.zeros_like(ball.middle), ball.radius)

    @staticmethod
    def zero(rows: int, columns: int) -> Fine:
        """The zero matrix, exactly."""
        return Fine(np.zeros((rows, columns)), np.zeros((rows, columns)), np.zeros((rows, columns)))

    def ball(self) -> Ball:
        """The same without the low part."""
        return Ball(self.middle, (np.abs(self.low) + self.radius) * _OUTWARD)

    def __neg__(self) -> Fine:
        return Fine(-self.middle, -self.low, self.radius)

    @np.errstate(over="ignore", invalid="ignore")
    def __add__(self, other: Fine) -> Fine:
        middle, lost = _two_sum(self.middle, other.middle)
        lows = (self.low, other.low, lost)
        low = lows[0] + lows[1] + lows[2]
        rounded = gam(4.0) * (np.abs(lows[0]) + np.abs(lows[1]) + np.abs(lows[2]))
        return Fine(middle, low, (self.radius + other.radius + rounded) * _OUTWARD)

    def block(self, rows: slice, columns: slice) -> Fine:
        """A part of it."""
        return Fine(self.middle[rows, columns], self.low[rows, columns], self.radius[rows, columns])


@np.errstate(over="ignore", invalid="ignore")
def product(A: FloatArray, B: FloatArray) -> Fine:
    """``A B`` of stored matrices (r, n) and (n, c), to some 88 bits of ``n max |a_i| max |b_j|``.

    Cost: sixteen products of that size.
    """
    terms = A.shape[1]
    if not (_is_moderate(A) and _is_moderate(B)):
        return Fine.of(Ball.exact(A) @ Ball.exact(B))
    bits = (53 - int(np.ceil(np.log2(max(terms, 2))))) // 2
    left, rows = _slices(A, bits, 1)
    right, columns = _slices(B, bits, 0)
    total = Fine.zero(A.shape[0], B.shape[1])
    for k in range(2 * _SLICES - 2, -1, -1):  # the smallest ones first
        for i in range(max(0, k - _SLICES + 1), min(k, _SLICES - 1) + 1):
            part = left[i] @ right[k - i]
            total = total + Fine(part, np.zeros_like(part), np.zeros_like(part))
    # What is left of a row of A is below max |a_i| 2^-(4 bits); so for the columns of B, and for both together.
    rest = 3.0 * terms * 2.0 ** (-_SLICES * bits) * rows * columns
    return Fine(total.middle, total.low, total.radius + rest * _OUTWARD)


@np.errstate(over="ignore", invalid="ignore")
def between(R: FloatArray, H: Fine, T: FloatArray) -> Fine:
    """``R H T`` for stored R and T."""
    r, t = np.abs(R), np.abs(T)
    inner = product(H.middle, T) + Fine.of(Ball.exact(H.low) @ Ball.exact(T))
    outer = product(R, inner.middle) + Fine.of(Ball.exact(R) @ Ball.exact(inner.low))
    unknown = (r @ inner.radius + r @ (H.radius @ t)) * (1.0 + float(gam(4.0 * R.shape[0] + 16.0)))
    return Fine(outer.middle, outer.low, (outer.radius + unknown + _FLOOR) * _OUTWARD)


def decays_between(R: FloatArray, T: FloatArray, H: Fine, rate: float) -> bool:
    """Prove ``P H + H' P + 2 rate P < 0`` and P > 0 for ``P = R' R``, P itself never being formed.

    ``T' (P H + H' P + 2 rate P) T = G' S + S' G + 2 rate G' G`` with ``G = R T`` and ``S = R H T``. Negative definite,
    it makes T injective, hence the inequality itself true. ``G' G > 0`` makes R injective, hence P > 0. Where R and T
    are nearly inverse, P may have the condition 1e25: numbers near 1 are compared.

    Args: ``R`` and ``T`` any (n, n), ``H`` (n, n). Source: congruence; Rump (2006), key Rump2006.
    """
    return decreases_between(R, T, np.eye(R.shape[0]), H, rate)


def decreases_between(R: FloatArray, T: FloatArray, Q: FloatArray, H: Fine, rate: float) -> bool:
    """Prove ``P H + H' P + 2 rate P < 0`` for ``P = R' Q R``, and that R has an inverse; Q symmetric, of either sign.

    Args: ``R``, ``T``, ``H`` as in ``decays_between``, ``Q`` (n, n).
    """
    G, S, middle = product(R, T).ball(), between(R, H, T).ball(), Ball.exact(Q)
    square, drift = G.T @ (middle @ G), G.T @ (middle @ S)
    return is_positive(G.T @ G) and is_positive(-(drift + drift.T) - square.times(2.0 * rate))


def _two_sum(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rounded sum, and exactly what rounding took (Knuth's). Source: Ozaki2012."""
    total = a + b
    virtual = total - a
    return total, np.asarray((a - (total - virtual)) + (b - virtual))


def _is_moderate(matrix: FloatArray) -> bool:
    size = np.abs(matrix[matrix != 0.0])
    return bool(np.isfinite(matrix).all() and (not size.size or (size.max() < 2.0**_WIDEST)))


def _slices(matrix: FloatArray, bits: int, axis: int) -> tuple[list[FloatArray], FloatArray]:
    """Slices of ``bits`` bits below the largest entry of each row (axis 1) or column (axis 0), and that power of two.

    Multiples of ``grid`` of at most ``2^bits grid`` each; their sum differs from the matrix by less than the last grid.
    """
    largest = np.abs(matrix).max(axis=axis, keepdims=True, initial=0.0)
    top = np.ldexp(1.0, np.maximum(np.frexp(largest)[1], -_WIDEST))
    parts, rest, grid = [], matrix, top
    for _ in range(_SLICES):
        grid = grid * 2.0**-bits
        part = np.rint(rest / grid) * grid
        parts.append(part)
        rest = rest - part
    return parts, np.asarray(top)
