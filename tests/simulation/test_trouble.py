"""Delay, loss, clocks, rounding, triggers, absences: what the channels and policies promise."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.graphs import chain, grid
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.simulation import (
    Absence,
    Bouncing,
    Bursts,
    Channel,
    Clocks,
    Noise,
    Outage,
    Scenario,
    Topology,
    Trajectory,
    Trigger,
    simulate,
    switched,
)
from trigpoint.simulation.documents import scenario_document, scenario_from_document
from trigpoint.simulation.wire import HEAD_BYTES

from .drawn import observed, start

OSCILLATOR = LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]])
GRID = NetworkedAgents(grid(3, 3, anchors=(0,)), OSCILLATOR)
OBSERVER = tp.design(GRID, tp.methods.LocalKalman(tp.FromGraph(1.5)))
STATIC = NetworkedAgents(chain(6), LinearAgent.static())
STATIC_OBSERVER = tp.design(STATIC, tp.methods.LocalKalman(tp.Fixed(1.0)))


def run(times, error=1.0, state=0.0, *, problem=GRID, observer=OBSERVER, **options):
    return simulate(problem, observer, Scenario(times, error, state, **options))


# -- the paths agree ---------------------------------------------------------------------------------------------------
@settings(max_examples=30, deadline=None)
@given(
    observed(),
    st.integers(0, 999),
    st.floats(0.0, 0.5),
    st.sampled_from(["drop", "use", "propagate"]),
    st.sampled_from([0.0, 1e-3]),
    st.sampled_from([None, 0.3]),
)
def test_reference_and_stacked_agree_with_delays(observer, seed, delay, old, quantum, stale) -> None:
    error, state, inputs = start(observer, seed)
    span = 50.0 if quantum else None
    channel = Channel(delay=delay, old=old, stale=stale, quantum=quantum, span=span)
    times = [0.0, 0.1, 0.35, 0.8, 1.5]
    runs = [
        simulate(
            observer.problem,
            observer,
            Scenario(times, error, state, period=0.1, channel=channel, inputs=inputs, path=path),
        )
        for path in ("reference", "stacked")
    ]
    assert [one.path for one in runs] == ["reference", "stacked"]
    scale = np.abs(runs[0].estimate).max() + 1.0
    # A value that lies between two quanta may be rounded either way: then only the quantum's effect is bounded.
    np.testing.assert_allclose(runs[0].estimate, runs[1].estimate, atol=(1e-12 + 20.0 * quantum) * scale)
    for name in ("messages", "delivered", "bytes"):
        assert np.array_equal(runs[0][name], runs[1][name])


def test_equal_clocks_are_one_clock() -> None:
    times = np.linspace(0.0, 3.0, 31)
    plain = run(times, period=0.1, path="reference")
    clocked = run(times, period=0.1, clocks=Clocks())
    assert clocked.path == "reference"
    assert np.array_equal(plain.estimate, clocked.estimate)


def test_a_given_motion_is_known_to_the_agents() -> None:
    """Whatever the motion, the error is that of the free motion, to rounding, on both paths and continuously."""
    times = np.linspace(0.0, 2.0, 21)
    rng = np.random.default_rng(3)
    motion = Trajectory(np.linspace(0.0, 2.0, 7), rng.normal(size=(7, 9, 2)))
    error = rng.normal(size=(9, 2))
    for options in ({"period": 0.1, "path": "reference"}, {"period": 0.1, "path": "stacked"}, {}):
        free = run(times, error, 0.0, **options)
        moved = run(times, error, 0.0, motion=motion, **options)
        np.testing.assert_allclose(moved.error, free.error, atol=1e-12)
        np.testing.assert_allclose(moved.truth[5], motion.at(0.5), atol=1e-15)


# -- old messages ------------------------------------------------------------------------------------------------------
def test_an_old_value_used_as_new_leaves_a_floor_and_a_propagated_one_does_not() -> None:
    times = np.linspace(0.0, 200.0, 401)
    floors = {}
    for old in ("use", "drop", "propagate"):
        result = run(times, 1.0, 3.0, period=0.02, channel=Channel(delay=0.03, old=old))
        floors[old] = float(result.error_norm[-50:].max())
    assert floors["propagate"] < 1e-3 * floors["use"]
    assert floors["drop"] == pytest.approx(floors["use"], rel=1e-9)  # nothing is lost: the same messages


def test_a_wrong_clock_leaves_a_floor_of_offset_times_speed() -> None:
    """The age is wrong by the offset: the message is moved too far by some ``offset |A x|``."""
    offsets = np.zeros(9)
    offsets[4] = 0.01
    times = np.linspace(0.0, 120.0, 241)
    channel = Channel(old="propagate")
    floors = [
        float(
            run(times, 1.0, 3.0, period=0.05, channel=channel, clocks=Clocks(offset=share * offsets))
            .error_norm[-40:]
            .max()
        )
        for share in (0.0, 1.0, 2.0)
    ]
    speed = 3.0 * np.sqrt(2.0)
    assert floors[0] < 1e-4
    assert 0.1 * 0.01 * speed < floors[1] < 2.0 * 0.01 * speed * tp.gain_bound(GRID.graph)
    assert floors[2] / floors[1] == pytest.approx(2.0, rel=0.1)


def test_stale_neighbours_are_left_out_and_come_back() -> None:
    outage = Outage(5.0, 8.0, links=((1, 0), (1, 2), (1, 4)))
    channel = Channel(old="propagate", stale=0.5, outages=(outage,))
    result = run(np.linspace(0.0, 60.0, 301), 1.0, 1.0, period=0.1, channel=channel)
    delivered = np.diff(result.delivered[:, [0, 2, 4]].sum(axis=1))
    assert delivered[30] < delivered[10] == delivered[60]
    assert result.error_norm[-1] < 1e-2 * result.error_norm[0]


def test_messages_that_overtake_are_ignored() -> None:
    channel = Channel(jitter=0.5, old="propagate")
    result = run(np.linspace(0.0, 80.0, 81), 1.0, 1.0, period=0.1, channel=channel, seed=4)
    assert result.error_norm[-1] < 0.06 * result.error_norm[0]
    again = run(np.linspace(0.0, 80.0, 81), 1.0, 1.0, period=0.1, channel=channel, seed=4)
    assert np.array_equal(result.estimate, again.estimate)


# -- losses ------------------------------------------------------------------------------------------------------------
def share_delivered(channel, **options) -> float:
    result = run([0.0, 200.0], period=0.1, problem=STATIC, observer=STATIC_OBSERVER, channel=channel, **options)
    return float(result.delivered[-1].sum() / result.messages[-1].sum())


def test_losses_happen_as_often_as_asked() -> None:
    assert share_delivered(Channel(loss=0.3)) == pytest.approx(0.7, abs=0.02)
    # Gilbert-Elliott: the share of bad time is begin / (begin + end).
    assert share_delivered(Channel(bursts=Bursts(0.05, 0.15))) == pytest.approx(0.75, abs=0.04)
    assert share_delivered(Channel(outages=(Outage(50.0, 100.0),))) == pytest.approx(0.75, abs=0.01)
    # Neighbours one apart, reach 1: exp(-1) arrive.
    assert share_delivered(Channel(reach=1.0), state=np.arange(6.0)) == pytest.approx(np.exp(-1.0), abs=0.02)


def test_bursts_come_in_runs() -> None:
    """A bad link stays bad for 1 / end exchanges on average."""
    times = 0.1 * np.arange(20001) + 0.05
    pair = NetworkedAgents(chain(2), LinearAgent.static())
    observer = tp.design(pair, tp.methods.LocalKalman(tp.Fixed(1.0)))
    result = run(times, period=0.1, problem=pair, observer=observer, channel=Channel(bursts=Bursts(0.02, 0.1)))
    lost = np.diff(result.delivered[:, 0]) == 0
    edges = np.flatnonzero(np.diff(lost.astype(int)) == 1).shape[0]
    assert lost.sum() / edges == pytest.approx(10.0, rel=0.2)


def test_rounded_messages_cost_fewer_bytes_and_leave_a_floor_of_the_quantum() -> None:
    coarse, fine = (
        run([0.0, 400.0], problem=STATIC, observer=STATIC_OBSERVER, period=0.2, channel=Channel(quantum=q, span=4.0))
        for q in (0.5, 1e-6)
    )
    bits = np.ceil(np.log2(8.0 / 0.5 + 1.0))
    assert coarse.bytes[-1].sum() == coarse.messages[-1].sum() * (HEAD_BYTES + np.ceil(bits / 8))
    assert fine.error_norm[-1] < 1e-4 < coarse.error_norm[-1] + 1e-4
    assert coarse.error_norm[-1] < 0.5 * 36.0


# -- triggers ----------------------------------------------------------------------------------------------------------
def test_a_trigger_saves_messages_and_keeps_the_error_in_its_bound() -> None:
    """Theory 6-F6: a neighbour's picture is never off by more than the threshold, so the error follows it."""
    rate = 0.5 * STATIC_OBSERVER.decay_rate
    trigger = Trigger(0.3, rate)
    options = {"problem": STATIC, "observer": STATIC_OBSERVER, "period": 0.02}
    times = np.linspace(0.0, 40.0, 201)
    all_told = run(times, **options)
    told = run(times, channel=Channel(old="use"), trigger=trigger, **options)
    assert told.messages[-1].sum() < 0.02 * all_told.messages[-1].sum()
    lmin, degree = 1.0 / tp.gain_bound(STATIC.graph), 2.0
    # |e| <= transient + degree * threshold / (lmin - rate), node by node in the Euclidean norm.
    bound = np.exp(-rate * times) * (np.sqrt(6.0) + degree * 0.3 * np.sqrt(6.0) / (lmin - rate)) * 1.1
    assert (told.error_norm <= bound).all()


# -- absences ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("options", [{"period": 0.1}, {}])
def test_a_node_that_leaves_comes_back_empty_and_converges(options) -> None:
    times = np.linspace(0.0, 60.0, 601)
    result = run(times, 1.0, 2.0, absences=[Absence(4, 5.0, 9.0), Absence(8, 0.0, 2.0)], **options)
    away = result.status == "away"
    assert np.array_equal(away[:, 4], (times > 5.0 - 1e-6) & (times < 9.0 - 1e-6))
    assert np.isnan(result.estimate[away]).all()
    assert not np.isnan(result.estimate[~away]).any()
    back = int(np.argmax(times > 9.0 - 1e-6))
    np.testing.assert_allclose(result.estimate[back, 4], 0.0, atol=1e-12)
    assert result.error_norm[-1] < 0.02 * result.error_norm[0]
    assert result.lambda_min[70] < result.lambda_min[0]
    sent = np.diff(result.messages[:, 4])
    assert sent[60:80].sum() == 0


def test_who_is_away_counts_for_the_anchoring_of_the_others() -> None:
    problem = NetworkedAgents(chain(4), LinearAgent.static())
    observer = tp.design(problem, tp.methods.LocalKalman(tp.Fixed(1.0)))
    result = run([0.0, 1.5], problem=problem, observer=observer, absences=[Absence(1, 1.0)])
    assert result.status.tolist() == [["anchored"] * 4, ["anchored", "away", "relative", "relative"]]
    assert result.lambda_min[1] == 0.0


# -- the record --------------------------------------------------------------------------------------------------------
SCENARIOS = [
    {"period": 0.1, "channel": Channel(0.2, 0.05, 0.01, "propagate", 0.9, Bursts(0.1, 0.5), (Outage(0.3, 0.5),))},
    {"period": 0.1, "clocks": Clocks([0.1, 0.2, 0.15] * 3, phase=0.02, drift=1e-4, jitter=1e-3), "seed": 7},
    {"topology": Topology.random(GRID.graph.n_arcs, 0.25, 0.7, 3.0, seed=2), "noise": Noise(0.1, 0.2)},
    {"period": 0.1, "channel": Channel(old="use"), "trigger": Trigger(0.2, 0.1), "absences": [Absence(2, 1.0)]},
    {"period": 0.1, "channel": Channel(reach=3.0, axes=(0, 1), quantum=0.01, span=9.0)},
]


@pytest.mark.parametrize("options", SCENARIOS)
def test_a_recorded_run_says_enough_to_be_run_again_bit_for_bit(options, tmp_path) -> None:
    times = np.linspace(0.0, 2.0, 11)
    result = run(times, 1.0, 0.5, **options)
    tp.save(result, tmp_path / "run.npz")
    kept = tp.load(tmp_path / "run.npz")
    again = simulate(GRID, OBSERVER, scenario_from_document(kept.attributes["scenario"]))
    assert np.array_equal(again.estimate, result.estimate, equal_nan=True)
    assert np.array_equal(kept.estimate, result.estimate, equal_nan=True)
    assert again.path == result.path == kept.path
    for name in ("delivered", "bytes", "lambda_min"):
        one, other = getattr(kept, name), getattr(result, name)
        assert (one is None) == (other is None)
        assert one is None or np.array_equal(one, other)


def test_damaged_scenarios_are_refused() -> None:
    document = json.loads(json.dumps(scenario_document(Scenario([1.0], period=0.1, channel=Channel()))))
    for spoilt, words in (
        ({}, "exactly the fields"),
        ({**document, "period": -1.0}, "period must be a positive number"),
        ({**document, "channel": {"value": "os.system"}}, "unknown value 'os.system'"),
        ({**document, "channel": {"value": "Channel", "speed": 1.0}}, "this is no scenario"),
        ({**document, "seed": "x"}, "seed must be a whole number"),
    ):
        with pytest.raises(ProtocolError, match=words):
            scenario_from_document(spoilt)


@pytest.mark.parametrize("path", ["stacked", "reference"])
def test_an_interrupted_run_keeps_what_was_computed(path) -> None:
    def stop(ticks):
        for tick in ticks:
            if tick.number == 12:
                raise KeyboardInterrupt
            yield tick

    channel = Channel(delay=0.05)
    scenario = Scenario(np.linspace(0.0, 3.0, 31), 1.0, period=0.1, channel=channel, path=path)
    partial = simulate(GRID, OBSERVER, scenario, progress=stop)
    whole = simulate(GRID, OBSERVER, scenario)
    assert partial.attributes["interrupted"] is True
    assert 10 <= partial.times.shape[0] <= 12
    assert np.array_equal(partial.estimate, whole.estimate[: partial.times.shape[0]])

    def never(ticks):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(GRID, OBSERVER, scenario, progress=never)


@pytest.mark.parametrize("options", [{"path": "stacked"}, {"path": "reference"}, {"gossip": True}])
def test_plain_runs_and_gossip_keep_what_was_computed_too(options) -> None:
    def stop(ticks):
        for tick in ticks:
            if tick.number == 12:
                raise KeyboardInterrupt
            yield tick

    def never(ticks):
        raise KeyboardInterrupt

    scenario = Scenario(np.linspace(0.0, 3.0, 31), 1.0, period=0.1, **options)
    partial = simulate(STATIC, STATIC_OBSERVER, scenario, progress=stop)
    all_of_it = simulate(STATIC, STATIC_OBSERVER, scenario)
    assert partial.attributes["interrupted"] is True
    assert partial.times.shape[0] == 12
    assert np.array_equal(partial.estimate, all_of_it.estimate[:12])
    with pytest.raises(KeyboardInterrupt):
        simulate(STATIC, STATIC_OBSERVER, scenario, progress=never)


def test_a_changing_continuous_run_keeps_what_was_computed(monkeypatch) -> None:
    """The interrupt comes in the middle of an interval."""
    scenario = Scenario(np.linspace(0.0, 3.0, 31), 1.0, noise=Noise(0.1), seed=1)
    all_of_it, calls = run_of(scenario), []

    def stopping(*arguments):
        calls.append(0)
        if len(calls) == 12:
            raise KeyboardInterrupt
        return go(*arguments)

    go = switched._ThroughModes.go
    monkeypatch.setattr(switched._ThroughModes, "go", stopping)
    partial = run_of(scenario)
    assert partial.attributes["interrupted"] is True
    assert np.array_equal(partial.estimate, all_of_it.estimate[:12])
    calls[:] = [0] * 11
    with pytest.raises(KeyboardInterrupt):
        run_of(Scenario([1.0], noise=Noise(0.1)))


def run_of(scenario):
    return simulate(GRID, OBSERVER, scenario)


def test_values_beyond_the_span_are_clipped_and_bits_are_counted() -> None:
    channel = Channel(quantum=0.25, span=1.0)
    assert channel.bits_per_value == np.ceil(np.log2(9.0))
    assert Channel(quantum=0.25).bits_per_value == 64.0
    # Errors of 5: the neighbours hear 1, as the stacked path and the reference path agree.
    runs = [
        run([0.1], 5.0, problem=STATIC, observer=STATIC_OBSERVER, period=0.1, channel=channel, path=path)
        for path in ("stacked", "reference")
    ]
    np.testing.assert_allclose(runs[0].estimate, runs[1].estimate, atol=1e-14)
    free = run([0.1], 5.0, problem=STATIC, observer=STATIC_OBSERVER, period=0.1)
    assert (free.estimate[0, 1:] - runs[0].estimate[0, 1:] > 0.1).all()


def through(outage: Outage) -> None:
    run([1.0], period=0.1, channel=Channel(outages=(outage,)))


def test_a_series_that_was_not_recorded_says_so() -> None:
    with pytest.raises(ArgumentError, match="did not record 'lambda_min'"):
        run([1.0])["lambda_min"]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Channel(delay=-1.0), "delay must be a number of at least 0"),
        (lambda: Channel(stale=0.0), "stale must be positive"),
        (lambda: Channel(old="keep"), "old must be one of drop, use, propagate; got 'keep'"),
        (lambda: Channel(bursts=0.1), "bursts must be Bursts"),
        (lambda: Channel(outages=((1.0, 2.0),)), "outages must be a tuple of Outage"),
        (lambda: Bursts(0.0, 0.5), "begin of bursts must be a probability"),
        (lambda: Outage(2.0, 1.0), "an outage must stop after its start"),
        (
            lambda: run([1.0], period=0.1, channel=Channel(outages=(Outage(1.0, 2.0, ((0, 99),)),))),
            "pairs of node indices below",
        ),
        (lambda: Trigger(0.0), "a trigger needs size > 0"),
        (lambda: Clocks(0.0), "period of a clock must be positive"),
        (lambda: Clocks(phase=-1.0), "phase of a clock must be at least 0"),
        (lambda: Clocks(drift=-1.0), "drift of a clock must be above -1"),
        (lambda: Absence(0, 2.0, 1.0), "an absence needs a node and start < stop"),
        (lambda: Topology([1.0, 0.0], np.ones((2, 1), dtype=bool)), "times of a topology must ascend"),
        (lambda: Topology.random(3, 0.0, 0.5, 1.0), "a random topology needs dwell > 0"),
        (lambda: Topology.schedule(chain(2), [(0.0, [5])]), "arcs of a schedule must be numbers from 0 to 1"),
        (lambda: Trajectory([1.0, 1.0], np.zeros((2, 1, 1))), "times of a trajectory must ascend"),
        (lambda: Bouncing([[2.0]], [[1.0]], 1.0), "every position within 0 and 1"),
        (lambda: Scenario([1.0], absences=[3]), "absences must hold Absence"),
        (lambda: Scenario([1.0], topology=3), r"topology must be Topology\(...\)"),
        (lambda: Scenario([1.0], motion=3), r"motion must be Trajectory\(...\) or Bouncing\(...\)"),
        (lambda: Scenario([1.0], period=1.0, trigger=Trigger(1.0)), "with a trigger silence means no news"),
        (lambda: Scenario([1.0], gossip=True), "gossip needs sampled exchange"),
        (
            lambda: Scenario([1.0], noise=Noise(process=1.0), motion=Trajectory([0.0], np.zeros((1, 1, 1)))),
            "a given motion has no process noise",
        ),
        (lambda: run([1.0], period=0.1, channel=Channel(jitter=0.1), path="stacked"), "the stacked path knows no"),
        (lambda: run([1.0], noise=Noise(1.0), path="stacked"), "goes mode by mode: use path='auto'"),
        (lambda: run([1.0], period=0.1, channel=Channel(reach=1.0, axes=(5,))), r"axes \(5,\) of the channel"),
    ],
)
def test_nonsense_is_refused(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Topology([0.0], np.ones((1, 2))), "active must be true or false"),
        (lambda: Trajectory([0.0], np.zeros((2, 1))), r"states must have shape \(K, N, n\)"),
        (lambda: Bouncing(np.zeros((2, 2)), np.zeros((3, 2)), 1.0), r"position and velocity must both be \(N, d\)"),
        (lambda: run([1.0], period=0.1, clocks=Clocks([0.1, 0.2])), "period of the clocks must be one number or 9"),
    ],
)
def test_shapes_are_checked(make, words) -> None:
    with pytest.raises(ShapeError, match=words):
        make()
