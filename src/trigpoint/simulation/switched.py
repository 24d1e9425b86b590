"""Continuous exchange with events or noise: exact between the instants at which something changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.modes import mode_matrices
from trigpoint.arrays import BoolArray, FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.exponentials import exponentials
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation import modal
from trigpoint.simulation.motion import Bouncing, Trajectory
from trigpoint.simulation.plant import Plant, noise_factor
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Series
from trigpoint.simulation.topology import is_away, with_absences

_JUST = 1e-9  # s, before an instant: the velocity with which an agent arrives at a wall


@dataclass(frozen=True, eq=False)
class _Modes:
    """Eigenpairs of one topology's generalized Laplacian, and the matrices of its modes."""

    values: FloatArray
    vectors: FloatArray
    matrices: FloatArray


def continuous(
    observer: DiffusiveObserver, plant: Plant, scenario: Scenario, truth: FloatArray, estimate: FloatArray
) -> tuple[Series, modal.Engines]:
    """Truth and estimates (T, N, n), and who computed them: every interval between changes by itself.

    Up to 1200 nodes by the exponentials of its own modes, noise drawn exactly. Above by the series and Krylov spaces of
    ``modal``, each to ``scenario.tolerance`` of the error at its begin; the run says the sum of all their estimates.

    We assume: equal agents, scalar weights. With noise, or a trajectory that the agents do not know, at most 1200
    nodes: a draw needs a square root of each step's covariance, which couples all nodes. With noise unit weights.

    Raises:
        ArgumentError: what is asked for does not split into modes, or needs all of a large network's.
    """
    _check(observer, scenario)
    error, x, now = estimate - truth, truth, 0.0
    small = observer.graph.n_nodes <= modal.ALL_MODES
    flow: _ThroughModes | _ThroughSpaces
    flow = _ThroughModes(observer, scenario) if small else _ThroughSpaces(observer, scenario, error)
    truths, estimates = [], []
    try:
        for time, is_output in _instants(scenario):
            if time > now:
                x, error = flow.go(x, error - _jump(scenario, now, time), now, time)
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
    return (np.stack(truths), table, np.zeros(table.shape[:2], dtype=np.int64)), flow.engines


def _check(observer: DiffusiveObserver, scenario: Scenario) -> None:
    if observer.graph.dimension > 1:
        raise ArgumentError("continuous exchange with changes or noise is for scalar weights; give a period")
    if observer.graph.n_nodes > modal.ALL_MODES:
        unknown = isinstance(scenario.motion, Trajectory) and not scenario.motion.known
        noise = scenario.noise
        if unknown or (noise is not None and max(noise.measurement, noise.process) > 0.0):
            what = "a trajectory that the agents do not know" if unknown else "noise"
            raise ArgumentError(
                f"{what} under continuous exchange needs all modes of the network: at most {modal.ALL_MODES} nodes, "
                f"got {observer.graph.n_nodes}; give a period, as sampled runs of any size have it"
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


def _modes(observer: DiffusiveObserver, graph: MeasurementGraph) -> _Modes:
    values, vectors = la.eigh(graph.laplacian().toarray())
    values = np.maximum(values, 0.0)
    agent = observer.agent
    return _Modes(values, vectors, mode_matrices(agent.A, observer.injection, agent.C, observer.gain * values))


class _Network:
    """Which part of the network works when."""

    def __init__(self, observer: DiffusiveObserver, scenario: Scenario) -> None:
        self._graph = observer.graph
        self._topology = with_absences(observer.graph, scenario.topology, scenario.absences)
        self._whole = np.ones(observer.graph.n_arcs, dtype=bool)

    def active(self, time: float) -> BoolArray:
        """(M,) the arcs that work from ``time`` on."""
        return self._whole if self._topology is None else self._topology.at(time)

    def graph(self, active: BoolArray) -> MeasurementGraph:
        """The network of these arcs."""
        return self._graph if active.all() else self._graph.without_arcs(np.flatnonzero(~active))


class _ThroughSpaces:
    """Intervals without noise, of large networks: all outputs before the next change in one go."""

    def __init__(self, observer: DiffusiveObserver, scenario: Scenario, error: FloatArray) -> None:
        self._observer, self._tolerance = observer, scenario.tolerance
        self._network = _Network(observer, scenario)
        self._scale = float(np.linalg.norm(error)) or 1.0
        instants = list(_instants(scenario))
        self._changes = np.array([time for time, is_output in instants if not is_output] + [np.inf])
        self._times = np.unique([time for time, _ in instants])
        self._ahead: dict[float, FloatArray] = {}
        self._gap = 0.0

    @property
    def engines(self) -> modal.Engines:
        """Series and spaces, and the sum of what each interval's may be wrong by."""
        return modal.Engines("chebyshev and krylov, interval by interval", self._gap)

    def go(self, x: FloatArray, error: FloatArray, before: float, now: float) -> tuple[FloatArray, FloatArray]:
        """Error at ``now``, from that at ``before``; the truth ``x`` as it was."""
        if now not in self._ahead:
            change = self._changes[np.searchsorted(self._changes, before, side="right")]
            times = self._times[(self._times > before) & (self._times <= change)]
            graph = self._network.graph(self._network.active(before))
            rows, gap = modal.moved(self._observer, graph, error, times - before, self._tolerance)
            self._ahead = dict(zip(times.tolist(), rows, strict=True))
            self._gap += gap * float(np.linalg.norm(error)) / self._scale
        return x, self._ahead[now]


class _ThroughModes:
    """Intervals by the exponentials of all modes, with the noise of truth and error together."""

    engines = modal.Engines("eigenpairs", 1e-12)

    def __init__(self, observer: DiffusiveObserver, scenario: Scenario) -> None:
        self._observer, self._scenario, noise = observer, scenario, scenario.noise
        self._noise = (0.0, 0.0) if noise is None else (noise.measurement, noise.process)
        self._network, self._rng = _Network(observer, scenario), np.random.default_rng(scenario.seed)
        self._known: dict[bytes, _Modes] = {}
        self._factors: dict[tuple[int, float], FloatArray] = {}

    def go(self, x: FloatArray, error: FloatArray, before: float, now: float) -> tuple[FloatArray, FloatArray]:
        """Error at ``now``, from that at ``before``; the truth with its noise."""
        modes, duration = self._modes(self._network.active(before)), now - before
        moved = exponentials(modes.matrices * duration) @ (modes.vectors.T @ error)[:, :, None]
        error = modes.vectors @ moved[:, :, 0]
        if any(self._noise):
            agent, n = self._observer.agent, error.shape[1]
            factors = self._of(modes, round(duration, 12))
            drawn = (factors @ self._rng.standard_normal((error.shape[0], factors.shape[2], 1)))[:, :, 0]
            x = x @ exponentials(agent.A * duration).T + modes.vectors @ drawn[:, :n]
            error = error + modes.vectors @ drawn[:, n:]
        return x, error - _surprise(self._observer, modes, self._scenario, before, now)

    def _modes(self, active: BoolArray) -> _Modes:
        key = active.tobytes()
        if key not in self._known:
            if len(self._known) > 256:
                self._known.clear()
            self._known[key] = _modes(self._observer, self._network.graph(active))
        return self._known[key]

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
