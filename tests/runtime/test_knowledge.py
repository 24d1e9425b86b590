"""Self-knowledge: bounds that hold whatever happens, on drawn networks with drawn trouble."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from tests.runtime.given import PERIOD, STATIC, case
from trigpoint.runtime import Down, Knowledge, Mute, NodeMachine, Trouble, run_virtual
from trigpoint.runtime.knowledge import Hearsay, Pull, averaged, learn
from trigpoint.testing.strategies import measurement_graphs

SEEDS = st.integers(0, 2**31)


@settings(max_examples=60)
@given(
    st.floats(0.0, 5.0),
    st.lists(st.tuples(st.floats(0.0, 50.0), st.floats(0.0, 9.0)), max_size=5),
    st.floats(1e-3, 2.0),
)
def test_the_uncertainty_stays_between_its_own_and_its_neighbours(own, pulls, duration) -> None:
    found = averaged(own, [Pull(*pull) for pull in pulls], duration)
    around = [own, *(level for rate, level in pulls if rate > 0.0)]
    assert min(around) * (1.0 - 1e-12) <= found <= max(around) * (1.0 + 1e-12)


def test_a_pull_the_wrong_way_counts_as_none() -> None:
    assert averaged(2.0, [Pull(-1.0, 0.0)], 1.0) == 2.0


@settings(max_examples=60)
@given(st.lists(st.tuples(st.floats(-1, 9), st.floats(0, 20), st.floats(0, 20)), max_size=5), st.floats(0, 20))
def test_no_word_makes_evidence_younger_than_what_was_said(told, own) -> None:
    before = Knowledge(2.0, 3.0, 1.0)
    known = learn(before, 10.0, 1.0, own=own, missing=False, told=[Hearsay(*one) for one in told])
    assert known.evidence == min(10.0, max([3.0, own, *(evidence for _, evidence, _ in told)]))
    assert known.evidence <= 10.0
    assert known.broken == min(10.0, max([1.0, *(broken for _, _, broken in told)]))
    assert (known.hops >= 0.0) <= known.anchored(10.0, 1.0)


def test_hops_are_one_more_than_the_nearest_neighbour_s() -> None:
    told = [Hearsay(4.0, 9.9, 0.0), Hearsay(2.0, 9.5, 0.0), Hearsay(0.0, 1.0, 0.0), Hearsay(-1.0, 9.9, 0.0)]
    known = learn(Knowledge(), 10.0, 1.0, own=0.0, missing=True, told=told)
    assert known.hops == 3.0
    assert known.broken == 10.0
    assert learn(known, 10.0, 1.0, own=9.9, missing=False, told=told).hops == 0.0
    alone = learn(known, 10.5, 1.0, own=0.0, missing=True, told=[])
    assert (alone.hops, alone.anchored(10.5, 1.0)) == (3.0, True)
    assert learn(alone, 11.0, 1.0, own=0.0, missing=True, told=[]).hops == -1.0


def drawn_trouble(names, anchors, rng, until: float) -> Trouble:
    """Some processes come and go, some anchors fall silent."""
    downs, mutes = [], []
    for name in names:
        if rng.random() < 0.4:
            start = rng.uniform(0.0, until)
            downs.append(Down(name, start, start + rng.uniform(0.1, until), orderly=bool(rng.random() < 0.5)))
    for label in anchors:
        if rng.random() < 0.7:
            start = rng.uniform(0.0, until)
            mutes.append(Mute(label, start, start + rng.uniform(0.5, until)))
    return Trouble(downs, mutes)


def believed(graph, seed: int, until: float) -> None:
    """Whatever happens: no claim outlives the last anchor reading by the bound, and no error exceeds its figure."""
    rng = np.random.default_rng(seed)
    one = case(STATIC, graph, tp.methods.Fixed(float(rng.uniform(0.3, 5.0))), seed=seed)
    anchors = {arc.label: program.name for program in one.programs for arc in program.arcs if not arc.heard}
    trouble = drawn_trouble(one.names, anchors, rng, until)
    network = one.network(loss=0.3, delay=0.01, jitter=0.05, seed=seed)
    deviation = 0.2
    plant = one.plant()
    exact = plant.readings
    errors = {label: rng.normal(size=2) for label in exact()}  # of constant direction and of the full size: the worst
    errors = {label: deviation * np.sqrt(2.0) * error / np.linalg.norm(error) for label, error in errors.items()}
    plant.readings = lambda: {label: value + errors[label] for label, value in exact().items()}  # type: ignore[method-assign]
    biggest = float(np.linalg.norm(one.error, axis=1).max()) / np.sqrt(2.0)
    given_settings = one.settings(start_uncertainty=biggest, deviations=dict.fromkeys(errors, deviation))
    timeout, last = given_settings[0].anchor_timeout, -np.inf
    checked = 0

    def watch(now: float, machines) -> None:
        nonlocal last, checked
        silent = {mute.label for mute in trouble.mutes if mute.start <= now < mute.stop}
        if any(name in machines and label not in silent for label, name in anchors.items()):
            last = now
        for k, name in enumerate(one.names):
            machine: NodeMachine | None = machines.get(name)
            if machine is None:
                continue
            error = float(np.linalg.norm(machine.state.estimate - one.truth[k])) / np.sqrt(2.0)
            assert error <= machine.knowledge.uncertainty * (1.0 + 1e-9) + 1e-12
            assert now <= last + timeout + PERIOD or not machine.anchored
            checked += 1

    run_virtual(given_settings, plant, PERIOD * np.arange(1, round(until / PERIOD)), network, trouble, watch)
    assert checked


@settings(max_examples=4)
@given(measurement_graphs(max_nodes=6, max_extra_arcs=3, externally_connected=True), SEEDS)
def test_claims_and_figures_hold_on_drawn_networks_in_drawn_trouble(graph, seed) -> None:
    believed(graph, seed, 3.0)


@pytest.mark.slow
@settings(max_examples=60)
@given(measurement_graphs(max_nodes=9, max_extra_arcs=6, externally_connected=True), SEEDS)
def test_claims_and_figures_hold_on_many_drawn_networks(graph, seed) -> None:
    believed(graph, seed, 8.0)
