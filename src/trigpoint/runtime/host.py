"""``Host``: the loop of one process. It has the clock, the deadlines and the links; the protocol has none of them."""

from __future__ import annotations

import heapq
import queue
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from trigpoint.errors import TrigpointError
from trigpoint.runtime.clock import Clock
from trigpoint.runtime.endings import Order, listen_for_orders
from trigpoint.runtime.machine import NodeMachine, Outgoing
from trigpoint.runtime.settings import NodeSettings
from trigpoint.runtime.topics import node_key
from trigpoint.runtime.transport import Sink, Transport

WAITING = 16384
"""Frames that may wait to be looked at; beyond it the oldest is dropped and counted."""


@dataclass(frozen=True, eq=False)
class Member:
    """One node of a process.

    Attributes:
        machine: its protocol.
        links: opens its own links, from its settings; again when these change.
        reread: reads its settings again, or None.
    """

    machine: NodeMachine
    links: Callable[[NodeSettings], Transport]
    reread: Callable[[], NodeSettings] | None = None


@dataclass(frozen=True)
class _Arrival:
    time: float
    member: int
    key: str
    data: bytes


class Host:
    """Runs one or several nodes in this process.

    Node i of n acts at ``start + (k + i/n) period``: the deadlines do not drift, and the nodes of one process take
    turns. An act happens, in the node's own time, exactly at its deadline: only what arrived before it is heard before
    it, however late the processor comes to it. A deadline that is late by a whole period or more is missed: it is
    left out, counted, and the next step is longer.

    Nodes of one process hand frames to each other directly, at the same subscriptions; between them there is no link.

    Args:
        members: the nodes.
        clock: the process's clock.
        waiting: frames that may wait; the oldest beyond it is dropped.
    """

    def __init__(self, members: Sequence[Member], clock: Clock, *, waiting: int = WAITING) -> None:
        self._members, self._clock, self._limit = tuple(members), clock, waiting
        self._mail: queue.SimpleQueue[_Arrival | Order] = queue.SimpleQueue()
        self._next: deque[_Arrival] = deque()
        self._agenda: list[tuple[float, int]] = []
        self._transports: list[Transport] = []
        self._inside: dict[str, list[int]] = {}
        self._heard: list[set[str]] = []
        self.dropped = 0

    def tell(self, order: Order) -> None:
        """Take an order, from any thread or a signal handler."""
        self._mail.put(order)

    def run(self, *, tied: bool = False) -> None:
        """Run until told to stop (or, ``tied``, until standard input ends), then say goodbye and close the links."""
        listen_for_orders(self.tell, tied=tied)
        self.start()
        try:
            while self.turn():
                pass
        finally:
            self.stop()

    def start(self) -> None:
        """Open the links, say hello, and set the first deadlines."""
        self._transports = [member.links(self._outward(member.machine.settings)) for member in self._members]
        self._heard = [set() for _ in self._members]
        self._map_inside()
        for number, member in enumerate(self._members):
            self._subscribe(number, member.machine.subscriptions())
        now = self._clock.now()
        for number, member in enumerate(self._members):
            period = member.machine.settings.period
            self._send(number, member.machine.start(now))
            self._agenda.append((now + period * (1.0 + number / len(self._members)), number))
        heapq.heapify(self._agenda)

    def stop(self) -> None:
        """Say goodbye and close the links."""
        for number, member in enumerate(self._members):
            self._send(number, member.machine.stop(self._clock.now()))
        for transport in self._transports:
            transport.close()

    def turn(self) -> bool:
        """Take the next thing in time, an arrival or a deadline; False when told to stop."""
        due, number = self._agenda[0]
        arrival = self._arrival(due)
        if isinstance(arrival, Order):
            if arrival is Order.RELOAD:
                self._reload()
            return arrival is not Order.STOP
        if arrival is None:
            self._act(due, number)
        else:
            machine = self._members[arrival.member].machine
            self._send(arrival.member, machine.receive(arrival.time, arrival.key, arrival.data))
        return True

    def _arrival(self, due: float) -> _Arrival | Order | None:
        """What came next before ``due``; None when nothing did. What came after it stays for later."""
        if self._next:
            return self._next.popleft() if self._next[0].time <= due else None
        wait = due - self._clock.now()
        try:
            found = self._mail.get(timeout=wait) if wait > 0.0 else self._mail.get_nowait()
        except queue.Empty:
            return None
        if isinstance(found, _Arrival) and found.time > due:
            self._next.append(found)
            return None
        return found

    def _act(self, due: float, number: int) -> None:
        heapq.heappop(self._agenda)
        machine = self._members[number].machine
        period = machine.settings.period
        missed = max(0, int((self._clock.now() - due) / period))
        due += missed * period
        began = time.perf_counter()
        outgoing = machine.act(due)
        machine.latch(due)
        took = time.perf_counter() - began
        self._send(number, outgoing)
        machine.took(took)
        heapq.heappush(self._agenda, (due + period, number))

    def _sink(self, number: int) -> Sink:
        mail, clock, machine = self._mail, self._clock, self._members[number].machine

        def sink(key: str, data: bytes) -> None:
            if mail.qsize() >= self._limit:
                self._drop_oldest()
            # cut where it is too long to be let in: it stays malformed, and the queue is bounded in bytes, too
            mail.put(_Arrival(clock.now(), number, key, data[: machine.longest + 1]))

        return sink

    def _outward(self, settings: NodeSettings) -> NodeSettings:
        """The settings without the addresses of those who live in this process."""
        here = {member.machine.settings.name for member in self._members}
        return replace(settings, peers={name: where for name, where in settings.peers.items() if name not in here})

    def _map_inside(self) -> None:
        """Who in this process listens to which key that another one here publishes."""
        own = tuple(node_key(m.machine.settings.network, m.machine.settings.name, "") for m in self._members)
        self._inside = {}
        for number, member in enumerate(self._members):
            for key in member.machine.subscriptions():
                if key.startswith(own):
                    self._inside.setdefault(key, []).append(number)

    def _drop_oldest(self) -> None:
        """Make room for one frame; orders are never dropped, they go to the end."""
        orders = []
        try:
            while isinstance(oldest := self._mail.get_nowait(), Order):
                orders.append(oldest)
            self.dropped += 1
        except queue.Empty:  # the loop has taken everything meanwhile
            pass
        for order in orders:
            self._mail.put(order)

    def _send(self, number: int, outgoing: Sequence[Outgoing]) -> None:
        publish = self._transports[number].publish
        for one in outgoing:
            inside = self._inside.get(one.key, ())
            if not inside or "/ping/" not in one.key:  # what one node asks another is for nobody else
                publish(one.key, one.data)
            for other in inside:
                if other != number:
                    self._mail.put(_Arrival(self._clock.now(), other, one.key, one.data))

    def _reload(self) -> None:
        for number, member in enumerate(self._members):
            if member.reread is None:
                continue
            before = member.machine.settings
            try:
                member.machine.reload(member.reread(), self._clock.now())
            except TrigpointError as error:  # a slip in the file must not end a node that runs
                _say(error)
                continue
            self._link_anew(number, before)

    def _link_anew(self, number: int, before: NodeSettings) -> None:
        """Links are opened afresh only where addresses or rights changed, and as ``before`` where that fails.

        Where that fails, too, the process ends: a node without links would go on alone and nobody would notice.
        """
        machine = self._members[number].machine
        if _links_of(before) != _links_of(machine.settings):
            self._transports[number].close()
            try:
                self._open(number, machine.settings)
            except TrigpointError as error:
                _say(error)
                machine.reload(before, self._clock.now())
                self._open(number, before)
        self._map_inside()
        self._subscribe(number, machine.subscriptions())

    def _open(self, number: int, settings: NodeSettings) -> None:
        self._transports[number] = self._members[number].links(self._outward(settings))
        self._heard[number].clear()

    def _subscribe(self, number: int, patterns: Iterable[str]) -> None:
        """Listen to those of the ``patterns`` that the open links do not listen to yet: twice, and all comes twice."""
        sink, heard = self._sink(number), self._heard[number]
        for pattern in patterns:
            if pattern not in heard:
                self._transports[number].subscribe(pattern, sink)
                heard.add(pattern)


def _say(error: TrigpointError) -> None:
    print(f"settings not taken: {error}", file=sys.stderr, flush=True)


def _links_of(settings: NodeSettings) -> tuple[object, ...]:
    """What an open transport depends on; plain links have no rules."""
    rights = None if settings.identity is None else (settings.program.hears, settings.program.reads, settings.guests)
    return settings.listen, dict(settings.peers), settings.identity, rights
