"""Messages, frames and the playback value: pure, so tested without a server."""

import json
import math
import struct

import numpy as np
import pytest

from trigpoint import graphs
from trigpoint.dashboard import Playback, decode_frame, frame, topology_message
from trigpoint.dashboard.frames import trace_message
from trigpoint.dashboard.playback import decode_command, traced_node
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.observers.run import Run


def recorded(nodes=3, samples=5, seed=0):
    rng = np.random.default_rng(seed)
    truth, estimate = rng.normal(size=(2, samples, nodes, 2))
    names = tuple(f"<b>{k}" for k in range(nodes))
    status = np.full((samples, nodes), "anchored")
    return Run(
        0.1 * np.arange(samples), truth, estimate, np.zeros((samples, nodes), np.int64), status, names, "stacked"
    )


def test_a_frame_is_the_time_and_the_error_norms():
    run = recorded()
    for k in range(5):
        data = frame(run, k)
        assert struct.unpack("<f", data[:4])[0] == np.float32(run.times[k])
        assert len(data) == 4 * (1 + 3)
        time, errors = decode_frame(data)
        assert time == pytest.approx(run.times[k], rel=1e-7)
        np.testing.assert_allclose(errors, np.linalg.norm(run["error"][k], axis=1), rtol=1e-6)


def test_frames_carry_nan_and_overflow():
    run = recorded()
    run.estimate[2, 0], run.estimate[2, 1] = np.nan, 1e60
    _, errors = decode_frame(frame(run, 2))
    assert math.isnan(errors[0])
    assert math.isinf(errors[1])


@pytest.mark.parametrize("k", [-1, 5])
def test_no_frame_outside_the_run(k):
    with pytest.raises(ArgumentError, match=f"sample {k} is not in the run"):
        frame(recorded(), k)


@pytest.mark.parametrize("data", [b"", b"abc", b"12345"])
def test_a_broken_frame_is_refused(data):
    with pytest.raises(ProtocolError, match="4 bytes each"):
        decode_frame(data)


def test_the_topology_is_json_without_nan():
    run = recorded()
    run.estimate[0, 0] = np.nan
    graph = MeasurementGraph(3, [EXTERNAL, 0, 1, 1], [2, 1, 0, 2])
    message = topology_message(run, graph, [[0, 0], [1, 0], [1, 2]])
    assert json.loads(json.dumps(message, allow_nan=False)) == message
    assert message["arcs"] == [[0, 1], [1, 2]]
    assert message["anchored"] == [2]
    assert (message["x"], message["y"]) == ([0, 1, 1], [0, 0, 2])
    assert message["names"] == ["<b>0", "<b>1", "<b>2"]
    assert message["times"] == run.times.tolist()
    assert message["norm"][0] is None
    assert message["norm"][1:] == pytest.approx(run.error_norm[1:])
    low, high = message["error_range"]
    norms = np.linalg.norm(run["error"], axis=2)
    assert (low, high) == pytest.approx((np.nanmin(norms), np.nanmax(norms)))


def test_error_range_spans_at_most_six_decades_and_is_null_without_error():
    run = recorded()
    run.estimate[1, 0] = run.truth[1, 0] + 1e-12
    low, high = topology_message(run, graphs.chain(3))["error_range"]
    assert high / low == pytest.approx(1e6)
    run.estimate[:] = run.truth
    assert topology_message(run, graphs.chain(3))["error_range"] is None


@pytest.mark.parametrize("graph", [graphs.chain(1), MeasurementGraph(5, [0, 3], [1, 4]), graphs.grid(6, 7)])
def test_places_are_finite_distinct_and_repeatable(graph):
    run = recorded(graph.n_nodes)
    message = topology_message(run, graph)
    assert message == topology_message(run, graph)
    assert (
        len({(round(x, 6), round(y, 6)) for x, y in zip(message["x"], message["y"], strict=True)}) > graph.n_nodes / 2
    )
    assert np.isfinite(message["x"] + message["y"]).all()


def test_topology_misuse():
    run = recorded()
    with pytest.raises(ShapeError, match="graph has 2 nodes; the run has 3"):
        topology_message(run, graphs.chain(2))
    with pytest.raises(ShapeError, match="positions must have shape"):
        topology_message(run, graphs.chain(3), np.zeros((2, 2)))
    with pytest.raises(ArgumentError, match="positions must be finite"):
        topology_message(run, graphs.chain(3), np.full((3, 2), np.nan))
    with pytest.raises(ArgumentError, match="no samples"):
        topology_message(recorded(samples=0), graphs.chain(3))


def test_a_trace_is_the_error_of_one_node():
    run = recorded()
    run.estimate[0, 1] = np.nan
    message = trace_message(run, 1)
    assert message["errors"][0] is None
    assert message["errors"][1:] == pytest.approx(np.linalg.norm(run["error"][1:, 1], axis=1))
    long = trace_message(recorded(samples=4001), 0)
    assert len(long["times"]) == len(long["errors"]) == 1334
    with pytest.raises(ProtocolError, match="node 3 is not in the run"):
        trace_message(run, 3)


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
    assert state.obeying({"type": "trace", "node": 0}) is state
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
        ("[" * 100_000, "must be JSON"),
        ("[]", "object of type"),
        ('{"type": ["play"]}', "object of type"),
        ('{"type": "stop"}', "object of type"),
        ('{"type": "play", "now": 1}', "keys type, no other"),
        ('{"type": "seek"}', "keys type, frame"),
    ],
)
def test_commands_that_are_none(text, match):
    with pytest.raises(ProtocolError, match=match):
        decode_command(text)


@pytest.mark.parametrize("value", [-1, 2, 0.5, True, "0", None])
def test_commands_with_wrong_values(value):
    state = Playback.start(np.array([0.0, 1.0]), 1.0)
    with pytest.raises(ProtocolError, match="frame must be a whole number"):
        state.obeying({"type": "seek", "frame": value})
    with pytest.raises(ProtocolError, match="node must be a whole number"):
        traced_node({"type": "trace", "node": value}, 2)


@pytest.mark.parametrize("value", [0, -1, True, "1", None, math.nan, math.inf])
def test_speeds_that_are_none(value):
    state = Playback.start(np.array([0.0, 1.0]), 1.0)
    with pytest.raises(ProtocolError, match="speed must be a positive number"):
        state.obeying({"type": "speed", "value": value})
