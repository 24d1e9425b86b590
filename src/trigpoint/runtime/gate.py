"""What a node lets in: counters by reason, order and rate of each source. Nothing here grows with what arrives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from trigpoint.runtime.codec import Frame, Kind

REASONS = ("malformed", "stranger", "old", "window", "size", "flood", "unknown")
"""Why a frame is dropped; ``docs/reference/protocol.md`` says what each means."""

LARGEST_VALUE = 1e100
"""Numbers beyond it are refused as malformed: nothing that is estimated is that large, and sums must not overflow."""


_LARGEST_TIME = 1e12


@dataclass(frozen=True)
class Counters:
    """Frames so far.

    Attributes:
        accepted: frames that were used.
        rejected: frames that were dropped, by reason; every reason of ``REASONS`` is there.
    """

    accepted: int
    rejected: Mapping[str, int]

    @property
    def dropped(self) -> int:
        """All frames that were dropped."""
        return sum(self.rejected.values())


@dataclass(eq=False)
class Bucket:
    """Lets through ``rate`` frames a second, with as many at once."""

    rate: float
    _tokens: float = 0.0
    _filled: float = -float("inf")

    def lets(self, now: float) -> bool:
        """Whether one more may pass at ``now``; then it counts."""
        room = max(1.0, self.rate)
        gained = max(0.0, now - self._filled) * self.rate
        self._tokens = min(room, self._tokens + gained)
        self._filled = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


@dataclass(eq=False)
class Source:
    """Whoever may send under one key, or several: order and rate of its frames. Owned by the machine.

    Frames of a source must come in order: an older epoch, a sequence number that is not above the last one of the same
    kind, or a HELLO of an epoch that was heard already is ``old``. After ``memory`` seconds of silence the order is
    forgotten; by then every frame recorded before is outside the window of time stamps, so nothing can be replayed, and
    a source whose clock was set back, or whose place a forged frame had taken, comes back by itself.

    Attributes:
        rate: frames a second, with as many at once.
        memory: seconds.
    """

    rate: float
    memory: float
    epoch: int = -1
    heard: float = -float("inf")
    _last: dict[Kind, int] = field(default_factory=dict)
    _bucket: Bucket = field(default_factory=lambda: Bucket(0.0))

    def refuses(self, frame: Frame, now: float) -> str | None:
        """The reason to drop ``frame``, or None; then it counts as the last one."""
        if now - self.heard > self.memory:
            self.epoch = -1
            self._last.clear()
        if frame.epoch < self.epoch or (frame.kind is Kind.HELLO and frame.epoch == self.epoch):
            return "old"
        if frame.epoch == self.epoch and frame.sequence <= self._last.get(frame.kind, -1):
            return "old"
        self._bucket.rate = self.rate
        if not self._bucket.lets(now):
            return "flood"
        if frame.epoch > self.epoch:
            self.epoch = frame.epoch
            self._last.clear()
        self._last[frame.kind] = frame.sequence
        self.heard = now
        return None

    def close(self, epoch: int) -> None:
        """Nothing more of this ``epoch`` is new."""
        self.epoch = max(self.epoch, epoch + 1)
        self._last.clear()


@dataclass(frozen=True, eq=False)
class Route:
    """What may arrive under one key.

    Attributes:
        kinds: kinds of frames.
        senders: names that may stand in them.
        source: whose order and rate they share.
        size: how many values they must hold, by kind; none where not given.
        label: the arc of a reading, or None.
    """

    kinds: frozenset[Kind]
    senders: frozenset[str]
    source: Source
    size: int = 0
    label: int | None = None

    def misfit(self, frame: Frame) -> str | None:
        """What is wrong with the frame by itself, or None."""
        if frame.kind not in self.kinds:
            return "unknown"
        if frame.sender not in self.senders:
            return "stranger"
        sized = frame.kind in (Kind.ESTIMATE, Kind.READING)
        if frame.values.shape[0] != (self.size if sized else 0):
            return "size"
        if sized and max(map(abs, frame.values.tolist()), default=0.0) > LARGEST_VALUE:
            return "malformed"
        if frame.kind is Kind.ESTIMATE and not _sensible(frame.facts):
            return "malformed"
        if frame.kind in (Kind.PING, Kind.PONG) and max(map(abs, (frame.time, *frame.facts))) > _LARGEST_TIME:
            return "malformed"
        if frame.kind is Kind.READING and frame.facts[0] != self.label:
            return "unknown"
        return None


def _sensible(facts: tuple[float, ...]) -> bool:
    hops, evidence, broken, uncertainty = facts
    return hops >= -1.0 and evidence >= 0.0 and broken >= 0.0 and 0.0 <= uncertainty <= LARGEST_VALUE
