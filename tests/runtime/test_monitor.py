"""The monitor: the latest of everybody, moved to one instant; nothing that arrives can hurt it."""

from __future__ import annotations

import numpy as np
import pytest

from trigpoint.arrays import expm
from trigpoint.observers import LocalArc, LocalObserver
from trigpoint.runtime import LINK_FIELDS, STATUS_FIELDS, Frame, Kind, Monitor, encode_frame
from trigpoint.runtime.codec import LARGEST_FRAME
from trigpoint.runtime.topics import node_key, reading_key, truth_key

TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
ROW = np.array([[1.0, 0.0]])
PROGRAMS = tuple(
    LocalObserver(name, TURN, None, (LocalArc(0, other, 1.0, ROW.T, ROW, ROW),)) for name, other in ("ab", "ba")
)


class Hand:
    """A clock that a test sets, and a transport that it feeds."""

    def __init__(self):
        self.time, self.sinks = 100.0, {}

    def now(self):
        return self.time

    def subscribe(self, pattern, sink):
        self.sinks[pattern] = sink

    def feed(self, key, data):
        next(iter(self.sinks.values()))(key, data)


def estimate(sender, sequence, time, value, epoch=1):
    frame = Frame(Kind.ESTIMATE, sender, epoch, sequence, time, (-1.0, 0.0, 0.0, 1.0), np.array(value))
    return node_key("n", sender, "estimate"), encode_frame(frame)


def truth(name, time, value):
    frame = Frame(Kind.TRUTH, name, 1, 0, time, (), np.array(value))
    return truth_key("n", name), encode_frame(frame)


def watching(**options):
    hand = Hand()
    return hand, Monitor(hand, "n", PROGRAMS, hand, **options)


def test_nothing_is_known_at_first():
    _, monitor = watching()
    snapshot = monitor.snapshot()
    assert snapshot.names == ("a", "b")
    assert (snapshot.estimate, snapshot.truth, snapshot.status) == ((None, None),) * 3
    assert np.isposinf(snapshot.age).all()
    assert np.isnan(snapshot.error).all()
    assert monitor.epoch("a") is None


def test_the_truth_is_moved_to_the_time_of_the_estimate():
    """Error zero for a node that is right about another instant than the plant spoke of; earlier or later."""
    hand, monitor = watching(motions={"a": TURN, "b": TURN})
    x = np.array([1.0, 2.0])
    hand.feed(*truth("a", 100.0, x))
    hand.feed(*truth("b", 100.0, x))
    hand.feed(*estimate("a", 0, 100.3, expm(0.3 * TURN) @ x))
    hand.feed(*estimate("b", 0, 99.8, expm(-0.2 * TURN) @ x + [0.0, 0.5]))
    hand.time = 100.5
    assert monitor.poll() == 4
    hand.time = 101.0
    snapshot = monitor.snapshot()
    np.testing.assert_allclose(snapshot.error, [0.0, 0.5], atol=1e-14)
    np.testing.assert_allclose(snapshot.age, [1.0, 1.0])  # heard when the sink was called
    assert snapshot.time == 1.0
    assert monitor.lateness(Kind.ESTIMATE) == pytest.approx(0.0)


def test_only_what_is_newer_counts():
    hand, monitor = watching()
    for sequence, epoch, value in ((5, 1, 5.0), (4, 1, 4.0), (0, 2, 9.0), (6, 1, 6.0)):
        hand.feed(*estimate("a", sequence, 100.0, [value, 0.0], epoch))
    monitor.poll()
    assert monitor.snapshot().estimate[0][0] == 9.0
    assert monitor.epoch("a") == 2


def test_nonsense_is_counted_and_dropped():
    hand, monitor = watching()
    heard = []
    monitor.hooks.append(lambda frame, arrived: heard.append((frame.kind, arrived)))
    hand.feed(node_key("n", "a", "estimate"), b"nonsense")
    hand.feed(*estimate("a", 0, 100.0, [1.0]))  # one value too few
    status = Frame(Kind.STATUS, "a", 1, 0, 100.0, (), np.zeros(3))
    hand.feed(node_key("n", "a", "status"), encode_frame(status))
    hand.feed(*estimate("stranger", 0, 100.0, [1.0, 1.0]))
    assert monitor.poll() == 4
    assert (monitor.malformed, monitor.strangers) == (2, 2)
    assert heard == []  # a log has room for so many topics, and no room for names that somebody invents
    assert monitor.snapshot().estimate == (None, None)


@pytest.mark.parametrize(
    "frame",
    [
        Frame(Kind.ESTIMATE, "b", 9, 0, 100.0, (0.0, 100.0, 0.0, 0.0), np.ones(2)),
        Frame(Kind.STATUS, "b", 9, 0, 100.0, (), np.ones(len(STATUS_FIELDS) + 6)),
        Frame(Kind.TRUTH, "b", 9, 0, 100.0, (), np.ones(2)),
        Frame(Kind.BYE, "b", 9, 0, 100.0),
        Frame(Kind.READING, "b", 9, 0, 100.0, (0.0,), np.ones(1)),
    ],
)
def test_nobody_speaks_for_another(frame):
    """The access rules of a closed network let the node ``a`` write under its own keys: whatever names stand inside."""
    hand, monitor = watching()
    logged = []
    monitor.hooks.append(lambda frame, _: logged.append(frame))
    for channel in ("estimate", "status", "hello", "control", "nonsense", "ping/b"):
        hand.feed(node_key("n", "a", channel), encode_frame(frame))
    hand.feed(truth_key("n", "a"), encode_frame(frame))
    assert monitor.poll() == monitor.strangers == 7
    assert logged == []
    snapshot = monitor.snapshot()
    assert (snapshot.estimate, snapshot.truth, snapshot.status) == ((None, None),) * 3
    assert monitor._readings == {}


def test_a_flood_does_not_hold_up_whoever_polls():
    """As much arrives as is taken out: before, the supervisor never came to its turn again."""
    hand, monitor = watching()
    monitor.hooks.append(lambda frame, _: hand.feed(*estimate("a", frame.sequence + 1, 100.0, [1.0, 1.0])))
    hand.feed(*estimate("a", 0, 100.0, [1.0, 1.0]))
    assert [monitor.poll() for _ in range(3)] == [1, 1, 1]


def test_a_node_that_floods_does_not_fill_the_log():
    hand, monitor = watching()
    logged = []
    monitor.hooks.append(lambda frame, _: logged.append(frame.sender))
    for k in range(5000):
        hand.time = 100.0 + k / 5000.0
        hand.feed(*estimate("a", k, hand.time, [1.0, 1.0]))
        if k % 100 == 0:
            hand.feed(*estimate("b", k, hand.time, [1.0, 1.0]))
    monitor.poll()
    assert 1000 <= logged.count("a") <= 2000  # so many at once, and so many a second
    assert monitor.flooded == 5000 - logged.count("a")
    assert logged.count("b") == 50


def test_a_frame_of_the_far_future_keeps_its_place_for_some_seconds_only():
    hand, monitor = watching()
    hand.feed(*estimate("a", 2**64 - 1, 100.0, [1.0, 0.0], 2**64 - 1))
    monitor.poll()
    for later, value in ((4.0, 1.0), (6.0, 2.0), (6.1, 3.0)):
        hand.time = 100.0 + later
        hand.feed(*estimate("a", round(10 * later), hand.time, [value, 0.0], 7))
        hand.feed(*estimate("a", 0, hand.time, [9.0, 0.0], 7))  # an older one of the same process
        monitor.poll()
        assert monitor.snapshot().estimate[0][0] == (1.0 if later < 5.0 else value)
    assert monitor.epoch("a") == 7


def test_an_older_status_does_not_come_back():
    """Replayed, or overtaken on its way."""
    hand, monitor = watching()
    for sequence, anchored in ((5, 0.0), (4, 1.0)):
        values = np.zeros(len(STATUS_FIELDS) + 6)
        values[0] = anchored
        frame = Frame(Kind.STATUS, "a", 1, sequence, 100.0, (), values)
        hand.feed(node_key("n", "a", "status"), encode_frame(frame))
    monitor.poll()
    assert not monitor.snapshot().status[0].anchored


def test_a_node_that_was_joined_by_another_is_still_understood():
    """Its status has one link more than the monitor knows of; half a link is nonsense."""
    hand, monitor = watching()
    known = len(STATUS_FIELDS) + len(LINK_FIELDS) * len(monitor._programs["a"].hears)
    for sequence, more in enumerate((0, len(LINK_FIELDS), 1)):
        values = np.zeros(known + more)
        values[0] = 1.0
        frame = Frame(Kind.STATUS, "a", 1, sequence, 100.0 + sequence, (), values)
        hand.feed(node_key("n", "a", "status"), encode_frame(frame))
    monitor.poll()
    status = monitor.snapshot().status[0]
    assert (status.time, status.anchored, monitor.malformed) == (101.0, True, 1)
    assert tuple(link.neighbour for link in status.links) == monitor._programs["a"].hears


def test_how_old_what_nodes_used_was_by_their_own_word_and_in_a_span_of_time():
    hand, monitor = watching()
    assert monitor.link_age() is None
    assert monitor.lateness(Kind.READING) == 0.0
    for k, (state, age) in enumerate(((2, 0.01), (2, 0.03), (3, 5.0), (2, 0.05))):
        values = np.zeros(len(STATUS_FIELDS) + len(LINK_FIELDS))
        values[len(STATUS_FIELDS) :][:2] = state, age
        hand.time = 100.0 + k
        hand.feed(node_key("n", "a", "status"), encode_frame(Frame(Kind.STATUS, "a", 1, k, 100.0 + k, (), values)))
        hand.feed(*estimate("a", k, 99.9 + k - 0.1 * k, [1.0, 1.0]))
    monitor.poll()
    assert monitor.link_age() == 0.03  # a stale link is not used
    assert monitor.link_age(100.5, 102.5) == 0.03
    assert monitor.link_age(102.5) == 0.05
    assert monitor.lateness(Kind.ESTIMATE, 100.5, 101.5) == pytest.approx(0.2)


def says(hand, name, sequence, age):
    """A status with the age of the one message that was used."""
    values = np.zeros(len(STATUS_FIELDS) + len(LINK_FIELDS))
    values[len(STATUS_FIELDS) :][:2] = 2, age
    frame = Frame(Kind.STATUS, name, 1, sequence, hand.time, (), values)
    hand.feed(node_key("n", name, "status"), encode_frame(frame))


@pytest.mark.parametrize("first", [0.001, 0.004, 0.0199])
def test_the_age_of_messages_is_that_of_both_ways_also_where_one_says_more_often(first):
    """A part p of a period one way, 1 - p back: half a period, whoever tells more often and whatever stalls once."""
    hand, monitor = watching()
    for k in range(20):
        hand.time = 100.0 + k
        says(hand, "a", k, 3.0 if k == 7 else first)
        if k % 3:
            says(hand, "b", k, 0.02 - first)
    monitor.poll()
    assert monitor.link_age() == pytest.approx(0.01, abs=1e-12)


def test_readings_of_arcs_that_nobody_has_are_forgotten():
    hand, monitor = watching()
    for label in (0.0, 1e6, 0.5, -1.0):
        frame = Frame(Kind.READING, "plant", 1, 0, 100.0, (label,), np.ones(1))
        hand.feed(reading_key("n", int(label)), encode_frame(frame))
    assert monitor.poll() == 4
    assert monitor.strangers == 3
    assert list(monitor._readings) == [0]


def test_the_queue_is_bounded(monkeypatch):
    hand, monitor = watching()
    monkeypatch.setattr("trigpoint.runtime.monitor._WAITING", monitor._waiting.maxlen)
    key, data = estimate("a", 0, 100.0, [1.0, 1.0])
    for _ in range(monitor._waiting.maxlen + 10):
        hand.feed(key, data)
    assert monitor.dropped == 10
    assert monitor.poll() == monitor._waiting.maxlen


def test_what_waits_is_bounded_in_bytes(monkeypatch):
    hand, monitor = watching()
    monkeypatch.setattr("trigpoint.runtime.monitor._WAITING_BYTES", 10 * LARGEST_FRAME)
    for _ in range(100):
        hand.feed("k", bytes(60_000))
    assert 8 <= len(monitor._waiting) <= 10
    assert monitor.dropped == 100 - len(monitor._waiting)
    assert sum(len(data) for _, _, data in monitor._waiting) == monitor._waiting_bytes <= 10 * LARGEST_FRAME
    monitor.poll()
    assert monitor._waiting_bytes == 0


def test_lateness_is_measured():
    hand, monitor = watching()
    for sequence, late in enumerate((0.01, 0.03)):
        hand.time = 100.0 + sequence + late
        hand.feed(*estimate("a", sequence, 100.0 + sequence, [1.0, 1.0]))
    monitor.poll()
    assert monitor.lateness(Kind.ESTIMATE) == pytest.approx(0.02)
    assert monitor.lateness(Kind.READING) == 0.0
