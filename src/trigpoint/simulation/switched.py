"""Continuous exchange with events or noise: exact between the instants at which something changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.modes import mode_matrices
from trigpoint.arrays import BoolArray, FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.linalg.exponentials import exponentials
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation.motion import Bouncing, Trajectory
from trigpoint.simulation.plant import Plant, noise_factor
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Series
from trigpoint.simulation.topology import is_away, with_absences

MODES_LIMIT = 1200
_JUST = 1e-9  # s, before an instant: the velocity with which an agent arrives at a wall


@dataclass(frozen=True, eq=False)
class _Modes:
    """Eigenpairs of one topology's generalized Laplacian, and the matrices of its modes."""

    values: FloatArray
    vectors: FloatArray
    matrices: FloatArray


def continuous(
    observer: DiffusiveObserver, plant: Plant, scenario: Scenario, truth: FloatArray, estimate: FloatArray
) -> Series:
    """Truth and estimates (T, N, n): every interval by the exponentials of its own modes; noise drawn exactly.

    We assume: equal agents, scalar weights, at most 1200 nodes; with noise unit weights.

    Raises:
        ArgumentError: what is asked for does not split into modes.
    """
    _check(observer, scenario)
    topology = with_absences(observer.graph, scenario.topology, scenario.absences)
    rng, error, x, now = np.random.default_rng(scenario.seed), estimate - truth, truth, 0.0
    cache: dict[bytes, _Modes] = {}
    whole = np.ones(observer.graph.n_arcs, dtype=bool)
    step = _Step(observer, scenario)
    truths, estimates = [], []
    try:
        for time, is_output in _instants(scenario):
            if time > now:
                modes = _modes(observer, whole if topology is None else topology.at(now), cache)
                x, error = step.go(modes, x, error - _jump(scenario, now, time), time - now, rng)
                error = error - _surprise(observer, modes, scenario, now, time)
                x = _truth_at(plant, scenario, truth, x, time)
                error = _returned(scenario, x, error, now, time)
                now = time
            if is_output:
                truths.append(x)
                estimates.append(_hidden(scenario, x + error, time))
    except KeyboardInterrupt:
        if not estimates:
            raise
        truths = truths[: len(estimates)]
    table = np.stack(estimates)
    return np.stack(truths), table, np.zeros(table.shape[:2], dtype=np.int64)


def _check(observer: DiffusiveObserver, scenario: Scenario) -> None:
    if observer.graph.dimension > 1 or observer.graph.n_nodes > MODES_LIMIT:
        raise ArgumentError(
            f"continuous exchange with changes or noise is for scalar weights and at most {MODES_LIMIT} nodes; give a "
            "period"
        )
    if scenario.measurements is not None:
        raise ArgumentError("recorded measurements belong to a fixed topology without noise")
    if scenario.noise is not None and not (observer.graph.arc_weights == 1.0).all():
        raise ArgumentError("noise under continuous exchange is drawn mode by mode: unit weights, or give a period")
    if scenario.topology is not None and scenario.topology.active.shape[1] != observer.graph.n_arcs:
        raise ArgumentError(
            f"the topology switches {scenario.topology.active.shape[1]} arcs; the network has {observer.graph.n_arcs}"
        )


def _instants(scenario: Scenario) -> Iterator[tuple[float, bool]]:
    """Changes and outputs in order."""
    outputs = scenario.times.tolist()
    changes = set() if scenario.topology is None else set(scenario.topology.times.tolist())
    for one in scenario.absences:
        changes |= {one.start, one.stop}
    last, motion = outputs[-1], scenario.motion
    if isinstance(motion, Bouncing) and not motion.known:
        changes.update(motion.bounces(last).tolist())
    if isinstance(motion, Trajectory) and not motion.known:
        changes.update(motion.times.tolist())
    return iter(sorted({(t, False) for t in changes if 0.0 < t < last} | {(t, True) for t in outputs}))


def _modes(observer: DiffusiveObserver, active: BoolArray, cache: dict[bytes, _Modes]) -> _Modes:
    key = active.tobytes()
    if key not in cache:
        if len(cache) > 256:
            cache.clear()
        graph = observer.graph if active.all() else observer.graph.without_arcs(np.flatnonzero(~active))
        values, vectors = la.eigh(graph.laplacian().toarray())
        values = np.maximum(values, 0.0)
        agent = observer.agent
        cache[key] = _Modes(
            values, vectors, mode_matrices(agent.A, observer.injection, agent.C, observer.gain * values)
        )  # fmt: skip
    return cache[key]


class _Step:
    """One interval: exponentials mode by mode, and the noise of truth and error together."""

    def __init__(self, observer: DiffusiveObserver, scenario: Scenario) -> None:
        self._observer, noise = observer, scenario.noise
        self._noise = (0.0, 0.0) if noise is None else (noise.measurement, noise.process)
        self._factors: dict[tuple[int, float], FloatArray] = {}

    def go(
        self, modes: _Modes, x: FloatArray, error: FloatArray, duration: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Error after ``duration``; the truth with its noise."""
        moved = exponentials(modes.matrices * duration) @ (modes.vectors.T @ error)[:, :, None]
        error = modes.vectors @ moved[:, :, 0]
        if not any(self._noise):
            return x, error
        agent, n = self._observer.agent, error.shape[1]
        factors = self._of(modes, round(duration, 12))
        drawn = (factors @ rng.standard_normal((error.shape[0], factors.shape[2], 1)))[:, :, 0]
        free = x @ exponentials(agent.A * duration).T
        return free + modes.vectors @ drawn[:, :n], error + modes.vectors @ drawn[:, n:]

    def _of(self, modes: _Modes, duration: float) -> FloatArray:
        key = (id(modes), duration)
        if key not in self._factors:
            if len(self._factors) > 64:
                self._factors.clear()
            observer, (measurement, process) = self._observer, self._noise
            A, n = observer.agent.A, observer.agent.n_states
            E = process * (np.eye(n) if observer.agent.E is None else observer.agent.E)
            rows = []
            for value, M in zip(modes.values.tolist(), modes.matrices, strict=True):
                pull = measurement * observer.gain * np.sqrt(value) * observer.injection
                entry = np.block([[E, np.zeros((n, pull.shape[1]))], [-E, pull]])
                rows.append(noise_factor(la.block_diag(A, M), entry, duration))
            self._factors[key] = np.stack(rows)
        return self._factors[key]


def _truth_at(plant: Plant, scenario: Scenario, start: FloatArray, x: FloatArray, time: float) -> FloatArray:
    if scenario.motion is not None:
        return scenario.motion.at(time)
    noisy = scenario.noise is not None and scenario.noise.process > 0.0
    if not noisy:
        return plant.advance(start, time)
    if plant.inputs is not None:
        raise ArgumentError("process noise under continuous exchange is for agents without inputs; give a period")
    return x


def _jump(scenario: Scenario, before: float, now: float) -> FloatArray | float:
    """What reflections at the instant ``before`` did to the velocities; ``now`` is the interval's end.

    They count in the interval that begins with them, so that both ends are read just inside of an interval.
    """
    motion = scenario.motion
    if not isinstance(motion, Bouncing) or motion.known:
        return 0.0
    middle, earlier = motion.at(0.5 * (before + now)), motion.at(max(before - _JUST, 0.0))
    d = motion.position.shape[1]
    return np.concatenate([np.zeros_like(middle[:, :d]), middle[:, d:] - earlier[:, d:]], axis=1)


def _surprise(
    observer: DiffusiveObserver, modes: _Modes, scenario: Scenario, before: float, now: float
) -> FloatArray | float:
    """``int e^{H (now - s)} (x'(s) - A x(s)) ds`` of an unknown motion on a straight line, all since ``before``."""
    motion = scenario.motion
    if not isinstance(motion, Trajectory) or motion.known:
        return 0.0
    duration, first = now - before, motion.at(before)
    speed = (motion.at(now) - first) / duration
    count, n = first.shape
    block = np.zeros((count, 3 * n, 3 * n))
    block[:, :n, :n], block[:, :n, n : 2 * n], block[:, :n, 2 * n :] = modes.matrices, -observer.agent.A, np.eye(n)
    block[:, n : 2 * n, 2 * n :] = np.eye(n)
    given = modes.vectors.T @ np.concatenate([np.zeros_like(first), first, speed], axis=1)
    return np.asarray(modes.vectors @ (exponentials(block * duration) @ given[:, :, None])[:, :n, 0])


def _returned(scenario: Scenario, x: FloatArray, error: FloatArray, before: float, now: float) -> FloatArray:
    """A node that comes back starts with an empty state."""
    for one in scenario.absences:
        if is_away(scenario.absences, one.node, before) and not is_away(scenario.absences, one.node, now):
            error = error.copy()
            error[one.node] = -x[one.node]
    return error


def _hidden(scenario: Scenario, estimate: FloatArray, time: float) -> FloatArray:
    away = [one.node for one in scenario.absences if is_away(scenario.absences, one.node, time)]
    if away:
        estimate = estimate.copy()
        estimate[away] = np.nan
    return estimate
