"""Machines on a virtual clock: the simulator's run to the last bit, and what trouble does to them."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest

import trigpoint as tp
from tests.machine import unit
from tests.runtime.given import DOUBLE, OSCILLATOR, PERIOD, STATIC, case
from trigpoint.arrays import expm
from trigpoint.errors import ArgumentError
from trigpoint.runtime import Down, Frame, Kind, NodeMachine, Trouble, encode_frame, run_virtual
from trigpoint.runtime.topics import node_key, reading_key
from trigpoint.runtime.virtual import SENSOR
from trigpoint.simulation import Channel


@pytest.mark.parametrize(("delay", "told"), [(0.0, False), (0.02, True), (0.05, False), (0.033, True)])
@pytest.mark.parametrize("agent", [STATIC, DOUBLE, OSCILLATOR], ids=["static", "double integrator", "oscillator"])
def test_the_machines_give_the_simulated_estimates_to_the_last_bit(agent, delay, told) -> None:
    one = case(agent, told=told and agent is not STATIC)
    times = PERIOD * np.arange(61)
    scenario = tp.Scenario(
        times, one.error, one.truth, period=PERIOD, channel=Channel(delay=delay, old="propagate"), inputs=one.inputs,
        path="reference",
    )  # fmt: skip
    simulated = tp.simulate(one.observer.problem, one.observer, scenario)
    live = run_virtual(one.settings(), one.plant(), times, one.network(delay=delay))
    np.testing.assert_array_equal(live.truth, simulated.truth)
    np.testing.assert_array_equal(live.estimate, simulated.estimate)


def test_between_two_acts_an_estimate_moves_freely_and_one_that_is_away_is_unknown() -> None:
    one = case(OSCILLATOR)
    run = run_virtual(
        one.settings(), one.plant(), np.array([1.0, 1.013]), one.network(), Trouble([Down("3", 0.5, orderly=True)])
    )
    moved = run.estimate[0] @ expm(0.013 * one.programs[0].A).T
    others = [k for k in range(9) if k != 3]
    np.testing.assert_allclose(run.estimate[1][others], moved[others], rtol=1e-12)
    assert np.isnan(run.estimate[:, 3]).all()
    assert (run.status[:, 3] == "away").all()
    assert run.messages[0].tolist() == [51, 51, 51, 25] + [51] * 5
    assert run.path == "virtual"


def test_equal_seeds_give_equal_runs() -> None:
    one = case(DOUBLE)
    runs = [
        run_virtual(
            one.settings(), one.plant(dict.fromkeys(range(13), 0.1), seed=2), PERIOD * np.arange(20),
            one.network(loss=0.3, jitter=0.05, seed=3),
        )
        for _ in range(2)
    ]  # fmt: skip
    np.testing.assert_array_equal(runs[0].estimate, runs[1].estimate)
    assert runs[0].attributes["lost"] > 0


def test_the_noise_of_the_readings_is_as_large_as_asked_for() -> None:
    one = case(STATIC, tp.graphs.chain(2, anchors=[0]))
    exact, noisy = one.plant().readings(), one.plant({0: 0.3}, seed=1)
    drawn = np.array([noisy.readings()[0] - exact[0] for _ in range(4000)])
    assert drawn.std() == pytest.approx(0.3, rel=0.05)
    np.testing.assert_array_equal(noisy.readings()[1], exact[1])


@pytest.mark.parametrize("times", [[], [1.0, 1.0], [-1.0], [[0.0]]])
def test_times_must_ascend(times) -> None:
    one = case(STATIC, tp.graphs.chain(2, anchors=[0]))
    with pytest.raises(ArgumentError, match="times must be ascending"):
        run_virtual(one.settings(), one.plant(), np.array(times), one.network())


def test_an_act_with_four_neighbours_takes_well_under_a_millisecond() -> None:
    """Act, nine frames and latch with ages all different: 0.2 ms on a quiet machine; the bound leaves room.

    A millisecond is a tenth of a unit, which takes that machine 10 ms, and others as much longer as they are slower.
    """
    one = case(OSCILLATOR, tp.graphs.grid(3, 3, anchors=[4]))
    machine, program = NodeMachine(one.settings()[4], epoch=1, now=1e9), one.programs[4]
    rng, spent, before = np.random.default_rng(0), [], unit()
    for k in range(400):
        now = 1e9 + PERIOD * k + rng.uniform(0.0, 1e-4)
        frames, facts = [], (1.0, now, 0.0, 1.0)
        for name in program.hears:
            then = now - rng.uniform(0.0, 0.02)
            frames.append(
                (node_key("net", name, "estimate"), Frame(Kind.ESTIMATE, name, 1, k, then, facts, np.ones(2)))
            )
        for label in program.reads:
            frame = Frame(Kind.READING, SENSOR, 1, k, now - 0.004, (float(label),), np.ones(1))
            frames.append((reading_key("net", label), frame))
        sent = [(key, encode_frame(frame)) for key, frame in frames]
        begun = process_time()
        machine.act(now)
        for key, data in sent:
            machine.receive(now, key, data)
        machine.latch(now)
        spent.append(process_time() - begun)
    assert machine.counters.dropped == 0
    assert np.median(spent) < 0.1 * max(before, unit())
