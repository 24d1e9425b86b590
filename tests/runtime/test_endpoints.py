"""Addresses: taken apart, judged, and refused where they leave the machine in plain text."""

from __future__ import annotations

import pytest

from trigpoint.errors import ArgumentError
from trigpoint.runtime import (
    ADDRESS_KINDS,
    Address,
    BestEffort,
    Identity,
    Reliable,
    is_local,
    parse_address,
    require_safe,
)
from trigpoint.runtime.endpoints import LONGEST_SOCKET_PATH

SOMEBODY = Identity("authority.pem", "a.pem", "a.key")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("unixsock-stream//run/x/a.sock", Address("unixsock-stream", path="/run/x/a.sock")),
        ("tcp/127.0.0.1:7447", Address("tcp", "127.0.0.1", 7447)),
        ("udp/my-host.lan:0", Address("udp", "my-host.lan", 0)),
        ("tls/localhost:65535", Address("tls", "localhost", 65535)),
        ("quic/[::1]:7447", Address("quic", "[::1]", 7447)),
    ],
)
def test_addresses_are_taken_apart(text, expected) -> None:
    assert parse_address(text) == expected
    assert isinstance(expected.delivery, Reliable | BestEffort)


def test_what_may_overtake_is_declared() -> None:
    weak = {kind for kind, delivery in ADDRESS_KINDS.items() if isinstance(delivery, BestEffort)}
    assert weak == {"udp", "quic"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected unixsock-stream, tcp"),
        ("http/a:1", "expected unixsock-stream, tcp"),
        ("tcp", "tcp/HOST:PORT"),
        ("tcp/a", "tcp/HOST:PORT"),
        ("tcp/:7447", "tcp/HOST:PORT"),
        ("tcp/a:65536", "at most 65535"),
        ("tcp/a:1?rel=0", "tcp/HOST:PORT"),
        ("tls/a:1#root_ca_certificate=x", "tls/HOST:PORT"),
        ("quic/a b:1", "quic/HOST:PORT"),
        ("unixsock-stream/run/x/a", "absolute path"),
        ("unixsock-stream//run/x/a?x=1", "absolute path"),
        ("unixsock-stream//" + "x" * LONGEST_SOCKET_PATH, "systems allow about 100"),
    ],
)
def test_others_are_refused(text, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        parse_address(text)


@pytest.mark.parametrize(
    ("text", "local"),
    [
        ("unixsock-stream//run/x/a", True),
        ("tcp/127.1.2.3:1", True),
        ("tcp/localhost:1", True),
        ("tcp/[::1]:1", True),
        ("tcp/0.0.0.0:1", False),
        ("tcp/[::]:1", False),
        ("tcp/10.0.0.1:1", False),
        ("tcp/localhost.example:1", False),
    ],
)
def test_what_stays_on_the_machine(text, local) -> None:
    assert is_local(text) is local


@pytest.mark.parametrize("text", ["tcp/10.0.0.1:1", "udp/0.0.0.0:1"])
def test_plain_text_that_leaves_the_machine_needs_a_word(text) -> None:
    with pytest.raises(ArgumentError, match="plain text that anybody there can read"):
        require_safe(text, None)
    require_safe(text, None, allow_plain=True)


def test_secured_addresses_need_certificates() -> None:
    with pytest.raises(ArgumentError, match="tls needs certificates"):
        require_safe("tls/10.0.0.1:1", None, allow_plain=True)
    require_safe("tls/10.0.0.1:1", SOMEBODY)
    require_safe("tcp/127.0.0.1:1", None)
    require_safe("unixsock-stream//run/x/a", None)
