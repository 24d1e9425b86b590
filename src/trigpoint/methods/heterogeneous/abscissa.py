"""Step 4: minimise the spectral abscissa of ``A + L C`` over the L with a given structure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import BoolArray, FloatArray

_STEPS = 400
_HALVINGS = 40
_DECREASE, _CURVATURE = 1e-4, 0.5
_DEFECTIVE = 1e-12

Objective = Callable[[FloatArray], tuple[float, FloatArray]]


@dataclass(frozen=True, eq=False)
class AbscissaSearch:
    """Best L found.

    Attributes:
        gain: (n, p) L.
        abscissa: largest real part of the spectrum of ``A + L C``.
        starts: starting points used.
    """

    gain: FloatArray
    abscissa: float
    starts: int


def minimise_abscissa(
    A: FloatArray, C: FloatArray, mask: BoolArray, target: float, starts: int, seed: int
) -> AbscissaSearch:
    """Search L, zero outside ``mask``, with all eigenvalues of ``A + L C`` left of ``-target``.

    Quasi-Newton steps (BFGS) with a weak Wolfe line search, which go on where the rightmost eigenvalue changes places;
    the gradient of an eigenvalue with right and left vectors x, y is ``Re(y conj (C x)') / (y* x)``. The first start
    is ``-C'``, the others are drawn with ``seed``, at sizes from 1/4 to 16.

    Args:
        A: (n, n), of norm about 1.
        C: (p, n), rows of norm about 1.
        mask: (n, p) where L may have entries.
        target: rate at which the search stops.
        starts: most starting points.
        seed: of the generator.

    A local search: where it finds nothing, there may still be such an L. Cost O(n^3) for each of up to 400 steps.
    Source: 000-21, E-000-13.
    """
    objective = _objective(A, C, mask)
    best, least, used = np.zeros(int(mask.sum())), np.inf, 0
    for start in _starting_points(C, mask, starts, seed):
        used += 1
        point, value = minimise_nonsmooth(objective, start, -target)
        if value < least:
            best, least = point, value
        if least <= -target:
            break
    return AbscissaSearch(filled(mask, best), least, used)


def filled(mask: BoolArray, entries: FloatArray) -> FloatArray:
    """The matrix with ``entries`` where ``mask`` is true, row by row, and zero elsewhere."""
    gain = np.zeros(mask.shape)
    gain[mask] = entries
    return gain


def _starting_points(C: FloatArray, mask: BoolArray, starts: int, seed: int) -> Iterable[FloatArray]:
    rng = np.random.default_rng(seed)
    for k in range(starts):
        draw = rng.normal(size=int(mask.sum())) * 2.0 ** rng.uniform(-2.0, 4.0)
        yield -C.T[mask] if k == 0 else draw


def _objective(A: FloatArray, C: FloatArray, mask: BoolArray) -> Objective:
    def objective(entries: FloatArray) -> tuple[float, FloatArray]:
        H = A + filled(mask, entries) @ C
        if not np.isfinite(H).all():
            return np.inf, np.zeros(entries.shape)
        values, left, right = la.eig(H, left=True, right=True)
        k = int(np.argmax(values.real))
        x, y = right[:, k], left[:, k]
        overlap = complex(np.vdot(y, x))
        if abs(overlap) < _DEFECTIVE:  # a Jordan block: no gradient; any large one in the right direction will do
            overlap = _DEFECTIVE * (overlap / abs(overlap) if overlap else 1.0)
        slope = np.outer(y.conj(), C @ x) / overlap
        return float(values.real[k]), slope.real[mask]

    return objective


def minimise_nonsmooth(
    objective: Objective, start: FloatArray, goal: float, steps: int = _STEPS
) -> tuple[FloatArray, float]:
    """BFGS for an ``objective`` (value and gradient) that is smooth almost everywhere, from ``start``.

    Stops at a value of ``goal`` or below, after so many ``steps``, or where the line search finds no decrease.
    """
    point, (value, slope) = start, objective(start)
    inverse = np.eye(start.shape[0])
    for _ in range(steps):
        if value <= goal or not np.isfinite(value):
            break
        direction = -inverse @ slope
        descent = float(direction @ slope)
        if not descent < 0.0:
            inverse, direction = np.eye(start.shape[0]), -slope
            descent = float(direction @ slope)
            if not descent < 0.0:
                break
        step = _weak_wolfe(objective, point, value, descent, direction)
        if step is None:
            break
        moved, new_value, new_slope = step
        inverse = _updated(inverse, moved - point, new_slope - slope)
        point, value, slope = moved, new_value, new_slope
    return point, value


def _weak_wolfe(
    objective: Objective, point: FloatArray, value: float, descent: float, direction: FloatArray
) -> tuple[FloatArray, float, FloatArray] | None:
    """A point with enough decrease, and a slope that has risen; where bisection ends first, the last that decreased."""
    low, high, length = 0.0, np.inf, 1.0
    kept: tuple[FloatArray, float, FloatArray] | None = None
    for _ in range(_HALVINGS):
        trial = point + length * direction
        trial_value, slope = objective(trial)
        if not trial_value <= value + _DECREASE * length * descent:
            high = length
        else:
            kept = (trial, trial_value, slope)
            if float(slope @ direction) >= _CURVATURE * descent:
                return kept
            low = length
        length = 0.5 * (low + high) if np.isfinite(high) else 2.0 * low
    return kept


def _updated(inverse: FloatArray, step: FloatArray, change: FloatArray) -> FloatArray:
    """The BFGS update of the inverse Hessian; unchanged where the curvature is not positive."""
    curvature = float(step @ change)
    if not curvature > 1e-14 * float(np.linalg.norm(step) * np.linalg.norm(change)):
        return inverse
    left = np.eye(step.shape[0]) - np.outer(step, change) / curvature
    return np.asarray(left @ inverse @ left.T + np.outer(step, step) / curvature)
