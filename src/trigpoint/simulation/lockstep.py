"""The reference path where nothing goes wrong: all programs act together, and everybody hears everybody at once."""

from __future__ import annotations

import numpy as np

from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalState
from trigpoint.simulation.channel import Channel
from trigpoint.simulation.clockwork import Tick, ticks
from trigpoint.simulation.exchanges import Readings, Recorded, Sampling, Start, estimates_of, traffic_of
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.world import World, drawn_from, padded


def is_plain(scenario: Scenario) -> bool:
    """True where one clock, whole links and a free motion leave nothing to the agenda of ``events``."""
    channel = scenario.channel or Channel()
    rounded = channel.delay > 0.0 or channel.quantum > 0.0 or channel.span is not None
    return not (scenario.needs_events or scenario.motion is not None or rounded)


def run(observer: AssembledObserver, world: World, scenario: Scenario, how: Sampling, start: Start) -> Recorded:
    """Every program steps by itself; noise is drawn in the order of the other paths. Ctrl-C keeps what there is."""
    course = _Course(observer, world, scenario, how, start)
    try:
        for tick in how.progress(ticks(scenario.times, how.period)):
            course.through(tick)
    except KeyboardInterrupt:
        if not course.estimates:
            raise
    kept = len(course.estimates)
    traffic = traffic_of(observer, scenario, course.counts[:kept], how.period)
    return Recorded(np.stack(course.truths[:kept]), np.stack(course.estimates), traffic)


class _Course:
    def __init__(
        self, observer: AssembledObserver, world: World, scenario: Scenario, how: Sampling, start: Start
    ) -> None:
        self._observer, self._world, self._period = observer, world, how.period
        self._rng, self._truth = np.random.default_rng(scenario.seed), start.truth
        pairs = zip(observer.nodes, start.values, strict=True)
        self._states = [node.init(value) for node, value in pairs]
        noise = scenario.noise
        self._deviation, process = (0.0, 0.0) if noise is None else (noise.measurement, noise.process)
        self._factors = [] if process == 0.0 else world.noise_factors(process, how.period)
        self.truths: list[np.ndarray] = []
        self.estimates: list[np.ndarray] = []
        self.counts: list[tuple[int, float]] = []

    def through(self, tick: Tick) -> None:
        """Outputs on the exchange, the exchange, outputs after it, and on to the next one."""
        world, observer, size = self._world, self._observer, self._world.channels.C.shape[0]
        readings = world.read(
            self._truth, self._deviation * self._rng.standard_normal(size) if self._deviation else None
        )
        messages = {node.name: node.emit(state) for node, state in zip(observer.nodes, self._states, strict=True)}

        def later(duration: float) -> list[LocalState]:
            return [
                node.step(state, messages, readings, duration, told)
                for node, state, told in zip(observer.nodes, self._states, world.inputs, strict=True)
            ]

        done = 0.0
        for _, late in tick.outputs:
            done = self._moved(done, late)
            shown = self._states if late == 0.0 or observer.is_discrete else later(late)
            self._keep(shown, readings if late == 0.0 else world.read(self._truth), (tick.number, late))
        self._states = later(self._period)
        self._moved(done, self._period)
        if self._factors:
            self._truth = self._truth + drawn_from(self._factors, self._rng)

    def _moved(self, done: float, until: float) -> float:
        """Move the truth from ``done`` to ``until`` seconds after the exchange; a map moves with the exchange only."""
        if self._world.is_map and until < self._period:
            return done
        self._truth = self._world.advance(self._truth, until - done)
        return until

    def _keep(self, states: list[LocalState], readings: Readings, when: tuple[int, float]) -> None:
        self.truths.append(padded(self._world.shown(self._truth)))
        stacked = np.concatenate([state.estimate for state in states])
        self.estimates.append(estimates_of(self._observer, stacked, readings))
        self.counts.append(when)
