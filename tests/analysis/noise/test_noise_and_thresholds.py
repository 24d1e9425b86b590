"""Theorems 4 to 6 of G16 with errata: thresholds, noise levels, covariances, switching; each against an oracle."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import example, given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.analysis.modes import mode_matrices
from trigpoint.analysis.noise import gain_interval, mu_star, noise_budget, noise_condition
from trigpoint.analysis.thresholds import lmi_threshold, stable_gains
from trigpoint.errors import ArgumentError
from trigpoint.linalg.equations import filter_riccati
from trigpoint.methods import Family, Fixed, LocalKalman, WorstCase
from trigpoint.papers.g16_example1 import graph as example_1
from trigpoint.testing.strategies import measurement_graphs

DOUBLE = np.array([[0.0, 1.0], [0.0, 0.0]])
WAVY = np.array([[0.5, 1.0], [-1.0, 0.5]])
ROW = np.array([[1.0, 0.0]])


# -- thresholds (E-000-12) ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("A", "C", "S", "sufficient", "exact"),
    [
        (DOUBLE, ROW, np.eye(2), 0.375, 0.0),
        (WAVY, ROW, np.eye(2), 0.4518, 0.3718),
        (np.eye(1), np.eye(1), np.eye(1), 0.4142, 0.4142),
        (np.kron(DOUBLE, np.eye(2)), np.kron(ROW, np.eye(2)), np.diag([0.0, 0, 1, 1]), 0.5, 0.0),
    ],
)
def test_published_thresholds(A, C, S, sufficient, exact) -> None:
    Q = filter_riccati(A, C, S, np.eye(C.shape[0]))
    assert lmi_threshold(A, Q, C.T @ C) == pytest.approx(sufficient, abs=5e-5)
    gains = stable_gains(A, Q @ C.T, C)
    assert gains.threshold == pytest.approx(exact, abs=5e-5)
    for factor in (0.99, 1.01):
        g = factor * gains.threshold
        if g > 0.0:
            assert (np.linalg.eigvals(A - g * Q @ C.T @ C).real.max() < 0.0) == (factor > 1.0)


@given(st.integers(0, 100_000))
@example(220)  # a conjugate pair crosses
@example(3134)  # an infinite eigenvalue of the pencil
@settings(max_examples=100, deadline=None)
def test_the_exact_set_is_what_a_fine_scan_finds(seed) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    A, K, C = rng.normal(size=(n, n)), rng.normal(size=(n, 1)), rng.normal(size=(1, n))
    gains = stable_gains(A, K, C)
    for g in rng.uniform(0.01, 5.0, 50):
        abscissa = float(np.linalg.eigvals(A - g * K @ C).real.max())
        inside = any(low < g < high for low, high in gains.intervals)
        assert inside == (abscissa < 0.0) or abs(abscissa) < 1e-6
    if gains.intervals:
        low, high = gains.intervals[0]
        high = min(high, low + 1.0)
        assert gains.covers(low + 0.3 * (high - low), low + 0.6 * (high - low))
    else:
        assert gains.threshold == np.inf


def test_a_pair_that_no_gain_helps_has_no_threshold() -> None:
    assert stable_gains(np.zeros((1, 1)), np.eye(1), np.eye(1)).threshold == 0.0
    assert stable_gains(np.eye(1), np.zeros((1, 1)), np.eye(1)).threshold == np.inf
    assert lmi_threshold(np.eye(1), np.eye(1), np.zeros((1, 1))) == np.inf
    assert lmi_threshold(-np.eye(1), np.eye(1), np.zeros((1, 1))) == 0.0


def test_the_design_reports_all_three_bounds() -> None:
    facts = tp.design(tp.NetworkedAgents(example_1(), tp.LinearAgent(WAVY, ROW)), LocalKalman()).facts
    assert facts["gain_bound"] == pytest.approx(1.0 / 0.43845, rel=1e-4)
    assert facts["gain_bound_for_this_filter"] == pytest.approx(0.4518 / 0.43845, rel=2e-4)
    assert facts["gain_threshold_exact"] == pytest.approx(0.3718 / 0.43845, rel=2e-4)


# -- modes -------------------------------------------------------------------------------------------------------------
@given(measurement_graphs(max_nodes=12, externally_connected=True, weighted=True, decades=2), st.integers(0, 999))
@settings(max_examples=60, deadline=None)
def test_eigenvectors_split_the_error_matrix(graph, seed) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    agent = tp.LinearAgent(rng.normal(size=(n, n)), rng.normal(size=(1, n)))
    observer = tp.design(tp.NetworkedAgents(graph, agent), LocalKalman())
    values, U = la.eigh(graph.laplacian().toarray())
    H = observer.error_matrix().toarray()
    big = np.kron(U, np.eye(n))
    modes = mode_matrices(agent.A, observer.injection, agent.C, observer.gain * values)
    assert np.abs(big.T @ H @ big - la.block_diag(*modes)).max() <= 1e-12 * np.linalg.norm(H, 2)


def test_spectrum_operator_and_peak_through_the_modes() -> None:
    rng = np.random.default_rng(0)
    graph = tp.graphs.grid(3, 4, anchors=(0,))
    observer = tp.design(tp.NetworkedAgents(graph, tp.LinearAgent(WAVY, ROW)), LocalKalman())
    H = observer.error_matrix().toarray()
    whole, modes = np.sort_complex(la.eigvals(H)), np.sort_complex(observer.spectrum())
    assert np.abs(whole - modes).max() < 1e-10 * np.linalg.norm(H, 2)
    e = rng.normal(size=24)
    assert np.abs(observer.error_operator() @ e - H @ e).max() < 1e-14 * np.linalg.norm(H)
    times = np.linspace(0.0, 10.0 / -observer.spectral_abscissa, 65)
    exact = max(np.linalg.norm(la.expm(H * t), 2) for t in times)
    assert observer.transient_peak() == pytest.approx(exact, rel=1e-9)
    unstable = tp.design(observer.problem, LocalKalman(Fixed(1e-3)))
    assert unstable.transient_peak() == np.inf
    blocks = graph.with_weight(np.stack([np.eye(2)] * graph.n_arcs))
    vector = tp.design(tp.NetworkedAgents(blocks, tp.LinearAgent.static(2)), LocalKalman())
    assert np.abs(vector.error_operator() @ e - vector.error_matrix() @ e).max() < 1e-13
    with pytest.raises(ArgumentError, match="modes are for scalar weights"):
        vector.spectrum()


# -- Theorem 4 ---------------------------------------------------------------------------------------------------------
def drawn_agent(rng):
    """A, C with the unobservable modes, if any, left of -0.01."""
    n = int(rng.integers(1, 5))
    A, C = rng.normal(size=(n, n)), rng.normal(size=(1, n))
    if n > 1 and rng.random() < 0.3:  # the last state is not seen, and stable
        A[:-1, -1], C[0, -1] = 0.0, 0.0
        A[-1, -1] = -0.01 - abs(rng.normal())
    return A, C


def drawn_filter(rng, A, C, *, tight: bool):
    """Q from the Riccati equation, or P = Q^-1 that satisfies (8) with a relative margin of at most 1e-3."""
    n = A.shape[0]
    E = rng.normal(size=(n, n))
    Q = filter_riccati(A, C, E @ E.T + 1e-3 * np.eye(n), np.eye(1))
    if not tight:
        return Q
    g = lmi_threshold(A, Q, C.T @ C)  # A Q + Q A' - 2 g Q S Q = 0 in one direction
    return Q * g * (1.0 + 1e-4)  # scaled: A Q + Q A' - 2 Q S Q < 0, nearly not


def theorem_4(draws: int, *, assembled: bool) -> tuple[int, int]:
    """How many of the drawn networks are Hurwitz just above the bound; how many tight ones fail at 0.9 of it."""
    rng = np.random.default_rng(4)
    good, broken = 0, 0
    for k in range(draws):
        A, C = drawn_agent(rng)
        Q = drawn_filter(rng, A, C, tight=k % 2 == 1)
        size = int(rng.integers(1, 8))
        L = tp.graphs.random_connected(size, 0.6, rng).laplacian().toarray()
        values = la.eigvalsh(L)
        K = Q @ C.T
        for factor in (1.0001, 0.9):
            g = factor / values[0]
            if assembled:
                H = np.kron(np.eye(size), A) - g * np.kron(L, K @ C)
                abscissa = np.linalg.eigvals(H).real.max()
            else:
                abscissa = np.linalg.eigvals(mode_matrices(A, K, C, g * values)).real.max()
            good += factor > 1.0 and abscissa < 0.0
            broken += factor < 1.0 and k % 2 == 1 and abscissa > 0.0
    return good, broken


def test_theorem_4_on_assembled_networks() -> None:
    good, broken = theorem_4(300, assembled=True)
    assert good == 300
    assert broken > 0


@pytest.mark.slow
def test_theorem_4_through_the_modes() -> None:
    good, broken = theorem_4(10_000, assembled=False)
    assert good == 10_000
    assert broken > 100


def test_the_printed_minimum_is_not_enough_for_two_topologies() -> None:  # E-000-1
    graphs = [tp.graphs.chain(4), tp.graphs.complete(4, anchors=(0, 1, 2, 3))]
    agent = tp.LinearAgent([[1.0]], [[1.0]])
    bounds = [tp.gain_bound(graph) for graph in graphs]
    Q = filter_riccati(np.eye(1), np.eye(1), np.eye(1), np.eye(1)) / (1.0 + np.sqrt(2.0))  # (8) with equality: P = 1
    worst = [float((1.0 - 1.05 * min(bounds) * Q * la.eigvalsh(g.laplacian().toarray())).max()) for g in graphs]
    assert max(worst) > 0.0
    family = tp.design(tp.NetworkedAgents(graphs[0], agent), LocalKalman(Family(graphs)))
    for graph in graphs:
        values = la.eigvalsh(graph.laplacian().toarray())
        assert mode_matrices(agent.A, family.injection, agent.C, family.gain * values).max() < 0.0


# -- Theorem 5 ---------------------------------------------------------------------------------------------------------
PLANAR = tp.LinearAgent(np.kron(DOUBLE, np.eye(2)), np.kron(ROW, np.eye(2)), E=np.vstack([np.zeros((2, 2)), np.eye(2)]))


@pytest.mark.parametrize("mu", [0.2, 0.5, 0.66])
def test_condition_18_changes_sign_at_the_ends_of_the_interval(mu) -> None:
    values = la.eigvalsh(example_1().laplacian().toarray())
    assert values[0] == pytest.approx(0.43845, abs=5e-6)
    Q = filter_riccati(PLANAR.A, PLANAR.C, PLANAR.E @ PLANAR.E.T, np.eye(2))
    low, high = gain_interval(mu, float(values[0]))
    for end, outside in ((low, 0.99), (high, 1.01)):
        assert noise_condition(PLANAR, Q, values, outside * end, mu) > 0.0
        assert noise_condition(PLANAR, Q, values, (2.0 - outside) * end, mu) < 0.0
    assert 0.5 / values[0] <= low <= 1.0 / values[0]


def test_the_printed_level_above_one_guarantees_nothing() -> None:  # E-000-3
    graph = tp.MeasurementGraph(1, [-1] * 4, [0] * 4)
    agent = tp.LinearAgent([[0.0]], [[1.0]], E=[[1.0]])
    problem = tp.NetworkedAgents(graph, agent)
    assert mu_star(0.25, 4.0) == 1.0, "clipped: the printed one is 2"
    assert noise_budget(problem, 0.25, mu=2.0).total == pytest.approx(2.5)
    assert noise_budget(problem, 0.25, mu=1.0).total == pytest.approx(0.625)
    assert noise_budget(problem, 0.25).guarantee == pytest.approx(1.0)


def test_the_true_covariance_is_below_the_guarantee() -> None:
    problem = tp.NetworkedAgents(example_1(), PLANAR)
    low, high = gain_interval(0.66, 0.4384471871911697)
    totals = [noise_budget(problem, gain, mu=0.66) for gain in np.linspace(1.001 * low, 0.999 * high, 9)]
    for budget in totals:
        assert budget.centralised <= budget.total <= budget.guarantee
        assert 12.0 <= budget.total <= 13.3, "theory 000-33"
        assert budget.guarantee == pytest.approx(22.6, abs=0.05)
        assert budget.gap >= 1.0


@given(measurement_graphs(max_nodes=6, externally_connected=True), st.floats(1.0, 4.0), st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_covariances_by_modes_equal_the_big_lyapunov_solution(graph, factor, seed) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    agent = tp.LinearAgent(0.5 * rng.normal(size=(n, n)), rng.normal(size=(1, n)))
    problem, R = tp.NetworkedAgents(graph, agent), np.array([[0.7]])
    gain = factor * tp.gain_bound(graph)
    budget = noise_budget(problem, gain, mu=0.8, measurement=R)
    Q = filter_riccati(agent.A, agent.C, np.eye(n), R)
    K = Q @ agent.C.T / R
    G = graph.incidence().toarray()
    L = G @ G.T
    H = np.kron(np.eye(graph.n_nodes), agent.A) - gain * np.kron(L, K @ agent.C)
    noise = 0.64 * (np.kron(np.eye(graph.n_nodes), np.eye(n)) + gain**2 * np.kron(L, K @ R @ K.T))
    big = la.solve_continuous_lyapunov(H, -noise)
    assert budget.total == pytest.approx(np.trace(big), rel=1e-9)
    for node in range(graph.n_nodes):
        own = slice(node * n, (node + 1) * n)
        assert np.abs(budget.covariance[node] - big[own, own]).max() <= 1e-9 * np.abs(big).max()
    best = la.solve_continuous_are(
        np.kron(np.eye(graph.n_nodes), agent.A).T, np.kron(G.T, agent.C).T, np.eye(H.shape[0]), 0.7 * np.eye(G.shape[1])
    )
    assert budget.centralised == pytest.approx(0.64 * np.trace(best), rel=1e-6)


def test_a_bare_graph_stands_for_constants() -> None:
    graph = tp.graphs.grid(3, 3, anchors=(0,))
    budget = noise_budget(graph, 3.0, mu=1.0)
    L = graph.laplacian().toarray()
    assert budget.total == pytest.approx(np.trace(la.solve_continuous_lyapunov(-3.0 * L, -(np.eye(9) + 9.0 * L))))


def test_large_networks_have_error_bars() -> None:
    graph = tp.graphs.grid(48, 48, anchors=(0, 47, 2303))
    problem = tp.NetworkedAgents(graph, tp.LinearAgent(DOUBLE, ROW))
    gain = 1.05 * tp.gain_bound(graph)
    budget = noise_budget(problem, gain, mu=1.0)
    assert budget.covariance is None
    assert "24 probes" in budget.method
    Q = filter_riccati(DOUBLE, ROW, np.eye(2), np.eye(1))
    K, exact = Q @ ROW.T, 0.0
    for value in la.eigvalsh(graph.laplacian().toarray()):
        exact += np.trace(
            la.solve_continuous_lyapunov(DOUBLE - gain * value * K @ ROW, -(np.eye(2) + gain**2 * value * K @ K.T))
        )
    assert abs(budget.total - exact) < 5.0 * budget.total_error
    assert budget.total_error < 0.05 * exact


# -- Theorems 6 and 7: switching ---------------------------------------------------------------------------------------
def test_under_switching_the_weighted_error_never_grows() -> None:
    rng = np.random.default_rng(7)
    agent = tp.LinearAgent(WAVY, ROW)
    observer = tp.design(tp.NetworkedAgents(tp.graphs.chain(5), agent), LocalKalman(WorstCase(5)))
    P = np.linalg.inv(observer.facts["Q"])
    for _ in range(1000):
        e = rng.normal(size=(5, 2))
        energy = float(np.einsum("ia,ab,ib->", e, P, e))
        for _ in range(4):
            L = tp.graphs.random_connected(5, float(rng.uniform(0.2, 1.0)), rng).laplacian().toarray()
            H = np.kron(np.eye(5), WAVY) - observer.gain * np.kron(L, observer.injection @ ROW)
            e = (la.expm(H * rng.uniform(0.001, 0.3)) @ e.ravel()).reshape(5, 2)
            after = float(np.einsum("ia,ab,ib->", e, P, e))
            assert after <= energy * (1.0 + 1e-12)
            energy = after


def test_a_topology_without_anchor_still_knows_the_relative_states() -> None:  # 000-36
    agent = tp.LinearAgent(DOUBLE, ROW)
    observer = tp.design(tp.NetworkedAgents(tp.graphs.cycle(5, anchors=(0,)), agent), LocalKalman(WorstCase(5)))
    L = tp.graphs.cycle(5).laplacian().toarray()
    H = np.kron(np.eye(5), DOUBLE) - observer.gain * np.kron(L, observer.injection @ ROW)
    e = (la.expm(40.0 * H) @ np.random.default_rng(0).normal(size=10)).reshape(5, 2)
    assert np.ptp(e, axis=0).max() < 1e-8 * np.abs(e).max()
    assert np.abs(e).max() > 0.1
    island = tp.diagnose(tp.NetworkedAgents(tp.graphs.cycle(5), agent))
    assert island.detectable is False
    assert any(finding.direction is not None for finding in island.findings)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: gain_interval(1.5, 1.0), "mu must be a noise level"),
        (lambda: noise_budget("chain", 1.0), "problem must be NetworkedAgents"),
        (lambda: noise_budget(tp.NetworkedAgents(tp.graphs.chain(3), PLANAR), -1.0), "gain must be a positive number"),
        (lambda: noise_budget(tp.graphs.chain(3), "2"), "gain must be a number, such as an observer's gain; got str"),
        (lambda: noise_budget(tp.NetworkedAgents(tp.graphs.cycle(3), PLANAR), 1.0), "a path from every node"),
        (
            lambda: noise_budget(tp.NetworkedAgents(tp.graphs.chain(3), tp.LinearAgent([[1.0]], [[1.0]])), 0.1),
            "is not stable: no steady covariance",
        ),
        (
            lambda: noise_budget(
                tp.NetworkedAgents(tp.graphs.chain(2).with_weight(np.stack([np.eye(2)] * 2)), tp.LinearAgent.static(2)),
                1.0,
            ),
            "scalar arc weights",
        ),
    ],
)
def test_nonsense_is_refused(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


def test_beyond_the_best_level_no_gain_is_left() -> None:
    assert gain_interval(0.9, 0.5) is None
    assert mu_star(0.1, 0.5) == 0.0
    assert mu_star(2.0, 0.5) == pytest.approx(np.sqrt(0.5))
    assert isinstance(Fixed(1.0), Fixed)
