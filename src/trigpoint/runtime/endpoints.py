"""Addresses of nodes: ``KIND/WHERE``, and which of them stay on this machine.

=============================  =====================================================================================
address                        what it is
=============================  =====================================================================================
``unixsock-stream//PATH``      a socket file (the path is absolute, so two slashes): one machine only
``tcp/HOST:PORT``              a stream in plain text
``udp/HOST:PORT``              datagrams in plain text
``tls/HOST:PORT``              a stream, encrypted; both ends show a certificate
``quic/HOST:PORT``             datagrams and streams, encrypted; both ends show a certificate
=============================  =====================================================================================
"""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Literal, cast, get_args

from trigpoint.errors import ArgumentError
from trigpoint.runtime.settings import Identity
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable

AddressKind = Literal["unixsock-stream", "tcp", "udp", "tls", "quic"]

ADDRESS_KINDS: dict[AddressKind, Delivery] = {
    "unixsock-stream": Reliable(),
    "tcp": Reliable(),
    "udp": BestEffort(),
    "tls": Reliable(),
    "quic": BestEffort(),
}
"""Kinds of addresses, and what each guarantees for a frame."""

SECURED: frozenset[AddressKind] = frozenset({"tls", "quic"})
"""Kinds whose links are encrypted and show certificates."""

LONGEST_SOCKET_PATH = 100
"""Bytes of a socket file's path: the systems allow 104 to 108, the ending zero included."""

_PLACE = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+):(?P<port>[0-9]{1,5})")


@dataclass(frozen=True)
class Address:
    """One address, taken apart.

    Attributes:
        kind: what carries the frames.
        host: name or number of the machine; empty for a socket file.
        port: port, 0 for a socket file or for any free one.
        path: the socket file; empty for others.
    """

    kind: AddressKind
    host: str = ""
    port: int = 0
    path: str = ""

    @property
    def delivery(self) -> Delivery:
        """What is guaranteed for a frame."""
        return ADDRESS_KINDS[self.kind]

    @property
    def secured(self) -> bool:
        """Whether the link is encrypted and both ends show a certificate."""
        return self.kind in SECURED

    @property
    def local(self) -> bool:
        """Whether the address cannot be reached from another machine."""
        if self.kind == "unixsock-stream" or self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host.strip("[]")).is_loopback
        except ValueError:  # another name: nobody knows where it leads
            return False


def parse_address(text: str) -> Address:
    """Take the address ``text`` apart.

    Raises:
        ArgumentError: it is none of the forms above, or the socket file's path is too long for the system.
    """
    kind, _, place = text.partition("/")
    if kind not in get_args(AddressKind):
        raise ArgumentError(f"address {text!r}: expected {', '.join(get_args(AddressKind))}, a slash and a place")
    known = cast(AddressKind, kind)
    if known == "unixsock-stream":
        return _socket_file(text, place)
    found = _PLACE.fullmatch(place)
    if found is None or int(found["port"]) > 65535:
        raise ArgumentError(f"address {text!r}: expected {kind}/HOST:PORT with a port of at most 65535")
    return Address(known, host=found["host"], port=int(found["port"]))


def is_local(address: str) -> bool:
    """Whether ``address`` cannot be reached from another machine: a socket file, or a loopback address."""
    return parse_address(address).local


def require_safe(address: str, identity: Identity | None, *, allow_plain: bool = False) -> None:
    """Refuse plain text that leaves the machine.

    Args:
        address: where a node listens or connects to.
        identity: the node's certificates, or None.
        allow_plain: whether the user asked for plain text.

    Raises:
        ArgumentError: the address can be reached from other machines and is not encrypted, or is, without ``identity``.
    """
    parsed = parse_address(address)
    if parsed.secured and identity is None:
        raise ArgumentError(
            f"{address}: {parsed.kind} needs certificates; make them with 'trigpoint keys' and name them as identity"
        )
    if not (parsed.secured or parsed.local or allow_plain):
        raise ArgumentError(
            f"{address} can be reached from other machines, and {parsed.kind} is plain text that anybody there can"
            " read and forge. Use tls/ or quic/ with certificates from 'trigpoint keys', a loopback address, or allow"
            " plain text explicitly"
        )


def _socket_file(text: str, path: str) -> Address:
    if not path.startswith("/") or re.search(r"[?#\0]", path):
        raise ArgumentError(f"address {text!r}: expected unixsock-stream/ and an absolute path without '?' and '#'")
    length = len(path.encode("utf-8", "surrogateescape"))
    if length > LONGEST_SOCKET_PATH:
        raise ArgumentError(
            f"the path of the socket {path} has {length} bytes; systems allow about {LONGEST_SOCKET_PATH}."
            " Use a folder with a shorter name"
        )
    return Address("unixsock-stream", path=path)
