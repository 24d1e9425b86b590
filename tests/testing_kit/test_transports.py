"""The conformance kit for transports: a plain one passes, each flaw is found and named."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from trigpoint.runtime import BestEffort, Delivery, Reliable, Sink, Transport
from trigpoint.testing import check_transport

PATIENCE = 0.2


class Time:
    """Passes by sleeping only, so that whether somebody waits is a matter of what he does and not of the machine."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


time = Time()


@pytest.fixture(autouse=True)
def _virtual_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trigpoint.testing.transports.time", time)


def matches(pattern: str, key: str) -> bool:
    first, _, rest = pattern.partition("/")
    if first == "**":
        return True
    head, _, tail = key.partition("/")
    return first in ("*", head) and (matches(rest, tail) if rest and tail else rest == tail)


class Direct:
    """One end of two in this process: every frame is handed over at once."""

    delivery: Delivery = Reliable()

    def __init__(self) -> None:
        self.other: Direct = self
        self.sinks: list[tuple[str, Sink]] = []
        self.open = True
        self.sent = 0

    def publish(self, key: str, data: bytes) -> None:
        self.sent += 1
        if self.open:
            self.other.hear(key, data)

    def hear(self, key: str, data: bytes) -> None:
        for pattern, sink in list(self.sinks):
            if self.open and matches(pattern, key):
                sink(key, data)

    def subscribe(self, pattern: str, sink: Sink) -> None:
        self.sinks.append((pattern, sink))

    def close(self) -> None:
        self.open = False


class Deaf(Direct):
    def hear(self, key: str, data: bytes) -> None:
        pass


class Cutting(Direct):
    def hear(self, key: str, data: bytes) -> None:
        super().hear(key, data[:1000])


class Echoing(Direct):
    def publish(self, key: str, data: bytes) -> None:
        super().publish(key, data)
        self.hear(key, data)


class Inventing(Direct):
    def hear(self, key: str, data: bytes) -> None:
        super().hear(key, data)
        super().hear(key, data + b"!")


class Greedy(Direct):
    """One star takes any number of parts."""

    def subscribe(self, pattern: str, sink: Sink) -> None:
        super().subscribe(pattern.replace("/*/", "/**/").removesuffix("/x") if "/*/" in pattern else pattern, sink)


class Single(Direct):
    """A second sink for a pattern replaces the first."""

    def subscribe(self, pattern: str, sink: Sink) -> None:
        self.sinks = [(known, old) for known, old in self.sinks if known != pattern]
        super().subscribe(pattern, sink)


class Locked(Direct):
    """What is published from a sink is thrown away."""

    busy = threading.local()

    def publish(self, key: str, data: bytes) -> None:
        if not getattr(self.busy, "now", False):
            super().publish(key, data)

    def hear(self, key: str, data: bytes) -> None:
        self.busy.now = True
        super().hear(key, data)
        self.busy.now = False


class LosingSome(Direct):
    def hear(self, key: str, data: bytes) -> None:
        self.sent += 1
        if self.sent % 7:
            super().hear(key, data)


class Swapping(Direct):
    """In a burst, every second frame overtakes the one before."""

    kept: tuple[str, bytes] | None = None

    def hear(self, key: str, data: bytes) -> None:
        if not key.endswith("burst"):
            super().hear(key, data)
        elif self.kept is None:
            self.kept = (key, data)
        else:
            super().hear(key, data)
            super().hear(*self.kept)
            self.kept = None


class Slow(Direct):
    def publish(self, key: str, data: bytes) -> None:
        if key.endswith("burst"):
            time.sleep(0.002)
        super().publish(key, data)


class Strange(Direct):
    """Best effort, but a burst arrives with frames that nobody sent."""

    delivery: Delivery = BestEffort()

    def hear(self, key: str, data: bytes) -> None:
        super().hear(key, data)
        if key.endswith("burst"):
            super().hear(key, data[::-1])


class Undead(Direct):
    def close(self) -> None:
        pass


class Waiting(Direct):
    """Publishing to an end that closed takes its time."""

    def publish(self, key: str, data: bytes) -> None:
        if self.open and not self.other.open:
            time.sleep(0.002)
        super().publish(key, data)


class Undeclared(Direct):
    delivery = "best"  # type: ignore[assignment]


def pairs(kind: Callable[[], Direct]) -> Callable[[], tuple[Transport, Transport]]:
    def make() -> tuple[Transport, Transport]:
        one, two = kind(), kind()
        one.other, two.other = two, one
        return one, two

    return make


def test_a_plain_transport_passes() -> None:
    check_transport(pairs(Direct), patience=PATIENCE)


def test_best_effort_may_lose_double_and_overtake() -> None:
    class Rough(LosingSome):
        delivery: Delivery = BestEffort()

        def hear(self, key: str, data: bytes) -> None:
            super().hear(key, data)
            super().hear(key, data)

    check_transport(pairs(Rough), patience=PATIENCE)


def test_a_transport_with_its_own_clock_is_moved() -> None:
    """Frames wait until the clock is moved."""
    waiting: list[tuple[Direct, str, bytes]] = []

    class Queued(Direct):
        def publish(self, key: str, data: bytes) -> None:
            if self.open:
                waiting.append((self.other, key, data))

    def advance() -> None:
        time.sleep(0.01)
        while waiting:
            end, key, data = waiting.pop(0)
            end.hear(key, data)

    check_transport(pairs(Queued), patience=PATIENCE, advance=advance)


def test_both_ends_are_closed_whatever_happens() -> None:
    made: list[Direct] = []

    def make() -> tuple[Transport, Transport]:
        one, two = pairs(Deaf)()
        made.extend([one, two])  # type: ignore[list-item]
        return one, two

    with pytest.raises(AssertionError):
        check_transport(make, patience=0.01)
    assert [end.open for end in made] == [False, False]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Deaf, r"1 bytes under 'conformance/.*' were not heard within 0\.2 s"),
        (Cutting, r"\d{5} bytes under"),
        (Echoing, "an end hears its own frames"),
        (Inventing, "was never sent so"),
        (Greedy, r"'conformance/.*' selects \["),
        (Single, "'to both'|7 bytes under"),
        (Locked, "an answer published from a sink was not heard"),
        (LosingSome, "declared Reliable, but .* of 300 frames arrived"),
        (Swapping, "frames arrived in another order"),
        (Slow, "publish must not wait"),
        (Strange, "frames arrived that were never sent"),
        (Undead, "frames reached a sink after close"),
        (Waiting, "publishing to a closed end took"),
        (Undeclared, "'best' is no Delivery"),
    ],
)
def test_a_flaw_is_found(kind, words) -> None:
    with pytest.raises(AssertionError, match=words):
        check_transport(pairs(kind), patience=PATIENCE)
