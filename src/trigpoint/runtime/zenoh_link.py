"""``ZenohTransport``: links of Eclipse Zenoh between exactly the addresses that are named; no broker, no scouting."""

from __future__ import annotations

import json
import re
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.runtime.access import AccessRules, node_rules
from trigpoint.runtime.endpoints import Address, parse_address
from trigpoint.runtime.settings import Identity, NodeSettings
from trigpoint.runtime.sockets import let_go
from trigpoint.runtime.topics import node_key
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable, Sink

Presence = Callable[[str, bool], None]
"""Called with the key of a token, and whether it appeared or is gone; from any thread; returns at once."""

LONGEST_MESSAGE = 60_000
"""Bytes of a message at most; a frame of the protocol has about half as many."""

_LEASE = 2000  # ms without a sign of life after which a link counts as broken
_MOMENT = 200_000  # us that a full link may hold up a sender before it is closed, to be opened afresh
_DRAIN = 0.5  # s; a QUIC address is taken for some 0.1 s after its session has closed
_SOURCE = re.compile(r" at /\S+:\d+\.?")  # where in the library's own sources an error arose


def session_config(
    listen: str, connect: Sequence[str], *, identity: Identity | None = None, rules: AccessRules | None = None
) -> dict[str, Any]:
    """Configuration of one Zenoh session, as (path, value) pairs.

    Args:
        listen: own address; empty to listen nowhere.
        connect: addresses to connect to, again and again until they answer.
        identity: certificates; needed by tls and quic, refused for others.
        rules: who may say and hear what; None: everybody with a certificate may do everything.

    Raises:
        ArgumentError: an address or a file of ``identity`` does not fit.
    """
    own = [parse_address(listen)] if listen else []
    others = [parse_address(address) for address in connect]
    addresses = [*own, *others]
    _check_identity(addresses, identity, rules)
    config: dict[str, Any] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "open/return_conditions": {"connect_scouted": False, "declares": False},
        "listen/endpoints": [_endpoint(text) for text in ([listen] if listen else [])],
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
        "connect/endpoints": [_endpoint(text) for text in connect],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
        "transport/link/protocols": sorted({address.kind for address in addresses}) or ["unixsock-stream"],
        "transport/link/tx/lease": _LEASE,
        "transport/link/tx/keep_alive": 4,
        "transport/link/tx/queue/size/data": 16,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": _MOMENT,
        "transport/link/rx/max_message_size": 65536,  # pieces of longer ones are not kept
        "transport/unicast/open_timeout": _LEASE // 2,
        "transport/unicast/accept_timeout": _LEASE,
        "transport/shared_memory/enabled": False,
    }
    if identity is not None:
        config["transport/link/tls"] = _certificates(identity)
    if rules is not None:
        config["access_control"] = rules.to_zenoh()
    return config


@dataclass(eq=False)
class _Gate:
    """Whether frames pass. One at a time is handed over, under the lock."""

    open: bool = True
    lock: threading.RLock = field(default_factory=threading.RLock)


def _shut(gate: _Gate, session: Any) -> None:
    with gate.lock:
        gate.open = False
    session.close()


class ZenohTransport:
    """Links over Zenoh; satisfies ``Transport``.

    Args:
        listen: own address (``endpoints`` says which there are); empty to listen nowhere.
        connect: addresses of others. Whoever is not there yet is tried again, and so is a link that broke.
        identity: certificates for tls and quic; both ends of a link must show one of the same authority.
        rules: who may say and hear what, by the name in the certificate; None: everything.

    We assume:
        - peers do not forward: only who is linked directly hears a frame.
        - ``sink`` of ``subscribe`` returns at once; one frame at a time is handed over.

    Raises:
        ArgumentError: an address does not fit, is in use or cannot be bound, or a certificate cannot be read.
        MissingExtraError: Zenoh is not installed.
    """

    def __init__(
        self,
        listen: str,
        connect: Sequence[str],
        *,
        identity: Identity | None = None,
        rules: AccessRules | None = None,
    ) -> None:
        self._addresses = tuple(parse_address(text) for text in (*([listen] if listen else []), *connect))
        self._listens = self._addresses[0] if listen else None
        settings = session_config(listen, connect, identity=identity, rules=rules)
        self._zenoh = _zenoh()
        config = self._zenoh.Config()
        for path, value in settings.items():
            config.insert_json5(path, json.dumps(value))
        self._gate = _Gate()
        self._publishers: dict[str, Any] = {}
        self._held: list[Any] = []
        self._announced: set[str] = set()
        self._session = self._opened(config, listen, connect)
        # An interpreter that ends while frames still arrive would wait for ever: the session ends first, at exit, too.
        self._end = weakref.finalize(self, _shut, self._gate, self._session)

    @property
    def delivery(self) -> Delivery:
        """The weaker one, where addresses differ."""
        weak = any(isinstance(address.delivery, BestEffort) for address in self._addresses)
        return BestEffort() if weak else Reliable()

    @property
    def linked(self) -> int:
        """Number of others that are linked at this moment."""
        return len(self._session.info.peers_zid()) if self._gate.open else 0

    def publish(self, key: str, data: bytes) -> None:
        """Send ``data`` to all linked subscribers of ``key``; nobody hears it once the transport is closed.

        A reliable link that stays full for 0.2 s is closed and opened afresh, so that one stuck neighbour does not
        hold up a node.

        Raises:
            ArgumentError: ``data`` is longer than ``LONGEST_MESSAGE``, or ``key`` is no key.
        """
        if len(data) > LONGEST_MESSAGE:
            raise ArgumentError(f"a message has at most {LONGEST_MESSAGE} bytes; got {len(data)} for {key!r}")
        if not self._gate.open:
            return
        try:
            publisher = self._publishers.get(key)
            if publisher is None:
                publisher = self._publishers.setdefault(key, self._publisher(key))
            publisher.put(data)
        except self._zenoh.ZError as error:
            if self._gate.open:  # else closed by another thread meanwhile
                raise ArgumentError(f"cannot publish under {key!r}: {_plain(str(error))}") from error

    def subscribe(self, pattern: str, sink: Sink) -> None:
        """Hand to ``sink`` the key and the bytes of what others publish under ``pattern``; never the own frames.

        Raises:
            ArgumentError: ``pattern`` is no pattern.
        """
        put = self._zenoh.SampleKind.PUT

        def hand_over(sample: Any) -> None:
            if sample.kind == put:
                with self._gate.lock:
                    if self._gate.open:
                        sink(str(sample.key_expr), sample.payload.to_bytes())

        self._hold(pattern, lambda: self._session.declare_subscriber(
            pattern, self._direct(hand_over), allowed_origin=self._zenoh.Locality.REMOTE
        ))  # fmt: skip

    def announce(self, key: str) -> None:
        """Show a token under ``key`` for as long as this transport is open and the process lives.

        Raises:
            ArgumentError: ``key`` is no key.
        """
        self._announced.add(key)
        self._hold(key, lambda: self._session.liveliness().declare_token(key))

    def watch(self, pattern: str, present: Presence) -> None:
        """Tell ``present`` of every token under ``pattern`` of a linked peer that appears or is gone.

        A killed peer is gone within milliseconds where links are streams, else, and behind a silent network, after the
        lease of 2 s at the latest. Own tokens are not told of.

        Raises:
            ArgumentError: ``pattern`` is no pattern.
        """
        put = self._zenoh.SampleKind.PUT

        def tell(sample: Any) -> None:
            with self._gate.lock:
                key = str(sample.key_expr)
                if self._gate.open and key not in self._announced:
                    present(key, sample.kind == put)

        self._hold(
            pattern, lambda: self._session.liveliness().declare_subscriber(pattern, self._direct(tell), history=True)
        )

    def close(self) -> None:
        """End all links; nothing reaches a sink afterwards. A second time does nothing.

        An attempt to connect that is under way is waited for, 1 s at most. Not to be called from a sink.
        """
        self._end()
        if self._listens is not None and self._listens.kind == "quic":
            let_go(self._listens)
        self._held.clear()
        self._publishers.clear()

    def _opened(self, config: Any, listen: str, connect: Sequence[str]) -> Any:
        deadline = time.monotonic() + (_DRAIN if listen.startswith("quic/") else 0.0)
        while True:
            try:
                return self._zenoh.open(config)
            except self._zenoh.ZError as error:
                text = str(error)
                if not _is_taken(text) or time.monotonic() > deadline:
                    raise ArgumentError(_refusal(listen, connect, text)) from error
            time.sleep(0.02)

    def _direct(self, callback: Callable[[Any], None]) -> Any:
        """In the thread that receives: a flood then waits in the sender's socket, not in our memory."""
        return self._zenoh.handlers.Callback(callback, indirect=False)

    def _hold(self, pattern: str, declare: Callable[[], Any]) -> None:
        try:
            self._held.append(declare())
        except self._zenoh.ZError as error:
            raise ArgumentError(f"{pattern!r} is no key or pattern: {_plain(str(error))}") from error

    def _publisher(self, key: str) -> Any:
        reliable = isinstance(self.delivery, Reliable)
        congestion, reliability = self._zenoh.CongestionControl, self._zenoh.Reliability
        return self._session.declare_publisher(
            key,
            congestion_control=congestion.BLOCK if reliable else congestion.DROP,
            reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
            express=True,
            allowed_destination=self._zenoh.Locality.REMOTE,
        )


def open_transport(settings: NodeSettings) -> ZenohTransport:
    """The transport of one node: its addresses, certificates and, where it has some, the rules of ``node_rules``.

    Args:
        settings: of the node; plain links carry no names, so that rules hold for tls and quic only.

    Raises:
        ArgumentError: an address, a certificate or a guest's role does not fit.
        MissingExtraError: Zenoh is not installed.
    """
    rules = None if settings.identity is None else node_rules(settings)
    transport = ZenohTransport(
        settings.listen, list(settings.peers.values()), identity=settings.identity, rules=rules
    )  # fmt: skip
    transport.announce(node_key(settings.network, settings.name, "alive"))
    return transport


def _zenoh() -> Any:
    try:
        import zenoh
    except ImportError as error:
        raise MissingExtraError("eclipse-zenoh", "live", "a live link") from error
    return zenoh


def _endpoint(text: str) -> str:
    """QUIC carries frames as datagrams and keeps its streams for what must arrive."""
    return f"{text}?mixed_rel=1" if text.startswith("quic/") else text


def _check_identity(addresses: Sequence[Address], identity: Identity | None, rules: AccessRules | None) -> None:
    for address in addresses:
        if address.secured and identity is None:
            raise ArgumentError(
                f"{address.kind} needs certificates; make them with 'trigpoint keys' and give them as identity"
            )
        if not address.secured and identity is not None:
            raise ArgumentError(f"{address.kind} shows no certificate; use tls or quic, or give no identity")
    if rules is not None and identity is None:
        raise ArgumentError("access rules go by the name in a certificate: they need an identity, and tls or quic")
    for name, file in {} if identity is None else vars(identity).items():
        if not Path(file).is_file():
            raise ArgumentError(f"the {name} of the identity, {file}, is no file; 'trigpoint keys' makes it")


def _certificates(identity: Identity) -> dict[str, Any]:
    return {
        "root_ca_certificate": identity.authority,
        "listen_certificate": identity.certificate,
        "listen_private_key": identity.key,
        "connect_certificate": identity.certificate,
        "connect_private_key": identity.key,
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _plain(text: str) -> str:
    return _SOURCE.sub("", text).strip()


def _is_taken(text: str) -> bool:
    return "in use" in text or "acquire lock" in text


def _refusal(listen: str, connect: Sequence[str], text: str) -> str:
    if _is_taken(text):
        return f"{listen} is in use by another process; stop that one or choose another address"
    return f"cannot listen on {listen or 'nothing'} and connect to {list(connect)}: {_plain(text)}"
