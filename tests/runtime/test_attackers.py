"""A compromised neighbour on a real encrypted link: whatever it sends is dropped, counted, and moves no estimate."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import trigpoint as tp
from tests.machine import until
from tests.runtime import links
from tests.runtime.given import PERIOD, case
from trigpoint.runtime import (
    FACTS,
    Frame,
    Kind,
    NodeMachine,
    NodeSettings,
    ZenohTransport,
    encode_frame,
    make_keys,
    open_transport,
)
from trigpoint.runtime.topics import node_key

ROUNDS = 12
START = 1000.0
KEY = node_key("net", "1", "estimate")
NAN = struct.pack("<d", float("nan"))


def estimate(number: int, **changes: object) -> bytes:
    """An honest frame of node 1, or one with changes."""
    values = np.array([np.sin(number), np.cos(number)])
    frame = Frame(Kind.ESTIMATE, "1", 1, number, START + number * PERIOD, (1.0, START, 0.0, 1.0), values)
    assert len(frame.facts) == len(FACTS[Kind.ESTIMATE])
    return encode_frame(replace(frame, **changes))


def attacks(number: int) -> Iterator[tuple[str, bytes]]:
    """The reason each must be dropped for, and the bytes."""
    honest = estimate(number)
    yield "malformed", os.urandom(60)
    yield "malformed", honest[:-3]
    yield "malformed", honest[:-8] + NAN
    yield "malformed", honest[:2] + b"\x63" + honest[3:]
    yield "malformed", bytes(59_000)
    yield "malformed", estimate(number, values=np.full(2, 1e200))
    yield "size", estimate(number, values=np.zeros(3))
    yield "stranger", estimate(number, sender="0")
    yield "window", estimate(number, time=START + 1e6)
    yield "window", estimate(number, time=START - 1e6)
    if number > 1:
        yield "old", estimate(number - 1)
        yield "old", estimate(number - 1, values=np.full(2, 1e9))


@pytest.mark.parametrize("kind", ["tls", "quic"])
def test_the_estimates_are_unharmed_and_every_attack_is_counted(kind, tmp_path) -> None:
    identities = make_keys(tmp_path / "keys", ["0", "1"])
    where = links.address(kind)
    network = case(graph=tp.graphs.chain(2, anchors=(0,)))
    settings: NodeSettings = network.settings(listen=where, identity=identities["0"])[0]
    attacked, calm = (NodeMachine(settings, epoch=1, now=START) for _ in range(2))
    node = open_transport(settings)
    neighbour = ZenohTransport("", [where], identity=identities["1"])
    heard: list[tuple[str, bytes]] = []
    expected: dict[str, int] = {}
    try:
        for key in attacked.subscriptions():
            node.subscribe(key, lambda key, data: heard.append((key, data)))
        assert until(lambda: heard, act=lambda: neighbour.publish(KEY, b"hello"))
        for number in range(1, ROUNDS):
            now = START + number * PERIOD
            sent = [data for _, data in attacks(number)]
            for data in (*sent, estimate(number), *sent[-1:]):
                heard.clear()
                assert until(lambda: (KEY, data) in heard, act=lambda: neighbour.publish(KEY, data))  # noqa: B023
                attacked.receive(now, KEY, data)
            calm.receive(now, KEY, estimate(number))
            for reason, _ in [*attacks(number), *list(attacks(number))[-1:]]:
                expected[reason] = expected.get(reason, 0) + 1
            for machine in (attacked, calm):
                machine.act(now)
                machine.latch(now)
    finally:
        neighbour.close()
        node.close()
    counted = {reason: count for reason, count in attacked.counters.rejected.items() if count}
    assert counted == expected
    assert attacked.counters.accepted == calm.counters.accepted == ROUNDS - 1
    assert np.array_equal(attacked.state.estimate, calm.state.estimate)
    assert not np.array_equal(attacked.state.estimate, settings.start)
