"""A network in memory: links that lose, delay and reorder by a seed, under a clock that somebody else moves."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass, field
from threading import RLock

import numpy as np

from trigpoint.errors import ArgumentError
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable, Sink

_SOON = 1e-12


@dataclass(frozen=True)
class Cut:
    """Nothing that is sent over ``links`` from ``start`` to before ``stop`` [s] arrives."""

    links: frozenset[tuple[str, str]]
    start: float
    stop: float


class MemoryNetwork:
    """Members joined by directed links; ``transport(name)`` is the end of one of them.

    A frame arrives ``delay`` plus up to ``jitter`` seconds (uniform) after it was published, or never with the
    probability ``loss``; so frames overtake each other where there is jitter. What takes no time arrives at once,
    within ``publish``; everything else when ``deliver`` moves the clock over its arrival. Equal seeds and calls give
    equal runs.

    Args:
        links: (sender, receiver) pairs of names. Nobody forwards.
        loss: probability, 0 <= loss < 1.
        delay, jitter: seconds.
        seed: of everything random.
        calm: senders whose frames are never lost or late: sensors, say.
    """

    def __init__(
        self,
        links: Iterable[tuple[str, str]],
        *,
        loss: float = 0.0,
        delay: float = 0.0,
        jitter: float = 0.0,
        seed: int = 0,
        calm: Iterable[str] = (),
    ) -> None:
        if not 0.0 <= loss < 1.0:
            raise ArgumentError(f"loss must be a probability, 0 <= loss < 1; got {loss}")
        for name, value in (("delay", delay), ("jitter", jitter)):
            if not (np.isfinite(value) and value >= 0.0):
                raise ArgumentError(f"{name} must be a number of seconds of at least 0; got {value}")
        self._receivers: dict[str, list[str]] = {}
        for sender, receiver in dict.fromkeys(links):
            self._receivers.setdefault(sender, []).append(receiver)
        self._loss, self._delay, self._jitter = loss, delay, jitter
        self._rng = np.random.default_rng(seed)
        self._calm = frozenset(calm)
        self._ends: dict[str, list[MemoryTransport]] = {}
        self._linked = {sender: frozenset(names) for sender, names in self._receivers.items()}
        self._listening: dict[str, list[MemoryTransport]] = {}
        self._cuts: list[Cut] = []
        self._way: list[_Parcel] = []
        self._count = 0
        self._lock = RLock()
        self.now = 0.0
        self.lost = 0

    @property
    def delivery(self) -> Delivery:
        """Best effort where frames are lost or overtake each other."""
        return BestEffort() if self._loss or self._jitter or self._cuts else Reliable()

    def transport(self, name: str) -> MemoryTransport:
        """A new end for the member ``name``; it holds until it is closed."""
        end = MemoryTransport(self, name)
        with self._lock:
            self._ends.setdefault(name, []).append(end)
        return end

    def cut(self, links: Iterable[tuple[str, str]], start: float, stop: float) -> None:
        """Lose everything that is sent over ``links`` from ``start`` to before ``stop`` [s]."""
        self._cuts.append(Cut(frozenset(links), start, stop))

    def part(self, one: Iterable[str], other: Iterable[str], start: float, stop: float) -> None:
        """Cut all links, both ways, between the members ``one`` and ``other`` from ``start`` to ``stop`` [s]."""
        left, right = tuple(one), tuple(other)
        pairs = [(a, b) for a in left for b in right]
        self.cut([*pairs, *((b, a) for a, b in pairs)], start, stop)

    def deliver(self, until: float) -> None:
        """Hand over what arrives up to ``until`` [s], in the order of arrival, and set the clock to it."""
        limit = until + _SOON * max(1.0, abs(until))
        while True:
            with self._lock:
                if not self._way or self._way[0].arrival > limit:
                    break
                parcel = heapq.heappop(self._way)
                self.now = max(self.now, min(parcel.arrival, until))
            self._hand_over(parcel)
        self.now = max(self.now, until)

    def send(self, sender: str, key: str, data: bytes) -> None:
        """Put a frame of ``sender`` on its links: ``key`` and ``data``; ends call it."""
        if sender in self._calm:
            linked = self._linked.get(sender, frozenset())
            for end in dict.fromkeys((*self._listening.get(key, ()), *self._listening.get("", ()))):
                if end.name in linked:
                    end.take(key, data)
            return
        ready = []
        with self._lock:
            for receiver in self._receivers.get(sender, ()):
                late = self._late(sender, receiver)
                if late is None:
                    self.lost += 1
                    continue
                self._count += 1
                parcel = _Parcel(self.now + late, self._count, receiver, key, data)
                if late == 0.0:
                    ready.append(parcel)
                else:
                    heapq.heappush(self._way, parcel)
        for parcel in ready:
            self._hand_over(parcel)

    def forget(self, end: MemoryTransport) -> None:
        """Take an ``end`` away that was closed."""
        self.unlisten(end)
        with self._lock:
            ends = self._ends.get(end.name, [])
            if end in ends:
                ends.remove(end)

    def listen(self, end: MemoryTransport, key: str) -> None:
        """Note that an ``end`` listens to this ``key``, or, where it is empty, to patterns: once each."""
        with self._lock:
            ends = self._listening.setdefault(key, [])
            if end not in ends:
                self._listening[key] = [*ends, end]

    def unlisten(self, end: MemoryTransport) -> None:
        """Note that an ``end`` listens to nothing any more."""
        with self._lock:
            for key in end.keys:
                self._listening[key] = [one for one in self._listening.get(key, ()) if one is not end]

    def _late(self, sender: str, receiver: str) -> float | None:
        """Seconds on the way, or None for never; chances are drawn whether the link is cut or not."""
        chance = float(self._rng.random()) if self._loss else 1.0
        late = self._delay + (self._jitter * float(self._rng.random()) if self._jitter else 0.0)
        gone = chance < self._loss or any(
            (sender, receiver) in cut.links and cut.start <= self.now < cut.stop for cut in self._cuts
        )
        return None if gone else late

    def _hand_over(self, parcel: _Parcel) -> None:
        with self._lock:
            ends = tuple(self._ends.get(parcel.receiver, ()))
        for end in ends:
            end.take(parcel.key, parcel.data)


@dataclass(frozen=True, order=True)
class _Parcel:
    arrival: float
    number: int
    receiver: str = field(compare=False)
    key: str = field(compare=False)
    data: bytes = field(compare=False)


class MemoryTransport:
    """One member's end of a ``MemoryNetwork``: a ``Transport``."""

    def __init__(self, network: MemoryNetwork, name: str) -> None:
        self._network = network
        self.name = name
        self._exact: dict[str, list[Sink]] = {}
        self._wild: list[tuple[tuple[str, ...], Sink]] = []
        self._open = True

    @property
    def keys(self) -> tuple[str, ...]:
        """What it listens to, as the network keeps it: keys, and an empty one for all patterns."""
        return (*self._exact, "")

    @property
    def delivery(self) -> Delivery:
        """As the network's."""
        return self._network.delivery

    def publish(self, key: str, data: bytes) -> None:
        """Send ``data`` under ``key`` to all linked members that subscribed to it."""
        if self._open:
            self._network.send(self.name, key, bytes(data))

    def subscribe(self, pattern: str, sink: Sink) -> None:
        """Hand to ``sink`` what others publish under ``pattern``."""
        parts = tuple(pattern.split("/"))
        if "*" in parts or "**" in parts:
            self._wild.append((parts, sink))
            self._network.listen(self, "")
        else:
            self._exact.setdefault(pattern, []).append(sink)
            self._network.listen(self, pattern)

    def subscribe_anew(self, patterns: Iterable[str], sink: Sink) -> None:
        """Hand to ``sink`` what fits one of the ``patterns``, and nothing else any more."""
        self._network.unlisten(self)
        self._exact.clear()
        self._wild.clear()
        for pattern in patterns:
            self.subscribe(pattern, sink)

    def close(self) -> None:
        """Neither send nor hear anything from now on."""
        self._open = False
        self._network.forget(self)

    def take(self, key: str, data: bytes) -> None:
        """A frame has arrived: ``key`` and ``data``."""
        for sink in self._exact.get(key, ()) if self._open else ():
            sink(key, data)
        if self._wild and self._open:
            parts = tuple(key.split("/"))
            for pattern, sink in self._wild:
                if fits(pattern, parts):
                    sink(key, data)


def fits(pattern: tuple[str, ...], parts: tuple[str, ...]) -> bool:
    """True where the ``parts`` of a key fit the parts of a ``pattern``: ``*`` is one, ``**`` any number."""
    if not pattern:
        return not parts
    if pattern[0] == "**":
        return any(fits(pattern[1:], parts[k:]) for k in range(len(parts) + 1))
    return bool(parts) and pattern[0] in ("*", parts[0]) and fits(pattern[1:], parts[1:])
