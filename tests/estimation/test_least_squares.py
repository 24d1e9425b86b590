"""``estimate`` against a dense pseudo-inverse, and the properties that define the best linear unbiased estimate."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.estimation import estimate
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, complete, cycle, grid
from trigpoint.model import Network

from .drawn import dense_covariance, measured, oracle


@settings(max_examples=50)
@given(measured())
def test_every_network_agrees_with_the_pseudo_inverse(network) -> None:
    """Correlated, vector-valued, exact readings, several components, unanchored ones relative to their first node."""
    found, truth = estimate(network, a_priori=True), oracle(network)
    size = max(np.abs(truth.x).max(initial=0.0), 1.0)
    assert found.x.shape == found.sigma.shape
    np.testing.assert_allclose(found.x.ravel(), truth.x, atol=1e-9 * size)
    np.testing.assert_allclose(found.sigma.ravel(), np.sqrt(np.maximum(np.diag(truth.covariance), 0)), atol=1e-6)
    np.testing.assert_allclose(found.sigma.ravel() ** 2, np.diag(truth.covariance), atol=1e-9)
    np.testing.assert_allclose(found.residuals.ravel(), truth.residuals, atol=1e-9 * size)
    assert found.degrees_of_freedom == truth.freedom
    assert found.sigma_kind == "a-priori"
    if truth.freedom:
        assert found.variance_factor == pytest.approx(truth.square_sum / truth.freedom, rel=1e-9, abs=1e-18)
    else:
        assert found.variance_factor is None


@settings(max_examples=50)
@given(measured())
def test_residual_deviations_and_redundancy_agree_with_the_pseudo_inverse(network) -> None:
    found, truth = estimate(network, a_priori=True), oracle(network)
    spread = np.diag(truth.residual_covariance)
    prior = np.where(np.repeat(network.exact, network.dimension), 0.0, np.diag(dense_covariance(network)))
    expected = np.divide(spread, prior, out=np.zeros_like(prior), where=prior > 0)
    np.testing.assert_allclose(found.redundancy.ravel(), expected, atol=1e-9)
    checked = expected > 1e-4
    standardized = found.standardized.ravel()
    np.testing.assert_allclose(
        standardized[checked], (truth.residuals / np.sqrt(np.maximum(spread, 1e-300)))[checked], atol=1e-7
    )
    assert not standardized[expected < 1e-8].any(), "what nothing checks is not standardized"


@settings(max_examples=50)
@given(measured())
def test_the_gradient_vanishes_and_the_status_is_told(network) -> None:
    found = estimate(network)
    assert found.gradient <= 1e-13
    graph = network.graph
    for label, nodes in enumerate(graph.components):
        if graph.component_is_anchored[label]:
            assert (found.status[nodes] == "anchored").all()
            assert (found.reference[nodes] == -1).all()
        else:
            assert (found.status[nodes] == "relative").all()
            assert (found.reference[nodes] == nodes[0]).all()
            assert not found.x[nodes[0]].any()
            assert not found.sigma[nodes[0]].any()
    for k in np.flatnonzero(network.exact):
        node = graph.head[k]
        assert np.array_equal(found.x[node], network.values[k])
        assert not np.any(found.sigma[node])


@settings(max_examples=50)
@given(measured(kinds=("none", "variances")))
def test_redundancy_numbers_of_uncorrelated_readings_sum_to_the_degrees_of_freedom(network) -> None:
    found = estimate(network)
    assert ((found.redundancy >= 0) & (found.redundancy <= 1)).all()
    assert found.redundancy.sum() == pytest.approx(found.degrees_of_freedom, abs=1e-9)


@settings(max_examples=25)
@given(measured(kinds=("variances", "blocks", "joint"), connected=True, exact=False), st.integers(0, 999))
def test_no_linear_unbiased_estimate_has_smaller_variance(network, seed) -> None:
    """BLUE (theory 7-H3): against unweighted least squares and against other left inverses of D."""
    D = np.kron(network.graph.incidence().toarray().T, np.eye(network.dimension))
    R = dense_covariance(network)
    best = estimate(network, a_priori=True).sigma.ravel() ** 2
    plain = np.linalg.pinv(D)
    rng = np.random.default_rng(seed)
    other = plain + rng.normal(size=plain.shape) @ (np.eye(len(R)) - D @ plain)
    for inverse in (plain, other):
        np.testing.assert_allclose(inverse @ D, np.eye(D.shape[1]), atol=1e-9)
        variance = np.diag(inverse @ R @ inverse.T)
        assert (best <= variance * (1 + 1e-9)).all()
        assert best.sum() <= np.trace(inverse @ R @ inverse.T) * (1 + 1e-9)


def test_weighting_pays_where_the_readings_differ() -> None:
    graph = complete(6, anchors=(0, 5))
    variances = np.geomspace(10.0, 0.01, graph.n_arcs)
    best = estimate(graph, np.zeros(graph.n_arcs), variances, a_priori=True).sigma ** 2
    plain = np.linalg.pinv(graph.incidence().toarray().T)
    assert best.sum() < 0.7 * np.trace(plain @ np.diag(variances) @ plain.T)


# -- closed forms: the variance of a difference is an effective resistance -------------------------------------------
@pytest.mark.parametrize("n", [3, 7, 12])
def test_effective_resistance_of_a_ring(n) -> None:
    k = np.arange(n)
    sigma = estimate(cycle(n), np.zeros(n), a_priori=True).sigma
    np.testing.assert_allclose(sigma**2, k * (n - k) / n, atol=1e-13)


@pytest.mark.parametrize("n", [2, 5, 20])
def test_effective_resistance_of_the_complete_graph(n) -> None:
    sigma = estimate(complete(n), np.zeros(n * (n - 1) // 2), a_priori=True).sigma
    np.testing.assert_allclose(sigma[1:] ** 2, 2 / n, atol=1e-13)


def test_effective_resistance_of_a_tree_is_the_path_length() -> None:
    graph = MeasurementGraph(7, [0, 0, 1, 1, 2, 5], [1, 2, 3, 4, 5, 6])
    sigma = estimate(graph, np.zeros(6), a_priori=True).sigma
    np.testing.assert_allclose(sigma**2, [0, 1, 1, 2, 2, 2, 3], atol=1e-13)
    anchored = estimate(chain(9), np.zeros(9), a_priori=True).sigma
    np.testing.assert_allclose(anchored**2, np.arange(1, 10), atol=1e-12)


@pytest.mark.parametrize("side", [5, pytest.param(101, marks=pytest.mark.slow)])
def test_effective_resistance_of_the_square_grid(side) -> None:
    """Infinite grid: adjacent 1/2, diagonal 2/pi; centre of 101 x 101: 0.500054, 0.636727."""
    middle = side * (side // 2) + side // 2
    graph = grid(side, side, anchors=(middle,))
    exact = graph.is_external
    sigma = estimate(Network(graph, np.zeros(graph.n_arcs), exact=exact), a_priori=True).sigma
    adjacent, diagonal = sigma[middle + 1] ** 2, sigma[middle + side + 1] ** 2
    if side == 101:
        assert adjacent == pytest.approx(0.500054, abs=5e-7)
        assert diagonal == pytest.approx(0.636727, abs=5e-7)
    else:
        inverse = np.linalg.pinv(
            graph.subgraph(np.arange(side**2)).laplacian().toarray() - np.diag(np.arange(side**2) == middle)
        )
        for node, found in ((middle + 1, adjacent), (middle + side + 1, diagonal)):
            expected = inverse[node, node] + inverse[middle, middle] - 2 * inverse[node, middle]
            assert found == pytest.approx(expected, rel=1e-10)


# -- what changes nothing, what changes something ------------------------------------------------------------------
@settings(max_examples=25)
@given(measured(kinds=("none", "variances")), st.floats(0.01, 100.0))
def test_a_common_factor_of_the_covariance_cancels_in_the_a_posteriori_sigma(network, factor) -> None:
    variances = np.ones(network.graph.n_arcs) if network.covariance is None else network.covariance
    one = Network(network.graph, network.values.reshape(len(variances), -1)[:, 0] if len(variances) else [], variances)
    scaled = Network(one.graph, one.values, factor * variances)
    a, b = estimate(one), estimate(scaled)
    np.testing.assert_allclose(a.x, b.x, atol=1e-9)
    if a.degrees_of_freedom:
        np.testing.assert_allclose(a.sigma, b.sigma, rtol=1e-6, atol=1e-9)
        assert a.sigma_kind == "a-posteriori"
    else:
        np.testing.assert_allclose(a.sigma * np.sqrt(factor), b.sigma, rtol=1e-9, atol=1e-12)
        assert a.sigma_kind == "a-priori"


def test_a_posteriori_is_a_priori_times_m0() -> None:
    graph = complete(5, anchors=(4,))
    values = np.random.default_rng(0).normal(size=graph.n_arcs)
    prior, post = estimate(graph, values, a_priori=True), estimate(graph, values)
    np.testing.assert_allclose(post.sigma, np.sqrt(post.variance_factor) * prior.sigma, rtol=1e-14)
    assert prior.variance_factor == post.variance_factor
    assert (prior.sigma_kind, post.sigma_kind) == ("a-priori", "a-posteriori")


def test_large_numbers_keep_their_last_digits() -> None:
    """Geocentric coordinates: 6e6 m with millimetres that count."""
    graph = complete(6, anchors=(5,))
    truth = 6.378e6 + np.random.default_rng(1).uniform(size=6)
    values = np.append(truth[graph.head[:-1]] - truth[graph.tail[:-1]], truth[5])
    found = estimate(graph, values, np.full(graph.n_arcs, 1e-6))
    assert np.abs(found.x - truth).max() <= 3e-9
    assert found.gradient <= 1e-13


def test_without_uncertainty_there_are_no_deviations() -> None:
    graph = complete(5, anchors=(0,))
    values = np.random.default_rng(0).normal(size=graph.n_arcs)
    quick, whole = estimate(graph, values, uncertainty=False), estimate(graph, values)
    assert np.array_equal(quick.x, whole.x)
    assert np.isnan(quick.sigma).all()
    assert np.isnan(quick.standardized).all()
    assert np.isnan(quick.redundancy).all()
    assert quick.suspects == ()
    assert quick.variance_factor == whole.variance_factor
    assert quick.gradient == whole.gradient


def test_known_nodes_leave_nothing_to_estimate() -> None:
    graph = MeasurementGraph(2, [EXTERNAL, EXTERNAL, 0], [0, 1, 1])
    found = estimate(Network(graph, [1.0, 3.0, 2.5], exact=[True, True, False]))
    assert found.x.tolist() == [1.0, 3.0]
    assert found.sigma.tolist() == [0.0, 0.0]
    assert found.residuals.tolist() == [0.0, 0.0, 0.5]
    assert (found.degrees_of_freedom, found.variance_factor) == (1, 0.25)


def test_a_network_without_measurements_is_all_relative() -> None:
    found = estimate(MeasurementGraph(3, [], []), [])
    assert found.x.tolist() == [0.0, 0.0, 0.0]
    assert found.reference.tolist() == [0, 1, 2]
    assert found.variance_factor is None


def test_perfect_readings_leave_no_deviation_and_no_suspect() -> None:
    found = estimate(cycle(4, anchors=(3,)), [1.0, 1.0, 1.0, -3.0, 3.0])
    assert np.abs(found.x - [0, 1, 2, 3]).max() <= 1e-14
    assert found.variance_factor <= 1e-28
    assert found.suspects == ()


def test_weights_of_the_graph_are_not_measurement_weights() -> None:
    graph = cycle(3, anchors=(2,))
    values = [1.0, 2.0, -2.5, 3.0]
    weighted = estimate(graph.with_weight([1.0, 50.0, 3.0, 9.0]), values)
    assert np.array_equal(weighted.x, estimate(graph, values).x)


# -- suspects ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("arc", range(0, 30, 3))
@pytest.mark.parametrize("a_priori", [True, False])
def test_a_planted_gross_error_is_the_first_suspect(arc, a_priori) -> None:
    graph = complete(8, anchors=(0, 7))
    rng = np.random.default_rng(arc)
    variances = rng.uniform(0.5, 2.0, size=graph.n_arcs)
    truth = rng.normal(size=8)
    values = graph.incidence().T @ truth + np.sqrt(variances) * rng.normal(size=graph.n_arcs)
    clean = estimate(graph, values, variances, a_priori=a_priori)
    assert clean.suspects == ()
    values[arc] += 60.0 * np.sqrt(variances[arc])
    found = estimate(graph, values, variances, a_priori=a_priori)
    if not graph.is_external[arc]:
        assert found.suspects[0] == arc
        assert abs(found.standardized[arc]) > 3.29
    else:
        assert {28, 29} >= set(found.suspects[:2]) != set(), "two absolute readings cannot tell which of them is wrong"
    sizes = np.abs(found.standardized[list(found.suspects)])
    assert (np.diff(sizes) <= 0).all(), "the worst first"


# -- refusals ----------------------------------------------------------------------------------------------------------
def test_arguments_must_fit_together() -> None:
    graph = chain(2)
    network = Network(graph, [1.0, 2.0])
    with pytest.raises(ArgumentError, match="a Network has its values and covariance already"):
        estimate(network, [1.0, 2.0])
    with pytest.raises(ArgumentError, match="a Network has its values and covariance already"):
        estimate(network, covariance=[1.0, 2.0])
    with pytest.raises(ArgumentError, match="a Network, or a MeasurementGraph and values; got list"):
        estimate([1.0, 2.0])
    with pytest.raises(ArgumentError, match="values are missing: one measured value an arc"):
        estimate(graph)
    with pytest.raises(ShapeError, match=r"values must have shape \(2,\) or \(2, d\); got \(3,\)"):
        estimate(graph, [1.0, 2.0, 3.0])
    with pytest.raises(ArgumentError, match="values must be finite; got nan at position 1"):
        estimate(graph, [1.0, np.nan])
    with pytest.raises(ArgumentError, match=r"covariance\[1\] = 0.0 must be a positive variance"):
        estimate(graph, [1.0, 2.0], [1.0, 0.0])
    with pytest.raises(ShapeError, match="covariance must have shape"):
        estimate(graph, [1.0, 2.0], [1.0])


def test_a_joint_covariance_must_be_positive_definite() -> None:
    joint = sp.csr_array(np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    with pytest.raises(
        ArgumentError, match=r"joint covariance of the measured numbers \[0, 1\] is not positive definite"
    ):
        estimate(chain(3), np.zeros(3), joint)


def test_results_cannot_be_written_into() -> None:
    found = estimate(chain(3), [1.0, 1.0, 1.0])
    for table in (found.x, found.sigma, found.residuals, found.standardized, found.redundancy, found.reference):
        with pytest.raises(ValueError, match="read-only"):
            table[0] = 5


def test_inputs_are_not_mutated() -> None:
    values, joint = np.array([1.0, 2.0, 3.0]), sp.csr_array(np.diag([1.0, 2.0, 3.0]))
    before = values.copy(), joint.toarray()
    one, two = (estimate(chain(3), values, joint) for _ in range(2))
    assert np.array_equal(values, before[0])
    assert np.array_equal(joint.toarray(), before[1])
    assert np.array_equal(one.x, two.x)
    assert np.array_equal(one.x, la.solve(chain(3).incidence().toarray().T, values))
