"""The loop of a process: deadlines without drift, arrivals in their order, bounded queues, orders from outside."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

from tests.machine import PATIENCE, until
from tests.runtime.living import CHAIN, planned
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.runtime import Frame, Host, Kind, Member, NodeMachine, decode_frame, encode_frame
from trigpoint.runtime.endings import Order, listen_for_orders
from trigpoint.runtime.topics import node_key

PERIOD = 0.01


class Clock:
    """Stands still unless it is told to go on."""

    def __init__(self):
        self.time = 1000.0

    def now(self):
        return self.time


class Wire:
    """A transport that remembers what is published and who listens."""

    def __init__(self, settings):
        self.settings, self.sent, self.sinks, self.open = settings, [], {}, True

    def publish(self, key, data):
        self.sent.append((key, decode_frame(data)))

    def subscribe(self, pattern, sink):
        self.sinks[pattern] = sink

    def close(self):
        self.open = False


@pytest.fixture
def nodes(tmp_path):
    with planned(CHAIN, tmp_path, rate=1.0 / PERIOD) as (_, plan):
        return plan.nodes


def hosted(settings, clock, **options):
    wires = []

    def links(given):
        wires.append(Wire(given))
        return wires[-1]

    members = [Member(NodeMachine(one, epoch=int(1e12), now=clock.now()), links) for one in settings]
    host = Host(members, clock, **options)
    host.start()
    return host, wires, members


def estimates(wire):
    return [frame for _, frame in wire.sent if frame.kind is Kind.ESTIMATE]


def test_deadlines_do_not_drift(nodes):
    """Acts are for ``start + k period``, whatever the time at which the processor comes to them."""
    clock = Clock()
    host, (wire,), _ = hosted(nodes[:1], clock)
    rng = np.random.default_rng(0)
    for k in range(1, 51):
        clock.time = 1000.0 + k * PERIOD + rng.uniform(0.0, 0.9 * PERIOD)
        host.turn()
    times = np.array([frame.time for frame in estimates(wire)])
    np.testing.assert_allclose(times, 1000.0 + PERIOD * np.arange(1, 51), atol=1e-5)


def test_missed_deadlines_are_left_out_and_counted(nodes):
    clock = Clock()
    host, (wire,), (member,) = hosted(nodes[:1], clock)
    clock.time = 1000.0 + PERIOD
    host.turn()
    clock.time = 1000.0 + 4.5 * PERIOD  # those at 2 and 3 are gone; the one at 4 is late, but in time
    host.turn()
    clock.time = 1000.0 + 5.0 * PERIOD
    host.turn()
    steps = [round((frame.time - 1000.0) / PERIOD) for frame in estimates(wire)]
    assert steps == [1, 4, 5]
    assert member.machine.status.missed == 2


def test_nodes_of_a_process_take_turns_and_hear_each_other(nodes):
    clock = Clock()
    host, wires, members = hosted(nodes, clock)
    assert all(not wire.settings.peers for wire in wires)  # no link between them
    while clock.time < 1000.0 + 5 * PERIOD:
        clock.time = max(clock.time, host._agenda[0][0])
        host.turn()
    first = [estimates(wire)[0].time for wire in wires]
    np.testing.assert_allclose(np.diff(first), PERIOD / 3, atol=1e-5)
    for member in members:
        assert all(link.received >= 3 for link in member.machine.status.links)


def test_only_what_came_before_a_deadline_is_heard_before_it(nodes):
    """The frame that arrives after the deadline waits, although the processor looks at both together."""
    clock = Clock()
    host, (wire,), (member,) = hosted(nodes[:1], clock)
    (key,) = [key for key in wire.sinks if key.endswith("/estimate")]

    def say(sequence):
        facts = (-1.0, 0.0, 0.0, 1.0)
        frame = Frame(Kind.ESTIMATE, "1", 1, sequence, clock.now(), facts, np.array([float(sequence)]))
        wire.sinks[key](key, encode_frame(frame))

    clock.time = 1000.0 + 0.5 * PERIOD
    say(1)
    clock.time = 1000.0 + 1.25 * PERIOD
    say(2)
    host.turn()  # hears the first
    host.turn()  # acts at the deadline
    assert estimates(wire)
    assert member.machine.status.links[0].received == 1
    host.turn()  # hears the second
    assert member.machine.status.links[0].received == 2


def test_the_queue_is_bounded_and_keeps_orders(nodes):
    clock = Clock()
    host, (wire,), (member,) = hosted(nodes[:1], clock, waiting=8)
    host.tell(Order.STOP)
    key, sink = next((key, sink) for key, sink in wire.sinks.items() if key.endswith("/estimate"))
    for _ in range(100):
        sink(key, b"nonsense")
    assert host.dropped == 93  # eight places, one of them for the order
    assert host._mail.qsize() == 8
    turns = 0
    while host.turn():
        turns += 1
    assert turns <= 9
    assert member.machine.counters.rejected["malformed"] == turns


def test_the_queue_is_bounded_in_bytes(nodes):
    """Frames as long as the codec allows, of a neighbour whose state has one component."""
    clock = Clock()
    host, (wire,), (member,) = hosted(nodes[:1], clock)
    key, sink = next((key, sink) for key, sink in wire.sinks.items() if key.endswith("/estimate"))
    for k in range(50):
        sink(key, encode_frame(Frame(Kind.ESTIMATE, "1", 1, k, 1000.0, (-1.0, 0.0, 0.0, 1.0), np.zeros(4096))))
    good = encode_frame(Frame(Kind.ESTIMATE, "1", 1, 50, 1000.0, (-1.0, 0.0, 0.0, 1.0), np.zeros(1)))
    sink(key, good)
    waiting = [host._mail.get() for _ in range(51)]
    assert sum(len(one.data) for one in waiting) < 51 * 100
    assert len(good) <= member.machine.longest
    for one in waiting:
        member.machine.receive(one.time, one.key, one.data)
    assert member.machine.counters.rejected["malformed"] == 50
    assert member.machine.counters.accepted == 1


def test_reload_takes_new_neighbours_and_survives_a_slip(nodes, capsys):
    clock = Clock()
    with_one = replace(nodes[1], program=replace(nodes[1].program, arcs=nodes[1].program.arcs[:1], _memo={}), peers={})
    wires, files = [], [nodes[1]]

    def links(given):
        wires.append(Wire(given))
        return wires[-1]

    def reread():
        if not files:
            raise FileFormatError("node.json", "damaged")
        return files.pop()

    machine = NodeMachine(with_one, epoch=int(1e12), now=clock.now())
    host = Host([Member(machine, links, reread)], clock)
    host.start()
    assert node_key(with_one.network, "2", "estimate") not in wires[0].sinks
    host.tell(Order.RELOAD)
    assert host.turn()
    assert machine.settings is nodes[1]
    assert not wires[0].open  # it has a peer to connect to now
    assert node_key(with_one.network, "2", "estimate") in wires[1].sinks
    host.tell(Order.RELOAD)
    assert host.turn()
    assert "settings not taken: node.json: damaged" in capsys.readouterr().err
    assert machine.settings is nodes[1]


def test_settings_whose_links_cannot_be_opened_leave_the_node_as_it_was(nodes, capsys):
    """A slip in an address must not leave a node that runs on without links, deaf and unnoticed."""
    clock, wires, bad = Clock(), [], replace(nodes[1], listen="tcp/nonsense")

    def links(given):
        if given.listen == bad.listen:
            raise ArgumentError("no such address")
        wires.append(Wire(given))
        return wires[-1]

    machine = NodeMachine(nodes[1], epoch=int(1e12), now=clock.now())
    host = Host([Member(machine, links, lambda: bad)], clock)
    host.start()
    host.tell(Order.RELOAD)
    assert host.turn()
    assert "settings not taken: no such address" in capsys.readouterr().err
    assert machine.settings is nodes[1]
    assert [wire.open for wire in wires] == [False, True]
    assert set(wires[1].sinks) == set(wires[0].sinks) == set(machine.subscriptions())
    clock.time += PERIOD
    host.turn()
    assert estimates(wires[1])


def test_a_node_that_cannot_be_linked_at_all_ends(nodes):
    clock, wires = Clock(), []

    def links(given):
        if wires:
            raise ArgumentError("in use")
        wires.append(Wire(given))
        return wires[-1]

    machine = NodeMachine(nodes[1], epoch=int(1e12), now=clock.now())
    host = Host([Member(machine, links, lambda: replace(nodes[1], peers={}))], clock)
    host.start()
    host.tell(Order.RELOAD)
    with pytest.raises(ArgumentError, match="in use"):
        host.turn()


def test_a_neighbour_that_goes_and_comes_back_is_listened_to_once(nodes):
    clock, wires, subscribed = Clock(), [], []
    whole = replace(nodes[1], peers={})
    alone = replace(whole, program=replace(whole.program, arcs=whole.program.arcs[:1], _memo={}))
    files = [whole, alone, whole, alone]

    def links(given):
        wires.append(Wire(given))
        wires[-1].subscribe = lambda pattern, _: subscribed.append(pattern)
        return wires[-1]

    machine = NodeMachine(whole, epoch=int(1e12), now=clock.now())
    host = Host([Member(machine, links, files.pop)], clock)
    host.start()
    for _ in range(4):
        host.tell(Order.RELOAD)
        host.turn()
    assert len(wires) == 1
    assert sorted(subscribed) == sorted(machine.subscriptions())


def test_an_orderly_end(nodes, monkeypatch):
    monkeypatch.setattr("trigpoint.runtime.host.listen_for_orders", lambda tell, **_: tell(Order.STOP))
    clock = Clock()
    wires = []

    def links(given):
        wires.append(Wire(given))
        return wires[-1]

    Host([Member(NodeMachine(nodes[0], epoch=int(1e12), now=clock.now()), links)], clock).run()
    assert [frame.kind for _, frame in wires[0].sent] == [Kind.HELLO, Kind.BYE]
    assert not wires[0].open


def test_orders_come_by_signals_and_by_the_end_of_input(monkeypatch):
    told = []
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    reading, writing = os.pipe()
    real = os.read
    monkeypatch.setattr("trigpoint.runtime.endings.os.read", lambda _, count: real(reading, count))
    ended = threading.Event()
    try:
        listen_for_orders(lambda order: (told.append(order), ended.set()), tied=True)
        for number, order in ((signal.SIGHUP, Order.RELOAD), (signal.SIGTERM, Order.STOP)):
            before_it = len(told)
            os.kill(os.getpid(), number)  # any thread may get it; the handler runs in this one
            assert until(lambda: len(told) > before_it)  # noqa: B023
            assert told[before_it:] == [order]
        ended.clear()
        os.write(writing, b"words are ignored")
        assert not ended.wait(0.05)
        os.close(writing)
        assert ended.wait(PATIENCE)
        assert told[2:] == [Order.STOP]
    finally:
        os.close(reading)
        for number, handler in before.items():
            signal.signal(number, handler)
