"""Addresses of QUIC are free as soon as their session has closed, whoever still calls."""

from __future__ import annotations

import socket
from contextlib import ExitStack

from tests.runtime.links import address, identity, until
from trigpoint.runtime import ZenohTransport
from trigpoint.runtime.endpoints import Address
from trigpoint.runtime.sockets import let_go


def bound(kind: int) -> tuple[socket.socket, Address]:
    one = socket.socket(type=kind)
    one.bind(("127.0.0.1", 0))
    return one, Address("quic", "localhost", one.getsockname()[1])


def no_such_name(*_, **__):
    raise socket.gaierror("no such name")


def test_a_session_opens_again_where_neighbours_go_on_calling(monkeypatch) -> None:
    """They call at once after the link broke: without ``let_go`` every other time the address is taken for 30 s."""
    monkeypatch.setattr("trigpoint.runtime.zenoh_link._DRAIN", 0.0)
    where = address("quic")
    with ExitStack() as stack:
        for name in "bc":
            stack.callback(ZenohTransport("", [where], identity=identity("quic", name)).close)
        for _ in range(6):
            one = ZenohTransport(where, [], identity=identity("quic", "a"))
            try:
                assert until(lambda one=one: one.linked == 2)
            finally:
                one.close()


def test_only_the_datagram_socket_of_this_very_address_is_let_go(monkeypatch) -> None:
    (own, place), (other, _), (stream, elsewhere) = map(
        bound, (socket.SOCK_DGRAM, socket.SOCK_DGRAM, socket.SOCK_STREAM)
    )
    with own, other, stream:
        before = [one.getsockname() for one in (own, other, stream)]
        let_go(elsewhere)
        let_go(Address("quic", place.host, 0))
        with monkeypatch.context() as without_names:
            without_names.setattr(socket, "getaddrinfo", no_such_name)
            let_go(place)
        assert [one.getsockname() for one in (own, other, stream)] == before
        let_go(place)
        assert own.getsockname()[1] != place.port
        assert [one.getsockname() for one in (other, stream)] == before[1:]
        with socket.socket(type=socket.SOCK_DGRAM) as next_one:
            next_one.bind(before[0])
