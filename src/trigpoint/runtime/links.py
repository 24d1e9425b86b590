"""One neighbour as a node knows it: a state that a table moves, the last estimate, gaps, and the neighbour's clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from types import MappingProxyType

from trigpoint.arrays import FloatArray
from trigpoint.runtime.codec import Frame

SAMPLES = 8
"""Round trips that are remembered of each neighbour."""


class State(IntEnum):
    """What a node knows of one neighbour."""

    ABSENT = 0
    HEARD = 1
    LIVE = 2
    STALE = 3
    GONE = 4


class Event(IntEnum):
    """What happens on a link: three kinds of frames that were accepted, and that nothing fresh is known any more."""

    HELLO = 0
    ESTIMATE = 1
    BYE = 2
    SILENCE = 3


_ROWS: dict[State, tuple[State, State, State, State]] = {
    State.ABSENT: (State.HEARD, State.LIVE, State.GONE, State.ABSENT),
    State.HEARD: (State.HEARD, State.LIVE, State.GONE, State.ABSENT),
    State.LIVE: (State.HEARD, State.LIVE, State.GONE, State.STALE),
    State.STALE: (State.HEARD, State.LIVE, State.GONE, State.STALE),
    State.GONE: (State.HEARD, State.LIVE, State.GONE, State.GONE),
}

TABLE: Mapping[tuple[State, Event], State] = MappingProxyType(
    {(state, event): row[event] for state, row in _ROWS.items() for event in Event}
)
"""The next state of a link. Only a LIVE neighbour's estimate is used."""


@dataclass(frozen=True, eq=False)
class Heard:
    """The last estimate of a neighbour: its ``time``, ``estimate`` (n_j,), and what the neighbour says of itself."""

    time: float
    sequence: int
    estimate: FloatArray
    hops: float
    evidence: float
    broken: float
    uncertainty: float


@dataclass(eq=False)
class Link:
    """One neighbour; owned and changed by the machine alone.

    Attributes:
        name: the neighbour.
        state: see ``TABLE``.
        heard: its last estimate, unless it has started anew since.
        at: when a frame of it was accepted last, by the own clock; minus infinity for never.
        received: estimates accepted so far.
        lost: estimates whose number was jumped over: lost, or too late.
    """

    name: str
    state: State = State.ABSENT
    heard: Heard | None = None
    at: float = -float("inf")
    received: int = 0
    lost: int = 0
    asked: float | None = None
    _last: tuple[int, int] | None = None
    _clock: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=SAMPLES))

    def happen(self, event: Event) -> None:
        """Move by the table."""
        self.state = TABLE[self.state, event]

    def hello(self, now: float) -> None:
        """The neighbour has started: what it said before is void."""
        self.at, self.heard = now, None
        self._clock.clear()  # another process: its clock may have been set in between
        self.happen(Event.HELLO)

    def bye(self, now: float) -> None:
        """The neighbour has stopped."""
        self.at, self.heard = now, None
        self.happen(Event.BYE)

    def take(self, frame: Frame, now: float) -> None:
        """An estimate; what it says of times is cut off at ``now``, so that no clock ahead renews anything later."""
        hops, evidence, broken, uncertainty = frame.facts
        self.at = now
        self.heard = Heard(
            frame.time, frame.sequence, frame.values, hops, min(evidence, now), min(broken, now), uncertainty
        )
        self.received += 1
        if self._last is not None and self._last[0] == frame.epoch:
            self.lost += max(0, frame.sequence - self._last[1] - 1)
        elif self._last is not None:  # its HELLO was lost, or comes later
            self._clock.clear()
        self._last = frame.age_key
        self.happen(Event.ESTIMATE)

    def age(self, now: float) -> float:
        """Seconds since the instant that its last estimate is for; infinity where there is none."""
        return float("inf") if self.heard is None else now - self.heard.time

    def pass_time(self, now: float, stale: float) -> None:
        """Fall silent when nothing fresh is known; ``stale`` seconds are fresh."""
        since = {State.LIVE: self.age(now), State.HEARD: now - self.at}.get(self.state, 0.0)
        if since > stale:
            self.happen(Event.SILENCE)

    def answer(self, frame: Frame, now: float) -> bool:
        """Take a PONG: a sample of the neighbour's clock. False where it answers no question that is open."""
        asked, received = frame.facts
        if self.asked is None or asked != self.asked:
            return False
        self.asked = None
        self._clock.append(((now - asked) - (frame.time - received), ((received - asked) + (frame.time - now)) / 2.0))
        return True

    @property
    def round_trip(self) -> float | None:
        """The smallest of the last round trips [s], or None."""
        return min(self._clock)[0] if self._clock else None

    @property
    def offset(self) -> float | None:
        """What the neighbour's clock shows less what the own shows [s], by the fastest of the last round trips."""
        return min(self._clock)[1] if self._clock else None
