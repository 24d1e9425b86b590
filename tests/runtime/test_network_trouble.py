"""Loss and partition on a real network stack: two namespaces, a cable, and processes that talk over it."""

from __future__ import annotations

import contextlib
import time

import pytest

from tests.machine import until, with_time
from tests.runtime.two_hosts import Host, Talker, hosts
from trigpoint.runtime import BestEffort, Identity, MemoryNetwork, Reliable, make_keys, parse_address
from trigpoint.runtime.endpoints import SECURED

LEASE = 2.0
LOSS = {"tcp": 10, "udp": 20, "quic": 20}  # per cent, each way
FRAMES, INTERVAL = 200, 0.01


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(LOSS))
def test_loss_and_partition_between_hosts(kind, tmp_path) -> None:
    with hosts() as found:
        if isinstance(found, str):
            print(f"no namespaces on this machine ({found}): the memory network stands in")
            assert found
            in_memory(LOSS[kind] / 100.0)
            return
        named = make_keys(tmp_path / "keys", ["a", "b"], [host.address for host in found])
        identities = [named[name] if kind in SECURED else None for name in "ab"]
        with_time(lambda _: between(kind, found, identities))


def between(kind: str, found: tuple[Host, Host], identities: list[Identity | None]) -> None:
    first, second = found
    where = f"{kind}/{first.address}:7447"
    with contextlib.ExitStack() as stack:
        stack.callback(heal, found)
        listener = Talker(first, where, [], identities[0])
        stack.callback(listener.close)
        connector = Talker(second, "", [where], identities[1])
        stack.callback(connector.close)
        assert until(lambda: connector("linked") == 1 == listener("linked"))
        assert until(lambda: len(connector("ask", 1, 0.0, 0.1)["order"]) == 1)
        loses(kind, found, connector)
        parts(kind, found, connector)


def heal(found: tuple[Host, Host]) -> None:
    """Neither loss nor partition any more."""
    for host in found:
        host.cable("up")
        with contextlib.suppress(OSError):
            host.within("nft", "flush", "ruleset")
        with contextlib.suppress(OSError):
            host.within("tc", "qdisc", "del", "dev", host.device, "root")


def loses(kind: str, found: tuple[Host, Host], connector: Talker) -> None:
    """Best effort loses and does not wait; reliable waits and loses nothing while the link stands."""
    percent = LOSS[kind]
    clean = connector("ask", FRAMES, INTERVAL, 5.0)
    assert len(set(clean["order"])) >= 0.95 * FRAMES  # a busy machine may drop some of what nobody waits for
    ways = {host.lose(percent) for host in found}
    rough = connector("ask", FRAMES, INTERVAL, 1.0 if kind != "tcp" else 20.0)
    share = len(set(rough["order"])) / FRAMES
    stood = rough["presence"] == [True]
    print(
        f"{kind}: round trip p95 {1e3 * clean['p95']:.1f} ms; {percent} % loss each way by {', '.join(ways)}:"
        f" {100 * share:.0f} % arrived, p95 {1e3 * rough['p95']:.1f} ms, link stood: {stood}"
    )
    if isinstance(parse_address(f"{kind}/x:1").delivery, Reliable):
        assert rough["order"] == sorted(rough["order"])
        assert share == 1.0 or not stood
    elif ways == {"nft"}:
        expected = (1.0 - percent / 100.0) ** 2
        assert abs(share - expected) < 0.2 or not stood  # five standard deviations are 0.17
        assert rough["p95"] < 0.2
    heal(found)
    assert until(lambda: len(connector("ask", 10, INTERVAL, 1.0)["order"]) == 10)


def parts(kind: str, found: tuple[Host, Host], connector: Talker) -> None:
    """A silent partition is noticed by the lease; afterwards the link comes back by itself."""
    known = len(connector("presence"))
    found[1].cable("down")
    start = time.monotonic()
    assert until(lambda: connector("presence")[known:] == [False])
    noticed = time.monotonic() - start
    assert noticed < 3.0 * LEASE
    assert connector("linked") == 0
    found[1].cable("up")
    start = time.monotonic()
    assert until(lambda: len(connector("ask", 1, 0.0, 0.1)["order"]) == 1)
    print(f"{kind}: partition noticed after {noticed:.2f} s, rejoined {time.monotonic() - start:.2f} s after its end")


def in_memory(loss: float) -> None:
    """The same questions to the memory network."""
    network = MemoryNetwork([("a", "b")], loss=loss)
    sender, receiver = network.transport("a"), network.transport("b")
    assert sender.delivery == BestEffort()
    heard: list[bytes] = []
    receiver.subscribe("x", lambda _, data: heard.append(data))
    network.cut([("a", "b")], 1.0, 2.0)
    for number in range(1000):
        sender.publish("x", number.to_bytes(4, "little"))
    assert abs(len(heard) / 1000 - (1.0 - loss)) < 0.1
    heard.clear()
    network.deliver(1.5)
    sender.publish("x", b"lost")
    network.deliver(2.5)
    assert until(lambda: heard, act=lambda: sender.publish("x", b"back"))
    assert set(heard) == {b"back"}


def test_the_stand_in_holds() -> None:
    in_memory(0.2)


def test_a_machine_without_namespaces_says_why(monkeypatch) -> None:
    monkeypatch.setattr("tests.runtime.two_hosts.shutil.which", lambda _: None)
    with hosts() as found:
        assert found == "there is no program ip (iproute2)"
