"""The claim about the decay of the error: the certified rate is never above the true one, and close to the design's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings

import trigpoint as tp
from tests.certificates.oracle import AGENTS, decay, drawn_graph, drawn_observer, holds, record_of
from trigpoint.certificates import Convergence
from trigpoint.errors import ProtocolError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.observers.documents import observer_document, read_observer
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.testing.strategies import measurement_graphs

CLAIM = Convergence()


def judged(observer: DiffusiveObserver, record) -> str:
    return CLAIM.verify(record, observer.problem, observer)


def double_integrators(margin: float = 1.05) -> DiffusiveObserver:
    graph = tp.graphs.grid(2, 2, anchors=(3,))
    problem = tp.NetworkedAgents(graph, AGENTS["double integrator"])
    return tp.design(problem, tp.methods.LocalKalman(gain=tp.FromGraph(margin)))


@pytest.mark.parametrize("agent", AGENTS)
def test_a_certified_rate_is_a_true_one(agent: str) -> None:
    rng = np.random.default_rng(sorted(AGENTS).index(agent))
    certified = 0
    for _ in range(25):
        observer = drawn_observer(rng, AGENTS[agent], 1.0)
        record = record_of(CLAIM, observer)
        assert record.verdict in ("certified", "inconclusive")
        if record.verdict == "certified":
            certified += 1
            assert holds(record, observer), record
            assert judged(observer, record) == "certified"
    assert certified >= 6


@pytest.mark.slow
@pytest.mark.parametrize("agent", AGENTS)
def test_many_certified_rates_are_true_ones(agent: str) -> None:
    rng = np.random.default_rng(100 + sorted(AGENTS).index(agent))
    for _ in range(500):
        observer = drawn_observer(rng, AGENTS[agent], 3.0)
        record = record_of(CLAIM, observer)
        assert record.verdict != "certified" or holds(record, observer), record


@pytest.mark.parametrize("agent", AGENTS)
@pytest.mark.parametrize("margin", [1.001, 1.05, 20.0])
def test_the_guaranteed_rate_of_a_design_is_certified(agent: str, margin: float) -> None:
    graph = drawn_graph(np.random.default_rng(3), 6, 1.0)
    problem = tp.NetworkedAgents(graph, AGENTS[agent])
    observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.FromGraph(margin)))
    record = record_of(CLAIM, observer)
    assert record.verdict == "certified"
    assert (1.0 - 1.001e-3) * observer.decay_rate <= record.numbers["rate"] <= observer.decay_rate


def test_any_witness_and_rate_that_pass_are_true() -> None:
    """P from Lyapunov equations of other gains, rates on both sides of the truth."""
    rng = np.random.default_rng(17)
    agents = list(AGENTS.values())
    certified = 0
    for _ in range(90):
        observer = drawn_observer(rng, agents[int(rng.integers(0, len(agents)))])
        record = record_of(CLAIM, observer)
        n, true = observer.agent.n_states, float(decay(observer))
        pull = observer.gain * observer.injection @ observer.agent.C
        closed = observer.agent.A - pull * rng.uniform(0.2, 4.0)
        shift = min(0.0, -float(np.linalg.eigvals(closed).real.max()) - 1e-3)
        P = la.solve_continuous_lyapunov((closed + shift * np.eye(n)).T, -np.eye(n))
        P = 0.5 * (P + P.T)
        for rate in (0.5 * true, true * (1.0 + 1e-15), true * (1.0 - 10.0 ** rng.uniform(-14, -1)), 2.0 * abs(true)):
            for matrix in (P, record.witness["P"], np.eye(n)):
                forged = replace(
                    record,
                    numbers={"rate": rate, "lambda_floor": record.numbers["lambda_floor"]},
                    witness={**record.witness, "P": matrix},
                )
                if judged(observer, forged) == "certified":
                    certified += 1
                    assert holds(forged, observer)
    assert certified > 20


def test_a_rate_above_what_one_matrix_for_all_modes_allows_is_decided_on_the_whole() -> None:
    """Up to the true rate it is certified, beyond it refuted; the design guarantees less than the truth."""
    observer = double_integrators()
    true, few = float(decay(observer)), record_of(CLAIM, observer)
    assert few.verdict == "certified"
    assert "whole" not in few.witness
    assert observer.decay_rate < 0.99 * true
    for rate, verdict in (
        (0.999 * observer.decay_rate, "certified"),
        (1.001 * observer.decay_rate, "certified"),
        (true * (1.0 - 1e-7), "certified"),
        (true * (1.0 + 1e-7), "refuted"),
        (2.0 * true, "refuted"),
    ):
        record = record_of(Convergence(rate=rate), observer)
        assert (record.verdict, record.numbers["rate"]) == (verdict, rate)
        assert judged(observer, record) == verdict
        apart = "edges" in record.witness or "whole" in record.witness
        assert verdict == "refuted" or apart == (rate > observer.decay_rate)


def test_where_the_fastest_mode_is_the_slow_one_the_whole_network_refutes() -> None:
    """At a high gain the mode of the largest eigenvalue is overdamped; no vector for lambda_min shows that."""
    observer = double_integrators(40.0)
    true = float(decay(observer))
    record = record_of(Convergence(rate=true * (1.0 + 1e-7)), observer)
    assert record.verdict == judged(observer, record) == "refuted"
    assert record.witness["P"].shape == (8, 8)
    assert record_of(Convergence(rate=true * (1.0 - 1e-7)), observer).verdict == "certified"
    beyond = replace(record, numbers={**record.numbers, "rate": 0.9 * true})
    assert judged(observer, beyond) == "inconclusive"
    for name in ("P", "growing"):
        spoilt = replace(record, witness={**record.witness, name: 0.0 * record.witness[name]})
        assert judged(observer, spoilt) == "inconclusive"


@pytest.mark.parametrize("agent", ["double integrator", "driven oscillator", "two outputs"])
def test_a_rate_above_the_guaranteed_one_is_proved_mode_by_mode_whatever_the_number_of_nodes(agent: str) -> None:
    problem = tp.NetworkedAgents(tp.graphs.grid(40, 40, anchors=(0,)), AGENTS[agent])
    observer = tp.design(problem, tp.methods.LocalKalman())
    assert observer.spectral_abscissa is not None
    true = -observer.spectral_abscissa
    assert 0.999 * true > 1.02 * observer.decay_rate
    record = record_of(Convergence(rate=0.999 * true), observer)
    assert record.verdict == "certified"
    assert "edges" in record.witness
    assert judged(observer, record) == "certified"
    assert record_of(Convergence(rate=1.001 * true), observer).verdict != "certified"
    edges, P = record.witness["edges"], record.witness["P"]
    for numbers, arrays in (
        ({"rate": 1.001 * true}, {}),
        ({"lambda_floor": 1.1 * record.numbers["lambda_floor"]}, {}),
        ({}, {"P": -P}),
        ({}, {"P": np.broadcast_to(np.eye(2), P.shape)}),
        ({}, {"edges": edges + 0.1 * edges[0]}),
        ({}, {"edges": 0.9 * edges}),
        ({}, {"edges": edges[::-1]}),
    ):
        forged = replace(record, numbers={**record.numbers, **numbers}, witness={**record.witness, **arrays})
        assert judged(observer, forged) == "inconclusive"
    with pytest.raises(ProtocolError, match="'edges' must hold 2 to 1000 numbers"):
        judged(observer, replace(record, witness={**record.witness, "edges": edges[:1]}))


def test_a_matrix_for_the_whole_has_the_size_of_the_whole() -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(200), AGENTS["double integrator"])
    observer = tp.design(problem, tp.methods.LocalKalman())
    whole = {"P": np.eye(1000), "whole": np.ones(1)}
    forged = replace(record_of(CLAIM, observer), numbers={"rate": 0.1, "lambda_floor": 0.0}, witness=whole)
    with pytest.raises(ProtocolError, match="'P' must be floats of shape"):
        judged(observer, forged)


@pytest.mark.parametrize("rate", [0.0, -1.0])
def test_a_rate_that_is_no_decay_is_inconclusive(rate: float) -> None:
    assert record_of(Convergence(rate=rate), double_integrators()).verdict == "inconclusive"


def test_a_gain_below_the_bound_is_never_certified_for_unstable_agents() -> None:
    graph = tp.graphs.chain(4)
    for factor in (0.01, 0.1, 0.2):
        gain = tp.Fixed(factor / tp.smallest_eigenvalue(graph).value)
        problem = tp.NetworkedAgents(graph, AGENTS["unstable"])
        observer = tp.design(problem, tp.methods.LocalKalman(gain=gain))
        record = record_of(CLAIM, observer)
        proved = "certified" if observer.decay_rate > 0 else "inconclusive"
        assert record.verdict == (proved if decay(observer) > 0 else "refuted")
        if decay(observer) < 0:
            forged = replace(record, verdict="certified", numbers={**record.numbers, "rate": 1e-9})
            assert judged(observer, forged) == "refuted"


def test_an_unanchored_network_proves_no_decay() -> None:
    graph = MeasurementGraph(4, [EXTERNAL, 0, 2], [0, 1, 3])
    problem = tp.NetworkedAgents(graph, AGENTS["double integrator"])
    observer = DiffusiveObserver("given", problem, np.ones((2, 1)), 5.0, 1.0, None)
    record = record_of(CLAIM, observer)
    assert record.verdict == "inconclusive"
    forged = replace(record, verdict="certified", numbers={"rate": 1e-3, "lambda_floor": 0.1})
    assert judged(observer, forged) == "inconclusive"


@given(measurement_graphs(max_nodes=3, max_extra_arcs=3, blocks=2, decades=1, externally_connected=True))
@settings(max_examples=30)
def test_networks_with_weight_blocks_are_proved_as_a_whole(graph: MeasurementGraph) -> None:
    agent = tp.LinearAgent([[0.0, 0.2], [0.0, -0.1]], np.eye(2))
    observer = tp.design(tp.NetworkedAgents(graph, agent), tp.methods.LocalKalman(gain=tp.FromGraph(2.0)))
    record = record_of(CLAIM, observer)
    assert record.verdict == "certified"
    assert holds(record, observer)
    forged = replace(record, numbers={**record.numbers, "rate": float(decay(observer)) * 1.01})
    assert judged(observer, forged) == "inconclusive"


def test_a_false_floor_is_not_believed() -> None:
    observer = double_integrators()
    record = record_of(CLAIM, observer)
    for floor in (record.numbers["lambda_floor"] * 1.0001, 1e9, 0.0, -1.0, np.nan, np.inf):
        forged = replace(record, numbers={**record.numbers, "lambda_floor": floor})
        assert judged(observer, forged) == "inconclusive", floor


def test_a_matrix_that_is_no_lyapunov_matrix_proves_nothing() -> None:
    observer = double_integrators()
    record = record_of(CLAIM, observer)
    P = record.witness["P"]
    skew = np.array([[0.0, 1.0], [-1.0, 0.0]])
    for matrix in (-P, 0.0 * P, P + skew, np.eye(2), np.full((2, 2), np.nan), P * 1e-310, np.full((2, 2), 1e308)):
        forged = replace(record, witness={**record.witness, "P": matrix})
        assert judged(observer, forged) == "inconclusive", matrix


@pytest.mark.parametrize("name", ["P", "x"])
def test_a_missing_misshapen_or_whole_number_witness_is_a_protocol_error(name: str) -> None:
    observer = double_integrators()
    record = record_of(CLAIM, observer)
    without = {key: value for key, value in record.witness.items() if key != name}
    whole = np.ones(record.witness[name].shape, dtype=np.int64)
    for witness in (without, {**without, name: np.ones(5)}, {**without, name: whole}):
        with pytest.raises(ProtocolError, match=name):
            judged(observer, replace(record, witness={**witness}))


@pytest.mark.parametrize("name", ["rate", "lambda_floor"])
def test_a_missing_number_is_a_protocol_error(name: str) -> None:
    observer = double_integrators()
    record = record_of(CLAIM, observer)
    numbers = {key: value for key, value in record.numbers.items() if key != name}
    with pytest.raises(ProtocolError, match=name):
        judged(observer, replace(record, numbers=numbers))


def test_an_observer_read_from_its_document_is_certified_like_the_designed_one() -> None:
    observer = double_integrators()
    again = read_observer(observer_document(observer))
    assert record_of(CLAIM, again).verdict == "certified"
    assert record_of(CLAIM, again).numbers == record_of(CLAIM, observer).numbers


@pytest.mark.parametrize("Q", [-np.eye(2), np.zeros((2, 2)), np.eye(3), "text", None, np.full((2, 2), np.nan)])
def test_a_nonsensical_fact_of_the_design_is_survived(Q: object) -> None:
    observer = double_integrators()
    forged = replace(observer, facts={"Q": Q})
    assert record_of(CLAIM, forged).verdict == "inconclusive"
