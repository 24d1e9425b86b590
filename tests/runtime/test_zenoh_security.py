"""Attackers with real sessions, over tls and quic: nobody gets in, hears or says what a certificate does not allow."""

from __future__ import annotations

import contextlib
import json
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from tests.machine import PATIENCE, until
from tests.runtime import links
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.runtime import Identity, NodeSettings, ZenohTransport, guest_rules, make_keys, open_transport
from trigpoint.runtime.topics import node_key
from trigpoint.runtime.zenoh_link import session_config

KINDS = ["tls", "quic"]
ONE = np.eye(1)
NODE = f"{links.NET}/node"
GUESTS = {"sensor": "sensor", "monitor": "monitor", "supervisor": "supervisor"}


def node_a(where: str) -> ZenohTransport:
    """Node a hears b and uses the reading 4; c belongs to the network, but is no neighbour of a."""
    arcs = (LocalArc(4, "b", 1.0, ONE, ONE, ONE),)
    program = LocalObserver("a", ONE, None, arcs)
    identity = links.identities()["a"]
    return open_transport(NodeSettings("net", program, 0.1, listen=where, identity=identity, guests=GUESTS))


@contextlib.contextmanager
def around_a(kind: str, *names: str, where: str = "") -> Iterator[tuple[ZenohTransport, ...]]:
    """Node a, and others linked to it that keep to no rules of their own."""
    where = where or links.address(kind)
    with contextlib.ExitStack() as stack:
        a = node_a(where)
        stack.callback(a.close)
        others = [ZenohTransport("", [where], identity=links.identities()[name]) for name in names]
        for other in others:
            stack.callback(other.close)
        assert until(lambda: a.linked == len(names) and all(other.linked == 1 for other in others))
        yield (a, *others)


def attempt(config: dict[str, Any]) -> None:
    """One try to link, with whatever configuration; a refusal is a ``ZError``."""
    given = zenoh.Config()
    tries = {"connect/timeout_ms": 1000, "connect/exit_on_failure": True}
    for path, value in {**config, **tries}.items():
        given.insert_json5(path, json.dumps(value))
    zenoh.open(given).close()


def refused(config: dict[str, Any]) -> bool:
    try:
        attempt(config)
    except zenoh.ZError:
        return True
    return False


def stranger(tmp_path: Path, name: str) -> Identity:
    return make_keys(tmp_path / "theirs", [name])[name]


@pytest.mark.parametrize("kind", KINDS)
def test_strangers_get_no_link(kind, tmp_path, capfd) -> None:
    own = links.identities()["b"]
    theirs = stranger(tmp_path, "b")
    where = links.address(kind)
    good = session_config("", [where], identity=own)
    tls = good["transport/link/tls"]
    without = {key: value for key, value in tls.items() if not key.startswith(("listen", "connect"))}
    signed_by_themselves = {"connect_certificate": theirs.certificate, "connect_private_key": theirs.key}
    a = node_a(where)
    try:
        assert until(lambda: not refused(good))
        for spoiled in ({**without, "enable_mtls": False}, {**tls, **signed_by_themselves}):
            with pytest.raises(zenoh.ZError):
                attempt({**good, "transport/link/tls": spoiled})
        plain = "tcp" if kind == "tls" else "udp"
        with pytest.raises(zenoh.ZError):
            attempt(session_config("", [where.replace(kind, plain)]))
        assert until(lambda: a.linked == 0)
        with_certificate = ZenohTransport("", [where], identity=own)
        assert until(lambda: with_certificate.linked == 1)
        with_certificate.close()
    finally:
        a.close()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", KINDS)
def test_a_node_links_to_no_impostor(kind, tmp_path) -> None:
    where = links.address(kind)
    impostor = ZenohTransport(where, [], identity=stranger(tmp_path, "a"))
    try:
        with pytest.raises(zenoh.ZError):
            attempt(session_config("", [where], identity=links.identities()["b"]))
    finally:
        impostor.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_certificate_speaks_for_its_own_node_only(kind) -> None:
    with around_a(kind, "b", "c") as (a, b, c):
        heard = links.listen(a, f"{links.NET}/**")
        for name in ("a", "b", "c"):
            a.subscribe(f"{NODE}/{name}/**", lambda key, data: heard.append((key, data)))
        a.subscribe(f"{links.NET}/reading/4", lambda key, data: heard.append((key, data)))

        def speak() -> None:
            for key in (f"{NODE}/c/estimate", f"{NODE}/a/control", f"{links.NET}/reading/4", f"{NODE}/a/estimate"):
                b.publish(key, b"forged")
            for key in (f"{NODE}/b/estimate", f"{NODE}/c/estimate"):
                c.publish(key, b"forged")
            b.publish(f"{NODE}/b/estimate", b"own")

        assert until(lambda: len(heard) >= 20, act=speak)
        assert set(heard) == {(f"{NODE}/b/estimate", b"own")}


@pytest.mark.parametrize("kind", KINDS)
def test_any_text_is_a_name(kind, tmp_path) -> None:
    """Names are written so that they fit keys and certificates alike."""
    odd, other = "Nord 3/ü*", "$#?&*"
    made = make_keys(tmp_path / "keys", [odd, other])
    where = links.address(kind)
    program = LocalObserver(odd, ONE, None, (LocalArc(0, other, 1.0, ONE, ONE, ONE),))
    a = open_transport(NodeSettings("my net/1", program, 0.1, listen=where, identity=made[odd]))
    b = ZenohTransport("", [where], identity=made[other])
    try:
        keys = [node_key("my net/1", name, "estimate") for name in (odd, other)]
        at_a, at_b = links.listen(a, keys[1]), links.listen(b, keys[0])
        assert until(lambda: at_a and at_b, act=lambda: (a.publish(keys[0], b"1"), b.publish(keys[1], b"2")))
        assert set(at_a) == {(keys[1], b"2")}
    finally:
        b.close()
        a.close()


@pytest.mark.parametrize("kind", KINDS)
def test_who_may_not_listen_hears_nothing(kind) -> None:
    with around_a(kind, "b", "c", "sensor", "monitor", "supervisor") as (a, *others):
        heard = [links.listen(other, f"{links.NET}/**") for other in others]
        narrow = [links.listen(other, f"{NODE}/a/**") for other in others]
        b, c, sensor, monitor, supervisor = range(5)
        assert until(
            lambda: min(len(narrow[b]), len(heard[monitor]), len(heard[supervisor])) >= 20,
            act=lambda: (a.publish(f"{NODE}/a/estimate", b"own"), a.publish(f"{NODE}/b/estimate", b"forged")),
        )
        assert heard[c] == narrow[c] == heard[sensor] == narrow[sensor] == []
        for each in (narrow[b], heard[monitor], heard[supervisor]):
            assert set(each) == {(f"{NODE}/a/estimate", b"own")}


@pytest.mark.parametrize("kind", KINDS)
def test_guests_do_what_their_role_says(kind) -> None:
    with around_a(kind, "sensor", "monitor", "supervisor") as (a, sensor, monitor, supervisor):
        heard: list[tuple[str, bytes]] = []
        keys = [f"{links.NET}/reading/4", f"{links.NET}/reading/5", f"{NODE}/a/control", f"{NODE}/b/estimate"]
        for key in keys:
            a.subscribe(key, lambda key, data: heard.append((key, data)))

        def speak() -> None:
            for name, guest in (("sensor", sensor), ("monitor", monitor), ("supervisor", supervisor)):
                for key in keys:
                    guest.publish(key, name.encode())

        expected = {(f"{links.NET}/reading/4", b"sensor"), (f"{NODE}/a/control", b"supervisor")}
        assert until(lambda: expected <= set(heard) and len(heard) >= 40, act=speak)
        assert set(heard) == expected


@pytest.mark.parametrize("kind", KINDS)
def test_a_monitor_takes_from_each_node_its_own_keys_only(kind) -> None:
    """It asks for everything, so that everything is sent to it; what is forged does not come in."""
    where = links.address(kind)
    rules = guest_rules("net", "monitor", {"a": "node", "b": "node"})
    monitor = ZenohTransport(where, [], identity=links.identities()["monitor"], rules=rules)
    a = ZenohTransport("", [where], identity=links.identities()["a"])
    try:
        heard = links.listen(monitor, f"{links.NET}/**")

        def speak() -> None:
            a.publish(f"{NODE}/b/estimate", b"forged")
            a.publish(f"{NODE}/a/estimate", b"own")

        assert until(lambda: len(heard) >= 20, act=speak)
        assert set(heard) == {(f"{NODE}/a/estimate", b"own")}
    finally:
        a.close()
        monitor.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_flood_drowns_nobody(kind) -> None:
    """While one neighbour sends as fast as it can, forged and replayed frames among them, another is heard."""
    with around_a(kind, "b", "supervisor") as (a, b, supervisor):
        heard = links.listen(a, f"{NODE}/b/*")
        orders = links.listen(a, f"{NODE}/a/control")

        def flood() -> None:
            for _ in range(500):
                b.publish(f"{NODE}/b/estimate", bytes(500))
                b.publish(f"{NODE}/c/estimate", bytes(500))
            supervisor.publish(f"{NODE}/a/control", b"go")

        assert until(lambda: len(orders) >= 3 and len(heard) >= 1000, act=flood)
        assert {key for key, _ in heard} == {f"{NODE}/b/estimate"}


def test_half_open_and_garbled_connections_block_nobody() -> None:
    """Links that stand go on, and new ones come up. (Zenoh takes 0.1 s after each garbled greeting.)"""
    where = links.address("tls")
    place = where.removeprefix("tls/").rpartition(":")
    with around_a("tls", "b", where=where) as (a, b):
        heard = links.listen(a, f"{NODE}/b/*")
        with contextlib.ExitStack() as stack:
            for count in range(130):  # more than may wait for an answer at a time
                connection = socket.create_connection((place[0], int(place[2])), timeout=PATIENCE)
                stack.callback(connection.close)
                if count < 10:
                    connection.sendall(os.urandom(200))
            assert until(lambda: heard, act=lambda: b.publish(f"{NODE}/b/estimate", b"own"))
            c = ZenohTransport("", [where], identity=links.identities()["c"])
            stack.callback(c.close)
            assert until(lambda: a.linked == 2)
