"""Machines on a virtual clock: the simulator's run to the last bit, and what trouble does to them."""

from __future__ import annotations

import numpy as np
import pytest

import trigpoint as tp
from tests.runtime.given import DOUBLE, OSCILLATOR, PERIOD, STATIC, case
from trigpoint.runtime import run_virtual
from trigpoint.simulation import Channel


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize("delay", [0.0, 0.02, 0.05, 0.033])
@pytest.mark.parametrize("agent", [STATIC, DOUBLE, OSCILLATOR], ids=["static", "double integrator", "oscillator"])
def test_the_machines_give_the_simulated_estimates_to_the_last_bit(agent, delay, told) -> None:
    one = case(agent, told=told and agent is not STATIC)
    times = PERIOD * np.arange(101)
    scenario = tp.Scenario(
        times, one.error, one.truth, period=PERIOD, channel=Channel(delay=delay, old="propagate"), inputs=one.inputs,
        path="reference",
    )  # fmt: skip
    simulated = tp.simulate(one.observer.problem, one.observer, scenario)
    live = run_virtual(one.settings(), one.plant(), times, one.network(delay=delay))
    np.testing.assert_array_equal(live.truth, simulated.truth)
    np.testing.assert_array_equal(live.estimate, simulated.estimate)
