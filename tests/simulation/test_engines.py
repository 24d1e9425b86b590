"""Matrix functions by products and by factorizations, the rule between them, steady covariances, families."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.analysis.modes import largest_eigenvalue_bound
from trigpoint.errors import ArgumentError
from trigpoint.linalg import chebyshev
from trigpoint.linalg.sparse import WIDEST, widest_level
from trigpoint.simulation import (
    Absence,
    Bouncing,
    Noise,
    Scenario,
    Topology,
    Trajectory,
    modal,
    simulate,
    simulate_family,
    stationary_covariance,
)

from .drawn import observed, start

DOUBLE = tp.LinearAgent([[0, 1], [0, 0]], [[1, 0]], E=[[0.0], [1.0]])


def designed(graph, agent, gain=None):
    method = tp.methods.LocalKalman() if gain is None else tp.methods.LocalKalman(tp.Fixed(gain))
    return tp.design(tp.NetworkedAgents(graph, agent), method)


# -- Chebyshev series --------------------------------------------------------------------------------------------------
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 999), st.sampled_from([0.01, 1.0, 40.0]), st.sampled_from([1e-4, 1e-9]))
def test_a_series_is_the_function_within_its_tail(seed, time, tolerance) -> None:
    rng = np.random.default_rng(seed)
    graph = tp.graphs.random_connected(60, 0.1, rng)
    L, ceiling = graph.laplacian(), largest_eigenvalue_bound(graph)
    values, vectors = la.eigh(L.toarray())
    block = rng.normal(size=(60, 2))

    def function(x):
        return la.expm(
            time * (np.array([[0.0, 1.0], [-1.0, 0.0]]) - x[:, None, None] * np.array([[1.0, 0.0], [0.2, 0.0]]))
        )

    found = chebyshev.series(function, ceiling, tolerance, 20_000)
    assert found.tail < 2.0 * tolerance
    exact = vectors @ (function(values) @ (vectors.T @ block)[:, :, None])[:, :, 0]
    before = block.copy()
    ours = chebyshev.applied(L, ceiling, block, [found])[0]
    assert np.array_equal(block, before)
    assert np.linalg.norm(ours - exact) <= (found.tail + 1e-13 * found.degree) * np.linalg.norm(block)


def test_series_of_different_lengths_share_one_recurrence() -> None:
    L = tp.graphs.grid(9, 9).laplacian()
    block = np.random.default_rng(0).normal(size=(81, 1))
    times = [1.0, 0.0, 30.0, 0.1]
    several = [chebyshev.series(lambda x, t=t: np.exp(-t * x)[:, None, None], 8.0, 1e-12, 999) for t in times]
    assert several[1].degree == 0
    for time, row in zip(times, chebyshev.applied(L, 8.0, block, several), strict=True):
        np.testing.assert_allclose(row, la.expm(-time * L.toarray()) @ block, atol=1e-11)


def test_a_series_that_would_be_too_long_is_none() -> None:
    assert chebyshev.series(lambda x: np.exp(-1e6 * x)[:, None, None], 8.0, 1e-8, 100) is None


# -- the rule ----------------------------------------------------------------------------------------------------------
def test_levels_tell_planar_networks_from_expanders() -> None:
    assert widest_level(tp.graphs.chain(50).laplacian()) == 1
    assert widest_level(tp.graphs.grid(30, 40).laplacian()) == 30
    assert widest_level(tp.graphs.star(50).laplacian()) >= 48
    assert widest_level(sp.csr_array((3, 3))) == 1
    tail, head = np.random.default_rng(0).integers(0, 30_000, (2, 90_000))
    keep = tail != head
    chords = tp.MeasurementGraph(30_000, np.append(tail[keep], -1), np.append(head[keep], 0))
    assert widest_level(chords.laplacian()) > WIDEST


@pytest.mark.parametrize("agent", [tp.LinearAgent.static(), DOUBLE])
@pytest.mark.parametrize("with_readings", [False, True])
def test_every_engine_gives_the_exact_modes(monkeypatch, agent, with_readings) -> None:
    if with_readings and not agent.is_static:
        agent = tp.LinearAgent.static(2)
    graph = tp.graphs.grid(14, 16, anchors=(0, 100))
    observer = designed(graph, agent, 3.0)
    rng, n = np.random.default_rng(1), agent.n_states
    readings = rng.normal(size=(graph.n_arcs, agent.n_outputs)) if with_readings else None
    scenario = Scenario([0.0, 0.01, 0.4, 6.0, 90.0], rng.normal(size=(224, n)), measurements=readings, path="modal")
    exact = simulate(observer.problem, observer, scenario)
    assert exact.attributes["engines"] == "eigenpairs"
    size = np.linalg.norm(scenario.initial_error) + np.linalg.norm(exact.error[-1])
    monkeypatch.setattr(modal, "ALL_MODES", 10)
    for widest, short, names in ((5500, 60, "chebyshev and krylov"), (5500, 10, "krylov"), (1, 60, "chebyshev")):
        monkeypatch.setattr(modal, "WIDEST", widest)
        monkeypatch.setattr(modal, "SHORT", short if names != "krylov" else -1)
        run = simulate(observer.problem, observer, scenario)
        assert run.attributes["engines"] == names
        gaps = np.linalg.norm(run.error - exact.error, axis=(1, 2)) / size
        assert gaps.max() < 1e-8
        assert 0.0 < run.attributes["error_estimate"] < 1e-8


MOVING = Bouncing.drawn(224, 14.0, (0.5, 1.0), np.random.default_rng(3), known=False)
CHANGES = {
    "arcs fail": {"topology": Topology.random(tp.graphs.grid(14, 16, anchors=(0, 100)).n_arcs, 0.7, 0.8, 3.0, 4)},
    "nothing works": {"topology": Topology([0.0, 1.0], np.repeat([[True], [False]], 420, axis=1))},
    "nodes leave": {"absences": (Absence(0, 0.4, 1.1), Absence(7, 0.9), Absence(30, 0.0, 2.0))},
    "nodes move": {"motion": MOVING, "topology": Topology([0.0, 1.3], np.arange(840).reshape(2, 420) % 5 > 0)},
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_changing_networks_too_large_for_all_modes_follow_them_all_the_same(monkeypatch, changes) -> None:
    graph = tp.graphs.grid(14, 16, anchors=(0, 100))
    observer = designed(graph, tp.LinearAgent(np.kron([[0, 1], [0, 0]], np.eye(2)), np.eye(4)[:2]), 3.0)
    error = np.random.default_rng(1).normal(size=(224, 4))
    scenario = Scenario([0.0, 0.4, 0.5, 1.0, 1.1, 3.0], error, seed=2, **changes)
    exact = simulate(observer.problem, observer, scenario)
    assert exact.attributes["engines"] == "eigenpairs"
    monkeypatch.setattr(modal, "ALL_MODES", 10)
    run = simulate(observer.problem, observer, scenario)
    assert run.attributes["engines"] == "chebyshev and krylov, interval by interval"
    size = np.linalg.norm(np.nan_to_num(exact.error), axis=(1, 2)).max()
    np.testing.assert_allclose(run.estimate, exact.estimate, atol=1e-7 * size)
    np.testing.assert_array_equal(run.truth, exact.truth)
    np.testing.assert_array_equal(run.status, exact.status)
    assert 0.0 < run.attributes["error_estimate"] < 1e-6


def test_noise_and_unknown_trajectories_need_all_modes() -> None:
    observer = designed(tp.graphs.grid(40, 40), DOUBLE, 5.0)
    unknown = Trajectory([0.0, 1.0], np.zeros((2, 1600, 2)), known=False)
    for options, words in (({"noise": Noise(0.1)}, "noise"), ({"motion": unknown}, "a trajectory that")):
        with pytest.raises(ArgumentError, match=f"{words}.* needs all modes .* at most 1200 nodes, got 1600; give a"):
            simulate(observer.problem, observer, Scenario([1.0], **options))


def test_a_looser_tolerance_is_kept_and_named() -> None:
    observer = designed(tp.graphs.grid(40, 40), DOUBLE, 5.0)
    error = np.random.default_rng(0).normal(size=(1600, 2))
    times = [0.1, 3.0, 100.0]
    fine, coarse = (
        simulate(observer.problem, observer, Scenario(times, error, tolerance=goal)) for goal in (1e-11, 1e-4)
    )
    gap = np.linalg.norm(fine.error - coarse.error, axis=(1, 2)).max() / np.linalg.norm(error)
    assert gap < 1e-4
    assert 1e-11 < coarse.attributes["error_estimate"] < 1e-4
    with pytest.raises(ArgumentError, match="tolerance must be a relative error"):
        Scenario([1.0], tolerance=0.0)


@settings(max_examples=8, deadline=None)
@given(observed(max_nodes=3), st.integers(0, 999))
def test_the_three_paths_agree_to_a_billionth(observer, seed) -> None:
    error, state, inputs = start(observer, seed)
    times = np.array([0.0, 0.4, 1.0]) * 3.0 / np.abs(observer.error_matrix().toarray()).max()
    paths = ["reference", "stacked", *(["modal"] if observer.graph.dimension == 1 else [])]
    runs = [
        simulate(observer.problem, observer, Scenario(times, error, state, inputs=inputs, path=path)) for path in paths
    ]
    assert [run.path for run in runs] == paths
    scale = max(np.abs(runs[0].estimate).max(), 1.0)
    for run in runs[1:]:
        np.testing.assert_allclose(run.estimate, runs[0].estimate, atol=1e-9 * scale)


# -- the stationary covariance -----------------------------------------------------------------------------------------
def test_the_stationary_covariance_solves_the_whole_networks_equation() -> None:
    observer = designed(tp.graphs.cycle(5, anchors=(0, 2)), DOUBLE)
    K = observer.reading_matrix().toarray()
    noise = 0.25 * K @ K.T + 0.09 * np.kron(np.eye(5), DOUBLE.E @ DOUBLE.E.T)
    X = la.solve_continuous_lyapunov(observer.error_matrix().toarray(), -noise)
    found = stationary_covariance(observer, Noise(0.5, 0.3))
    for node in range(5):
        block = X[2 * node : 2 * node + 2, 2 * node : 2 * node + 2]
        np.testing.assert_allclose(found.covariance[node], block, atol=1e-11 * np.abs(X).max())
    one = stationary_covariance(observer, Noise(0.5, 0.3), nodes=[3])
    np.testing.assert_allclose(one.covariance[0], found.covariance[3], rtol=1e-12)


def test_a_large_networks_covariance_is_found_node_by_node(monkeypatch) -> None:
    observer = designed(tp.graphs.grid(20, 20), DOUBLE, 10.0)
    exact = stationary_covariance(observer, Noise(0.5, 0.3), nodes=[0, 399])
    monkeypatch.setattr("trigpoint.simulation.stationary.ALL_MODES", 10)
    found = stationary_covariance(observer, Noise(0.5, 0.3), nodes=[0, 399])
    assert found.error < 1e-8
    gap = np.abs(found.covariance - exact.covariance).max() / np.abs(exact.covariance).max()
    assert gap < 1e-7
    for nodes, words in ((None, "name the nodes"), (range(17), "at most 16 nodes")):
        with pytest.raises(ArgumentError, match=words):
            stationary_covariance(observer, Noise(1.0), nodes=nodes)


def test_what_does_not_settle_has_no_stationary_covariance() -> None:
    with pytest.raises(ArgumentError, match="is for unit weights"):
        stationary_covariance(designed(tp.graphs.chain(3).with_weight([1.0, 2.0, 1.0]), DOUBLE), Noise(1.0))
    island = tp.MeasurementGraph(3, [0, -1], [1, 2])
    problem = tp.NetworkedAgents(island, tp.LinearAgent.static())
    observer = tp.observers.DiffusiveObserver("given", problem, np.eye(1), 1.0, 0.0, 0.0)
    with pytest.raises(ArgumentError, match="a mode is not stable"):
        stationary_covariance(observer, Noise(1.0))


# -- families ----------------------------------------------------------------------------------------------------------
def family():
    rng = np.random.default_rng(5)
    agents = (tp.LinearAgent.static(), DOUBLE)
    return [
        designed(tp.graphs.random_connected(int(rng.integers(2, 6)), 0.4, rng), agents[k % 2], 2.0 + 0.1 * k)
        for k in range(20)
    ]


def test_a_family_is_every_network_by_itself_with_any_number_of_workers() -> None:
    observers, scenario = family(), Scenario([0.0, 0.3, 4.0], 0.7)
    one, two = (simulate_family(observers, scenario, workers=count) for count in (1, 2))
    assert np.array_equal(one.error_norm, two.error_norm)
    for k, observer in enumerate(observers):
        run = simulate(observer.problem, observer, scenario)
        np.testing.assert_allclose(one.errors[k], run.error, atol=1e-9)
        np.testing.assert_allclose(one.error_norm[k], run.error_norm, atol=1e-9)
        assert one.lambda_min[k] == pytest.approx(1.0 / tp.gain_bound(observer.graph), rel=1e-9)
        assert one.slowest[k] == pytest.approx(observer.spectral_abscissa, rel=1e-6)


@pytest.mark.parametrize(
    ("observers", "options", "words"),
    [
        ([], {}, "at least one network"),
        ([None], {}, "observer 0 of the family must be of equal agents"),
        (family()[:1], {"period": 0.1}, "under continuous exchange, and nothing else"),
        (family()[:1], {"absences": [Absence(0, 1.0)]}, "under continuous exchange, and nothing else"),
    ],
)
def test_what_a_family_does_not_cover_is_refused(observers, options, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        simulate_family(observers, Scenario([1.0], **options))
