"""``NodeMachine``: the protocol of one node, without input, output or clock: instants and frames in, frames out.

Whatever others send, it never raises: what does not fit is counted by reason and dropped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, ProtocolError
from trigpoint.observers.local import LocalState
from trigpoint.runtime.codec import Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.gate import LARGEST_VALUE, REASONS, Counters, Route, Source
from trigpoint.runtime.knowledge import Knowledge, averaged, cautious, learn
from trigpoint.runtime.latched import NOTHING, Latched, Reading, free_growth, is_mean, latched, pull_rates
from trigpoint.runtime.links import Heard, Link, State
from trigpoint.runtime.routes import longest_of, neighbours, routes_of
from trigpoint.runtime.settings import NodeSettings
from trigpoint.runtime.status import LinkStatus, NodeStatus, require_frames
from trigpoint.runtime.topics import node_key, ping_key

GO, PAUSE = 0, 1
"""Orders of a CONTROL frame."""

_SNAP = 1e-9
_GRID = 1024


@dataclass(frozen=True)
class Outgoing:
    """A frame to publish: its ``key`` and its bytes, ``data``."""

    key: str
    data: bytes


class NodeMachine:
    """One live node.

    The host calls ``start`` once, then ``act`` and at once ``latch`` every period, ``receive`` for whatever arrives in
    between, ``stop`` at the end, and publishes what they return. All instants are seconds by one clock of the host that
    does not run backwards.

    Args:
        settings: all that the node is given.
        epoch: when this process started, nanoseconds since 1970 by the same clock; larger after every restart.
        now: seconds since 1970 (or since anything, if all clocks of the network agree on it).

    A step goes over the time that has passed since the one before: the period if it is that to 1e-9, else the next
    multiple of period / 1024, and the state says for which instant it is; so little is computed twice. What was latched
    is held for at most ``stale`` seconds; after that the node moves freely.
    """

    def __init__(self, settings: NodeSettings, *, epoch: int, now: float) -> None:
        self._settings, self._epoch = settings, epoch
        self._state = settings.program.init(settings.start, now)
        self._known = Knowledge(uncertainty=settings.first_uncertainty)
        self._latched: Latched = NOTHING
        self._links: dict[str, Link] = {}
        self._readings: dict[int, Reading] = {}
        self._sources: dict[str, Source] = {}
        self._routes: dict[str, Route] = {}
        self._counts = dict.fromkeys(("accepted", *REASONS), 0)
        self._sequences = dict.fromkeys(Kind, 0)
        self._paused, self._resumed = False, True
        self._acts = self._missed = self._resets = 0
        self._cost, self._innovation = 0.0, 0.0
        self._status_at = self._asked_at = -math.inf
        self._now = now
        self._adopt(settings)

    # -- what can be seen ------------------------------------------------------------------------------------------
    @property
    def settings(self) -> NodeSettings:
        """What the node was given."""
        return self._settings

    @property
    def state(self) -> LocalState:
        """The estimate, and the instant that it is for."""
        return self._state

    @property
    def knowledge(self) -> Knowledge:
        """What the node knows of itself."""
        return self._known

    @property
    def paused(self) -> bool:
        """Whether it only listens."""
        return self._paused

    @property
    def anchored(self) -> bool:
        """Whether it knows of an anchor reading that is at most ``anchor_timeout`` old."""
        return self._known.anchored(self._now, self._settings.anchor_timeout)

    @property
    def covered(self) -> bool:
        """Whether it is anchored, and the gain's guarantee covers the arcs at work."""
        settings = self._settings
        whole = settings.coverage == "every" or self._known.whole(self._now, settings.anchor_timeout)
        return self.anchored and whole

    @property
    def counters(self) -> Counters:
        """Frames accepted and dropped so far."""
        counts = dict(self._counts)
        return Counters(counts.pop("accepted"), counts)

    @property
    def status(self) -> NodeStatus:
        """All that the node says of itself, as of its last act."""
        settings, state, known = self._settings, self._state, self._known
        now, anchored = self._now, self.anchored
        links = tuple(self._link_status(self._links[name]) for name in settings.program.hears)
        offset = max((abs(link.offset) for link in self._links.values() if link.offset is not None), default=0.0)
        drift = settings.program.A @ state.estimate
        return NodeStatus(
            name=settings.name,
            time=now,
            anchored=anchored,
            covered=self.covered,
            paused=self._paused,
            hops=int(min(known.hops, 2.0**53)) if anchored and known.hops >= 0.0 else None,
            uncertainty=known.uncertainty,
            evidence_age=now - known.evidence if known.evidence > 0.0 else None,
            acts=self._acts,
            missed=self._missed,
            step_us=1e6 * self._cost,
            resets=self._resets,
            innovation=self._innovation,
            clock_offset=offset,
            floor=offset * float(np.linalg.norm(drift)),
            magnitude=float(np.linalg.norm(state.estimate)),
            counters=self.counters,
            links=links,
        )

    def estimate_at(self, time: float) -> FloatArray:
        """The node's estimate (q,) at ``time``, moved on freely since its last act; NaN where a reading is missing."""
        settings, state = self._settings, self._state
        value = settings.program.moved(state.estimate, time - state.time, settings.input)
        return settings.program.estimate(LocalState(time, state.sequence, value), self._latched.readings)

    def subscriptions(self) -> tuple[str, ...]:
        """Keys that the node listens to."""
        return tuple(self._routes)

    @property
    def longest(self) -> int:
        """Bytes of the longest frame that it may let in; no more need be kept of what waits to be looked at."""
        return self._longest

    # -- what the host does ----------------------------------------------------------------------------------------
    def start(self, now: float) -> tuple[Outgoing, ...]:
        """Say HELLO."""
        return (self._greeting(Kind.HELLO, now),)

    def stop(self, now: float) -> tuple[Outgoing, ...]:
        """Say BYE."""
        return (self._greeting(Kind.BYE, now),)

    def took(self, seconds: float) -> None:
        """The host measured that one act with its latch took so long; the status shows a smoothed figure."""
        self._cost = seconds if self._acts <= 1 else self._cost + 0.1 * (seconds - self._cost)

    def act(self, now: float) -> tuple[Outgoing, ...]:
        """Step over the time that has passed, with what was latched; tell the estimate, now and then the status."""
        settings, out = self._settings, []
        self._now = now
        if not self._paused:
            self._advance(now)
            self._acts += 1
            frame = self._frame(Kind.ESTIMATE, self._state.time, self._known.facts, self._state.estimate)
            out.append(Outgoing(node_key(settings.network, settings.name, "estimate"), encode_frame(frame)))
            if now - self._asked_at >= settings.ping_every * (1.0 - _SNAP):
                self._asked_at = now
                out.extend(self._ask(name, now) for name in neighbours(settings))
        if now - self._status_at >= settings.status_every * (1.0 - _SNAP):
            self._status_at = now
            frame = self._frame(Kind.STATUS, now, (), self.status.to_values())
            out.append(Outgoing(node_key(settings.network, settings.name, "status"), encode_frame(frame)))
        return tuple(out)

    def latch(self, now: float) -> None:
        """Decide what the next step uses; arcs of which something is missing are left out of it."""
        settings = self._settings
        heard = self._fresh_estimates(now)
        if self._paused:
            self._latched = NOTHING
            return
        oldest = now - settings.stale * (1.0 + _SNAP)
        fresh = {label: reading for label, reading in self._readings.items() if reading.time >= oldest}
        self._latched = use = latched(settings, self._rates, self._state, heard, fresh)
        self._known = learn(
            self._known, now, settings.anchor_timeout, own=use.own, missing=bool(use.missing), told=use.told
        )
        if now + settings.period - self._status_at >= settings.status_every * (1.0 - _SNAP):
            found = settings.program.innovations(self._state, use.inbox, use.readings)
            self._innovation = math.sqrt(sum(float(one @ one) for one in found if one is not None))

    def receive(self, now: float, key: str, data: bytes) -> tuple[Outgoing, ...]:
        """Take in one frame, and return answers; whatever does not fit is counted and dropped."""
        route = self._routes.get(key)
        if route is None:
            return self._drop("unknown")
        try:
            frame = decode_frame(data)
        except ProtocolError:
            return self._drop("malformed")
        reason = route.misfit(frame) or self._untimely(frame, now) or route.source.refuses(frame, now)
        if reason is not None:
            return self._drop(reason)
        return self._take(frame, route, now)

    def reload(self, settings: NodeSettings, now: float) -> None:
        """Go on with new ``settings``: the state and known neighbours stay, arcs and peers may be others.

        Raises:
            ArgumentError: the settings are another node's, of another number of states, or of too many neighbours.
        """
        old = self._settings
        same = (old.network, old.name, old.program.n_states)
        other = (settings.network, settings.name, settings.program.n_states)
        if same != other:
            raise ArgumentError(
                f"new settings must be of the same network, node and number of states, {same}; got {other}: start a "
                "new process for another node"
            )
        self._adopt(settings)
        self.latch(now)

    # -- inside ----------------------------------------------------------------------------------------------------
    def _adopt(self, settings: NodeSettings) -> None:
        require_frames(settings.program)
        self._settings = settings
        self._rates = pull_rates(settings.program)
        self._growth = None if is_mean(settings) else free_growth(settings.program)
        self._links = {name: self._links.get(name) or Link(name) for name in neighbours(settings)}
        known = self._sources
        self._sources = {}
        memory = settings.stale + 2.0 * settings.window

        def source(name: str) -> Source:
            one = known.get(name) or Source(settings.rate_limit, memory)
            one.rate, one.memory = settings.rate_limit, memory
            return self._sources.setdefault(name, one)

        self._routes = routes_of(settings, source)
        self._longest = longest_of(self._routes.values())
        reads = set(settings.program.reads)
        self._readings = {label: reading for label, reading in self._readings.items() if label in reads}

    def _advance(self, now: float) -> None:
        """The state at ``now``, or at the nearest instant of the grid."""
        settings, state = self._settings, self._state
        period, elapsed = settings.period, now - state.time
        resumed, self._resumed = self._resumed, False
        if elapsed <= _SNAP * period:
            self._state = LocalState(now, state.sequence, state.estimate)
            return
        duration, moment = period, now
        if abs(elapsed - period) > _SNAP * period:
            duration = period * round(elapsed / period * _GRID) / _GRID
            moment = state.time + duration
        if duration <= 0.0:
            return
        if not resumed:
            self._missed += max(0, round(elapsed / period) - 1)
        held = min(duration, max(period, settings.stale))
        use = self._latched
        with np.errstate(over="ignore", invalid="ignore"):
            state = settings.program.step(state, use.inbox, use.readings, held, settings.input)
            estimate = state.estimate
            if duration > held:
                estimate = settings.program.moved(estimate, duration - held, settings.input)
        self._known = replace(self._known, uncertainty=self._uncertain(use, held, duration - held))
        self._state = LocalState(moment, state.sequence, estimate)
        if not all(abs(value) <= LARGEST_VALUE for value in estimate.tolist()):
            self._begin_anew(moment)

    def _uncertain(self, use: Latched, held: float, free: float) -> float:
        """The uncertainty after a step of ``held`` seconds with what was latched, and ``free`` seconds without."""
        figure, growth = self._known.uncertainty, self._growth
        if growth is None:
            return min(averaged(figure, use.pulls, held), LARGEST_VALUE)
        rate = self._settings.settle_rate if self.covered else 0.0
        figure = cautious(figure, use.pulls, held, rate=rate, growth=growth)
        figure = cautious(figure, (), free, rate=rate, growth=growth)
        return min(figure, LARGEST_VALUE)

    def _begin_anew(self, moment: float) -> None:
        """The estimate has run out of range: back to the start, rather than spread it or stop."""
        settings = self._settings
        first = settings.program.init(settings.start, moment)
        self._state = LocalState(moment, self._state.sequence, first.estimate)
        self._known = replace(self._known, uncertainty=settings.first_uncertainty)
        self._resets += 1

    def _fresh_estimates(self, now: float) -> dict[str, Heard]:
        stale = self._settings.stale * (1.0 + _SNAP)
        fresh = {}
        for name, link in self._links.items():
            link.pass_time(now, stale)
            if link.state is State.LIVE and link.heard is not None:
                fresh[name] = link.heard
        return fresh

    def _untimely(self, frame: Frame, now: float) -> str | None:
        """Clock questions pass at any time, so that a clock that is far off is seen."""
        if frame.kind in (Kind.PING, Kind.PONG):
            return None
        settings = self._settings
        latest = now + settings.window
        if not now - settings.stale - settings.window <= frame.time <= latest or 1e-9 * frame.epoch > latest:
            return "window"
        return None

    def _take(self, frame: Frame, route: Route, now: float) -> tuple[Outgoing, ...]:
        kind = frame.kind
        if kind is Kind.READING:
            assert route.label is not None  # every route of readings has one
            self._readings[route.label] = Reading(frame.time, frame.values)
        elif kind is Kind.CONTROL:
            if frame.facts[0] not in (GO, PAUSE):
                return self._drop("unknown")
            self._paused = frame.facts[0] == PAUSE
            self._resumed = True
        else:
            return self._take_from_neighbour(frame, route, now)
        self._counts["accepted"] += 1
        return ()

    def _take_from_neighbour(self, frame: Frame, route: Route, now: float) -> tuple[Outgoing, ...]:
        kind, link = frame.kind, self._links[frame.sender]
        answers: tuple[Outgoing, ...] = ()
        if kind is Kind.ESTIMATE:
            link.take(frame, now)
        elif kind is Kind.HELLO:
            link.hello(now)
        elif kind is Kind.BYE:
            route.source.close(frame.epoch)
            link.bye(now)
        elif kind is Kind.PING:
            answers = (self._clock_frame(Kind.PONG, link.name, now, (frame.time, now)),)
        elif not link.answer(frame, now):
            return self._drop("old")
        self._counts["accepted"] += 1
        return answers

    def _drop(self, reason: str) -> tuple[Outgoing, ...]:
        self._counts[reason] += 1
        return ()

    def _frame(self, kind: Kind, time: float, facts: tuple[float, ...] = (), values: FloatArray | None = None) -> Frame:
        number = self._sequences[kind]
        self._sequences[kind] = number + 1
        return Frame(
            kind, self._settings.name, self._epoch, number, time, facts, np.zeros(0) if values is None else values
        )

    def _greeting(self, kind: Kind, now: float) -> Outgoing:
        settings = self._settings
        return Outgoing(node_key(settings.network, settings.name, "hello"), encode_frame(self._frame(kind, now)))

    def _ask(self, name: str, now: float) -> Outgoing:
        self._links[name].asked = now
        return self._clock_frame(Kind.PING, name, now)

    def _clock_frame(self, kind: Kind, other: str, now: float, facts: tuple[float, ...] = ()) -> Outgoing:
        settings = self._settings
        return Outgoing(ping_key(settings.network, settings.name, other), encode_frame(self._frame(kind, now, facts)))

    def _link_status(self, link: Link) -> LinkStatus:
        age = None if link.heard is None else link.age(self._now)
        return LinkStatus(link.name, link.state, age, link.received, link.lost, link.round_trip, link.offset)
