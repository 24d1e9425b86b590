"""The protocol of one node: what each frame does to it, good or bad."""

from __future__ import annotations

import numpy as np
import pytest

import trigpoint as tp
from tests.runtime.given import PERIOD, STATIC, case
from trigpoint.arrays import expm
from trigpoint.errors import ArgumentError
from trigpoint.observers.local import LocalArc, LocalObserver, Message
from trigpoint.runtime import (
    GO,
    LINK_FIELDS,
    PAUSE,
    REASONS,
    STATUS_FIELDS,
    TABLE,
    Event,
    Frame,
    Kind,
    NodeMachine,
    NodeSettings,
    State,
    decode_frame,
    encode_frame,
    node_status,
)  # fmt: skip
from trigpoint.runtime.codec import LARGEST_FRAME
from trigpoint.runtime.status import MOST_NEIGHBOURS
from trigpoint.runtime.topics import node_key, ping_key, reading_key
from trigpoint.runtime.virtual import SENSOR

LINE = case(STATIC, tp.graphs.chain(3, anchors=[0]))
MOVING = case(graph=tp.graphs.chain(3, anchors=[0]))
START = 1000.0
"""Seconds at which everything begins here; processes of epoch 1 began long before."""


class Bench:
    """The middle node of a chain 0 - 1 - 2 (anchored at 0), and frames for it."""

    def __init__(self, one=LINE, node=1, **options) -> None:
        self.case = one
        self.machine = NodeMachine(one.settings(**options)[node], epoch=5, now=START)
        self.numbers: dict[tuple[str, Kind], int] = {}

    def frame(self, kind=Kind.ESTIMATE, sender="0", time=START, **changes) -> Frame:
        number = self.numbers[sender, kind] = self.numbers.get((sender, kind), -1) + 1
        facts = {Kind.ESTIMATE: (0.0, time, 0.0, 0.5), Kind.READING: (1.0,), Kind.CONTROL: (PAUSE,)}.get(kind, ())
        values = np.ones(2) if kind in (Kind.ESTIMATE, Kind.READING) else np.zeros(0)
        fields = {"epoch": 1, "sequence": number, "facts": facts, "values": values, **changes}
        return Frame(kind, sender, time=time, **fields)  # type: ignore[arg-type]

    def key(self, frame: Frame) -> str:
        if frame.kind is Kind.READING:
            return reading_key("net", int(frame.facts[0]))
        if frame.kind is Kind.CONTROL:
            return node_key("net", self.machine.settings.name, "control")
        if frame.kind in (Kind.PING, Kind.PONG):
            return ping_key("net", frame.sender, self.machine.settings.name)
        return node_key("net", frame.sender, "estimate" if frame.kind is Kind.ESTIMATE else "hello")

    def give(self, frame: Frame, now=START, key=None):
        return self.machine.receive(now, key or self.key(frame), encode_frame(frame))

    def rejected(self) -> dict[str, int]:
        return {name: count for name, count in self.machine.counters.rejected.items() if count}

    def link(self, name="0"):
        return next(link for link in self.machine.status.links if link.neighbour == name)


def test_the_table_is_whole_and_only_an_estimate_makes_a_link_live() -> None:
    assert set(TABLE) == {(state, event) for state in State for event in Event}
    assert {state for (_, event), state in TABLE.items() if event is Event.ESTIMATE} == {State.LIVE}
    assert State.LIVE not in {state for (_, event), state in TABLE.items() if event is not Event.ESTIMATE}


def test_it_listens_to_its_neighbours_its_arcs_and_its_own_orders_only() -> None:
    keys = Bench().machine.subscriptions()
    others = [node_key("net", name, part) for name in ("0", "2") for part in ("estimate", "hello")]
    expected = {*others, ping_key("net", "0", "1"), ping_key("net", "2", "1"), node_key("net", "1", "control")}
    assert set(keys) == expected | {reading_key("net", label) for label in LINE.programs[1].reads}


@pytest.mark.parametrize(
    ("reason", "changes"),
    [
        ("stranger", {"sender": "2", "key": node_key("net", "0", "estimate")}),
        ("stranger", {"sender": "x", "key": node_key("net", "0", "estimate")}),
        ("unknown", {"key": node_key("net", "7", "estimate")}),
        ("unknown", {"key": node_key("net", "1", "estimate")}),
        ("unknown", {"key": node_key("net", "0", "hello")}),
        ("unknown", {"kind": Kind.TRUTH, "key": node_key("net", "0", "estimate")}),
        ("size", {"values": np.ones(3)}),
        ("size", {"values": np.zeros(0)}),
        ("size", {"kind": Kind.HELLO, "values": np.ones(1)}),
        ("size", {"kind": Kind.READING, "sender": SENSOR, "values": np.ones(1)}),
        ("malformed", {"values": np.array([1.0, 1e101])}),
        ("malformed", {"facts": (-2.0, 0.0, 0.0, 0.0)}),
        ("malformed", {"facts": (0.0, 0.0, 0.0, -1.0)}),
        ("malformed", {"kind": Kind.PONG, "facts": (1e300, 1e300)}),
        ("window", {"time": START + 1.01}),
        ("window", {"time": START - 1.26}),
        ("window", {"epoch": int((START + 2.0) * 1e9)}),
        ("stranger", {"kind": Kind.READING, "sender": "0"}),
        ("unknown", {"kind": Kind.READING, "sender": SENSOR, "key": reading_key("net", 2)}),
        ("stranger", {"kind": Kind.CONTROL, "sender": "0"}),
        ("stranger", {"kind": Kind.CONTROL, "sender": SENSOR}),
        ("unknown", {"kind": Kind.CONTROL, "sender": "boss", "facts": (7.0,)}),
        ("old", {"kind": Kind.PONG, "facts": (START - 0.1, START)}),
    ],
)
def test_what_does_not_fit_is_counted_by_its_reason_and_changes_nothing(reason, changes) -> None:
    bench = Bench()
    key = changes.pop("key", None) if isinstance(changes, dict) else None
    assert bench.give(bench.frame(**changes), key=key) == ()
    if key is not None:
        changes["key"] = key
    assert bench.rejected() == {reason: 1}
    assert bench.machine.counters.dropped == 1
    assert bench.machine.counters.accepted == 0
    bench.machine.latch(START)
    assert bench.link().state is State.ABSENT


@pytest.mark.parametrize("data", [b"", b"TP", bytes(40), bytes(LARGEST_FRAME + 1)])
def test_bytes_that_are_no_frame_are_malformed(data) -> None:
    bench = Bench()
    assert bench.machine.receive(START, node_key("net", "0", "estimate"), data) == ()
    assert bench.rejected() == {"malformed": 1}


def test_late_duplicate_reordered_and_replayed_frames_are_old() -> None:
    bench = Bench()
    first, second, third = (bench.frame(values=np.full(2, float(k))) for k in range(3))
    for one in (first, third):
        bench.give(one)
    for one in (second, third, first):
        bench.give(one)
    assert bench.rejected() == {"old": 3}
    link = bench.link()
    assert (link.state, link.received, link.lost) == (State.LIVE, 2, 1)


def test_a_new_process_counts_from_zero_again_and_its_old_frames_are_old() -> None:
    bench = Bench()
    bench.give(bench.frame(sequence=900))
    bench.give(bench.frame(sequence=0, epoch=2))
    bench.give(bench.frame(sequence=901))
    assert bench.rejected() == {"old": 1}
    assert (bench.link().received, bench.link().lost) == (2, 0)


def test_a_hello_voids_what_was_heard_unless_it_is_of_the_same_process() -> None:
    bench = Bench()
    bench.give(bench.frame())
    bench.give(bench.frame(Kind.HELLO))
    assert bench.rejected() == {"old": 1}
    assert bench.link().state is State.LIVE
    bench.give(bench.frame(Kind.HELLO, epoch=3))
    assert (bench.link().state, bench.link().age) == (State.HEARD, None)
    bench.machine.latch(START + 0.3)
    assert bench.link().state is State.ABSENT


def test_nothing_of_a_process_that_said_goodbye_is_heard_any_more() -> None:
    bench = Bench()
    bench.give(bench.frame())
    bench.give(bench.frame(Kind.BYE))
    bench.give(bench.frame())
    assert (bench.link().state, bench.rejected()) == (State.GONE, {"old": 1})
    bench.give(bench.frame(epoch=2))
    assert bench.link().state is State.LIVE


def test_silence_makes_a_link_stale_and_one_estimate_brings_it_back() -> None:
    bench = Bench()
    bench.give(bench.frame())
    bench.machine.latch(START + 0.25)
    assert bench.link().state is State.LIVE
    bench.machine.latch(START + 0.26)
    assert bench.link().state is State.STALE
    bench.give(bench.frame(time=START + 0.3), now=START + 0.3)
    assert bench.link().state is State.LIVE


def test_after_a_long_silence_the_order_is_forgotten_but_no_recording_passes() -> None:
    """A clock that was set back: the new process has an older epoch, and is heard once the silence is long enough."""
    bench = Bench()
    recorded = bench.frame(epoch=2)
    bench.give(recorded)
    late = START + 0.25 + 2.0 + 0.01
    bench.give(recorded, now=late)
    bench.give(bench.frame(epoch=1, sequence=0, time=late), now=late)
    assert bench.rejected() == {"window": 1}
    assert bench.link().received == 2


def test_a_flood_is_cut_off_at_the_rate_limit_and_others_do_not_suffer() -> None:
    bench = Bench(rate_limit=50.0)
    for _ in range(200):
        bench.give(bench.frame())
    bench.give(bench.frame(sender="2"))
    assert bench.rejected() == {"flood": 150}
    for _ in range(10):
        bench.give(bench.frame(time=START + 0.1), now=START + 0.1)
    assert bench.rejected() == {"flood": 155}
    assert bench.link("2").state is State.LIVE


def test_a_question_for_the_time_is_answered_and_an_answer_measures_the_clock() -> None:
    bench = Bench()
    question = decode_frame(next(one for one in bench.machine.act(START) if "/ping/0" in one.key).data)
    assert (question.kind, question.time) == (Kind.PING, START)
    ahead, there, back = 0.3, 0.02, 0.04
    received = START + there + ahead
    answer = bench.frame(Kind.PONG, time=received + 0.01, facts=(START, received))
    bench.give(answer, now=START + there + 0.01 + back)
    link = bench.link()
    assert link.round_trip == pytest.approx(there + back)
    assert link.offset == pytest.approx(ahead + (there - back) / 2.0)
    (reply,) = bench.give(bench.frame(Kind.PING, time=START + 100.0), now=START + 0.1)
    pong = decode_frame(reply.data)
    assert reply.key == ping_key("net", "1", "0")
    assert (pong.kind, pong.facts) == (Kind.PONG, (START + 100.0, START + 0.1))


@pytest.mark.parametrize("kind", [Kind.HELLO, Kind.ESTIMATE])
def test_the_clock_of_a_process_that_is_gone_is_forgotten(kind) -> None:
    """A neighbour that was started again, its clock set right: no warning of the old one, HELLO heard or lost."""
    bench = Bench(MOVING)
    bench.machine.act(START)
    bench.give(bench.frame())
    bench.give(bench.frame(Kind.PONG, time=START + 0.2, facts=(START, START + 0.2)))
    assert bench.machine.status.warning is not None
    bench.give(bench.frame(kind, epoch=2))
    assert bench.link().offset is None
    assert bench.machine.status.warning is None


def test_clocks_that_differ_are_warned_about_with_the_floor_they_cause() -> None:
    bench = Bench(MOVING)
    bench.machine.act(START)
    bench.give(bench.frame(Kind.PONG, time=START + 0.2, facts=(START, START + 0.2)))
    status = bench.machine.status
    expected = 0.2 * np.linalg.norm(MOVING.programs[1].A @ bench.machine.state.estimate)
    assert status.floor == pytest.approx(expected)
    assert status.warning is not None
    assert "0.2 s" in status.warning
    assert Bench(MOVING).machine.status.warning is None


def test_a_neighbour_whose_clock_is_too_far_off_to_be_heard_is_named() -> None:
    bench = Bench()
    bench.machine.act(START)
    bench.give(bench.frame(time=START - 5.0))
    bench.give(bench.frame(Kind.PONG, time=START - 5.0, facts=(START, START - 5.0)))
    assert bench.rejected() == {"window": 1}
    assert "'0' answers '1', but its estimates are not in time: their clocks differ by 5 s" in str(
        bench.machine.status.warning
    )


def test_orders_of_the_supervisor_pause_and_go_on() -> None:
    bench = Bench(MOVING, status_every=10.0)
    bench.machine.act(START)
    bench.give(bench.frame(Kind.CONTROL, "boss"))
    before = bench.machine.state
    assert bench.machine.paused
    assert bench.machine.act(START + 1.0) == ()
    bench.machine.latch(START + 1.0)
    assert bench.machine.state is before
    bench.give(bench.frame(Kind.CONTROL, "boss", facts=(GO,)))
    assert any(one.key.endswith("/1/estimate") for one in bench.machine.act(START + 2.0))
    moved = expm(2.0 * MOVING.programs[1].A) @ before.estimate
    np.testing.assert_allclose(bench.machine.state.estimate, moved, rtol=1e-12)
    assert bench.machine.status.missed == 0


def test_a_paused_node_says_so_and_does_not_claim_an_anchor_for_ever() -> None:
    bench = Bench()
    for label in LINE.programs[1].reads:
        bench.give(bench.frame(Kind.READING, SENSOR, facts=(float(label),)))
    bench.give(bench.frame())
    bench.machine.latch(START)
    assert bench.machine.anchored
    bench.give(bench.frame(Kind.CONTROL, "boss"))
    (only,) = bench.machine.act(START)
    assert node_status(decode_frame(only.data), LINE.programs[1].hears).paused
    for late, anchored in ((0.9, True), (1.1, False)):
        bench.machine.act(START + late)
        assert bench.machine.status.anchored is anchored


def test_an_estimate_and_a_reading_of_the_past_have_the_innovation_of_their_instant() -> None:
    """With exact estimates everything moved to now leaves no correction at all, whatever the ages."""
    bench = Bench(MOVING)
    A, C = MOVING.programs[1].A, np.array([[1.0, 0.0]])
    own, other, far = np.array([1.0, -2.0]), np.array([0.5, 3.0]), np.array([2.0, 1.0])
    machine = NodeMachine(MOVING.settings(start=own)[1], epoch=5, now=START)
    bench.machine = machine
    machine.act(START)
    for name, truth, age in (("0", other, 0.013), ("2", far, 0.04)):
        bench.give(bench.frame(sender=name, time=START - age, values=expm(-A * age) @ truth))
    for arc in MOVING.programs[1].arcs:
        age = 0.01 * (1 + arc.label)
        truth = {"0": other, "2": far}[arc.neighbour]
        gap = arc.sign * (own - truth)
        reading = C @ (expm(-A * age) @ gap)
        number = bench.frame(Kind.READING, SENSOR, time=START - age, facts=(float(arc.label),), values=reading)
        bench.give(number)
    machine.latch(START)
    assert bench.rejected() == {}
    machine.act(START + PERIOD)
    np.testing.assert_allclose(machine.state.estimate, expm(A * PERIOD) @ own, rtol=1e-13)


@pytest.mark.parametrize("elapsed", [PERIOD, 0.0213, 0.2, 1.0])
def test_a_step_goes_over_the_time_that_has_passed_and_the_state_says_which(elapsed) -> None:
    bench = Bench(MOVING)
    machine, program = bench.machine, MOVING.programs[1]
    machine.act(START)
    for name in ("0", "2"):
        bench.give(bench.frame(sender=name))
    for label in program.reads:
        bench.give(bench.frame(Kind.READING, SENSOR, facts=(float(label),), values=np.ones(1)))
    machine.latch(START)
    before = machine.state
    inbox = {name: Message(name, 0, START, np.ones(2)) for name in ("0", "2")}
    readings = {label: np.ones(1) for label in program.reads}
    machine.act(START + elapsed)
    duration = machine.state.time - START
    assert duration == pytest.approx(elapsed, abs=PERIOD / 2048 + 1e-9)
    held = min(duration, 0.25)
    expected = program.moved(program.step(before, inbox, readings, held).estimate, duration - held)
    np.testing.assert_allclose(machine.state.estimate, expected, rtol=1e-9)
    assert machine.status.missed == round(elapsed / PERIOD) - 1


def test_an_arc_without_a_message_or_without_a_reading_is_left_out() -> None:
    for lacking in ("message", "reading"):
        bench = Bench(coverage="nominal")
        bench.give(bench.frame(sender="0"))
        if lacking == "reading":
            bench.give(bench.frame(sender="2"))
        for label in LINE.programs[1].reads:
            if lacking == "message" or label != 1:
                bench.give(bench.frame(Kind.READING, SENSOR, facts=(float(label),)))
        machine = bench.machine
        machine.latch(START)
        machine.act(START + PERIOD)
        start, gain = LINE.truth[1] + LINE.error[1], LINE.observer.gain
        kept = np.exp(-gain * PERIOD)
        aim = np.ones(2) + next(arc.sign for arc in LINE.programs[1].arcs if arc.neighbour == "0")
        np.testing.assert_allclose(machine.state.estimate, kept * start + (1.0 - kept) * aim, rtol=1e-12)
        assert machine.anchored
        assert not machine.status.covered


def test_a_status_comes_back_from_its_frame() -> None:
    bench = Bench()
    bench.give(bench.frame())
    bench.give(bench.frame(values=np.ones(5)))
    bench.machine.latch(START)
    bench.machine.took(2e-4)
    data = next(one.data for one in bench.machine.act(START + PERIOD) if one.key.endswith("status"))
    frame = decode_frame(data)
    found, hears = node_status(frame, LINE.programs[1].hears), LINE.programs[1].hears
    assert frame.values.shape == (len(STATUS_FIELDS) + len(LINK_FIELDS) * len(hears),)
    assert (found.name, found.step_us, found.acts) == ("1", pytest.approx(200.0), 1)
    assert found.counters.rejected == dict.fromkeys(REASONS, 0) | {"size": 1}
    assert [link.neighbour for link in found.links] == list(hears)
    assert bench.link() in found.links
    np.testing.assert_array_equal(found.to_values(), frame.values)


@pytest.mark.parametrize("spoiled", ["kind", "length", "state"])
def test_a_status_that_means_nothing_is_refused(spoiled) -> None:
    bench = Bench()
    data = next(one.data for one in bench.machine.act(START) if one.key.endswith("status"))
    frame = decode_frame(data)
    values = frame.values.copy()
    if spoiled == "state":
        values[len(STATUS_FIELDS)] = 17.0
    values = values[:-1] if spoiled == "length" else values
    kind = Kind.TRUTH if spoiled == "kind" else Kind.STATUS
    with pytest.raises(tp.errors.ProtocolError, match="a status of"):
        node_status(Frame(kind, "1", 1, 1, START, (), values), LINE.programs[1].hears)


def test_new_settings_keep_the_state_and_the_links_and_take_new_arcs() -> None:
    bench = Bench()
    bench.give(bench.frame())
    before = bench.machine.state
    longer = case(STATIC, tp.graphs.chain(4, anchors=[0]))
    bench.machine.reload(longer.settings()[1], START)
    assert bench.machine.state is before
    assert bench.link().received == 1
    bench.machine.reload(longer.settings(peers={"3": "tcp/somewhere"})[1], START)
    assert node_key("net", "3", "hello") in bench.machine.subscriptions()
    assert node_key("net", "3", "estimate") not in bench.machine.subscriptions()
    with pytest.raises(ArgumentError, match="start a new process"):
        bench.machine.reload(longer.settings()[2], START)


def test_an_estimate_that_runs_out_of_range_begins_anew() -> None:
    growing = case(tp.LinearAgent([[2000.0]], [[1.0]]), tp.graphs.chain(2, anchors=[0]), tp.methods.Fixed(1.0))
    machine = NodeMachine(growing.settings(period=0.1)[0], epoch=1, now=START)
    for k in range(20):
        machine.act(START + 0.1 * k)
        machine.latch(START + 0.1 * k)
        assert np.isfinite(machine.state.estimate).all()
    assert machine.status.resets > 0


def test_greetings_carry_the_epoch() -> None:
    machine = Bench().machine
    hello, bye = (decode_frame(frames[0].data) for frames in (machine.start(START), machine.stop(START)))
    assert (hello.kind, bye.kind) == (Kind.HELLO, Kind.BYE)
    assert hello.epoch == bye.epoch == 5


def program_of(name: str = "a", states: int = 1, neighbours: int = 1) -> LocalObserver:
    one = np.eye(1)
    arcs = tuple(LocalArc(k, f"n{k}", 1.0, np.ones((states, 1)), np.ones((1, states)), one) for k in range(neighbours))
    return LocalObserver(name, np.zeros((states, states)), None, arcs)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (program_of(neighbours=MOST_NEIGHBOURS + 1), "hears 680 neighbours; a live node hears at most 679"),
        (program_of(states=4097), "has 4097 states; a live node has at most 4096"),
        (program_of(name="ä" * 513), "1 to 1024 bytes; rename"),
        (program_of(name=""), "1 to 1024 bytes; rename"),
    ],
)
def test_a_node_whose_frames_would_not_fit_is_refused_at_once(program, message) -> None:
    """Not by every process of it that starts, at its first status."""
    with pytest.raises(ArgumentError, match=message):
        NodeMachine(NodeSettings("net", program, PERIOD), epoch=1, now=100.0)


def test_the_largest_status_fits_one_frame() -> None:
    settings = NodeSettings("net", program_of(neighbours=MOST_NEIGHBOURS), PERIOD)
    machine = NodeMachine(settings, epoch=1, now=100.0)
    (*_, last) = machine.act(100.0 + PERIOD)
    assert len(node_status(decode_frame(last.data), settings.program.hears).links) == MOST_NEIGHBOURS
