"""Assembled observers in a run: stacked through sparse matrices, or program by program with messages in between."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalState
from trigpoint.simulation import lockstep
from trigpoint.simulation.events import EventRun
from trigpoint.simulation.exchanges import Recorded, Sampling, Start, Traffic, estimates_of, sampled
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress, Series, error_series
from trigpoint.simulation.world import World, padded, start_of, truth_of

_TOLERANCE = 1e-12


def run(observer: AssembledObserver, scenario: Scenario, path: str, progress: Progress) -> Recorded:
    """Truth and estimates at the scenario's times, for problems of any kind (nodes filled up to equal length)."""
    world = World.of(observer, scenario)
    period = scenario.period if scenario.period is not None else observer.period
    if period is None and observer.is_discrete:
        raise ArgumentError("this observer is a map from one exchange to the next: give the scenario a period")
    if period is not None and observer.period not in (None, period):
        raise ArgumentError(f"the observer was designed for a period of {observer.period:g} s; got {period:g} s")
    start = _start(observer, world, scenario)
    if period is None:
        continuous = _continuous if path == "stacked" else _continuous_reference
        truth, estimate, messages = continuous(observer, world, scenario, start)
        return Recorded(truth, estimate, Traffic(messages))
    if path == "stacked":
        return sampled(observer, world, scenario, Sampling(period, progress), start)
    if lockstep.is_plain(scenario):
        return lockstep.run(observer, world, scenario, Sampling(period, progress), start)
    return EventRun(observer, world, scenario, period, start).record(progress)


def _start(observer: AssembledObserver, world: World, scenario: Scenario) -> Start:
    """z = V (x + error): a node with more states than it estimates begins consistently."""
    given = scenario.initial_state if scenario.motion is None else scenario.motion.at(0.0).ravel()
    truth = truth_of(world, given)
    errors = start_of(world, "initial_error", scenario.initial_error)
    shown = world.shown(truth)
    return Start(truth, [observer.target(k) @ (x + e) for k, (x, e) in enumerate(zip(shown, errors, strict=True))])


def _continuous(observer: AssembledObserver, world: World, scenario: Scenario, start: Start) -> Series:
    """``e' = H e``, exactly or by an implicit method, as for equal agents."""
    V, times = observer.target_matrix(), scenario.times
    H = observer.error_matrix()
    constant = np.zeros(H.shape[0])
    if world.recorded is not None:
        constant = observer.general_form().K @ (world.recorded - world.channels.C @ start.truth)
    errors = error_series(H, constant, np.concatenate(start.values) - V @ start.truth, times)
    truths, estimates = [], []
    for time, error in zip(times.tolist(), errors, strict=True):
        truth = world.advance(start.truth, time)
        truths.append(padded(world.shown(truth)))
        estimates.append(estimates_of(observer, V @ truth + error, world.read(truth)))
    return np.stack(truths), np.stack(estimates), np.zeros((len(times), len(observer.nodes)), dtype=np.int64)


def _continuous_reference(observer: AssembledObserver, world: World, scenario: Scenario, start: Start) -> Series:
    """Every program's own derivative, by an explicit Runge-Kutta method (order 8, tolerance 1e-12)."""
    cuts = observer.states.starts[1:-1]

    def slope(time: float, stacked: FloatArray) -> FloatArray:
        readings = world.read(world.advance(start.truth, time))
        pairs = list(zip(observer.nodes, np.split(stacked, cuts), strict=True))
        states = {node.name: LocalState(time, 0, value) for node, value in pairs}
        messages = {node.name: node.emit(states[node.name]) for node, _ in pairs}
        return np.concatenate(
            [
                node.derivative(states[node.name], {name: messages[name] for name in node.hears}, readings, told)
                for (node, _), told in zip(pairs, world.inputs, strict=True)
            ]
        )

    value = np.concatenate(start.values)
    scale = max(float(np.abs(value).max(initial=0.0)), float(np.abs(start.truth).max(initial=0.0)), 1e-300)
    values, now = [], 0.0
    for time in scenario.times.tolist():
        if time > now:  # up to each output itself: what lies between two steps is interpolated, some digits worse
            solution = solve_ivp(slope, (now, time), value, method="DOP853", rtol=_TOLERANCE, atol=_TOLERANCE * scale)
            if not solution.success:
                raise ArgumentError(
                    f"the programs could not be integrated beyond {solution.t[-1]:g} s: {solution.message}"
                )
            value, now = solution.y[:, -1], time
        values.append(value)
    truths = [world.advance(start.truth, time) for time in scenario.times.tolist()]
    estimates = [estimates_of(observer, value, world.read(truth)) for truth, value in zip(truths, values, strict=True)]
    shown = np.stack([padded(world.shown(truth)) for truth in truths])
    return shown, np.stack(estimates), np.zeros(shown.shape[:2], dtype=np.int64)
