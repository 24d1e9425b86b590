"""The modal path: equal agents mode by mode, ``e(t) = sum_k u_k (x) exp((A - gain lambda_k K C) t) c_k``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.modes import largest_eigenvalue_bound, mode_matrices
from trigpoint.arrays import FloatArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg import chebyshev
from trigpoint.linalg.exponentials import exponentials
from trigpoint.linalg.krylov import RationalKrylov
from trigpoint.linalg.sparse import WIDEST, widest_level
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation.plant import Plant
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Series, constant_error

ALL_MODES = 1200
"""Up to so many nodes all eigenpairs are computed."""
SHORT = 400
"""Up to this degree a Chebyshev series is taken although a factorization fits: it is cheaper."""
LONG = 200_000
"""Largest degree of a Chebyshev series."""

_ROUNDS = 40
_STEPS = 2
_STEPS_AGAIN = 6  # where a factorization is made anew at every visit of a pole


@dataclass(frozen=True)
class Engines:
    """Who computed a modal run, and how nearly.

    Attributes:
        names: ``eigenpairs``, ``chebyshev``, ``krylov``, or the last two.
        error: estimated largest error of all times, relative to the first error.
    """

    names: str
    error: float


def continuous(
    observer: DiffusiveObserver, plant: Plant, scenario: Scenario, truth: FloatArray, estimate: FloatArray
) -> tuple[Series, Engines]:
    """Continuous exchange through the modes of the generalized Laplacian; and who computed it, how nearly.

    ================================================== ==============================================================
    network and time                                   engine
    ================================================== ==============================================================
    up to 1200 nodes                                   all eigenpairs
    early times (a series of degree up to 400)         Chebyshev series: products only
    later ones, no level wider than 5500 nodes         rational Krylov space with cached factorizations, grown until
                                                       the answer changes by less than ``scenario.tolerance``
    later ones, wider levels (no factorization fits)   Chebyshev series
    ================================================== ==============================================================

    The error estimate is the tail of the series, or the last change of the Krylov space, relative to the first error.

    We assume: equal agents, scalar weights. Cost: N^3; or products and a few factorizations with some 15 to 100 solves.
    Source: G16, proof of Theorem 4; theory 1 (``f(L)`` with n x n values).
    """
    start = estimate - truth
    drive = constant_error(observer, plant, truth).reshape(start.shape)
    problem = _Functions(observer, observer.graph, start, drive, scenario.times)
    if observer.graph.n_nodes <= ALL_MODES:
        values, vectors = la.eigh(observer.graph.laplacian().toarray())
        columns = problem.columns
        errors = [vectors @ problem.moved(values, vectors.T @ columns, k) for k in range(scenario.times.shape[0])]
        engines = Engines("eigenpairs", 1e-12)
    else:
        errors, engines = _large(problem, scenario.tolerance)
    states = np.stack([plant.advance(truth, time) for time in scenario.times.tolist()])
    table = np.stack(errors)
    return (states, states + table, np.zeros(table.shape[:2], dtype=np.int64)), engines


@dataclass(frozen=True, eq=False)
class _Functions:
    """What is applied to L: at each time a function of lambda with values (n, n), or (n, 2 n) with a drive."""

    observer: DiffusiveObserver
    graph: MeasurementGraph
    start: FloatArray
    drive: FloatArray
    times: FloatArray

    @property
    def columns(self) -> FloatArray:
        """(N, n) the first error, with a drive (N, 2 n)."""
        return np.concatenate([self.start, self.drive], axis=1) if self.drive.any() else self.start

    @property
    def scale(self) -> float:
        """What errors are measured by."""
        return float(np.linalg.norm(self.start)) + float(np.linalg.norm(self.drive)) or 1.0

    def at(self, values: FloatArray, index: int) -> FloatArray:
        """(k, n, columns): ``exp(M t)`` and, with a drive, ``int_0^t exp(M s) ds``, M the matrices of the modes."""
        observer, n = self.observer, self.start.shape[1]
        modes = mode_matrices(observer.agent.A, observer.injection, observer.agent.C, observer.gain * values)
        time = float(self.times[index])
        if not self.drive.any():
            return np.exp(modes * time) if n == 1 else exponentials(modes * time)
        block = np.zeros((values.shape[0], 2 * n, 2 * n))
        block[:, :n, :n], block[:, :n, n:] = modes, np.eye(n)
        return exponentials(block * time)[:, :n]

    def moved(self, values: FloatArray, coordinates: FloatArray, index: int) -> FloatArray:
        """(k, n) the coordinates of the error at a time, from those of the columns in the same eigenvectors."""
        return np.asarray((self.at(values, index) @ coordinates[:, :, None])[:, :, 0])


def moved(
    observer: DiffusiveObserver, graph: MeasurementGraph, error: FloatArray, times: FloatArray, tolerance: float
) -> tuple[list[FloatArray], float]:
    """The ``error`` (N, n) at later ``times``, by series and Krylov spaces; and the estimated error of that.

    Args:
        observer: its agents, gain and injection.
        graph: the part of its network that works.
        error, times: where it begins, and seconds after that.
        tolerance: relative to the norm of ``error``, as is the error estimate.
    """
    if not graph.n_arcs:
        return [error @ exponentials(observer.agent.A * time).T for time in times.tolist()], 0.0
    rows, engines = _large(_Functions(observer, graph, error, np.zeros_like(error), times), tolerance)
    return rows, engines.error


def _large(problem: _Functions, tolerance: float) -> tuple[list[FloatArray], Engines]:
    """Early times by series, the others by the engine that fits."""
    graph = problem.graph
    matrix, ceiling = graph.laplacian(), largest_eigenvalue_bound(graph)
    fits = widest_level(matrix) <= WIDEST
    indices = range(problem.times.shape[0])
    several: dict[int, chebyshev.Series] = {}
    for k in indices:
        function = partial(problem.at, index=k)
        found = chebyshev.series(function, ceiling, 0.5 * tolerance, SHORT if fits else LONG)
        if found is None:
            break
        several[k] = found
    late = [k for k in indices if k not in several]
    errors: dict[int, FloatArray] = {}
    gap, names = 0.0, []
    if several:
        rows = chebyshev.applied(matrix, ceiling, problem.columns, list(several.values()))
        errors.update(zip(several, rows, strict=True))
        gap, names = max(one.tail for one in several.values()), ["chebyshev"]
    if late:
        rows, change = _through_krylov(problem, late, ceiling, tolerance)
        errors.update(zip(late, rows, strict=True))
        gap, names = max(gap, change), [*names, "krylov"]
    return [errors[k] for k in indices], Engines(" and ".join(names), gap)


def _through_krylov(
    problem: _Functions, indices: list[int], ceiling: float, tolerance: float
) -> tuple[list[FloatArray], float]:
    """Grown pole by pole until a round over all poles changes no coordinate's sum by more than the tolerance."""
    matrix, columns = problem.graph.laplacian(), problem.columns
    space = RationalKrylov(matrix, columns)
    poles = _poles(problem, indices, ceiling)
    steps = _STEPS if matrix.shape[0] <= 200_000 else _STEPS_AGAIN
    last, change = [np.zeros((0, 0))] * len(indices), np.inf
    for _ in range(_ROUNDS):
        for pole in poles:
            space.grow(pole, steps)
        values, inner = space.ritz()
        coordinates = inner.T @ (space.basis.T @ columns)
        rows = [inner @ problem.moved(values, coordinates, k) for k in indices]
        change = max(_change(now, before) for now, before in zip(rows, last, strict=True)) / problem.scale
        last = rows
        if change < tolerance:
            break
    return [np.asarray(space.basis @ row) for row in last], change


def _change(now: FloatArray, before: FloatArray) -> float:
    """Norm of the difference, in coordinates of an orthonormal basis that has grown."""
    if not before.size:
        return np.inf
    size = before.shape[0]
    return float(np.hypot(np.linalg.norm(now[:size] - before), np.linalg.norm(now[size:])))


def _poles(problem: _Functions, indices: list[int], ceiling: float) -> list[float]:
    """Shifts of L that belong to the time scales asked for: one for every three decades of them."""
    observer = problem.observer
    pull = float(np.linalg.norm(observer.injection @ observer.agent.C, 2)) * observer.gain
    later = problem.times[indices]
    later = later[later > 0.0]
    if not later.size or pull == 0.0:
        return [1.0]
    low, high = (min(1.0 / (pull * float(time)), ceiling) for time in (later[-1], later[0]))
    count = int(np.log10(high / low) / 3.0) + 1
    return [float(low * (high / low) ** ((k + 0.5) / count)) for k in range(count)]
