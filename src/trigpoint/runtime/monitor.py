"""``Monitor``: hears everybody, forgets all but the latest of each node, and takes part in nothing."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from trigpoint.arrays import FloatArray, frozen, transition_and_integral
from trigpoint.errors import ArgumentError, ProtocolError
from trigpoint.observers.local import LocalObserver, LocalState
from trigpoint.runtime.clock import Clock
from trigpoint.runtime.codec import LARGEST_FRAME, Frame, Kind, decode_frame
from trigpoint.runtime.gate import Bucket
from trigpoint.runtime.links import State
from trigpoint.runtime.routes import reading_sizes
from trigpoint.runtime.status import LINK_FIELDS, STATUS_FIELDS, NodeStatus, node_status
from trigpoint.runtime.topics import everything, node_key, reading_key, truth_key
from trigpoint.runtime.transport import Transport

Hook = Callable[[Frame, float], None]
"""Called with every frame and the time at which it arrived."""

_WAITING = 65536
_WAITING_BYTES = 256 * 2**20
_REMEMBERED = 16384
_AGES = 4096  # a link: half an hour of statuses
_FORGET = 5.0
_RATE = 1000.0  # frames a second of one key
_SAID = {
    "estimate": frozenset({Kind.ESTIMATE}),
    "status": frozenset({Kind.STATUS}),
    "hello": frozenset({Kind.HELLO, Kind.BYE}),
}


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What is known of all nodes at one moment, one entry a node.

    Attributes:
        time: seconds since the run began.
        names: the nodes' names.
        estimate: the latest estimate of each; None for one that was never heard.
        truth: its true state at the time of that estimate; None where no simulated truth is published.
        status: its latest status, or None.
        age: (N,) seconds since the last estimate was heard; infinite for never.
        error: (N,) norm of estimate minus truth; NaN where one of them is unknown.
    """

    time: float
    names: tuple[str, ...]
    estimate: tuple[FloatArray | None, ...]
    truth: tuple[FloatArray | None, ...]
    status: tuple[NodeStatus | None, ...]
    age: FloatArray
    error: FloatArray


class Controls(Protocol):
    """What the live page may ask for; each refuses the name of a node that does not exist (``ArgumentError``)."""

    def pause(self, name: str) -> None:
        """Let the node ``name`` listen only."""
        ...

    def go(self, name: str) -> None:
        """Let the node ``name`` go on."""
        ...

    def kill(self, name: str) -> None:
        """Kill the process of the node ``name``; it stays dead until it is revived."""
        ...

    def revive(self, name: str) -> None:
        """Start the node ``name`` again."""
        ...


def watched(network: str) -> tuple[str, ...]:
    """Patterns that a monitor listens to: all but the nodes' questions for the time, and orders."""
    start = everything(network).removesuffix("**")
    return tuple(start + rest for rest in ("node/*/estimate", "node/*/status", "node/*/hello", "reading/*", "truth/*"))


@dataclass(frozen=True)
class _Place:
    """What may stand under one key: ``kinds`` of frames of a ``sender`` (None: anybody) of ``size``, ``label``."""

    kinds: frozenset[Kind]
    sender: str | None = None
    size: int | None = None
    label: int | None = None

    def fits(self, frame: Frame) -> bool:
        return (
            frame.kind in self.kinds
            and self.sender in (None, frame.sender)
            and self.size in (None, frame.values.shape[0])
            and (self.label is None or frame.fact("label") == self.label)
        )


def _places(network: str, programs: Sequence[LocalObserver]) -> dict[str, _Place]:
    places = {}
    for program in programs:
        name = program.name
        for channel, kinds in _SAID.items():
            size = program.n_states if channel == "estimate" else None
            places[node_key(network, name, channel)] = _Place(kinds, name, size)
        places[truth_key(network, name)] = _Place(frozenset({Kind.TRUTH}), name)
        for label, width in reading_sizes(program).items():
            places[reading_key(network, label)] = _Place(frozenset({Kind.READING}), None, width, label)
    return places


class Monitor:
    """Collects what the nodes and the plant publish.

    Sinks only put what arrives into a bounded queue (the oldest is dropped and counted); ``poll`` takes it out, calls
    the hooks, and keeps the latest. ``snapshot`` may be called from another thread.

    By access rules a node publishes under its own keys only. So what stands under a key of another sender, arc or size,
    or under a key of nobody in ``programs``, is counted in ``strangers`` and goes nowhere, not into the log either; nor
    does what exceeds 1000 frames a second under one key, counted in ``flooded``: a node must not fill the disk.
    Frames of a node are ordered by epoch and sequence; after 5 s without a newer one the next is taken whatever its
    number, so that no forged frame keeps a node's place for ever.

    Args:
        transport: linked to every node and to the plant.
        network: name of the network.
        programs: what the nodes run, in order.
        clock: tells when something arrived, and since when the run goes.
        motions: by node, the (n, n) dynamics of what it estimates: the published truth is moved to the time of the
            estimate by it; truth of a node without one is taken as it is.
    """

    def __init__(
        self,
        transport: Transport,
        network: str,
        programs: Sequence[LocalObserver],
        clock: Clock,
        motions: Mapping[str, FloatArray] | None = None,
    ) -> None:
        self._clock, self._began = clock, clock.now()
        self._network = network
        self._programs = {program.name: program for program in programs}
        self._hears: Mapping[str, tuple[str, ...]] = {program.name: program.hears for program in programs}
        self._places = _places(network, programs)
        self._buckets = {key: Bucket(_RATE) for key in self._places}
        self._motions = {} if motions is None else dict(motions)
        self._waiting: deque[tuple[float, str, bytes]] = deque(maxlen=_WAITING)
        self._waiting_bytes = 0
        self._lock, self._door = threading.Lock(), threading.Lock()
        self._estimates: dict[str, tuple[Frame, float]] = {}
        self._truths: dict[str, tuple[Frame, float]] = {}
        self._said: dict[str, tuple[Frame, float]] = {}
        self._statuses: dict[str, NodeStatus] = {}
        self._readings: dict[int, FloatArray] = {}
        self._late = {k: deque[tuple[float, float]](maxlen=_REMEMBERED) for k in (Kind.ESTIMATE, Kind.READING)}
        self._ages: dict[tuple[str, str], deque[tuple[float, float]]] = {}
        self.hooks: list[Hook] = []
        self.received = self.dropped = self.malformed = self.strangers = self.flooded = self.received_bytes = 0
        for pattern in watched(network):
            transport.subscribe(pattern, self._sink)

    @property
    def names(self) -> tuple[str, ...]:
        """The nodes' names."""
        return tuple(self._programs)

    @property
    def began(self) -> float:
        """When the run began, by the clock."""
        return self._began

    def join(self, program: LocalObserver, transport: Transport, hears: Mapping[str, Sequence[str]]) -> None:
        """Hear one more node, which gets the last place in snapshots; from the thread that polls.

        Args:
            program: what it runs.
            transport: linked to it.
            hears: by node, the neighbours that it hears now, newcomers last: names of the links of a status.

        Raises:
            ArgumentError: a node of this name is heard already.
        """
        if program.name in self._programs:
            raise ArgumentError(f"a node {program.name!r} is heard already; names must differ")
        places = _places(self._network, [program])
        fresh = {key: place for key, place in places.items() if key not in self._places}
        with self._lock:
            self._places |= fresh
            self._buckets |= {key: Bucket(_RATE) for key in fresh}
            self._programs = {**self._programs, program.name: program}
            self._hears = {**self._hears, **{name: tuple(others) for name, others in hears.items()}}
        for pattern in watched(self._network):
            transport.subscribe(pattern, self._sink)

    def _sink(self, key: str, data: bytes) -> None:
        data = data[: LARGEST_FRAME + 1]
        with self._door:
            while self._waiting and (
                len(self._waiting) == _WAITING or self._waiting_bytes + len(data) > _WAITING_BYTES
            ):
                self.dropped += 1
                self._waiting_bytes -= len(self._waiting.popleft()[2])
            self._waiting.append((self._clock.now(), key, data))
            self._waiting_bytes += len(data)

    def _next(self) -> tuple[float, str, bytes] | None:
        with self._door:
            if not self._waiting:
                return None
            found = self._waiting.popleft()
            self._waiting_bytes -= len(found[2])
            return found

    def poll(self) -> int:
        """Take in what had arrived when it was called; the number of frames. A flood meanwhile waits for the next."""
        count = 0
        for _ in range(len(self._waiting)):
            found = self._next()
            if found is None:  # dropped meanwhile
                break
            arrived, key, data = found
            count += 1
            self.received += 1
            self.received_bytes += len(data)
            place = self._places.get(key)
            try:
                frame = decode_frame(data)
                if place is None or not place.fits(frame):
                    self.strangers += 1
                    continue
                if not self._buckets[key].lets(arrived):
                    self.flooded += 1
                    continue
                with self._lock:
                    self._keep(frame, arrived)
            except ProtocolError:
                self.malformed += 1
                continue
            for hook in self.hooks:
                hook(frame, arrived)
        return count

    def lateness(self, kind: Kind, since: float = -np.inf, until: float = np.inf) -> float:
        """Seconds from the instant that a frame of this ``kind`` (estimate, reading) is for to its arrival.

        The median of the last 16384, of those that arrived from ``since`` to ``until`` (by the clock): a processor that
        stalls now and then says nothing about the rest of the time. 0 where there is none.
        """
        return max(0.0, self._median(self._late[kind], since, until) or 0.0)

    def link_age(self, since: float = -np.inf, until: float = np.inf) -> float | None:
        """Age of the messages that nodes used, as they say themselves: the median of each link, their mean over links.

        Of LIVE links, in statuses that arrived from ``since`` to ``until`` (by the clock); None where there is none. Of
        two nodes with equal periods one hears the other's message a part p of a period late, the other the one's 1 - p
        or more: the mean over both is half a period at least, while a median over all links would be p or 1 - p where
        all start together. Over time it is the median, as stalls now and then say nothing about the rest.
        """
        medians = [self._median(pairs, since, until) for pairs in list(self._ages.values())]
        found = [age for age in medians if age is not None]
        return float(np.mean(found)) if found else None

    def _median(self, pairs: deque[tuple[float, float]], since: float, until: float) -> float | None:
        with self._lock:
            found = [value for arrived, value in pairs if since <= arrived <= until]
        return float(np.median(found)) if found else None

    def _keep(self, frame: Frame, arrived: float) -> None:
        if frame.kind in self._late:
            self._late[frame.kind].append((arrived, arrived - frame.time))
        if frame.kind is Kind.READING:
            self._readings[int(frame.fact("label"))] = frame.values
        elif frame.kind is Kind.STATUS:
            status = _status_of(frame, self._hears[frame.sender], len(self._programs[frame.sender].hears))
            if _newer(frame, arrived, self._said):
                self._statuses[frame.sender] = status
                for link in status.links:
                    if link.state is State.LIVE and link.age is not None:
                        pairs = self._ages.setdefault((frame.sender, link.neighbour), deque(maxlen=_AGES))
                        pairs.append((arrived, link.age))
        elif frame.kind is Kind.TRUTH:
            _newer(frame, arrived, self._truths)
        elif frame.kind is Kind.ESTIMATE:
            _newer(frame, arrived, self._estimates)

    def epoch(self, name: str) -> int | None:
        """Epoch of the process that the latest estimate of the node ``name`` came from; None before the first."""
        with self._lock:
            known = self._estimates.get(name)
        return None if known is None else known[0].epoch

    def snapshot(self) -> Snapshot:
        """What is known now."""
        now = self._clock.now()
        with self._lock:
            programs = self._programs
            rows = [self._row(name, program, now) for name, program in programs.items()]
            statuses = tuple(self._statuses.get(name) for name in programs)
        estimates, truths, ages = zip(*rows, strict=True)
        error = [
            np.nan if z is None or x is None or z.shape != x.shape else float(np.linalg.norm(z - x))
            for z, x in zip(estimates, truths, strict=True)
        ]
        return Snapshot(
            now - self._began, tuple(programs), estimates, truths, statuses, frozen(ages), frozen(error)
        )  # fmt: skip

    def _row(self, name: str, program: LocalObserver, now: float) -> tuple[FloatArray | None, FloatArray | None, float]:
        known, truth = self._estimates.get(name), self._truths.get(name, (None,))[0]
        if known is None:
            return None, None if truth is None else truth.values, np.inf
        frame, arrived = known
        value = program.estimate(LocalState(frame.time, frame.sequence, frame.values), self._readings)
        return value, None if truth is None else self._moved(name, truth, frame.time), now - arrived

    def _moved(self, name: str, truth: Frame, time: float) -> FloatArray:
        """The truth at the ``time`` of an estimate, earlier or later than it was published for."""
        motion = self._motions.get(name)
        if motion is None or not motion.any() or motion.shape[0] != truth.values.shape[0] or time == truth.time:
            return truth.values
        later = time - truth.time
        return np.asarray(transition_and_integral(np.sign(later) * motion, abs(later))[0] @ truth.values)


def _newer(frame: Frame, arrived: float, known: dict[str, tuple[Frame, float]]) -> bool:
    """Put ``frame`` into ``known``, unless a later one of its sender is there that is not forgotten yet."""
    before = known.get(frame.sender)
    if before is not None and frame.age_key <= before[0].age_key and arrived - before[1] <= _FORGET:
        return False
    known[frame.sender] = frame, arrived
    return True


def _status_of(frame: Frame, hears: tuple[str, ...], least: int) -> NodeStatus:
    """What the status ``frame`` of a node says that ``hears`` these: ``least`` from the start, newcomers after them.

    It has fewer links than ``hears`` as long as the node has not read its new settings, and more when somebody joined
    it of whom the monitor does not know: those are left out.
    """
    fixed, each = len(STATUS_FIELDS), len(LINK_FIELDS)
    count, odd = divmod(frame.values.shape[0] - fixed, each)
    if odd or count < least:
        return node_status(frame, hears)  # which refuses it
    known = hears[:count]
    return node_status(replace(frame, values=frame.values[: fixed + each * len(known)]), known)
