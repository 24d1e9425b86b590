"""The event-driven reference path: each program by itself, acting by its own clock, with messages on their way.

The oracle of the faster paths, and the only one for losses, jitter, clocks that differ, absences and triggers.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from trigpoint.arrays import BoolArray, FloatArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalObserver, LocalState, Message
from trigpoint.simulation.channel import Channel, Trigger
from trigpoint.simulation.clocks import Clock, Clocks
from trigpoint.simulation.clockwork import Tick
from trigpoint.simulation.exchanges import Recorded, Start, Traffic, estimates_of
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress
from trigpoint.simulation.topology import is_away
from trigpoint.simulation.wire import Wire
from trigpoint.simulation.world import World, drawn_from, padded

_SNAP = 1e-9


@dataclass(eq=False)
class _Node:
    """A program and what it remembers between two of its acts.

    ``sources`` are the nodes that it hears, each with the age [s] from which on its message is left out.
    """

    index: int
    program: LocalObserver
    clock: Clock
    acts: Iterator[float]
    told: FloatArray | None
    state: LocalState
    inbox: dict[str, Message]
    readings: dict[int, FloatArray]
    heard: dict[str, Message]
    last_act: float = 0.0
    last_sent: Message | None = None
    away: bool = False
    place: FloatArray = field(default_factory=lambda: np.zeros(0))
    sources: tuple[tuple[str, _Node, float], ...] = ()

    @property
    def known(self) -> FloatArray | None:
        """The input that it can use: None where it has no B."""
        return None if self.program.B is None else self.told

    def at(self, time: float) -> LocalState:
        """Its state at the true ``time``, from what it knew at its last act."""
        elapsed = (1.0 + self.clock.drift) * (time - self.last_act)
        if elapsed <= _SNAP * self.clock.period or self.away:
            return self.state
        if abs(elapsed - self.clock.period) <= _SNAP * self.clock.period:
            elapsed = self.clock.period  # equal steps of a time axis differ in their last digits only
        return self.program.step(self.state, self.inbox, self.readings, elapsed, self.told)


class EventRun:
    """One run; ``record`` goes through the output times.

    Args:
        observer, world, scenario, period, start: what runs, in which world, from where.
    """

    def __init__(
        self, observer: AssembledObserver, world: World, scenario: Scenario, period: float, start: Start
    ) -> None:
        self._observer, self._world, self._scenario = observer, world, scenario
        self._period = period
        self._rng = np.random.default_rng(scenario.seed)
        self._channel = scenario.channel or Channel()
        self._truth, self._now = start.truth, 0.0
        clocks = (scenario.clocks or Clocks()).of(len(observer.nodes), period)
        self._nodes = [
            _Node(
                k, node, clocks[k], clocks[k].acts(self._rng), world.inputs[k], node.init(value), {}, {}, {}
            )
            for k, (node, value) in enumerate(zip(observer.nodes, start.values, strict=True))
        ]  # fmt: skip
        self._position = {node.name: k for k, node in enumerate(observer.nodes)}
        links = [(self._position[name], k) for k, node in enumerate(observer.nodes) for name in node.hears]
        _check_outages(self._channel, links, observer)
        self._wire = Wire(links, self._channel, self._rng, len(observer.nodes))
        for node in self._nodes:
            senders = [(name, self._nodes[self._position[name]]) for name in node.program.hears]
            node.sources = tuple((name, sender, self._oldest(sender)) for name, sender in senders)
        self._agenda = [(next(node.acts), node.index) for node in self._nodes]
        heapq.heapify(self._agenda)
        self._noise = (0.0, 0.0) if scenario.noise is None else (scenario.noise.measurement, scenario.noise.process)
        self._factors: dict[float, list[FloatArray]] = {}
        self._opened: tuple[bytes, set[tuple[int, int]]] | None = None
        if scenario.motion is not None:
            self._seen = world.shown(self._truth)
            for node in self._nodes:
                node.place = self._seen[node.index]

    def record(self, progress: Progress) -> Recorded:
        """Run to the last output time; Ctrl-C keeps what was computed."""
        truths: list[FloatArray] = []
        estimates: list[FloatArray] = []
        traffic: list[list[list[int]]] = []
        try:
            for tick in progress(self._instants()):
                for index, _ in tick.outputs:
                    truths.append(padded(self._world.shown(self._truth)))
                    estimates.append(self._estimates(float(self._scenario.times[index])))
                    traffic.append(self._counts())
        except KeyboardInterrupt:
            if not truths:
                raise
        kept = len(estimates)
        counts = np.array(traffic[:kept], dtype=np.int64)
        table = Traffic(counts[:, 0], counts[:, 1], counts[:, 2])
        return Recorded(np.stack(truths[:kept]), np.stack(estimates), table)

    def _instants(self) -> Iterator[Tick]:
        """Every act and every output in order; outputs see the state before the act of the same instant speaks."""
        times, position, number = self._scenario.times.tolist(), 0, 0
        while position < len(times):
            due = self._agenda[0][0]
            slack = _SNAP * self._period
            if times[position] < due - slack:
                if not self._world.is_map:  # a map says nothing about the time between two exchanges
                    self._move(times[position])
                yield Tick(number, ((position, 0.0),), self._now / (times[-1] or 1.0))
                position += 1
                continue
            acting = []
            while self._agenda and self._agenda[0][0] <= due + slack * 1e-3:
                acting.append(self._nodes[heapq.heappop(self._agenda)[1]])
            acting.sort(key=lambda node: node.index)
            self._move(due)
            for node in acting:
                self._settle(node, due)
            outputs = []
            while position < len(times) and times[position] <= due + slack:
                outputs.append((position, 0.0))
                position += 1
            yield Tick(number, tuple(outputs), min(due / (times[-1] or 1.0), 1.0))
            self._exchange(acting, due)
            for node in acting:
                heapq.heappush(self._agenda, (max(next(node.acts), due + 1e-3 * self._period), node.index))
            number += 1

    def _move(self, time: float) -> None:
        """The truth moves on, with its noise, or as its motion is given."""
        duration = time - self._now
        if duration <= 0.0:
            return
        if abs(duration - self._period) <= _SNAP * self._period:
            duration = self._period  # equal steps of a time axis differ in their last digits only
        drawn = None
        if self._scenario.motion is not None:
            self._truth = self._scenario.motion.at(time).ravel()
            self._seen = self._world.shown(self._truth)
        else:
            if self._noise[1]:
                drawn = drawn_from(self._factors_of(duration), self._rng)
            self._truth = self._world.advance(self._truth, duration, drawn)
        self._now = time

    def _state(self, node: _Node, time: float) -> LocalState:
        """The node's state now; what a given motion adds to its free motion is known to it."""
        state = node.at(time)
        motion = self._scenario.motion
        if motion is None or not motion.known or node.away or time <= node.last_act:
            return state
        free = node.program.moved(node.place, time - node.last_act, node.known)
        return LocalState(state.time, state.sequence, frozen(state.estimate + self._seen[node.index] - free))

    def _factors_of(self, duration: float) -> list[FloatArray]:
        key = round(duration, 12)
        if key not in self._factors:
            if len(self._factors) > 64:
                self._factors.clear()
            self._factors[key] = self._world.noise_factors(self._noise[1], duration)
        return self._factors[key]

    def _settle(self, node: _Node, time: float) -> None:
        """The node's state is now what its last exchange led to; a node that comes back starts empty."""
        absences = self._scenario.absences
        away = bool(absences) and is_away(absences, node.index, time)
        if node.away and not away:
            node.state = LocalState(time, node.state.sequence + 1, frozen(np.zeros(node.program.n_states)))
            node.heard, node.last_sent = {}, None
        elif not away:
            node.state = self._state(node, time)
        node.away, node.last_act = away, time
        if self._scenario.motion is not None:
            node.place = self._seen[node.index]

    def _exchange(self, acting: list[_Node], time: float) -> None:
        """Those who act speak; then what has arrived is heard, and everybody reads its own instruments."""
        messages = {
            node.index: said for node in acting if not node.away and (said := self._said(node, time)) is not None
        }
        active = None if self._scenario.topology is None else self._scenario.topology.at(time)
        self._wire.send(time, messages, self._open(active), self._place())
        for receiver, message in self._wire.arrivals(time):
            heard = self._nodes[receiver].heard
            known = heard.get(message.sender)
            if known is None or message.sequence > known.sequence:
                heard[message.sender] = message
        deviation = self._noise[0]
        noise = deviation * self._rng.standard_normal(self._world.channels.C.shape[0]) if deviation else None
        reading = [node for node in acting if not node.away]
        labels = {label for node in reading for label in node.program.reads if active is None or active[label]}
        readings = self._world.read(self._truth, noise, labels)
        moved: dict[tuple[Message, float], Message] = {}
        for node in reading:
            node.readings = {label: readings[label] for label in node.program.reads if label in readings}
            node.inbox = self._inbox(node, time, moved)

    def _place(self) -> FloatArray:
        """True states (N, n), where losses depend on them."""
        return padded(self._world.shown(self._truth)) if self._channel.reach is not None else np.zeros((0, 0))

    def _said(self, node: _Node, time: float) -> Message | None:
        state = node.state
        message = Message(node.program.name, state.sequence, node.clock.shows(time), state.estimate)
        trigger = self._scenario.trigger
        if trigger is not None and node.last_sent is not None and not self._worth(trigger, node, message, time):
            return None
        node.last_sent = message
        return message

    def _worth(self, trigger: Trigger, node: _Node, message: Message, time: float) -> bool:
        picture = node.last_sent
        assert picture is not None  # asked before
        value = picture.estimate
        if self._channel.old == "propagate":
            value = node.program.moved(value, message.time - picture.time, node.known)
        gap = float(np.linalg.norm(message.estimate - value))
        return gap > trigger.size * float(np.exp(-trigger.rate * time))

    def _open(self, active: BoolArray | None) -> set[tuple[int, int]]:
        """Links that carry messages now: neither end away, some arc between them working."""
        key = b"" if active is None else active.tobytes()
        if self._opened is None or self._opened[0] != key:
            names: dict[str, int] = self._position
            found: set[tuple[int, int]] = set()
            for k, node in enumerate(self._observer.nodes):
                for arc in node.arcs:
                    if active is None or arc.label is None or active[arc.label]:
                        found.update((names[name], k) for name, _ in arc.heard)
            self._opened = (key, found)
        away = {node.index for node in self._nodes if node.away} if self._scenario.absences else None
        return {link for link in self._opened[1] if not away.intersection(link)} if away else self._opened[1]

    def _oldest(self, sender: _Node) -> float:
        """The age from which on a message of the ``sender`` is left out: the policy for old ones."""
        channel = self._channel
        if channel.old == "drop":
            return (1.0 - _SNAP) * sender.clock.period + channel.delay + channel.jitter
        return np.inf if channel.stale is None else channel.stale * (1.0 + _SNAP)

    def _inbox(self, node: _Node, time: float, moved: dict[tuple[Message, float], Message]) -> dict[str, Message]:
        """What the node makes of the last messages it heard; many hear the same one, so that it is ``moved`` once."""
        found, now, propagates = {}, node.clock.shows(time), self._channel.old == "propagate"
        for name, sender, oldest in node.sources:
            message = node.heard.get(name)
            if message is None or now - message.time > oldest:
                continue
            if propagates and message.time < now:
                key = (message, now)
                if key not in moved:
                    value = sender.program.moved(message.estimate, now - message.time, sender.known)
                    value.setflags(write=False)
                    moved[key] = Message(message.sender, message.sequence, now, value)
                message = moved[key]
            found[name] = message
        return found

    def _estimates(self, time: float) -> FloatArray:
        """What every node believes now; NaN for one that is away."""
        discrete = self._observer.is_discrete
        values = [node.state if discrete else self._state(node, time) for node in self._nodes]
        readings = self._world.read(self._truth)
        table = estimates_of(self._observer, np.concatenate([state.estimate for state in values]), readings)
        for node in self._nodes:
            if node.away:
                table[node.index] = np.nan
        return table

    def _counts(self) -> list[list[int]]:
        return [list(table) for table in (self._wire.sent, self._wire.delivered, self._wire.bytes)]


def _check_outages(channel: Channel, links: list[tuple[int, int]], observer: AssembledObserver) -> None:
    """An outage of what is no link would be a slip that nobody notices."""
    known = set(links)
    for link in (link for outage in channel.outages for link in outage.links or () if link not in known):
        if not all(0 <= node < len(observer.nodes) for node in link):
            raise ArgumentError(f"links of an outage are pairs of node indices below {len(observer.nodes)}; got {link}")
        sender, receiver = (observer.names[node] for node in link)
        raise ArgumentError(
            f"an outage names the link {sender} -> {receiver}, but node {receiver} does not hear {sender}"
        )
