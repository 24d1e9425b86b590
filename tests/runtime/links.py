"""Pairs of Zenoh transports, waiting, and certificates made once."""

from __future__ import annotations

import contextlib
import functools
import itertools
import os
import socket
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from tests.machine import free_port, until
from trigpoint.runtime import AccessRules, Identity, ZenohTransport, make_keys
from trigpoint.runtime.endpoints import ADDRESS_KINDS, SECURED

KINDS = sorted(ADDRESS_KINDS)
NET = "trigpoint/net"
_counter = itertools.count()


@functools.cache
def folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="tp")


def address(kind: str) -> str:
    """An address of this kind that nobody uses."""
    if kind == "unixsock-stream":
        return f"unixsock-stream/{folder().name}/{os.getpid()}-{next(_counter)}"
    port = free_port(socket.SOCK_DGRAM if kind in ("udp", "quic") else socket.SOCK_STREAM)
    return f"{kind}/127.0.0.1:{port}"


@functools.cache
def identities() -> Mapping[str, Identity]:
    guests = {"sensor": "sensor", "monitor": "monitor", "supervisor": "supervisor"}
    return make_keys(Path(folder().name) / "keys", ["a", "b", "c"], guests=guests)


def identity(kind: str, name: str) -> Identity | None:
    return identities()[name] if kind in SECURED else None


@contextlib.contextmanager
def opened(
    kind: str, *names: str, rules: Mapping[str, AccessRules] | None = None
) -> Iterator[tuple[ZenohTransport, ...]]:
    """The first of ``names`` listens, the others connect to it; all are closed at the end, the listener last."""
    where, given = address(kind), rules or {}
    with contextlib.ExitStack() as stack:
        ends = []
        for name in names:
            listen, connect = ("", [where]) if ends else (where, [])
            end = ZenohTransport(listen, connect, identity=identity(kind, name), rules=given.get(name))
            stack.callback(end.close)
            ends.append(end)
        assert until(lambda: ends[0].linked == len(names) - 1)
        yield tuple(ends)


def listen(transport: ZenohTransport, pattern: str) -> list[tuple[str, bytes]]:
    heard: list[tuple[str, bytes]] = []
    transport.subscribe(pattern, lambda key, data: heard.append((key, data)))
    return heard
