"""IntegratorObserver, optimal weights, Weighted: published rates, optimality proved by duality, best unbiasedness."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.errors import ArgumentError, MethodError, MissingExtraError
from trigpoint.methods import Fixed, IntegratorObserver, Weighted, optimal_weights
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing import check_design
from trigpoint.testing.strategies import measurement_graphs

STATIC, DOUBLE = tp.LinearAgent.static(), tp.LinearAgent([[0, 1], [0, 0]], [[1, 0]])


def network(graph, agent=STATIC):
    return tp.NetworkedAgents(graph, agent)


# -- IntegratorObserver (R23, Section VII) -----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("n", "weight", "rate", "half_unit"),
    [(5, 1.0, 0.3765, 5e-5), (5, 100.0, 13.92, 5e-3), (10, 1.0, 0.0971, 5e-5), (10, 100.0, 5.219, 5e-4)],
)
def test_tracking_rates_on_a_ring(n, weight, rate, half_unit) -> None:  # theory 3.5
    observer = tp.design(network(tp.graphs.cycle(n, anchors=(0,))), IntegratorObserver(weight, 100.0))
    assert observer.decay_rate == pytest.approx(rate, abs=half_unit)
    assert observer.decay_rate <= observer.facts["rate_ceiling"] == 100.0 / n


def test_the_image_experiments_rate() -> None:  # theory 3.4
    problem = network(tp.graphs.grid(70, 128, anchors=(8959,)))
    observer = tp.design(problem, IntegratorObserver(1000.0, 1000.0))
    assert observer.decay_rate == pytest.approx(0.029197394550, rel=1e-9)
    assert observer.facts["rate_ceiling"] == pytest.approx(0.1116, abs=5e-5)


@given(measurement_graphs(max_nodes=6, externally_connected=True), st.integers(0, 99), st.integers(1, 2))
@settings(max_examples=25, deadline=None)
def test_drawn_networks(graph, seed, dimension) -> None:
    rng = np.random.default_rng(seed)
    inner = int((~graph.is_external).sum())
    weights = rng.uniform(0.5, 2.0, inner) if inner else None
    method = IntegratorObserver(weights, rng.uniform(0.5, 2.0, graph.n_arcs - inner))
    observer = check_design(method, network(graph, tp.LinearAgent.static(dimension)))
    exact = np.linalg.eigvalsh(observer.graph.laplacian().toarray())[0]
    assert observer.decay_rate == pytest.approx(exact, rel=1e-8)


def test_known_inputs_are_carried_through() -> None:
    agent = tp.LinearAgent([[0.0]], [[1.0]], B=[[1.0]])
    problem = network(tp.graphs.cycle(5, anchors=(0, 2)), agent)
    observer = tp.design(problem, IntegratorObserver(anchor_gain=10.0))
    run = simulate(problem, observer, Scenario([0.0, 60.0], 1.0, inputs=np.arange(5.0)[:, None]))
    assert np.ptp(run.truth[1]) > 100.0
    assert run.error_norm[1] < 1e-6


@pytest.mark.parametrize(
    ("graph", "before", "after"),
    [
        (tp.graphs.chain(8), 0.0341, 0.0392),
        (tp.graphs.grid(5, 6, anchors=(0,)), 0.0171, 0.0474),
        (tp.graphs.grid(5, 6, anchors=(14,)), 0.0250, 0.1099),
    ],
)
def test_optimal_weights(graph, before, after) -> None:  # theory 7-H2
    assert tp.smallest_eigenvalue(graph).value == pytest.approx(before, abs=5e-5)
    found = optimal_weights(graph)
    assert found.value == pytest.approx(after, abs=5e-5)
    assert found.weights.sum() == pytest.approx(graph.n_arcs, rel=1e-12)
    assert 0.0 <= found.gap < 1e-5, "weak duality proves the optimum"
    assert found.ceiling >= found.value


@given(measurement_graphs(min_nodes=2, max_nodes=6, externally_connected=True), st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_no_drawn_weights_exceed_the_ceiling(graph, seed) -> None:
    found = optimal_weights(graph)
    assert found.value >= tp.smallest_eigenvalue(graph).lower * (1.0 - 1e-5)
    for weights in np.random.default_rng(seed).dirichlet(np.ones(graph.n_arcs), 20) * graph.n_arcs:
        other = graph.with_weight(np.maximum(weights, 1e-12))
        assert np.linalg.eigvalsh(other.laplacian().toarray())[0] <= found.ceiling * (1.0 + 1e-9)


def test_the_design_with_optimal_weights_keeps_the_anchor_gains() -> None:
    graph = tp.graphs.grid(3, 4, anchors=(0, 11))
    plain = tp.design(network(graph), IntegratorObserver(anchor_gain=2.0))
    best = tp.design(network(graph), IntegratorObserver("optimal", 2.0))
    assert best.decay_rate > plain.decay_rate
    assert np.array_equal(best.graph.arc_weights[graph.is_external], [2.0, 2.0])
    inner = ~graph.is_external
    assert best.graph.arc_weights[inner].sum() == pytest.approx(inner.sum(), rel=1e-12)


def test_without_the_solver_the_extra_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(MissingExtraError, match=r"trigpoint\[lmi\]"):
        optimal_weights(tp.graphs.chain(3))


# -- Weighted (theory 7-H3) --------------------------------------------------------------------------------------------
def test_the_fixed_point_is_the_weighted_least_squares_answer() -> None:
    graph = tp.graphs.grid(3, 3, anchors=(0, 8))
    rng = np.random.default_rng(0)
    variances, readings = rng.uniform(0.1, 4.0, graph.n_arcs), rng.normal(size=graph.n_arcs)
    observer = tp.design(network(graph), Weighted(variances))
    run = simulate(network(graph), tp.design(network(graph), Weighted(np.ones(graph.n_arcs))), Scenario([0.0]))
    assert run.truth.shape == (1, 9, 1)
    run = simulate(observer.problem, observer, Scenario([0.0, 200.0], 0.0, measurements=readings))
    answer = tp.estimate(tp.Network(graph, readings, variances))
    assert np.abs(run.estimate[-1, :, 0] - answer.x.ravel()).max() < 1e-8


@given(measurement_graphs(min_nodes=2, max_nodes=6, externally_connected=True), st.integers(0, 999))
@settings(max_examples=40, deadline=None)
def test_no_other_weights_have_a_smaller_covariance(graph, seed) -> None:
    rng = np.random.default_rng(seed)
    variances = rng.uniform(0.1, 5.0, graph.n_arcs)
    G = graph.incidence().toarray()

    def covariance(weights):
        gain = np.linalg.solve((G * weights) @ G.T, G * weights)
        return (gain * variances) @ gain.T

    best, other = covariance(1.0 / variances), covariance(rng.uniform(0.1, 5.0, graph.n_arcs))
    assert np.abs(best - np.linalg.inv((G / variances) @ G.T)).max() < 1e-9 * np.abs(best).max()
    assert np.linalg.eigvalsh(other - best)[0] > -1e-9 * np.trace(other)
    weights = tp.design(network(graph), Weighted(variances)).graph.arc_weights
    assert np.allclose(weights, 1.0 / variances, rtol=1e-14)


def test_vector_agents_with_matrix_weights() -> None:
    graph = tp.graphs.cycle(4, anchors=(0,))
    blocks = np.stack([np.array([[2.0, 0.3 * k], [0.3 * k, 1.0]]) for k in range(graph.n_arcs)])
    for agent in (tp.LinearAgent.static(2), tp.LinearAgent(np.kron(np.eye(2), DOUBLE.A), np.kron(np.eye(2), DOUBLE.C))):
        observer = check_design(Weighted(blocks), network(graph, agent))
        assert np.allclose(observer.graph.arc_weights[3] @ blocks[3], np.eye(2), atol=1e-12)


# -- refusals ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: IntegratorObserver("best"), "weights must be numbers or 'optimal'"),
        (lambda: IntegratorObserver(-1.0), "weights must be a positive number, or one an arc"),
        (lambda: IntegratorObserver(anchor_gain=[[1.0]]), "anchor_gain must be a positive number"),
        (lambda: Weighted(np.ones((2, 3, 2))), r"covariance must be \(M,\) variances"),
        (lambda: Weighted([1.0, 0.0]), "symmetric positive definite"),
        (lambda: Weighted(np.array([[[1.0, 0.5], [0.0, 1.0]]])), "symmetric positive definite"),
        (lambda: optimal_weights(tp.graphs.chain(151)), "up to 150 nodes"),
        (lambda: optimal_weights(tp.graphs.chain(3), total=-1.0), "total must be a positive number"),
    ],
)
def test_nonsense_is_refused(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


BLOCKS = tp.graphs.chain(3).with_weight(np.stack([np.eye(2)] * 3))


@pytest.mark.parametrize(
    ("method", "problem", "words"),
    [
        (IntegratorObserver(), tp.graphs.chain(3), "a NetworkedAgents problem"),
        (IntegratorObserver(), network(tp.graphs.chain(3), DOUBLE), "single integrators: A = 0 and C = I"),
        (IntegratorObserver(), network(tp.graphs.cycle(3)), "a path from every node to an anchor"),
        (IntegratorObserver([1.0, 2.0, 3.0]), network(tp.graphs.chain(3)), "weights with 2 numbers"),
        (IntegratorObserver(), network(BLOCKS, tp.LinearAgent.static(2)), "scalar arc weights"),
        (Weighted([1.0]), tp.graphs.chain(3), "a NetworkedAgents problem"),
        (Weighted([1.0]), network(tp.graphs.chain(3)), "one covariance an arc"),
        (Weighted(np.ones(3), Fixed(1.0)), network(tp.graphs.chain(3), tp.LinearAgent([[1.0]], [[0.0]])), "detectable"),
    ],
)
def test_what_does_not_fit_is_refused(method, problem, words) -> None:
    with pytest.raises(MethodError, match=words):
        tp.design(problem, method)
