"""Axioms of a transport."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

from trigpoint.runtime import BestEffort, Reliable, Transport
from trigpoint.runtime.codec import LARGEST_FRAME

MakePair = Callable[[], tuple[Transport, Transport]]

_FOLDER = "conformance/n%20-_.~1"  # what written names consist of
_BURST = 300
_SETTLE = 0.3  # s in which what must not arrive would have arrived on one machine


def check_transport(
    make_pair: MakePair, *, patience: float = 10.0, advance: Callable[[], None] = lambda: time.sleep(0.002)
) -> None:
    """Check two linked transports against what ``Transport`` promises; raises ``AssertionError`` with what went wrong.

    Both ends hear each other with key and bytes unchanged, up to the protocol's largest frame; patterns select; nobody
    hears itself; a sink may publish; a closed end neither hears nor disturbs. ``Reliable`` delivers a burst whole and
    in order; ``BestEffort`` may lose, overtake and double, but invents nothing.

    Args:
        make_pair: opens two transports that are linked, or will be within ``patience``; called once for each axiom, and
            both are closed each time.
        patience: seconds within which what must arrive arrives.
        advance: called while waiting; a transport with a clock of its own moves it there.
    """
    for axiom in (_carries, _selects, _hands_to_every_sink, _answers, _delivers, _closes):
        first, second = make_pair()
        try:
            axiom(_Pair(first, second, patience, advance))
        finally:
            second.close()
            first.close()


class _Pair:
    """Two ends, and how to wait for what must arrive."""

    def __init__(self, first: Transport, second: Transport, patience: float, advance: Callable[[], None]) -> None:
        self.first, self.second = first, second
        self.patience, self.advance = patience, advance

    def until(self, done: Callable[[], bool], *, act: Callable[[], None] = lambda: None, within: float = 0.0) -> bool:
        """Act and wait again and again; whether ``done`` came true."""
        end = time.monotonic() + (within or self.patience)
        while not done():
            if time.monotonic() > end:
                return False
            act()
            self.advance()
        return True

    def settle(self) -> None:
        """Let what is on its way arrive."""
        self.until(lambda: False, within=min(_SETTLE, self.patience / 2.0))

    def carry(self, sender: Transport, key: str, data: bytes, heard: list[tuple[str, bytes]]) -> None:
        """Publish until it is heard: before the link stands, and on lossy links, one frame may not be enough."""
        arrived = self.until(lambda: (key, data) in heard, act=lambda: sender.publish(key, data))
        assert arrived, f"{len(data)} bytes under {key!r} were not heard within {self.patience:g} s"


Heard = list[tuple[str, bytes]]


def _listen(transport: Transport, pattern: str) -> Heard:
    heard: Heard = []
    transport.subscribe(pattern, lambda key, data: heard.append((key, data)))
    return heard


def _carries(pair: _Pair) -> None:
    """Both ways, all bytes, small and large; never to the sender itself."""
    ends = (pair.first, pair.second)
    heard = [_listen(end, f"{_FOLDER}/**") for end in ends]
    sent: list[set[tuple[str, bytes]]] = [set(), set()]
    for side, sender in enumerate(ends):
        for data in (b"\0", bytes(range(256)), bytes(LARGEST_FRAME)):
            key = f"{_FOLDER}/from{side}/{len(data)}"
            sent[side].add((key, data))
            pair.carry(sender, key, data, heard[1 - side])
    pair.settle()
    for side in range(2):
        own = [key for key, _ in heard[side] if f"/from{side}/" in key]
        assert not own, f"an end hears its own frames: {own[0]!r}"
        other = [key for key, data in heard[side] if (key, data) not in sent[1 - side]]
        assert not other, f"what arrived under {other[0]!r} was never sent so"


def _selects(pair: _Pair) -> None:
    """``*`` is one part, ``**`` is any number of them."""
    patterns = {
        f"{_FOLDER}/a/x": ["a/x"],
        f"{_FOLDER}/*/x": ["a/x", "b/x"],
        f"{_FOLDER}/a/**": ["a/x", "a/y", "a/b/x"],
        f"{_FOLDER}/a/*": ["a/x", "a/y"],
    }
    heard = {pattern: _listen(pair.second, pattern) for pattern in patterns}
    everything = _listen(pair.second, f"{_FOLDER}/**")
    for key in ("a/x", "b/x", "a/y", "a/b/x"):
        pair.carry(pair.first, f"{_FOLDER}/{key}", key.encode(), everything)
        for pattern, keys in patterns.items():
            if key in keys:
                pair.carry(pair.first, f"{_FOLDER}/{key}", key.encode(), heard[pattern])
    pair.settle()
    for pattern, keys in patterns.items():
        found = {key.removeprefix(f"{_FOLDER}/") for key, _ in heard[pattern]}
        assert found == set(keys), f"{pattern!r} selects {sorted(found)}; expected {sorted(keys)}"


def _hands_to_every_sink(pair: _Pair) -> None:
    one, other = _listen(pair.second, f"{_FOLDER}/x"), _listen(pair.second, f"{_FOLDER}/x")
    for heard in (one, other):
        pair.carry(pair.first, f"{_FOLDER}/x", b"to both", heard)


def _answers(pair: _Pair) -> None:
    """A sink may publish: nothing waits for itself."""
    pair.second.subscribe(f"{_FOLDER}/ask", lambda _, data: pair.second.publish(f"{_FOLDER}/answer", data[::-1]))
    heard = _listen(pair.first, f"{_FOLDER}/answer")
    arrived = pair.until(
        lambda: (f"{_FOLDER}/answer", b"321") in heard, act=lambda: pair.first.publish(f"{_FOLDER}/ask", b"123")
    )
    assert arrived, f"an answer published from a sink was not heard within {pair.patience:g} s"


def _delivers(pair: _Pair) -> None:
    """The declared guarantee, on a burst."""
    for end in (pair.first, pair.second):
        assert isinstance(end.delivery, Reliable | BestEffort), f"{end.delivery!r} is no Delivery"
    heard = _listen(pair.second, f"{_FOLDER}/*")
    pair.carry(pair.first, f"{_FOLDER}/begin", b"begin", heard)
    burst = [number.to_bytes(4, "little") * 40 for number in range(_BURST)]
    start = time.monotonic()
    for data in burst:
        pair.first.publish(f"{_FOLDER}/burst", data)
    took = time.monotonic() - start
    assert took < pair.patience, f"{_BURST} frames took {took:.1f} s to publish: publish must not wait"

    def arrived() -> list[bytes]:
        return [data for key, data in list(heard) if key == f"{_FOLDER}/burst"]

    if isinstance(pair.first.delivery, Reliable):
        pair.until(lambda: len(arrived()) >= _BURST)
        pair.settle()
        got = arrived()
        assert len(got) == _BURST, f"declared Reliable, but {len(got)} of {_BURST} frames arrived"
        assert got == burst, "declared Reliable, but frames arrived in another order"
    else:
        pair.settle()
        strange = Counter(arrived()).keys() - set(burst)
        assert not strange, f"{len(strange)} frames arrived that were never sent"
        pair.carry(pair.first, f"{_FOLDER}/end", b"end", heard)


def _closes(pair: _Pair) -> None:
    """A closed end hears nothing more, may be closed again, and takes nobody's time."""
    heard = _listen(pair.second, f"{_FOLDER}/x")
    pair.carry(pair.first, f"{_FOLDER}/x", b"before", heard)
    pair.second.close()
    known = len(heard)
    start = time.monotonic()
    for _ in range(_BURST):
        pair.first.publish(f"{_FOLDER}/x", b"after")
    took = time.monotonic() - start
    assert took < pair.patience, f"publishing to a closed end took {took:.1f} s"
    pair.settle()
    assert len(heard) == known, f"{len(heard) - known} frames reached a sink after close"
    pair.second.close()
    pair.second.publish(f"{_FOLDER}/x", b"nobody hears this")
