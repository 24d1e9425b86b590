"""Messages, frames, commands and the playback value: pure, so tested without a server."""

import dataclasses
import json
import math
import struct

import numpy as np
import pytest

from tests.dashboard.feeds import recorded
from trigpoint import graphs
from trigpoint.dashboard import STATES, Event, Moment, Playback, ReplayFeed, Scene, decode_moment, encode_moment
from trigpoint.dashboard.commands import LONGEST, decode_command, ordered, selected
from trigpoint.dashboard.frames import trace_message
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph


def drawn(nodes=3, links=2, seed=0):
    rng = np.random.default_rng(seed)
    tables = [rng.normal(size=nodes) for _ in range(4)] + [rng.normal(size=links) for _ in range(2)]
    return Moment(7, 1e6 + 0.125, 1.5, np.nan, 3.0, np.inf, *tables)


@pytest.mark.parametrize(("nodes", "links"), [(3, 2), (1, 0), (0, 0), (50, 80)])
def test_a_frame_reads_back(nodes, links):
    moment = drawn(nodes, links)
    data = encode_moment(moment)
    assert len(data) == 40 + 16 * nodes + 8 * links
    assert struct.unpack("<IIII", data[:16]) == (2, nodes, links, 7)
    assert struct.unpack("<d", data[16:24]) == (1e6 + 0.125,)  # exact, however long the run
    back = decode_moment(data)
    assert (back.index, back.time, back.norm, back.missed, back.rejected) == (7, 1e6 + 0.125, 1.5, 3.0, math.inf)
    assert math.isnan(back.traffic)
    for name in ("error", "uncertainty", "age", "state", "loss", "link_age"):
        np.testing.assert_array_equal(getattr(back, name), getattr(moment, name).astype(np.float32))


def test_the_layout_is_the_documented_one():
    data = encode_moment(Moment(1, 2.0, 3.0, 4.0, 5.0, 6.0, *(np.array([k]) for k in (7.0, 8, 9, 1, 10, 11))))
    assert struct.unpack("<IIIId10f", data) == (2, 1, 1, 1, 2.0, 3, 4, 5, 6, 7, 8, 9, 1, 10, 11)


@pytest.mark.parametrize("data", [b"", b"abc", bytes(39)])
def test_a_short_frame_is_refused(data):
    with pytest.raises(ProtocolError, match="a head of 40 bytes"):
        decode_moment(data)


def test_another_version_or_length_is_refused():
    data = encode_moment(drawn())
    with pytest.raises(ProtocolError, match="frame version 1 is unknown"):
        decode_moment(struct.pack("<I", 1) + data[4:])
    with pytest.raises(ProtocolError, match="3 nodes and 2 pairs has 104 bytes; got 108"):
        decode_moment(data + bytes(4))


def test_a_replayed_frame_is_the_run():
    run = recorded()
    feed = ReplayFeed(run, Scene(graphs.chain(4)))
    for k in range(6):
        moment = decode_moment(feed.frame(k))
        assert (moment.index, moment.time) == (k, run.times[k])
        np.testing.assert_allclose(moment.error, np.linalg.norm(run["error"][k], axis=1), rtol=1e-6)
        assert moment.norm == pytest.approx(run.error_norm[k], rel=1e-6)
        assert [STATES[int(code)] for code in moment.state] == ["anchored"] * 4
        assert np.isnan([moment.uncertainty, moment.age]).all()
        assert np.isnan([moment.loss, moment.link_age]).all()
        if k:
            assert moment.traffic == pytest.approx(8 / 0.05, rel=1e-6)  # four nodes, two messages a sample
    assert math.isnan(decode_moment(feed.frame(0)).traffic)


def test_frames_carry_nan_and_overflow():
    run = recorded()
    run.estimate[2, 0], run.estimate[2, 1] = np.nan, 1e60
    moment = decode_moment(ReplayFeed(run, Scene(graphs.chain(4))).frame(2))
    assert math.isnan(moment.error[0])
    assert math.isinf(moment.error[1])


def test_states_and_events_of_a_run():
    run = recorded(nodes=5)
    run.status[:2, 1:] = "relative"
    run.status[3:, 2] = "away"
    run.status[5, 0] = "no such"
    feed = ReplayFeed(run, Scene(graphs.chain(5)))
    assert [STATES[int(code)] for code in feed.moment(3).state] == ["anchored"] * 2 + ["away"] + ["anchored"] * 2
    count, events = feed.events(0)
    assert count == 3
    assert [(event.time, event.node) for event in events] == [
        (run.times[2], None),
        (run.times[3], 2),
        (run.times[5], 0),
    ]
    assert events[0].text == "4 nodes: anchored (was relative)"
    assert events[1].text == "<b>2: away (was anchored)"
    assert feed.events(2)[1] == events[2:]


def test_the_list_of_events_is_bounded():
    run = recorded(nodes=3, samples=400)
    run.status[::2] = "relative"
    count, events = ReplayFeed(run, Scene(graphs.chain(3))).events(0)
    assert count == len(events) == 501
    assert "only the first 500" in events[-1].text


@pytest.mark.parametrize("k", [-1, 6])
def test_no_frame_outside_the_run(k):
    with pytest.raises(ArgumentError, match=f"sample {k} is not in the run"):
        ReplayFeed(recorded(), Scene(graphs.chain(4))).frame(k)


def test_the_topology_is_json_without_nan():
    run = recorded(3)
    run.estimate[0, 0] = np.nan
    graph = MeasurementGraph(3, [EXTERNAL, 0, 1, 1], [2, 1, 0, 2])
    message = ReplayFeed(run, Scene(graph, "file", [[0, 0], [1, 0], [1, 2]], 0.5, "m")).topology()
    assert json.loads(json.dumps(message, allow_nan=False)) == message
    assert (message["type"], message["version"], message["mode"]) == ("topology", 2, "replay")
    assert (message["title"], message["rate"], message["unit"]) == ("file", 0.5, "m")
    assert message["rate_name"] == "guaranteed rate"
    assert message["arcs"] == [[0, 1], [1, 2]]
    assert message["anchored"] == [2]
    assert (message["x"], message["y"]) == ([0, 1, 1], [0, 0, 2])
    assert message["names"] == ["<b>0", "<b>1", "<b>2"]
    assert message["times"] == message["norm"]["times"] == run.times.tolist()
    assert message["norm"]["values"][0] is None
    assert message["norm"]["values"][1:] == pytest.approx(run.error_norm[1:])
    assert (message["colours"], message["links"], message["controls"]) == (["error", "state"], [], [])
    low, high = message["error_range"]
    norms = np.linalg.norm(run["error"], axis=2)
    assert (low, high) == pytest.approx((np.nanmin(norms), np.nanmax(norms)))


def test_error_range_spans_at_most_six_decades_and_is_null_without_error():
    run = recorded(3)
    run.estimate[1, 0] = run.truth[1, 0] + 1e-12
    low, high = ReplayFeed(run, Scene(graphs.chain(3))).topology()["error_range"]
    assert high / low == pytest.approx(1e6)
    run.estimate[:] = run.truth
    assert ReplayFeed(run, Scene(graphs.chain(3))).topology()["error_range"] is None


@pytest.mark.parametrize("graph", [graphs.chain(1), MeasurementGraph(5, [0, 3], [1, 4]), graphs.grid(6, 7)])
def test_places_are_finite_distinct_and_repeatable(graph):
    run = recorded(graph.n_nodes)
    message = ReplayFeed(run, Scene(graph)).topology()
    assert message == ReplayFeed(run, Scene(graph)).topology()
    places = {(round(x, 6), round(y, 6)) for x, y in zip(message["x"], message["y"], strict=True)}
    assert len(places) > graph.n_nodes / 2
    assert np.isfinite(message["x"] + message["y"]).all()


def test_a_grid_lies_along_the_axes_and_a_ring_stays_round():
    message = ReplayFeed(recorded(9), Scene(graphs.grid(3, 3))).topology()
    x, y = np.array(message["x"]), np.array(message["y"])
    for i, j in message["arcs"]:
        along = sorted((abs(x[i] - x[j]), abs(y[i] - y[j])))
        assert along[0] < 0.1 * along[1]
    ring = ReplayFeed(recorded(7), Scene(graphs.cycle(7))).topology()
    radii = np.hypot(ring["x"] - np.mean(ring["x"]), ring["y"] - np.mean(ring["y"]))
    np.testing.assert_allclose(radii, radii[0], rtol=0.05)


def test_tables_of_a_replay():
    run = recorded(4)
    uncertainty, age = np.random.default_rng(0).random((2, 6, 4))
    age[0] = np.inf
    happened = Event(0.12, "killed", 1)
    scene = Scene(graphs.chain(4))
    feed = ReplayFeed(run, scene, uncertainty=uncertainty, age=age, events=[happened], stale=0.5)
    topology = feed.topology()
    assert (topology["colours"], topology["stale"]) == (["error", "uncertainty", "state", "age"], 0.5)
    moment = decode_moment(feed.frame(3))
    np.testing.assert_allclose(moment.uncertainty, uncertainty[3], rtol=1e-6)
    np.testing.assert_allclose(moment.age, age[3], rtol=1e-6)
    assert feed.traces(2)["uncertainty"] == uncertainty[:, 2].tolist()
    assert feed.details(2, 1)["uncertainty"] == uncertainty[1, 2]
    assert feed.events(0) == (1, [happened])
    with pytest.raises(ShapeError, match=r"age must be \(T, N\) = \(6, 4\); got \(4, 6\)"):
        ReplayFeed(run, scene, age=age.T)


def test_the_rate_is_the_one_that_the_run_was_made_with():
    run = recorded(attributes={"guaranteed_rate": 0.25})
    assert ReplayFeed(run, Scene(graphs.chain(4))).topology()["rate"] == 0.25
    assert ReplayFeed(run, Scene(graphs.chain(4), rate=0.5)).topology()["rate"] == 0.5
    live = ReplayFeed(dataclasses.replace(run, path="live"), Scene(graphs.chain(4))).topology()
    assert (live["rate"], live["rate_name"]) == (0.25, "designed rate, no delay")
    assert ReplayFeed(recorded(attributes={"guaranteed_rate": 0.0}), Scene(graphs.chain(4))).topology()["rate"] is None


def test_topology_misuse():
    run = recorded(3)
    with pytest.raises(ShapeError, match="graph has 2 nodes; the run has 3"):
        ReplayFeed(run, Scene(graphs.chain(2)))
    with pytest.raises(ShapeError, match="positions must have shape"):
        ReplayFeed(run, Scene(graphs.chain(3), positions=np.zeros((2, 2))))
    with pytest.raises(ArgumentError, match="positions must be finite"):
        ReplayFeed(run, Scene(graphs.chain(3), positions=np.full((3, 2), np.nan)))
    with pytest.raises(ArgumentError, match="no samples"):
        ReplayFeed(recorded(3, samples=0), Scene(graphs.chain(3)))
    for rate in (0.0, math.nan):
        with pytest.raises(ArgumentError, match="rate must be a positive number"):
            ReplayFeed(run, Scene(graphs.chain(3), rate=rate))


def test_a_trace_is_one_node():
    run = recorded(3)
    run.estimate[0, 1] = np.nan
    feed = ReplayFeed(run, Scene(graphs.chain(3)))
    message = feed.traces(1)
    assert json.loads(json.dumps(message, allow_nan=False)) == message
    assert message["error"][0] is None
    assert message["error"][1:] == pytest.approx(np.linalg.norm(run["error"][1:, 1], axis=1))
    assert message["truth"] == run.truth[:, 1].T.tolist()
    assert message["estimate"][1][1:] == run.estimate[1:, 1, 1].tolist()
    long = ReplayFeed(recorded(3, samples=4001), Scene(graphs.chain(3))).traces(0)
    assert len(long["times"]) == len(long["error"]) == 1334
    assert trace_message(0, np.zeros(0), error=np.zeros(0)) == {"type": "trace", "node": 0, "times": [], "error": []}
    with pytest.raises(ProtocolError, match="node 3 is not in the run"):
        feed.traces(3)


def test_the_details_of_a_node():
    run = recorded(3, delivered=np.full((6, 3), 5))
    details = ReplayFeed(run, Scene(graphs.chain(3))).details(1, 2)
    assert details["estimate"] == run.estimate[2, 1].tolist()
    assert details["truth"] == run.truth[2, 1].tolist()
    assert details["error"] == pytest.approx(np.linalg.norm(run["error"][2, 1]))
    assert details["facts"] == [["messages sent", 6], ["messages taken in", 5]]
    assert details["links"] == [{"neighbour": "<b>0"}, {"neighbour": "<b>2"}]


def test_playback_moves_pauses_seeks_and_ends():
    state = Playback.start(np.array([0.0, 1.0, 4.0]), 2.0)
    assert (state.index, state.playing, state.wait) == (0, True, 0.5)
    assert state.advanced(0.49).index == 0
    assert state.advanced(0.5).index == 1
    assert state.index == 0  # a value: nothing moved
    paused = state.advanced(0.6).obeying({"type": "pause"})
    assert paused.advanced(100.0).index == 1
    assert paused.wait == math.inf
    assert paused.obeying({"type": "seek", "frame": 2}).index == 2
    assert state.obeying({"type": "speed", "value": 4}).wait == 0.25
    end = state.advanced(100.0)
    assert (end.index, end.playing) == (2, False)
    again = end.obeying({"type": "play"})
    assert (again.index, again.playing) == (0, True)
    assert paused.obeying({"type": "play"}).index == 1
    assert not Playback.start(np.array([5.0]), 1.0).playing


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf, 1e7])
def test_playback_refuses_a_speed_that_is_none(speed):
    with pytest.raises(ArgumentError, match="speed must be positive"):
        Playback.start(np.zeros(1), speed)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("{", "must be JSON"),
        ("[" * 4000, "must be JSON"),
        (" " * (LONGEST + 1), "at most 4096 characters"),
        ("[]", "object of type"),
        ('{"type": ["play"]}', "object of type"),
        ('{"type": "stop"}', "object of type"),
        ('{"type": "play", "now": 1}', "keys type, no other"),
        ('{"type": "seek"}', "keys type, frame"),
        ('{"type": "order", "order": "kill"}', "keys type, node, order"),
    ],
)
def test_commands_that_are_none(text, match):
    with pytest.raises(ProtocolError, match=match):
        decode_command(text)


@pytest.mark.parametrize("value", [-1, 2, 0.5, True, "0", [0]])
def test_commands_with_wrong_values(value):
    state = Playback.start(np.array([0.0, 1.0]), 1.0)
    with pytest.raises(ProtocolError, match="frame must be a whole number"):
        state.obeying({"type": "seek", "frame": value})
    with pytest.raises(ProtocolError, match="node must be a whole number"):
        selected({"type": "select", "node": value}, 2)
    with pytest.raises(ProtocolError, match="node must be a whole number"):
        ordered({"type": "order", "order": "kill", "node": value}, ("kill",), 2)


def test_selecting_nobody():
    assert selected({"type": "select", "node": None}, 2) is None
    with pytest.raises(ProtocolError, match="frame must be a whole number"):
        Playback.start(np.zeros(2), 1.0).obeying({"type": "seek", "frame": None})


@pytest.mark.parametrize("order", ["explode", 1, None, ["kill"], "__class__"])
def test_orders_that_are_none(order):
    with pytest.raises(ProtocolError, match="must be one of kill, go"):
        ordered({"type": "order", "order": order, "node": 0}, ("kill", "go"), 1)
    with pytest.raises(ProtocolError, match="this page can only look"):
        ordered({"type": "order", "order": order, "node": 0}, (), 1)


@pytest.mark.parametrize("value", [0, -1, True, "1", None, math.nan, math.inf])
def test_speeds_that_are_none(value):
    state = Playback.start(np.array([0.0, 1.0]), 1.0)
    with pytest.raises(ProtocolError, match="speed must be a positive number"):
        state.obeying({"type": "speed", "value": value})
