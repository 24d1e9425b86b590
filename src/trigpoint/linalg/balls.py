"""Matrices known up to a radius: a computed middle and a bound of the error of every entry, rounding included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.linalg.verified import gam, is_positive_definite

_TERMS = 18
_FLOOR = 2.0**-1000
_LARGEST = 1e12


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

    @property
    def T(self) -> Ball:
        """Transposed."""
        return Ball(self.middle.T, self.radius.T)

    def __neg__(self) -> Ball:
        return Ball(-self.middle, self.radius)

    @np.errstate(over="ignore", invalid="ignore")
    def __add__(self, other: Ball) -> Ball:
        middle = self.middle + other.middle
        return Ball(middle, _outward(self.radius + other.radius + gam(1.0) * np.abs(middle)))

    def __sub__(self, other: Ball) -> Ball:
        return self + (-other)

    @np.errstate(over="ignore", invalid="ignore")
    def __matmul__(self, other: Ball) -> Ball:
        middle = self.middle @ other.middle
        mine, theirs = np.abs(self.middle), np.abs(other.middle)
        terms = self.middle.shape[1]
        spread = mine @ other.radius + self.radius @ (theirs + other.radius)
        radius = spread * (1.0 + float(gam(4.0 * terms + 8.0))) + gam(terms + 2.0) * (mine @ theirs)
        return Ball(middle, _outward(radius + terms * _FLOOR))

    @np.errstate(over="ignore", invalid="ignore")
    def times(self, factor: float) -> Ball:
        """The ball times a stored number."""
        middle = factor * self.middle
        return Ball(middle, _outward(abs(factor) * self.radius + gam(1.0) * np.abs(middle)))

    @np.errstate(over="ignore", invalid="ignore")
    def kron(self, other: Ball) -> Ball:
        """The Kronecker product."""
        middle = np.asarray(np.kron(self.middle, other.middle), dtype=np.float64)
        theirs = np.abs(other.middle) + other.radius
        radius = np.kron(np.abs(self.middle), other.radius) + np.kron(self.radius, theirs) + gam(1.0) * np.abs(middle)
        return Ball(middle, _outward(radius))

    def block(self, rows: slice, columns: slice) -> Ball:
        """A part of it."""
        return Ball(self.middle[rows, columns], self.radius[rows, columns])


def _outward(radius: FloatArray) -> FloatArray:
    return np.asarray(radius * (1.0 + 2.0**-48) + _FLOOR)


def transition_and_integral(matrix: Ball, duration: float) -> tuple[Ball, Ball]:
    """``e^{A h}`` and ``int_0^h e^{A s} ds`` for every A in the ball: Taylor with its remainder, then squarings.

    Args: ``matrix`` (n, n), ``duration`` h. The augmented matrix ``[[A, I], [0, 0]] h`` is scaled to a norm of at most
    1/2, where the 18 terms leave a remainder of ``2 (1/2)^19 / 19!``. A norm above 1e12 gives infinite radii.
    Cost O(n^3).
    """
    n = matrix.middle.shape[0]
    middle, radius = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    middle[:n, :n], radius[:n, :n], middle[:n, n:] = matrix.middle, matrix.radius, np.eye(n)
    with np.errstate(over="ignore", invalid="ignore"):
        size = float((np.abs(middle) + radius).sum(axis=1).max()) * duration * (1.0 + 1e-12)
    if not size < _LARGEST:  # the squarings would lose every digit: nothing is known
        unknown = Ball(np.zeros((n, n)), np.full((n, n), np.inf))
        return unknown, unknown
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


def stacked(rows: list[list[Ball]]) -> Ball:
    """Balls put together as the blocks of one."""
    middles, radii = ([[getattr(ball, part) for ball in row] for row in rows] for part in ("middle", "radius"))
    return Ball(np.block(middles), np.block(radii))


def is_positive(ball: Ball) -> bool:
    """Prove that every symmetric matrix of a square ``ball`` is positive definite; False means *not proved*.

    Source: Rump (2006), key Rump2006.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        middle = 0.5 * (ball.middle + ball.middle.T)
        radius = _outward(0.5 * (ball.radius + ball.radius.T) + gam(2.0) * np.abs(middle))
    return is_positive_definite(middle, radius)


def contracts(P: FloatArray, M: Ball, factor: float = 1.0) -> bool:
    """Prove ``factor^2 P - M' P M > 0`` for every M of the ball; P symmetric. False means *not proved*.

    Source: Stein's inequality; Rump (2006), key Rump2006.
    """
    return is_positive(Ball.exact(P).times(factor).times(factor) - M.T @ (Ball.exact(P) @ M))


def decays(P: FloatArray, F: Ball, rate: float) -> bool:
    """Prove ``P F + F' P + 2 rate P < 0`` for every F of the ball; P symmetric, of either sign. False: *not proved*.

    Source: Lyapunov's inequality; theory 8-G5; Rump (2006), key Rump2006.
    """
    drift = Ball.exact(P) @ F
    return is_positive(-(drift + drift.T) - Ball.exact(P).times(2.0 * rate))


def is_negative_along(P: FloatArray, v: FloatArray) -> bool:
    """Prove ``v' P v < 0``."""
    column = Ball.exact(v[:, None])
    value = column.T @ (Ball.exact(P) @ column)
    return bool((value.middle + value.radius < -_FLOOR).all())
