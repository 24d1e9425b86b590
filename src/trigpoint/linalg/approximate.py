"""Ground state of a very large M-matrix without any exact factorization: the optional engine ``approx-chol``.

An approximate Cholesky factorization preconditions a locally optimal three-term iteration. Nothing here is rigorous:
what it returns is proved, or not, by ``linalg.verified``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import MissingExtraError

_STEPS = 400
_LOOK = 5
_GOAL = 1e-8
_REFRESH = 10

Operator = Callable[[FloatArray], FloatArray]


def available() -> bool:
    """True where the extra ``fast`` is installed."""
    return find_spec("approx_chol") is not None


@dataclass(frozen=True, eq=False)
class Preconditioned:
    """An M-matrix in an order that caches like, with an approximate inverse.

    Attributes:
        order: position k of the inner vectors is entry ``order[k]`` of the outer ones.
        matrix: the permuted matrix.
        inverse: approximate inverse of it.
    """

    order: IntArray
    matrix: sp.csr_array
    inverse: Operator

    def inner(self, vector: FloatArray) -> FloatArray:
        """From the outer order to the inner one."""
        return np.asarray(vector[self.order])

    def outer(self, vector: FloatArray) -> FloatArray:
        """And back."""
        back = np.empty_like(vector)
        back[self.order] = vector
        return back


def preconditioned(stored: sp.sparray) -> Preconditioned:
    """Order ``stored`` by reverse Cuthill-McKee and factor it approximately.

    Raises MissingExtraError without the extra ``fast``. Cost O(nnz log n) time, O(nnz) memory.
    Source: Kyng and Sachdeva 2016, key KyngSachdeva2016.
    """
    try:
        import approx_chol
    except ImportError as error:
        raise MissingExtraError("approx-chol", "fast", "the approximate factorization") from error
    matrix = sp.csr_matrix(stored)  # the engine and SciPy's ordering know the older type only
    order = np.asarray(reverse_cuthill_mckee(matrix, symmetric_mode=True), dtype=np.int64)
    permuted = sp.csr_matrix(matrix[order][:, order])
    permuted.sort_indices()
    factor = approx_chol.factorize(permuted, approx_chol.Config(seed=0))
    return Preconditioned(order, sp.csr_array(permuted), factor.solve)


def lowest_pair(system: Preconditioned) -> tuple[float, FloatArray, int]:
    """Computed smallest eigenvalue, a unit vector in the inner order, and the number of steps.

    Locally optimal preconditioned conjugate gradients on one vector. Stops where the residual is below 1e-8 of the
    eigenvalue or no longer falls (rounding), whichever is first. Source: Knyazev 2001, key Knyazev2001.
    """
    state = _Iterate.start(system)
    best, best_size, last_look = state.x, np.inf, np.inf
    for step in range(1, _STEPS + 1):
        if not state.advance(system, refresh=step % _REFRESH == 0):
            break
        if step % _LOOK:
            continue
        size = float(np.linalg.norm(state.residual())) / state.value
        if size < best_size:
            best, best_size = state.x, size
        if size < _GOAL or (size < 1e-5 and size > 0.7 * last_look):
            break
        last_look = size
    vector = best if best.sum() >= 0 else -best
    return float(vector @ (system.matrix @ vector)), vector, step


@dataclass
class _Iterate:
    """Current vector, last direction, and their images."""

    x: FloatArray
    image: FloatArray
    value: float
    direction: FloatArray | None = None
    direction_image: FloatArray | None = None

    @staticmethod
    def start(system: Preconditioned) -> _Iterate:
        x = system.inverse(np.ones(system.matrix.shape[0]))
        x = x / np.linalg.norm(x)
        image = system.matrix @ x
        return _Iterate(x, image, float(x @ image))

    def residual(self) -> FloatArray:
        return np.asarray(self.image - self.value * self.x)

    def advance(self, system: Preconditioned, *, refresh: bool) -> bool:
        """One step; False where the three directions are no longer independent."""
        w = system.inverse(self.residual())
        size = float(np.linalg.norm(w))
        if not np.isfinite(size) or size == 0.0:
            return False
        w = w / size
        basis, images = [self.x, w], [self.image, system.matrix @ w]
        if self.direction is not None and self.direction_image is not None:
            basis.append(self.direction)
            images.append(self.direction_image)
        energy = np.array([[a @ b for b in images] for a in basis])
        mass = np.array([[a @ b for b in basis] for a in basis])
        try:
            _, vectors = la.eigh(0.5 * (energy + energy.T), mass, subset_by_index=(0, 0))
        except np.linalg.LinAlgError:
            if self.direction is None:
                return False
            self.direction = None  # restart: the last direction has become a multiple of the others
            return self.advance(system, refresh=True)
        self._move(vectors[:, 0], basis, images)
        if refresh:
            self.image = system.matrix @ self.x
        self.value = float(self.x @ self.image)
        return True

    def _move(self, c: FloatArray, basis: list[FloatArray], images: list[FloatArray]) -> None:
        step = sum((c[k] * basis[k] for k in range(2, len(basis))), c[1] * basis[1])
        step_image = sum((c[k] * images[k] for k in range(2, len(basis))), c[1] * images[1])
        x, image = c[0] * basis[0] + step, c[0] * images[0] + step_image
        length, reach = float(np.linalg.norm(x)), float(np.linalg.norm(step)) or 1.0
        self.x, self.image = x / length, image / length
        self.direction, self.direction_image = step / reach, step_image / reach


def solved(
    system: Preconditioned, rhs: FloatArray, start: FloatArray, goal: float, apply: Operator, steps: int = 300
) -> FloatArray:
    """``matrix @ x = rhs`` by preconditioned conjugate gradients from ``start``, all in the inner order.

    ``apply`` gives the accurate product for the first residual; stops when its 2-norm has come down to ``goal`` times
    that of ``rhs``, or after ``steps``.
    """
    x, residual = start.copy(), rhs - apply(start)
    z = system.inverse(residual)
    direction, product = z, float(residual @ z)
    limit = goal * float(np.linalg.norm(rhs))
    for _ in range(steps):
        if float(np.linalg.norm(residual)) <= limit or not product > 0.0:
            break
        image = system.matrix @ direction
        step = product / float(direction @ image)
        x += step * direction
        residual = residual - step * image
        z = system.inverse(residual)
        product, last = float(residual @ z), product
        direction = z + (product / last) * direction
    return x


def shifted_solution(system: Preconditioned, vector: FloatArray, value: float, shift: float) -> FloatArray:
    """``(matrix - shift I) x = 1`` in the inner order, shift just below the smallest eigenvalue ``value``.

    Along the known ``vector`` directly, on the rest by preconditioned conjugate gradients, until every entry of the
    residual is below a third: then ``(matrix x)_i >= shift x_i``.
    """
    ones = np.ones(vector.shape[0])
    unit = vector / np.linalg.norm(vector)
    x = (float(unit @ ones) / (value - shift)) * unit
    for _ in range(3):
        residual = ones - (system.matrix @ x - shift * x)
        if float(np.abs(residual).max()) < 1.0 / 3.0:
            break
        along = float(unit @ residual)
        x = x + (along / (value - shift)) * unit + _on_the_rest(system, unit, residual - along * unit, shift)
    return x


def _on_the_rest(system: Preconditioned, unit: FloatArray, rhs: FloatArray, shift: float) -> FloatArray:
    y, residual = np.zeros_like(rhs), rhs
    z = system.inverse(residual)
    z = z - (unit @ z) * unit
    direction, product = z, float(residual @ z)
    for _ in range(_STEPS):
        if float(np.abs(residual).max()) < 0.1 or not product > 0.0:
            break
        image = system.matrix @ direction - shift * direction
        curvature = float(direction @ image)
        if not curvature > 0.0:
            break
        step = product / curvature
        y = y + step * direction
        residual = residual - step * image
        z = system.inverse(residual)
        z = z - (unit @ z) * unit
        product, last = float(residual @ z), product
        direction = z + (product / last) * direction
    return y
