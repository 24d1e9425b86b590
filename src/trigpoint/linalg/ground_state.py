"""Smallest eigenpair of a large M-matrix and rigorous bounds of it, from one factorization."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.linalg import approximate
from trigpoint.linalg.sparse import Factorization, factorize
from trigpoint.linalg.spectral import DENSE_LIMIT
from trigpoint.linalg.verified import Couplings, collatz_wielandt_lower, collatz_wielandt_upper, rayleigh_upper

EngineName = Literal["superlu", "approx-chol"]

_LARGE = 100_000
_POWER_STEPS = 14
_CONVERGED = 1e-11
_CONVERGED_LARGE = 1e-7  # the polishing step that follows gains two more decades
_TIGHT = 1e-7
_LEAST_CONTRACTION = 0.35
_DEFLATED = 4
_SHIFTS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-4, 1e-2, 0.5)
_LOOSE = 1e-6
_CG_STEPS = 60
_REFINEMENTS = 4


@dataclass(frozen=True, eq=False)
class GroundState:
    """``lower <= smallest eigenvalue <= upper``, with what proves it; the bounds hold whichever engine computed it.

    Attributes:
        value: computed smallest eigenvalue.
        lower, upper: rigorous bounds.
        vector: (n,) unit eigenvector, its entries summing to something positive.
        positive: (n,) the positive vector x whose quotients ``(L x)_i / x_i`` prove ``lower``.
        solves: solves with the (exact or approximate) factorization.
    """

    value: float
    lower: float
    upper: float
    vector: FloatArray
    positive: FloatArray
    solves: int


def _without_factorization(matrix: Couplings, stored: sp.sparray) -> GroundState:
    """The same bounds from ``linalg.approximate``: a polished eigenvector, or ``(L - s I) x = 1`` with s below it."""
    system = approximate.preconditioned(stored)
    value, inner, steps = approximate.lowest_pair(system)

    def accurate(x: FloatArray) -> FloatArray:
        return system.inner(matrix.apply(system.outer(x))[0])

    polished = approximate.solved(system, inner, inner / value, 1e-10, accurate)
    positive = _scaled(system.outer(polished))
    lower = collatz_wielandt_lower(matrix, positive)
    upper = min(rayleigh_upper(matrix, positive), collatz_wielandt_upper(matrix, positive))
    vector = positive
    if not lower > upper * (1.0 - _LOOSE):
        vector = system.outer(inner)
        upper = min(upper, rayleigh_upper(matrix, vector))
        for shift in (1e-7, 1e-6, 1e-5, 1e-4, 1e-2, 0.5):
            x = system.outer(approximate.shifted_solution(system, inner, value, value * (1.0 - shift)))
            bound = collatz_wielandt_lower(matrix, _scaled(x))
            if bound > lower:
                lower, positive = bound, _scaled(x)
            if lower > value * (1.0 - 4.0 * shift):
                break
    if vector.sum() < 0:
        vector = -vector
    return _result(matrix, lower, upper, vector, positive, steps)


class _Counted:
    """A factorization that counts its solves."""

    def __init__(self, factor: Factorization) -> None:
        self.factor = factor
        self.count = 0

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve and count."""
        self.count += 1
        return self.factor.solve(rhs)


@dataclass(frozen=True)
class Engine:
    """Which engine computes a ground state, and why.

    Attributes:
        name: ``superlu`` (exact factorization, always there) or ``approx-chol`` (the extra ``fast``).
        reason: the rule's reason, in words.
    """

    name: EngineName
    reason: str


def choose_engine(size: int, wanted: EngineName | None = None) -> Engine:
    """The rule: ``approx-chol`` from 200 000 rows on where it is installed, ``superlu`` otherwise.

    Args:
        size: number of rows.
        wanted: an engine by name overrides the rule; one that is missing is then a MissingExtraError.
    """
    if wanted is not None:
        if wanted not in get_args(EngineName):
            raise ArgumentError(f"engine must be one of {', '.join(get_args(EngineName))}; got {wanted!r}")
        return Engine(wanted, "asked for")
    if size < _LARGE:
        return Engine("superlu", f"below {_LARGE} rows an exact factorization is as fast")
    if not approximate.available():
        return Engine("superlu", "the extra 'fast' is not installed")
    return Engine("approx-chol", f"from {_LARGE} rows on, one eigenpair needs no exact factorization")


def ground_state(matrix: Couplings, stored: sp.sparray, engine: EngineName | None = None) -> GroundState:
    """Smallest eigenvalue of a positive definite M-matrix ``L``, with rigorous bounds, from one factorization.

    Inverse iteration ``z = L^-1 u`` from ``u = 1`` stays positive and its quotients ``u_i / z_i`` enclose the
    eigenvalue (Collatz-Wielandt). With a wide gap (few anchors) six to nine solves are enough, and the iterate itself
    proves the bound. Where the quotients contract slowly (many anchors, several components) Lanczos on ``L^-1`` finds
    the lowest four eigenpairs, and ``(L - s I) x = 1`` with s just below the eigenvalue is solved in two parts: along
    those eigenvectors directly, on their complement by conjugate gradients preconditioned with the same factorization.
    Only ``|(L - s I) x - 1| < 1`` is needed, entry by entry: then ``(L x)_i >= s x_i``.

    Args:
        matrix: L by its couplings, for the bounds.
        stored: the same L as a sparse matrix, for the factorization.
        engine: overrides the rule of ``choose_engine``.

    We assume:
        * every part of L is grounded (L is positive definite).

    Cost: one sparse factorization and 6 to 100 solves (a second one only where the bound stays loose: weights of
    very different sizes). Source: Barta1937; Collatz1942 and Wielandt1950; theory 8-G1.
    """
    if choose_engine(matrix.size, engine).name == "approx-chol":
        return _without_factorization(matrix, stored)
    factor = _Counted(factorize(stored))
    power, contracts = _inverse_iteration(factor, matrix.size)
    if contracts:
        power = _polished(matrix, factor, power)
        upper = min(rayleigh_upper(matrix, power), collatz_wielandt_upper(matrix, power))
        lower, positive = collatz_wielandt_lower(matrix, power), power
        if matrix.size < _LARGE or not lower > upper * (1.0 - _TIGHT):
            lower, positive = _lifted(matrix, power, factor.solve(np.ones(matrix.size)))
        if lower > upper * (1.0 - _LOOSE):
            return _result(matrix, lower, upper, power, positive, factor.count)
    values, vectors = _lowest(factor, stored, power)
    vector = vectors[:, 0] if vectors[:, 0].sum() >= 0 else -vectors[:, 0]
    upper = min(rayleigh_upper(matrix, vector), rayleigh_upper(matrix, power))
    lower, positive = _lower_bound(matrix, stored, factor, values, vectors, upper)
    return _result(matrix, lower, upper, vector, positive, factor.count)


def _result(
    matrix: Couplings, lower: float, upper: float, vector: FloatArray, positive: FloatArray, solves: int
) -> GroundState:
    unit = vector / np.linalg.norm(vector)
    low, high = matrix.quadratic_form(unit)
    lower, upper = max(lower, 0.0), max(upper, lower)
    value = min(max(0.5 * (low + high), lower), upper)
    return GroundState(value, lower, upper, frozen(unit), frozen(positive), solves)


def _inverse_iteration(factor: _Counted, size: int) -> tuple[FloatArray, bool]:
    """The last positive iterate, and whether its quotients closed up geometrically."""
    vector, last = np.ones(size), np.inf
    goal = _CONVERGED if size < _LARGE else _CONVERGED_LARGE
    for _ in range(_POWER_STEPS):
        image = factor.solve(vector)
        if not (np.isfinite(image).all() and (image > 0).all()):
            return vector, False
        quotient = vector / image
        vector = image / image.max()
        spread = float(quotient.max() / quotient.min()) - 1.0
        if spread < goal:
            return vector, True
        if spread > max(_LEAST_CONTRACTION * last, 0.0) and last < 1e3:
            return vector, spread < 1e2 * goal
        last = spread
    return vector, False


def _polished(matrix: Couplings, factor: _Counted, vector: FloatArray) -> FloatArray:
    """One more inverse iteration with two steps of refinement, the residual taken coupling by coupling."""
    image = factor.solve(vector)
    for _ in range(2 if matrix.size < _LARGE else 1):
        image = image + factor.solve(vector - matrix.apply(image)[0])
    return _scaled(image)


def _lifted(matrix: Couplings, vector: FloatArray, floor: FloatArray) -> tuple[float, FloatArray]:
    """The best bound from ``vector + c floor`` with ``L floor = 1`` and tiny c.

    Where the eigenvector is small, rounding weighs most in its quotients; there the added part lifts them.
    """
    best, witness = 0.0, vector
    if not (np.isfinite(floor).all() and (floor > 0).all()):
        return collatz_wielandt_lower(matrix, vector), vector
    for c in (0.0, 1e-10, 1e-9, 1e-8, 1e-7):
        x = vector + (c * float(vector.max()) / float(floor.max())) * floor
        bound = collatz_wielandt_lower(matrix, x)
        if bound > best:
            best, witness = bound, x
    return best, witness


def _scaled(x: FloatArray) -> FloatArray:
    """``x`` times a power of two, largest entry near 1: no further rounding."""
    largest = float(np.abs(x).max(initial=0.0))
    return np.asarray(np.ldexp(x, -int(np.frexp(largest)[1]))) if largest > 0.0 else x


def _lowest(factor: _Counted, stored: sp.sparray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The lowest eigenpairs: dense up to 500 rows, above by Lanczos on the inverse."""
    n = stored.shape[0]
    if n <= DENSE_LIMIT:
        values, vectors = la.eigh(stored.toarray(), subset_by_index=(0, min(_DEFLATED, n) - 1))
        return values, vectors
    inverse = LinearOperator((n, n), matvec=factor.solve, dtype=np.float64)
    try:
        values, vectors = eigsh(stored, k=_DEFLATED, sigma=0.0, OPinv=inverse, v0=start, which="LM", maxiter=100)
    except ArpackNoConvergence as error:
        values, vectors = error.eigenvalues, error.eigenvectors
        if not values.size:
            unit = start / np.linalg.norm(start)
            return np.array([float(unit @ (stored @ unit))]), unit[:, None]
    order = np.argsort(values)
    return values[order], vectors[:, order]


def _lower_bound(
    matrix: Couplings, stored: sp.sparray, factor: _Counted, values: FloatArray, vectors: FloatArray, upper: float
) -> tuple[float, FloatArray]:
    best, witness = 0.0, np.zeros(0)
    start = min(float(values[0]), upper)
    for shift in _SHIFTS:
        x = _positive_solution(matrix, stored, factor, (values, vectors), start * (1.0 - shift))
        bound = collatz_wielandt_lower(matrix, x)
        if bound > best:
            best, witness = bound, x
        if best > start * (1.0 - 4.0 * shift):
            return best, witness
    for shift in _SHIFTS:  # weights of very different sizes: a second factorization resolves what the first does not
        x = _direct_solution(matrix, stored, start * (1.0 - shift))
        bound = collatz_wielandt_lower(matrix, x)
        if bound > best:
            best, witness = bound, x
        if best > start * (1.0 - 4.0 * shift):
            break
    return best, witness


def _direct_solution(matrix: Couplings, stored: sp.sparray, shift: float) -> FloatArray:
    ones = np.ones(matrix.size)
    try:
        factor = factorize(stored - shift * sp.eye_array(matrix.size))
    except RuntimeError:  # exactly singular: the shift is not below the eigenvalue
        return -ones
    x = factor.solve(ones)
    for _ in range(2):
        x = x + factor.solve(ones - (matrix.apply(x)[0] - shift * x))
    return _scaled(x)


def _positive_solution(
    matrix: Couplings,
    stored: sp.sparray,
    factor: _Counted,
    pairs: tuple[FloatArray, FloatArray],
    shift: float,
) -> FloatArray:
    """``x`` with ``(L - s I) x = 1`` to within less than 1 an entry, as far as rounding allows."""
    values, vectors = pairs
    x = np.zeros(matrix.size)
    residual = np.ones(matrix.size)
    best, error = x, np.inf
    for _ in range(_REFINEMENTS):
        along = vectors.T @ residual
        step = vectors @ (along / (values - shift))
        step += _on_complement(stored, factor.solve, vectors, residual - vectors @ along, shift)
        x = x + step
        residual = 1.0 - (matrix.apply(x)[0] - shift * x)
        size = float(np.abs(residual).max())
        if size >= 0.5 * error:
            break
        best, error = x, size
        if size < 0.3 or not np.isfinite(size):
            break
    return _scaled(best)


def _on_complement(
    stored: sp.sparray, inverse: Callable[[FloatArray], FloatArray], vectors: FloatArray, rhs: FloatArray, shift: float
) -> FloatArray:
    """Solve ``(L - s I) y = rhs`` orthogonally to the known eigenvectors, until the residual is below a tenth."""
    y, residual = np.zeros_like(rhs), rhs.copy()
    goal = 0.1 * min(1.0, float(np.abs(rhs).max(initial=0.0)))
    z = _project(vectors, inverse(residual))
    direction, product = z, float(residual @ z)
    for _ in range(_CG_STEPS):
        if np.abs(residual).max(initial=0.0) <= goal or product <= 0.0:
            break
        image = _project(vectors, stored @ direction - shift * direction)
        curvature = float(direction @ image)
        if curvature <= 0.0:
            break
        step = product / curvature
        y, residual = y + step * direction, residual - step * image
        z = _project(vectors, inverse(residual))
        last, product = product, float(residual @ z)
        direction = z + (product / last) * direction
    return y


def _project(vectors: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray(x - vectors @ (vectors.T @ x))
