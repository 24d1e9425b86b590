"""Attackers on the links: everything is counted, and the estimates are those of a run without them, to the last bit."""

from __future__ import annotations

import contextlib
import tracemalloc
from collections import deque

import numpy as np
import pytest

import trigpoint as tp
from tests.runtime.given import STATIC, case
from trigpoint.errors import ProtocolError
from trigpoint.runtime import Frame, Kind, NodeMachine, Trouble, decode_frame, encode_frame, run_virtual
from trigpoint.runtime.codec import LARGEST_FRAME
from trigpoint.runtime.topics import node_key, ping_key, reading_key
from trigpoint.runtime.virtual import SENSOR

EVE = "eve"
DELAY = 0.01


class Attacker:
    """Hears everything that is said to anybody, and says it again, changed or not, under any key."""

    def __init__(self, network, names, labels, ways, seed: int = 0) -> None:
        self._end = network.transport(EVE)
        self._end.subscribe("**", lambda key, data: self._heard.append((key, data)))
        self._heard: deque[tuple[str, bytes]] = deque(maxlen=2000)
        self._names, self._labels, self._ways = names, labels, ways
        self._rng = np.random.default_rng(seed)
        self.sent = 0

    def __call__(self, now: float) -> None:
        for way in self._ways:
            for _ in range(5):
                for key, data in self._replay() if way == "replay" else getattr(self, way)(now):
                    self.sent += 1
                    self._end.publish(key, data)

    def _any(self, items):
        return items[int(self._rng.integers(len(items)))]

    def _estimate(self, now, sender, **changes) -> bytes:
        fields = {"epoch": 1, "sequence": 10**6 + self.sent, "facts": (0.0, now, 0.0, 0.0), "values": np.full(2, 77.0)}
        return encode_frame(Frame(Kind.ESTIMATE, sender, time=now, **(fields | changes)))

    def _key(self) -> str:
        return node_key("net", self._any(self._names), "estimate")

    def _replay(self):
        """What was said, again: at once, later, and much later."""
        return [self._any(self._heard)] if self._heard else []

    def stranger(self, now):
        """A name of its own, or a node's under another node's key, on every kind of key."""
        one, other = self._any(self._names), self._any(self._names)
        yield self._key(), self._estimate(now, EVE)
        if one != other:
            yield node_key("net", one, "estimate"), self._estimate(now, other)
        label = self._any(self._labels)
        yield reading_key("net", label), encode_frame(
            Frame(Kind.READING, EVE, 1, self.sent, now, (float(label),), np.full(2, 9.0))
        )  # fmt: skip
        yield node_key("net", one, "control"), encode_frame(Frame(Kind.CONTROL, EVE, 1, self.sent, now, (1.0,)))
        yield node_key("net", one, "hello"), encode_frame(Frame(Kind.BYE, EVE, 1, self.sent, now))
        yield ping_key("net", one, other), encode_frame(Frame(Kind.PING, EVE, 1, self.sent, now))

    def flood(self, now):
        """Forty at once, five times an instant: ten thousand a second."""
        data = self._estimate(now, EVE)
        return [(self._key(), data)] * 40

    def numbers(self, now):
        """NaN and infinity in every place, and numbers beyond all use, with the right name."""
        name = self._any(self._names)
        good = bytearray(self._estimate(now, name))
        place = 8 * int(self._rng.integers(1, 7))
        good[-place : len(good) - place + 8] = np.array(self._any([np.nan, np.inf, -np.inf])).tobytes()
        yield node_key("net", name, "estimate"), bytes(good)
        yield node_key("net", name, "estimate"), self._estimate(now, name, values=np.array([0.0, -1e200]))

    def shapes(self, now):
        """Huge, truncated, of another version, of another length, in the wrong place, and of another time."""
        name = self._any(self._names)
        data, key = self._estimate(now, name), node_key("net", name, "estimate")
        yield key, bytes(LARGEST_FRAME + 1)
        yield key, data[: int(self._rng.integers(len(data)))]
        yield key, b"TP\x01" + data[3:]
        yield key, self._estimate(now, name, values=np.zeros(4096))
        yield node_key("net", name, "status"), data
        yield key, encode_frame(Frame(Kind.ESTIMATE, name, 1, 10**7, now + 5.0, (0.0, now, 0.0, 0.0), np.zeros(2)))
        yield key, self._estimate(now, name, epoch=2**63)


EXPECTED = {
    "replay": {"old"},
    "stranger": {"stranger"},
    "flood": {"stranger"},
    "numbers": {"malformed"},
    "shapes": {"malformed", "size", "window"},
}


@pytest.mark.parametrize("way", [*EXPECTED, "all"])
def test_an_attack_is_counted_and_the_estimates_are_unharmed(way) -> None:
    one = case(STATIC, tp.graphs.grid(2, 2, anchors=[0]))
    labels = sorted({label for program in one.programs for label in program.reads})
    times = np.arange(0.0, 4.0, 0.1)
    calm = run_virtual(one.settings(), one.plant(), times, one.network(attacker=EVE, delay=DELAY))
    network = one.network(attacker=EVE, delay=DELAY)
    attacker = Attacker(network, one.names, labels, list(EXPECTED) if way == "all" else [way])
    machines: dict[str, NodeMachine] = {}
    trouble = Trouble(meddle=attacker)
    hurt = run_virtual(one.settings(), one.plant(), times, network, trouble, lambda _, found: machines.update(found))
    assert attacker.sent > 500
    np.testing.assert_array_equal(hurt.estimate, calm.estimate)
    np.testing.assert_array_equal(hurt.status, calm.status)
    wanted = set().union(*EXPECTED.values()) if way == "all" else EXPECTED[way]
    for machine in machines.values():
        rejected = machine.counters.rejected
        assert wanted <= {reason for reason, count in rejected.items() if count}
        assert not machine.paused


def spoiled(good: list[bytes], k: int, rng: np.random.Generator) -> bytes:
    """Garbage, and frames that are nearly right."""
    base = good[k % len(good)]
    way = k % 6
    if way == 0:
        return rng.bytes(int(rng.integers(0, 90)))
    if way == 1:
        return b"TP\x02" + rng.bytes(int(rng.integers(0, 90)))
    if way == 2:
        return base[: int(rng.integers(0, len(base)))]
    if way == 3:
        return base + rng.bytes(int(rng.integers(1, 9)))
    damaged = bytearray(base)
    for _ in range(1 if way == 4 else 8):
        damaged[int(rng.integers(0, len(damaged)))] = int(rng.integers(0, 256))
    return bytes(damaged)


def fuzz(count: int) -> tuple[NodeMachine, int]:
    """Spoiled frames under every key of a node, between its acts; (machine, bytes grown by over the last 40 000)."""
    one = case(tp.LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]]), tp.graphs.chain(3, anchors=[0]))
    machine = NodeMachine(one.settings(rate_limit=1e6)[1], epoch=7, now=0.0)
    keys = (*machine.subscriptions(), "trigpoint/net/node/9/estimate", "x", "")
    rng = np.random.default_rng(5)
    try:
        for k in range(count):
            if k == count - 40_000:
                tracemalloc.start()
            now = k * 1e-3
            if k % 20 == 0:
                good = [encode_frame(frame) for frame in _good(now, k)]
                for sent in machine.act(now):
                    decode_frame(sent.data)
                machine.latch(now)
                assert np.isfinite(machine.state.estimate).all()
            data = spoiled(good, k, rng)
            with contextlib.suppress(ProtocolError):
                decode_frame(data)
            for answer in machine.receive(now, keys[int(rng.integers(len(keys)))], data):
                decode_frame(answer.data)
        return machine, tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()


def _good(now: float, k: int) -> list[Frame]:
    ones = np.ones(2)
    return [
        Frame(Kind.ESTIMATE, "0", 1, k, now, (0.0, now, 0.0, 1.0), ones),
        Frame(Kind.ESTIMATE, "2", 1, k, now, (0.0, now, 0.0, 1.0), ones),
        Frame(Kind.READING, SENSOR, 1, k, now, (1.0,), np.ones(1)),
        Frame(Kind.HELLO, "0", 1, k, now),
        Frame(Kind.PONG, "2", 1, k, now, (now, now)),
        Frame(Kind.PING, "0", 1, k, now),
        Frame(Kind.CONTROL, "boss", 1, k, now, (0.0,)),
    ]


def check_fuzzed(count: int) -> None:
    machine, grown = fuzz(count)
    counters = machine.counters
    assert counters.accepted + counters.dropped == count
    assert counters.accepted > 0
    assert all(counters.rejected[reason] for reason in ("malformed", "stranger", "old", "unknown"))
    assert grown < 200_000
    machine.status.to_values()


def test_fifty_thousand_spoiled_frames_raise_nothing_and_leave_nothing() -> None:
    check_fuzzed(50_000)


@pytest.mark.slow
def test_a_million_spoiled_frames_raise_nothing_and_leave_nothing() -> None:
    check_fuzzed(1_000_000)
