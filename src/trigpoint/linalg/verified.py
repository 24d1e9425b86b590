"""Bounds that hold for the stored numbers, whatever the rounding: the only place where rounding errors are bounded.

Every bound is a priori in the IEEE sense: with unit roundoff u = 2^-53 and gam(k) = k u / (1 - k u), a sum of k
products, in any order, has an error of at most gam(k) times the sum of the absolute values (Higham, *Accuracy and
Stability of Numerical Algorithms*, 2002, Section 3.1, key Higham2002). Results are rounded outwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray, IntArray

UNIT_ROUNDOFF = 2.0**-53
_TINY = 2.0**-1000  # below this, products may underflow and relative bounds do not hold
_OUTWARD = 1.0 + 8.0 * UNIT_ROUNDOFF


def gam(k: FloatArray | float) -> FloatArray:
    """``gam(k) = k u / (1 - k u)``, rounded up."""
    ku = np.asarray(k, dtype=np.float64) * UNIT_ROUNDOFF
    result: FloatArray = np.asarray(ku / (1.0 - ku) * _OUTWARD)
    return result


@dataclass(frozen=True)
class Couplings:
    """A symmetric matrix given by its nonnegative couplings, never by its entries.

    ``(L x)_i = excess part + sum over couplings at i of w (x_i - x_j)``: coupling k joins ``first[k]`` and
    ``second[k]`` with ``weight[k]``; grounding k adds ``ground_weight[k] x_i`` at ``ground[k]``. The matrix is a
    symmetric M-matrix (Stieltjes) with row sums >= 0. Differences keep relative accuracy where entries would cancel.
    """

    size: int
    first: IntArray
    second: IntArray
    weight: FloatArray
    ground: IntArray
    ground_weight: FloatArray

    def apply(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``L x`` and a bound on the absolute error of each entry, for the stored numbers."""
        flow = self.weight * (x[self.first] - x[self.second])
        lift = self.ground_weight * x[self.ground]
        value = self._gather(flow, -flow, lift)
        magnitude = self._gather(np.abs(flow), np.abs(flow), np.abs(lift))
        terms = self._gather(np.ones_like(flow), np.ones_like(flow), np.ones_like(lift))
        # Each term carries two roundings, the sum of d terms d - 1 more; the computed magnitude is short by as much.
        error = gam(2.0 * terms + 6.0) * magnitude + terms * _TINY
        return value, error

    def _gather(self, at_first: FloatArray, at_second: FloatArray, at_ground: FloatArray) -> FloatArray:
        total: FloatArray = np.zeros(self.size)
        for positions, terms in ((self.first, at_first), (self.second, at_second), (self.ground, at_ground)):
            total += np.bincount(positions, terms, self.size)
        return total

    def quadratic_form(self, x: FloatArray) -> tuple[float, float]:
        """Return rigorous (lower, upper) bounds of ``x' L x = sum w (x_i - x_j)^2 + sum g x_i^2``."""
        across, lifted = x[self.first] - x[self.second], x[self.ground]
        # Weight first: a square that underflows before a large weight multiplies it would be lost without a trace.
        terms = np.concatenate([(self.weight * across) * across, (self.ground_weight * lifted) * lifted])
        total = float(terms.sum())
        lost = (terms.shape[0] + float(np.abs(across).sum() + np.abs(lifted).sum())) * _TINY
        slack = float(gam(2.0 * terms.shape[0] + 6.0)) * total + lost
        return max(0.0, down(total - slack)), up(total + slack)


def up(value: float) -> float:
    """Next float above (an outward-rounded upper bound)."""
    return float(np.nextafter(value, np.inf))


def down(value: float) -> float:
    """Next float below (an outward-rounded lower bound)."""
    return float(np.nextafter(value, -np.inf))


def collatz_wielandt_lower(matrix: Couplings, x: FloatArray) -> float:
    """Rigorous lower bound of the smallest eigenvalue: ``min_i (L x)_i / x_i`` for any ``x > 0``.

    We assume:
        * ``matrix`` has nonnegative couplings (it is a Stieltjes matrix): the constructor's business.

    Returns -inf when ``x`` is not positive or so small that products underflow: no bound, never a wrong one.
    Cost O(N + M). Source: Barta (1937); Collatz and Wielandt; theory 8-G1.
    """
    if not (np.isfinite(x).all() and (x > _TINY * 2.0**60).all()):
        return -np.inf
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows becomes NaN or infinite: no bound
        value, error = matrix.apply(x)
        least = float(((value - error) / x).min())
    if np.isnan(least):
        return -np.inf
    return down(least - 4.0 * UNIT_ROUNDOFF * abs(least))


def collatz_wielandt_upper(matrix: Couplings, x: FloatArray) -> float:
    """Rigorous upper bound ``max_i (L x)_i / x_i`` for any ``x > 0``; +inf when ``x`` is not positive."""
    if not (np.isfinite(x).all() and (x > _TINY * 2.0**60).all()):
        return np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        value, error = matrix.apply(x)
        most = float(((value + error) / x).max())
    if np.isnan(most):
        return np.inf
    return up(most + 4.0 * UNIT_ROUNDOFF * abs(most))


def rayleigh_upper(matrix: Couplings, x: FloatArray) -> float:
    """Rigorous upper bound ``x' L x / x' x`` of the smallest eigenvalue, for any ``x != 0``; arc by arc."""
    scale = float(np.abs(x).max(initial=0.0))
    if not np.isfinite(scale) or scale == 0.0:
        return np.inf
    unit = np.ldexp(x, -int(np.frexp(scale)[1]))  # a power of two: exact but for underflow
    with np.errstate(over="ignore", invalid="ignore"):
        _, high = matrix.quadratic_form(unit)
    if np.isnan(high):
        return np.inf
    squares = float((unit * unit).sum())
    length = down(squares * (1.0 - float(gam(unit.shape[0] + 2.0))))
    return up(high / length) if length > 0 else np.inf


def is_positive_definite(matrix: FloatArray, radius: FloatArray | float = 0.0) -> bool:
    """Prove that every symmetric matrix within ``radius`` (entrywise) of ``matrix`` is positive definite.

    A floating-point Cholesky factorization of ``A - c I`` that runs to completion proves ``A > 0`` when ``c`` exceeds
    the backward error of the factorization; False means *not proved*, never *not definite*.

    We assume:
        * ``matrix`` is exactly symmetric, (n, n), float64.

    Cost O(n^3). Source: Rump, *Verification of positive definiteness*, BIT 46 (2006), key Rump2006; theory 8-G2.
    """
    n = matrix.shape[0]
    diagonal, perturbation = np.diagonal(matrix), np.broadcast_to(np.asarray(radius, dtype=np.float64), matrix.shape)
    if not (np.isfinite(matrix).all() and np.isfinite(perturbation).all()):
        return False
    if (diagonal <= 0).any() or not np.array_equal(matrix, matrix.T):
        return False
    j = np.arange(1, n + 1, dtype=np.float64)
    growth = gam(j + 2.0)
    shift = float((growth / (1.0 - growth) * diagonal).sum()) * (1.0 + float(gam(n + 4.0))) + n * _TINY
    shift += float(perturbation.sum(axis=1).max(initial=0.0)) * (1.0 + float(gam(n + 4.0)))
    shifted = matrix.copy()
    np.fill_diagonal(shifted, np.nextafter(np.nextafter(diagonal - up(shift * _OUTWARD), -np.inf), -np.inf))
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            factor = np.linalg.cholesky(shifted)
    except np.linalg.LinAlgError:
        return False
    # Where a product overflows, some libraries run on with a pivot that is no number: that is no completed run.
    return bool(np.isfinite(factor).all())
