"""The sockets of this process: how an address of QUIC is freed whose session has closed."""

from __future__ import annotations

import os
import socket
import stat
import time
from contextlib import suppress

from trigpoint.runtime.endpoints import Address

_BY_ITSELF = 0.3  # s
_OPEN = "/dev/fd"  # the numbers of this process's open files; Linux and macOS have it


def let_go(address: Address) -> None:
    """Free the datagram socket that is bound to ``address`` in this process and that nobody here needs any more.

    When a session over QUIC has closed, its socket is closed within a tenth of a second; or, where a neighbour's call
    came just after the link broke, it stays open for as long as that one waits for an answer that nobody gives: up to
    half a minute in which nothing else could listen here, a node's own next session neither. So a socket that is still
    there after that tenth and some more is exchanged for one that is bound nowhere; what still reads from it hears
    nothing more, and ends in its time.

    Args:
        address: host and port; a port of 0 (any free one) names no socket, and nothing is done.
    """
    if not address.port or not os.path.isdir(_OPEN):
        return
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)
    except socket.gaierror:  # a name that means nothing any more
        return
    places = {(str(one[4][0]), address.port) for one in found}
    end = time.monotonic() + _BY_ITSELF
    while (bound := [number for number in map(int, os.listdir(_OPEN)) if _is_bound(number, places)]) and (
        time.monotonic() < end
    ):
        time.sleep(0.01)
    for number in bound:
        with (
            suppress(OSError),  # closed meanwhile
            socket.socket(fileno=os.dup(number)) as one,
            socket.socket(one.family, socket.SOCK_DGRAM) as nowhere,
        ):
            nowhere.setblocking(False)
            os.dup2(nowhere.fileno(), number, inheritable=False)


def _is_bound(number: int, places: set[tuple[str, int]]) -> bool:
    with suppress(OSError):  # gone meanwhile
        if stat.S_ISSOCK(os.fstat(number).st_mode):
            with socket.socket(fileno=os.dup(number)) as one:
                return one.type == socket.SOCK_DGRAM and tuple(one.getsockname()[:2]) in places
    return False
