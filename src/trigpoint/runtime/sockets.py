"""The sockets of this process: how an address of QUIC is freed whose session has closed."""

from __future__ import annotations

import os
import socket
import stat
from contextlib import suppress

from trigpoint.runtime.endpoints import Address

_OPEN = "/dev/fd"  # the numbers of this process's open files; Linux and macOS have it


def let_go(address: Address) -> None:
    """Free the datagram socket that is bound to ``address`` in this process and that nobody here needs any more.

    When a session over QUIC has closed, its socket stays open for as long as a neighbour's call, which comes at once
    after the link broke, waits for an answer that nobody gives: up to half a minute in which nothing else could listen
    here, a node's own next session neither. So the socket is exchanged for one that is bound nowhere; what still reads
    from it hears nothing more, and ends in its time.

    Args:
        address: host and port; a port of 0 (any free one) names no socket, and nothing is done.
    """
    if not address.port or not os.path.isdir(_OPEN):
        return
    with suppress(socket.gaierror):  # a name that means nothing any more
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)
        places = {(str(one[4][0]), address.port) for one in found}
        for number in map(int, os.listdir(_OPEN)):
            with suppress(OSError):  # gone meanwhile
                _exchange(number, places)


def _exchange(number: int, places: set[tuple[str, int]]) -> None:
    if not stat.S_ISSOCK(os.fstat(number).st_mode):
        return
    with socket.socket(fileno=os.dup(number)) as one:
        family, bound = one.family, one.type == socket.SOCK_DGRAM and tuple(one.getsockname()[:2]) in places
    if bound:
        with socket.socket(family, socket.SOCK_DGRAM) as nowhere:
            nowhere.setblocking(False)
            os.dup2(nowhere.fileno(), number, inheritable=False)
