"""Programs of any kind run live as they were simulated: agents that differ, one plant seen by many, odd names."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import trigpoint as tp
from tests.runtime.given import STATIC, case
from trigpoint.observers import AssembledObserver
from trigpoint.runtime import MemoryNetwork, NodeSettings, run_virtual, topics
from trigpoint.runtime.virtual import SENSOR
from trigpoint.simulation import Channel
from trigpoint.simulation.world import World

PERIOD = 0.02
TIMES = PERIOD * np.arange(60)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)


class Simulated:
    """The simulator's own truth as a plant."""

    def __init__(self, observer: AssembledObserver, scenario: tp.Scenario, state) -> None:
        self._world, self._state, self._now = World.of(observer, scenario), np.ravel(state), 0.0

    def move(self, time: float) -> None:
        if time > self._now:
            self._state = self._world.advance(self._state, float(f"{time - self._now:.12g}"))
            self._now = time

    def truth(self):
        return self._world.shown(self._state)

    def readings(self):
        return self._world.read(self._state)


def differing():
    """Four oscillators of different frequency in a ring."""
    agents = [tp.LinearAgent([[0.0, 1.0], [-(1.0 + 0.3 * k), 0.0]], [[1.0, 0.0]]) for k in range(4)]
    problem = tp.NetworkedAgents(tp.graphs.cycle(4, anchors=[0]), agents)
    return problem, tp.design(problem, tp.methods.Heterogeneous()), (4, 2)


def shared():
    """Three nodes, each with an output of one plant."""
    A = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -0.1]])
    outputs = [np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 1.0, 1.0]])]
    problem = tp.SharedPlant(A, outputs, {0: [1], 1: [2], 2: [0]})
    return problem, tp.design(problem, tp.methods.CouplingGain(0.3)), (3, 3)


@pytest.mark.parametrize("delay", [0.0, 0.03])
@pytest.mark.parametrize("kind", [differing, shared])
def test_programs_of_any_kind_give_the_simulated_estimates_to_the_last_bit(kind, delay) -> None:
    problem, observer, shape = kind()
    rng = np.random.default_rng(1)
    error = rng.normal(size=shape)
    state = rng.normal(size=shape if kind is differing else shape[1])
    channel = Channel(delay=delay, old="propagate")
    scenario = tp.Scenario(TIMES, error, state, period=PERIOD, channel=channel, path="reference")
    programs = observer.nodes
    models = {program.name: program.A for program in programs}
    settings = [
        NodeSettings(
            "net", program, PERIOD, start=start, models={name: models[name] for name in program.hears},
            guests={SENSOR: "sensor"},
        )
        for program, start in zip(programs, state + error, strict=True)
    ]  # fmt: skip
    links = [(name, program.name) for program in programs for name in program.hears]
    links += [(SENSOR, program.name) for program in programs]
    network = MemoryNetwork(links, delay=delay, calm=[SENSOR])
    live = run_virtual(settings, Simulated(observer, scenario, state), TIMES, network)
    np.testing.assert_array_equal(live.estimate, tp.simulate(problem, observer, scenario).estimate)


@given(NAMES)
def test_any_name_is_one_part_of_a_key(name) -> None:
    part = topics.written(name)
    assert topics.name_of(part) == name
    assert part
    assert not set(part) & set("/*?#$ ")


def test_odd_names_run_as_others_do() -> None:
    names = ("a/b", "**", "é %41", "x y")
    one = case(STATIC, tp.MeasurementGraph(4, [0, 1, 2, -1], [1, 2, 3, 0], names=names))
    assert one.names == names
    run = run_virtual(one.settings(), one.plant(), np.array([5.0]), one.network())
    assert (run.status == "anchored").all()
    assert set(topics.everything("n/t").split("/")) == {"trigpoint", "n%2Ft", "**"}
    assert topics.truth_key("net", "a/b") == "trigpoint/net/truth/a%2Fb"
