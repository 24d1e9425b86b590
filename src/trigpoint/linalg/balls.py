"""Matrices known up to a radius: a computed middle and a bound of the error of every entry, rounding included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.linalg.verified import gam, is_positive_definite

_TERMS = 18
_FLOOR = 2.0**-1000


@dataclass(frozen=True, eq=False)
class Ball:
    """Every matrix M with ``|M - middle| <= radius``, entry by entry.

    Attributes:
        middle: (r, c) computed values.
        radius: (r, c) nonnegative.
    """

    middle: FloatArray
    radius: FloatArray

    @staticmethod
    def exact(matrix: FloatArray) -> Ball:
        """A stored matrix is what it is."""
        return Ball(matrix, np.zeros_like(matrix))

    def __add__(self, other: Ball) -> Ball:
        middle = self.middle + other.middle
        return Ball(middle, _outward(self.radius + other.radius + gam(1.0) * np.abs(middle)))

    def __matmul__(self, other: Ball) -> Ball:
        middle = self.middle @ other.middle
        mine, theirs = np.abs(self.middle), np.abs(other.middle)
        terms = self.middle.shape[1]
        spread = mine @ other.radius + self.radius @ (theirs + other.radius)
        radius = spread * (1.0 + float(gam(4.0 * terms + 8.0))) + gam(terms + 2.0) * (mine @ theirs)
        return Ball(middle, _outward(radius + terms * _FLOOR))

    def times(self, factor: float) -> Ball:
        """The ball times a stored number."""
        middle = factor * self.middle
        return Ball(middle, _outward(abs(factor) * self.radius + gam(1.0) * np.abs(middle)))

    def block(self, rows: slice, columns: slice) -> Ball:
        """A part of it."""
        return Ball(self.middle[rows, columns], self.radius[rows, columns])


def _outward(radius: FloatArray) -> FloatArray:
    return np.asarray(radius * (1.0 + 2.0**-48) + _FLOOR)


def transition_and_integral(matrix: Ball, duration: float) -> tuple[Ball, Ball]:
    """``e^{A h}`` and ``int_0^h e^{A s} ds`` for every A in the ball: Taylor with its remainder, then squarings.

    Args: ``matrix`` (n, n), ``duration`` h. The augmented matrix ``[[A, I], [0, 0]] h`` is scaled to a norm of at most
    1/2, where the 18 terms leave a remainder of ``2 (1/2)^19 / 19!``. Cost O(n^3).
    """
    n = matrix.middle.shape[0]
    middle, radius = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    middle[:n, :n], radius[:n, :n], middle[:n, n:] = matrix.middle, matrix.radius, np.eye(n)
    size = float((np.abs(middle) + radius).sum(axis=1).max()) * duration * (1.0 + 1e-12)
    halvings = max(0, int(np.ceil(np.log2(max(size, 1e-300)))) + 1)
    X = Ball(middle, radius).times(duration).times(2.0**-halvings)
    eye = Ball.exact(np.eye(2 * n))
    total = eye
    for k in range(_TERMS, 0, -1):  # Horner: I + X/1 (I + X/2 (I + ...))
        total = eye + _over(X @ total, k)
    remainder = 4.0 * 0.5 ** (_TERMS + 1) / float(np.prod(np.arange(1.0, _TERMS + 2)))
    total = Ball(total.middle, _outward(total.radius + remainder))
    for _ in range(halvings):
        total = total @ total
    return total.block(slice(0, n), slice(0, n)), total.block(slice(0, n), slice(n, 2 * n))


def _over(ball: Ball, divisor: int) -> Ball:
    middle = ball.middle / divisor
    return Ball(middle, _outward(ball.radius / divisor + gam(1.0) * np.abs(middle)))


def contracts(P: FloatArray, M: Ball, factor: float = 1.0) -> bool:
    """Prove ``factor^2 P - M' P M > 0`` for every M of the ball; P symmetric. False means *not proved*.

    Source: Stein's inequality; Rump (2006), key Rump2006.
    """
    image = Ball(M.middle.T, M.radius.T) @ (Ball.exact(P) @ M)
    rest = Ball.exact(P).times(factor * factor) + image.times(-1.0)
    middle = 0.5 * (rest.middle + rest.middle.T)
    radius = 0.5 * (rest.radius + rest.radius.T) + gam(2.0) * np.abs(middle) + 4e-16 * np.abs(P)
    return is_positive_definite(middle, _outward(radius))
