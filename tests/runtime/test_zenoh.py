"""Links over Zenoh: the public conformance kit on every kind of address, trouble with addresses, and clean ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.machine import PATIENCE, listening, until, with_time
from tests.runtime import links
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.observers.local import LocalObserver
from trigpoint.runtime import (
    AccessRules,
    BestEffort,
    MemoryNetwork,
    NodeSettings,
    Reliable,
    Transport,
    ZenohTransport,
    open_transport,
    zenoh_link,
)
from trigpoint.runtime.zenoh_link import LONGEST_MESSAGE, session_config
from trigpoint.testing import check_transport

LEASE = 600_000  # ms, at both ends: whatever is noticed in time was not noticed by the lease
CHILD = """
import sys
from trigpoint.runtime import ZenohTransport, zenoh_link
zenoh_link._LEASE = int(sys.argv[2])
transport = ZenohTransport(sys.argv[1], [])
transport.announce("alive/child")
transport.subscribe("to/child", lambda key, data: transport.publish("from/child", data))
print("ready", flush=True)
sys.stdin.readline()
"""


def child(address: str, lease: int = zenoh_link._LEASE) -> subprocess.Popen[str]:
    """A process that listens there and echoes; it ends without closing anything when its input ends."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen([sys.executable, "-c", CHILD, address, str(lease)], **pipes)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def settings(name: str, listen: str = "", peers=None) -> NodeSettings:
    return NodeSettings("net", LocalObserver(name, np.eye(1), None, ()), 0.1, listen=listen, peers=peers or {})


@pytest.mark.parametrize("kind", links.KINDS)
def test_the_conformance_kit_passes(kind) -> None:
    where = links.address(kind)

    def pair() -> tuple[ZenohTransport, ZenohTransport]:
        first = ZenohTransport(where, [], identity=links.identity(kind, "a"))
        return first, ZenohTransport("", [where], identity=links.identity(kind, "b"))

    check_transport(pair, patience=PATIENCE / 2.0)  # 300 frames that each wait a moment, 0.2 s, are too slow


@pytest.mark.parametrize(
    "trouble", [{}, {"delay": 0.05}, {"loss": 0.2, "delay": 0.05, "jitter": 0.01}], ids=["plain", "late", "lossy"]
)
def test_the_conformance_kit_passes_in_memory(trouble, monkeypatch) -> None:
    networks: list[MemoryNetwork] = []

    def pair() -> tuple[Transport, Transport]:
        networks.append(MemoryNetwork([("a", "b"), ("b", "a")], **trouble))
        return networks[-1].transport("a"), networks[-1].transport("b")

    clock = SimpleNamespace(monotonic=lambda: networks[-1].now)  # publishing takes none of the network's time
    monkeypatch.setattr("trigpoint.testing.transports.time", clock)
    check_transport(pair, patience=2.0, advance=lambda: networks[-1].deliver(networks[-1].now + 0.01))


def test_the_weaker_guarantee_counts() -> None:
    with links.opened("tcp", "a") as (end,):
        assert end.delivery == Reliable()
    mixed = ZenohTransport(links.address("tcp"), [links.address("udp")])
    mixed.close()
    assert mixed.delivery == BestEffort()


@pytest.mark.parametrize("kind", links.KINDS)
def test_an_address_in_use_is_named(kind) -> None:
    where = links.address(kind)
    first = ZenohTransport(where, [], identity=links.identity(kind, "a"))
    try:
        with pytest.raises(ArgumentError, match=f"{where} is in use by another process"):
            ZenohTransport(where, [], identity=links.identity(kind, "b"))
    finally:
        first.close()
    ZenohTransport(where, [], identity=links.identity(kind, "a")).close()


def test_an_address_that_cannot_be_bound_is_named() -> None:
    with pytest.raises(ArgumentError, match=r"cannot listen on tcp/192\.0\.2\.1:7447") as refused:
        ZenohTransport("tcp/192.0.2.1:7447", [])
    assert ".rs:" not in str(refused.value)


def test_nobody_forwards_and_order_of_start_does_not_matter() -> None:
    """On a chain a - b - c, c hears b and never a; c started before b."""
    to_a, to_b = links.address("unixsock-stream"), links.address("unixsock-stream")
    c = ZenohTransport("", [to_b])
    a = ZenohTransport(to_a, [])
    b = ZenohTransport(to_b, [to_a])
    try:
        heard, at_b = links.listen(c, "**"), links.listen(b, "**")
        assert until(
            lambda: ("from/b", b"b") in heard and ("from/a", b"a") in at_b,
            act=lambda: (a.publish("from/a", b"a"), b.publish("from/b", b"b")),
        )
        assert {key for key, _ in heard} == {"from/b"}
        assert (a.linked, b.linked, c.linked) == (1, 2, 1)
    finally:
        for end in (c, b, a):
            end.close()
    assert a.linked == 0


def test_a_killed_peer_is_noticed_and_comes_back(monkeypatch) -> None:
    """By the end of its stream, not by the lease, which is ten minutes here."""
    monkeypatch.setattr(zenoh_link, "_LEASE", LEASE)
    where = links.address("tcp")
    seen: list[bool] = []
    end = ZenohTransport("", [where])
    try:
        heard = links.listen(end, "from/*")
        end.announce("alive/own")
        end.watch("alive/*", lambda _, here: seen.append(here))
        for count in (1, 2):
            process = child(where, LEASE)
            assert until(lambda: len(seen) == 2 * count - 1)  # noqa: B023
            heard.clear()
            assert until(lambda: heard, act=lambda: end.publish("to/child", b"x"))
            os.kill(process.pid, signal.SIGKILL)
            assert until(lambda: len(seen) == 2 * count)  # noqa: B023
            process.communicate()
        assert seen == [True, False] * 2
    finally:
        end.close()


def test_a_process_ends_while_frames_arrive() -> None:
    """Also one that closes nothing."""
    where = links.address("unixsock-stream")
    process = child(where)
    end = ZenohTransport("", [where])
    stop = threading.Event()

    def flood() -> None:
        while not stop.is_set():
            end.publish("to/child", bytes(100))
            time.sleep(0.0002)

    sender = threading.Thread(target=flood)
    try:
        heard = links.listen(end, "from/*")
        sender.start()
        assert until(lambda: heard)
        _, errors = process.communicate("", timeout=PATIENCE)
        assert process.returncode == 0
        assert errors == ""
    finally:
        stop.set()
        sender.join()
        process.kill()
        end.close()


def test_closing_while_others_publish_is_quiet() -> None:
    """Whatever the other threads are at: they go on as if nobody were linked."""
    for _ in range(5):
        trouble: list[BaseException] = []
        with links.opened("unixsock-stream", "a", "b") as (a, b):
            links.listen(a, "**")
            stop = threading.Event()

            def rush(end: ZenohTransport = b, stop: threading.Event = stop, trouble: list = trouble) -> None:
                number = 0
                try:
                    while not stop.is_set():
                        number += 1
                        end.publish(f"x/{number % 500}", b"1")
                except BaseException as error:
                    trouble.append(error)

            threads = [threading.Thread(target=rush) for _ in range(2)]
            for thread in threads:
                thread.start()
            time.sleep(0.02)
            b.close()
            stop.set()
            for thread in threads:
                thread.join()
        assert trouble == []


def test_a_stuck_neighbour_holds_up_nobody() -> None:
    """The link of a stopped process fills up, is given up once, and stands again when the process goes on.

    One frame waits for a moment, 0.2 s; without it for 5 s. No other frame waits.
    """
    with_time(lambda _: stuck())


def stuck() -> None:
    where = links.address("unixsock-stream")
    process = child(where)
    end = ZenohTransport("", [where])
    try:
        heard = links.listen(end, "from/*")
        assert until(lambda: heard, act=lambda: end.publish("to/child", b"x"))
        os.kill(process.pid, signal.SIGSTOP)
        waits: list[float] = []

        def publish() -> None:
            start = time.monotonic()
            end.publish("to/child", bytes(10_000))
            waits.append(time.monotonic() - start)

        assert until(lambda: end.linked == 0, act=publish)
        *others, longest = sorted(waits)
        assert longest < 2.0
        assert others[-1] < 0.1
        os.kill(process.pid, signal.SIGCONT)
        heard.clear()
        assert until(lambda: heard, act=lambda: end.publish("to/child", b"y"))
    finally:
        process.kill()
        process.communicate()
        end.close()


def test_nothing_is_left_behind(capfd) -> None:
    folder = Path(links.folder().name)
    before = set(folder.iterdir())  # a killed process leaves its socket; the next one takes it over
    with links.opened("unixsock-stream", "a", "b") as (a, b):
        heard = links.listen(a, "**")
        assert until(lambda: heard, act=lambda: b.publish("x", b"1"))
    threads, files = threading.active_count(), len(os.listdir("/proc/self/fd"))
    tasks = len(os.listdir("/proc/self/task"))
    for _ in range(5):
        with links.opened("unixsock-stream", "a", "b") as (a, b):
            heard = links.listen(a, "**")
            assert until(lambda: heard, act=lambda: b.publish("x", b"1"))  # noqa: B023
    assert until(lambda: threading.active_count() == threads)
    assert until(lambda: len(os.listdir("/proc/self/fd")) <= files + 2)
    assert until(lambda: len(os.listdir("/proc/self/task")) <= tasks + 4)  # the pool of all sessions
    assert set(folder.iterdir()) <= before
    assert capfd.readouterr() == ("", "")


def test_misuse_is_explained() -> None:
    with links.opened("unixsock-stream", "a") as (end,):
        with pytest.raises(ArgumentError, match=f"at most {LONGEST_MESSAGE} bytes"):
            end.publish("x", bytes(LONGEST_MESSAGE + 1))
        with pytest.raises(ArgumentError, match="cannot publish under 'a//b'"):
            end.publish("a//b", b"")
        with pytest.raises(ArgumentError, match="'a//b' is no key or pattern"):
            links.listen(end, "a//b")
        with pytest.raises(ArgumentError, match="'' is no key or pattern"):
            end.announce("")
        end.close()
        end.publish("x", b"nobody hears this")


@pytest.mark.parametrize(
    ("listen", "options", "words"),
    [
        ("tls/localhost:1", {}, "tls needs certificates"),
        ("tcp/localhost:1", {"identity": True}, "tcp shows no certificate"),
        ("tcp/localhost:1", {"rules": AccessRules()}, "access rules go by the name in a certificate"),
    ],
)
def test_certificates_and_addresses_must_fit(listen, options, words) -> None:
    if options.get("identity"):
        options = {"identity": links.identities()["a"]}
    with pytest.raises(ArgumentError, match=words):
        session_config(listen, [], **options)


def test_a_missing_certificate_is_named() -> None:
    identity = replace(links.identities()["a"], certificate="/nowhere/a.pem")
    with pytest.raises(ArgumentError, match=r"certificate of the identity, /nowhere/a\.pem, is no file"):
        ZenohTransport("tls/localhost:1", [], identity=identity)


def test_nothing_is_bound_that_nobody_named() -> None:
    config = session_config("", ["tcp/127.0.0.1:7447"])
    assert config["listen/endpoints"] == []
    assert not config["scouting/multicast/enabled"]
    assert not config["scouting/gossip/enabled"]
    with links.opened("tcp", "a", "b"):
        assert [host for host, _ in listening()] == ["0100007F"]


def test_a_node_opens_what_its_settings_say() -> None:
    where = links.address("unixsock-stream")
    seen: list[tuple[str, bool]] = []
    a = open_transport(settings("a", where))
    watcher = ZenohTransport("", [where])
    watcher.watch("trigpoint/net/node/*/alive", lambda key, here: seen.append((key, here)))
    try:
        assert until(lambda: seen == [("trigpoint/net/node/a/alive", True)])
        a.close()
        assert until(lambda: seen[1:] == [("trigpoint/net/node/a/alive", False)])
    finally:
        watcher.close()
        a.close()


def test_without_the_package_the_extra_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(MissingExtraError, match=r"eclipse-zenoh.*trigpoint\[live\]"):
        ZenohTransport("", [])
