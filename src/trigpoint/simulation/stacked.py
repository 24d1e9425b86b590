"""The stacked path: all nodes at once, through sparse matrices."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.integrate import solve_ivp

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import ArgumentError
from trigpoint.linalg.blocks import expand
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation.clockwork import Tick, ticks
from trigpoint.simulation.plant import Disturbances, Plant
from trigpoint.simulation.scenario import Scenario

Progress = Callable[[Iterable[Tick]], Iterable[Tick]]
DENSE_LIMIT = 1500

Series = tuple[FloatArray, FloatArray, IntArray]
"""(T, N, n) truth, (T, N, n) estimate, (T, N) messages sent."""


def continuous(
    observer: DiffusiveObserver, plant: Plant, scenario: Scenario, truth: FloatArray, estimate: FloatArray
) -> Series:
    """Continuous exchange. The error obeys ``e' = H e + K d``, d the constant error of recorded readings.

    Up to 1500 states by matrix exponentials of the steps between the output times (exact to rounding); above by an
    implicit Runge-Kutta method (Radau, relative tolerance 1e-10) with the sparse Jacobian H.
    """
    H = observer.error_matrix()
    constant = constant_error(observer, plant, truth)
    start = (estimate - truth).ravel()
    errors = error_series(H, constant, start, scenario.times)
    states = np.stack([plant.advance(truth, time) for time in scenario.times.tolist()])
    table = errors.reshape(scenario.times.shape[0], *truth.shape)
    return states, states + table, np.zeros(table.shape[:2], dtype=np.int64)


def constant_error(observer: DiffusiveObserver, plant: Plant, truth: FloatArray) -> FloatArray:
    """``K d`` (N n,), d the constant error of recorded readings; zero without."""
    if plant.recorded is None:
        return np.zeros(truth.size)
    offset = plant.recorded - (plant.output @ truth.ravel()).reshape(plant.readings_shape)
    return np.asarray(observer.reading_matrix() @ offset.ravel())


def error_series(H: sp.csr_array, constant: FloatArray, start: FloatArray, times: FloatArray) -> FloatArray:
    """(T, n) solution of ``e' = H e + constant`` at ``times``: by exponentials up to 1500 states, above by Radau."""
    solve = _by_exponentials if H.shape[0] <= DENSE_LIMIT else _by_radau
    return solve(H, constant, start, times)


def _by_exponentials(H: sp.csr_array, constant: FloatArray, start: FloatArray, times: FloatArray) -> FloatArray:
    n = start.shape[0]
    generator = np.zeros((n + 1, n + 1))
    generator[:n, :n], generator[:n, n] = H.toarray(), constant
    state, now, errors = np.append(start, 1.0), 0.0, []
    maps: dict[float, FloatArray] = {}
    for time in times.tolist():
        step = float(f"{time - now:.12g}")  # equal steps of a time axis differ in their last digits only
        if step not in maps:
            maps[step] = la.expm(generator * step)
        state, now = maps[step] @ state, time
        errors.append(state[:n])
    return np.stack(errors)


def _by_radau(H: sp.csr_array, constant: FloatArray, start: FloatArray, times: FloatArray) -> FloatArray:
    scale = float(np.abs(start).max(initial=0.0)) + float(np.abs(constant).max(initial=0.0)) or 1.0
    solution = solve_ivp(
        lambda _, e: H @ e + constant,
        (0.0, float(times[-1]) or 1.0),
        start,
        method="Radau",
        jac=sp.csc_matrix(H),
        t_eval=times,
        rtol=1e-10,
        atol=1e-13 * scale,
    )
    if not solution.success:
        raise ArgumentError(f"the error dynamics could not be integrated over {times[-1]:g} s: {solution.message}")
    return np.asarray(solution.y.T)


def sampled(
    observer: DiffusiveObserver,
    plant: Plant,
    scenario: Scenario,
    truth: FloatArray,
    estimate: FloatArray,
    progress: Progress,
) -> Series:
    """Exchange every ``period``: neighbours' values and readings are held in between (theory 6-F2).

    Ctrl-C keeps what there is.
    """
    period = scenario.period or 0.0
    disturbances = Disturbances.of(plant.problem, scenario)
    correct, maps = _innovation(observer), _Maps(observer, plant)
    states, estimates, sent = [], [], []
    degree = _neighbour_counts(observer)
    try:
        for tick in progress(ticks(scenario.times, period)):
            readings = plant.read(truth, disturbances.of_readings())
            innovation = correct(readings, estimate)
            for _, after in tick.outputs:
                states.append(plant.advance(truth, after))
                estimates.append(maps.step(estimate, innovation, after))
                sent.append((tick.number + (after > 0.0)) * degree)
            estimate = maps.step(estimate, innovation, period)
            truth = plant.advance(truth, period, disturbances.of_process())
    except KeyboardInterrupt:
        if not sent:
            raise
    return whole(states, estimates, sent)


def _neighbour_counts(observer: DiffusiveObserver) -> IntArray:
    """(N,) how many neighbours each node tells; parallel arcs join the same two."""
    graph = observer.graph
    inner = np.flatnonzero(~graph.is_external)
    ends = np.sort(np.stack([graph.tail[inner], graph.head[inner]]), axis=0)
    pairs = np.unique(np.ravel_multi_index((ends[0], ends[1]), (graph.n_nodes, graph.n_nodes)))
    return np.bincount(np.concatenate(np.divmod(pairs, graph.n_nodes)), minlength=graph.n_nodes)


def whole(states: list[FloatArray], estimates: list[FloatArray], sent: list[IntArray]) -> Series:
    """One table each, of as many times as all three have: a run that was ended keeps what it had."""
    kept = min(len(states), len(estimates), len(sent))
    return np.stack(states[:kept]), np.stack(estimates[:kept]), np.stack(sent[:kept])


def _innovation(observer: DiffusiveObserver) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Weighted sum of each node's innovations, (N p,): ``(G W (x) I)(y - (G^T (x) C_1) z)``."""
    p = observer.problem.n_outputs
    weight = observer.graph.arc_weights
    differences = expand(observer.graph.incidence(), p)
    output = observer.problem.stacked_output()

    def correct(readings: FloatArray, estimate: FloatArray) -> FloatArray:
        residual = readings - (output @ estimate.ravel()).reshape(readings.shape)
        if observer.graph.dimension == 1:
            weighted = weight.reshape(-1, 1) * residual
        else:
            weighted = np.einsum("kij,kj->ki", weight, residual)
        return np.asarray(differences @ weighted.ravel())

    return correct


class _Maps:
    """Steps of given durations, each map assembled once."""

    def __init__(self, observer: DiffusiveObserver, plant: Plant) -> None:
        self._observer = observer
        self._plant = plant
        self._known: dict[float, tuple[sp.csr_array, sp.csr_array]] = {}

    def step(self, estimate: FloatArray, innovation: FloatArray, duration: float) -> FloatArray:
        if duration == 0.0:
            return estimate
        if duration not in self._known:
            if len(self._known) > 64:
                self._known.clear()
            self._known[duration] = self._observer.sampled_maps(duration)
        transition, correction = self._known[duration]
        moved = transition @ estimate.ravel() + correction @ innovation
        free = self._plant.advance(np.zeros_like(estimate), duration)
        return np.asarray(moved.reshape(estimate.shape) + free)
