"""The claim about the smallest eigenvalue: never wrong, seldom loose, refuted without an anchor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import trigpoint as tp
from tests.certificates.oracle import AGENTS, SLACK, drawn_graph, eigenvalues, holds, record_of
from trigpoint.certificates import SmallestEigenvalue
from trigpoint.errors import ProtocolError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.testing.strategies import measurement_graphs

CLAIM = SmallestEigenvalue()


def observer_on(graph: MeasurementGraph, gain: float = 1.0) -> DiffusiveObserver:
    problem = tp.NetworkedAgents(graph, tp.LinearAgent.static(graph.dimension))
    return DiffusiveObserver("given", problem, np.eye(graph.dimension), gain, 0.0, None)


def assert_sound_and_tight(graph: MeasurementGraph, width: float) -> None:
    observer = observer_on(graph)
    record = record_of(CLAIM, observer)
    assert record.verdict == "certified", record
    assert holds(record, observer)
    truth = float(eigenvalues(graph)[0])
    assert record.numbers["upper"] - record.numbers["lower"] <= width * truth


def draws(count: int, seed: int, decades: float) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(count):
        assert_sound_and_tight(drawn_graph(rng, int(rng.integers(1, 7)), decades), 1e-6)


def test_drawn_unit_weight_networks_are_certified_and_enclose_the_truth() -> None:
    draws(350, seed=1, decades=0.0)


def test_drawn_weights_over_eight_decades_are_certified_and_enclose_the_truth() -> None:
    draws(350, seed=2, decades=4.0)


@pytest.mark.slow
@pytest.mark.parametrize("decades", [0.0, 2.0])
def test_many_drawn_networks_enclose_the_truth(decades: float) -> None:
    draws(4000, seed=3, decades=decades)


@pytest.mark.slow
def test_weights_over_twelve_decades_may_loosen_the_bounds_but_never_falsify_them() -> None:
    rng = np.random.default_rng(3)
    verdicts = []
    for _ in range(1500):
        observer = observer_on(drawn_graph(rng, int(rng.integers(1, 7)), 6.0))
        record = record_of(CLAIM, observer)
        verdicts.append(record.verdict)
        assert holds(record, observer), record
    assert verdicts.count("certified") >= 1400
    assert "refuted" not in verdicts


@given(measurement_graphs(max_nodes=5, weighted=True, decades=20, externally_connected=True))
@settings(max_examples=100)
def test_absurd_weights_give_no_wrong_bound(graph: MeasurementGraph) -> None:
    observer = observer_on(graph)
    record = record_of(CLAIM, observer)
    assert record.verdict in ("certified", "inconclusive")
    truth = eigenvalues(graph)
    assert record.numbers["lower"] <= truth[0] + SLACK * truth[-1]
    assert truth[0] - SLACK * truth[-1] <= record.numbers["upper"]


@given(measurement_graphs(max_nodes=3, max_extra_arcs=3, blocks=2, decades=2, externally_connected=True))
@settings(max_examples=60)
def test_weight_blocks_are_certified_and_enclose_the_truth(graph: MeasurementGraph) -> None:
    observer = observer_on(graph)
    record = record_of(CLAIM, observer)
    assert record.verdict == "certified"
    assert holds(record, observer)
    assert CLAIM.verify(record, observer.problem, observer) == "certified"


@given(measurement_graphs(max_nodes=6, externally_connected=False))
@settings(max_examples=100)
def test_a_node_without_a_path_to_an_anchor_refutes(graph: MeasurementGraph) -> None:
    observer = observer_on(graph)
    record = record_of(CLAIM, observer)
    assert record.verdict == "refuted"
    assert record.numbers == {"lower": 0.0, "upper": 0.0}
    forged = replace(record, verdict="certified", numbers={"lower": 0.1, "upper": 9.0})
    assert CLAIM.verify(forged, observer.problem, observer) == "refuted"


@pytest.mark.parametrize("n", [1, 2, 3, 8, 40])
def test_an_anchor_on_the_last_node_only_is_seen(n: int) -> None:
    graph = tp.graphs.chain(n, anchors=(n - 1,))
    record = record_of(CLAIM, observer_on(graph))
    truth = 2.0 - 2.0 * np.cos(np.pi / (2 * n + 1))
    assert record.verdict == "certified"
    assert record.numbers["lower"] == pytest.approx(truth, rel=1e-8)


def test_the_text_of_a_refusal_names_the_nodes() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, 1], [0, 2], names=["dock", "buoy", "raft"])
    text = record_of(CLAIM, observer_on(graph)).text
    assert "buoy" in text
    assert "raft" in text
    assert "dock" not in text


def test_numbers_beyond_what_the_witness_proves_are_not_certified() -> None:
    observer = observer_on(drawn_graph(np.random.default_rng(5), 5))
    record = record_of(CLAIM, observer)
    lower, upper = record.numbers["lower"], record.numbers["upper"]
    for numbers, verdict in (
        ({"lower": upper * 1.001, "upper": upper}, "refuted"),
        ({"lower": lower, "upper": lower * 0.999}, "refuted"),
        ({"lower": upper * 2, "upper": upper * 3}, "refuted"),
        ({"lower": np.inf, "upper": np.inf}, "refuted"),
        ({"lower": 0.5 * (lower + upper), "upper": upper}, "inconclusive"),
        ({"lower": 0.0, "upper": upper}, "inconclusive"),
        ({"lower": -1.0, "upper": upper}, "inconclusive"),
        ({"lower": np.nan, "upper": upper}, "inconclusive"),
        ({"lower": lower, "upper": np.nan}, "inconclusive"),
    ):
        forged = replace(record, numbers=numbers)
        assert CLAIM.verify(forged, observer.problem, observer) == verdict, numbers


def test_a_witness_that_is_not_positive_proves_nothing() -> None:
    observer = observer_on(tp.graphs.chain(3))
    record = record_of(CLAIM, observer)
    for x in ([1.0, 1.0, -1.0], [0.0, 0.0, 0.0], [np.nan, 1.0, 1.0], [np.inf, 1.0, 1.0], [1e-320, 1e-320, 1e-320]):
        forged = replace(record, witness={**record.witness, "x": np.array(x)})
        assert CLAIM.verify(forged, observer.problem, observer) == "inconclusive", x
    for v in ([0.0, 0.0, 0.0], [np.nan, 1.0, 1.0], [np.inf, 1.0, 1.0]):
        forged = replace(record, witness={**record.witness, "v": np.array(v)})
        assert CLAIM.verify(forged, observer.problem, observer) == "inconclusive", v


@pytest.mark.parametrize("name", ["x", "v"])
def test_a_missing_or_misshapen_witness_is_a_protocol_error(name: str) -> None:
    observer = observer_on(tp.graphs.chain(3))
    record = record_of(CLAIM, observer)
    without = {key: value for key, value in record.witness.items() if key != name}
    for witness in (without, {**without, name: np.ones(2)}, {**without, name: np.ones((3, 1))}):
        with pytest.raises(ProtocolError, match=name):
            CLAIM.verify(replace(record, witness=witness), observer.problem, observer)


def test_witnesses_drawn_at_random_never_prove_a_falsehood() -> None:
    rng = np.random.default_rng(11)
    certified = 0
    for _ in range(300):
        observer = observer_on(drawn_graph(rng, int(rng.integers(1, 6)), 2.0))
        record = record_of(CLAIM, observer)
        truth = float(eigenvalues(observer.graph)[0])
        x = record.witness["x"] * np.exp(rng.normal(scale=10.0 ** rng.uniform(-16, 0), size=observer.graph.n_nodes))
        v = record.witness["v"] + rng.normal(scale=10.0 ** rng.uniform(-16, 0), size=observer.graph.n_nodes)
        low, high = truth * (1 + rng.normal(size=2) * 10.0 ** rng.uniform(-17, -1, size=2))
        forged = replace(record, numbers={"lower": low, "upper": high}, witness={"x": x, "v": v})
        if CLAIM.verify(forged, observer.problem, observer) == "certified":
            certified += 1
            assert holds(forged, observer)
    assert certified > 10


def test_the_bounds_do_not_depend_on_the_agent() -> None:
    graph = drawn_graph(np.random.default_rng(6), 5)
    found = {
        tuple(record_of(CLAIM, tp.design(tp.NetworkedAgents(graph, agent), tp.methods.LocalKalman())).numbers.items())
        for agent in AGENTS.values()
    }
    assert len(found) == 1
