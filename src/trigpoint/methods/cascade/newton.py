"""All gains at once: Gauss-Newton on the spectrum, for lists that no cascade can be dealt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from scipy.optimize import linear_sum_assignment

from trigpoint.arrays import FloatArray
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.injection import spectrum_error
from trigpoint.methods.cascade.gains import Gains
from trigpoint.model import SharedPlant

_STEPS = 120
_STAGES = (6, 16, 40)
_NOISE = 0.05
_GOAL = 1e-11
_GOAL_ERROR = 1e-9


@dataclass(frozen=True, eq=False)
class Refined:
    """Gains after the search.

    Attributes:
        gains: the best found.
        error: largest distance between the spectrum of their H and the targets, best matched.
        steps: Gauss-Newton steps taken.
    """

    gains: Gains
    error: float
    steps: int


def refine_spectrum(problem: SharedPlant, start: Gains, targets: Sequence[complex]) -> Refined:
    """Move all gains until the spectrum of H is the ``targets``, from a ``start`` with their real parts.

    Eigenvalues are taken in pairs (conjugate, or two real ones) by mean and squared half difference, which stay smooth
    where two real ones meet and part as a conjugate pair. A step is ``J' (J J' + mu I)^-1 r`` with
    ``d lambda = y' dH x``; the imaginary parts grow in stages, of finer steps and from
    disturbed starts where that fails. Nothing is guaranteed: look at ``error``.
    Cost: O((m n)^3 + (m n)^2 P) a step for P gains. Source: W17, Theorem 1; theory 4.2.
    """
    layout = _Layout.of(problem)
    first, wanted = layout.pack(start), np.array(targets, dtype=complex)
    rng, taken, best = np.random.default_rng(0), 0, (np.inf, first)
    for attempt, stages in enumerate((*_STAGES, *_STAGES)):
        size = float(np.abs(first).max())
        theta = first + (_NOISE * size * rng.normal(size=first.shape) if attempt >= len(_STAGES) else 0.0)
        for share in np.linspace(1.0 / stages, 1.0, stages):
            theta, steps = _solve(layout, theta, wanted.real + 1j * share * wanted.imag)
            taken += steps
        error = spectrum_error(layout.matrix(theta), wanted)
        best = min(best, (error, theta), key=lambda found: found[0])
        if error <= _GOAL_ERROR * float(np.abs(wanted).max()):
            break
    return Refined(layout.unpack(best[1]), best[0], taken)


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where each gain sits in the vector of unknowns."""

    problem: SharedPlant
    states: Blocks
    links: tuple[tuple[int, int], ...]
    readers: tuple[int, ...]

    @staticmethod
    def of(problem: SharedPlant) -> _Layout:
        links = tuple((i, j) for i, heard in enumerate(problem.hears) for j in heard)
        readers = tuple(i for i, C in enumerate(problem.outputs) if C.any())
        return _Layout(problem, Blocks(problem.n_agents, problem.n_states), links, readers)

    def pack(self, gains: Gains) -> FloatArray:
        n = self.problem.n_states
        parts = [np.asarray(gains.couplings.get(link, np.zeros((n, n)))).ravel() for link in self.links]
        for i in self.readers:
            empty = np.zeros((n, self.problem.outputs[i].shape[0]))
            parts.append(np.asarray(gains.injections.get(i, empty)).ravel())
        return np.concatenate(parts)

    def unpack(self, theta: FloatArray) -> Gains:
        n, position = self.problem.n_states, 0
        couplings, injections = {}, {}
        for link in self.links:
            couplings[link] = theta[position : position + n * n].reshape(n, n)
            position += n * n
        for i in self.readers:
            size = n * self.problem.outputs[i].shape[0]
            injections[i] = theta[position : position + size].reshape(n, -1)
            position += size
        return Gains(couplings, injections)

    def matrix(self, theta: FloatArray) -> FloatArray:
        gains = self.unpack(theta)
        H: FloatArray = np.kron(np.eye(self.states.count), self.problem.A).astype(np.float64)
        for (i, j), F in gains.couplings.items():
            H[self.states.slice(i), self.states.slice(j)] += F
            H[self.states.slice(i), self.states.slice(i)] -= F
        for i, K in gains.injections.items():
            H[self.states.slice(i), self.states.slice(i)] -= K @ self.problem.outputs[i]
        return H

    def slopes(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """d lambda_k / d theta for all k: rows of ``left`` are y_k', columns of ``right`` x_k, ``y_k' x_k = 1``."""
        y, x = self.states.split(left), self.states.split(right.T)
        count = left.shape[0]
        parts = [np.einsum("ka,kb->kab", y[:, i], x[:, j] - x[:, i]).reshape(count, -1) for i, j in self.links]
        for i in self.readers:
            seen = x[:, i] @ self.problem.outputs[i].T
            parts.append(-np.einsum("ka,kb->kab", y[:, i], seen).reshape(count, -1))
        return np.concatenate(parts, axis=1)


def _solve(layout: _Layout, theta: FloatArray, targets: np.ndarray) -> tuple[FloatArray, int]:
    """Levenberg-Marquardt towards one list."""
    size = float(np.abs(targets).max()) or 1.0
    wanted = _pairs(targets)
    residual, slope = _residual(layout, theta, wanted, targets, size)
    mu, best = 1e-3, float(np.linalg.norm(residual))
    for step in range(_STEPS):
        if best < _GOAL * size:
            return theta, step
        normal = slope @ slope.T
        try:
            move = slope.T @ la.solve(
                normal + mu * np.trace(normal) / normal.shape[0] * np.eye(normal.shape[0]), residual, assume_a="pos"
            )
        except np.linalg.LinAlgError:
            mu *= 10.0
            continue
        trial = theta - move
        after, its_slope = _residual(layout, trial, wanted, targets, size)
        length = float(np.linalg.norm(after))
        if np.isfinite(length) and length < best:
            theta, residual, slope, best, mu = trial, after, its_slope, length, max(mu * 0.2, 1e-14)
        else:
            mu *= 8.0
            if mu > 1e8:
                return theta, step
    return theta, _STEPS


def _pairs(values: np.ndarray) -> list[tuple[int, int]]:
    """Indices in pairs: conjugates together, real ones with their neighbour; a last odd one with itself."""
    scale = float(np.abs(values).max()) or 1.0
    real = np.abs(values.imag) <= 1e-12 * scale
    upper = [int(k) for k in np.flatnonzero(values.imag > 1e-12 * scale)]
    lower = [int(k) for k in np.flatnonzero(values.imag < -1e-12 * scale)]
    pairs = []
    for k in upper:
        mate = min(lower, key=lambda other: abs(values[other] - values[k].conjugate()))
        lower.remove(mate)
        pairs.append((k, mate))
    alone = sorted((int(k) for k in np.flatnonzero(real)), key=lambda k: values[k].real)
    pairs += list(zip(alone[::2], alone[1::2], strict=False))
    return pairs + ([(alone[-1], alone[-1])] if len(alone) % 2 else [])


def _residual(
    layout: _Layout, theta: FloatArray, wanted: list[tuple[int, int]], targets: np.ndarray, size: float
) -> tuple[FloatArray, FloatArray]:
    values, right = np.linalg.eig(layout.matrix(theta))
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return np.full(targets.shape[0], np.inf), np.zeros((targets.shape[0], theta.shape[0]))
    slope = layout.slopes(left, right)
    found = _pairs(values)
    ours = np.array([_symmetric(values[a], values[b], size) for a, b in found])
    theirs = np.array([_symmetric(targets[a], targets[b], size) for a, b in wanted])
    single = np.array([a == b for a, b in found])[:, None] != np.array([a == b for a, b in wanted])[None, :]
    distance = ((ours[:, None] - theirs[None]) ** 2).sum(axis=2) + 1e12 * single
    rows, columns = linear_sum_assignment(distance)
    residual, jacobian = [], []
    for row, column in zip(rows, columns, strict=True):
        a, b = found[row]
        residual.append(ours[row, 0] - theirs[column, 0])
        jacobian.append(0.5 * (slope[a] + slope[b]).real)
        if a != b:
            residual.append(ours[row, 1] - theirs[column, 1])
            jacobian.append((0.5 * (values[a] - values[b]) * (slope[a] - slope[b])).real / size)
    return np.array(residual), np.array(jacobian)


def _symmetric(a: complex, b: complex, size: float) -> tuple[float, float]:
    return ((a + b) / 2.0).real, (((a - b) / 2.0) ** 2).real / size
