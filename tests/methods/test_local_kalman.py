"""``LocalKalman``: the local filter, the error spectrum, and what is guaranteed, against dense oracles."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle, grid
from trigpoint.methods import Fixed, FromGraph, LocalKalman, WorstCase, design
from trigpoint.model import LinearAgent, Network, NetworkedAgents
from trigpoint.testing.strategies import agents, measurement_graphs, weight_blocks

from .drawn import (
    DOUBLE_INTEGRATOR,
    FALLING,
    OSCILLATOR,
    RISING,
    assembled,
    detectable_agents,
    generic_agent,
    graph_with_everything,
    problems,
)


def spectra_gap(one: np.ndarray, other: np.ndarray) -> float:
    """Largest distance of an eigenvalue to the nearest one of the other set, both ways."""
    distance = np.abs(one[:, None] - other[None, :])
    return float(max(distance.min(axis=0).max(), distance.min(axis=1).max()))


# -- Step 1: the local filter ------------------------------------------------------------------------------------------
@settings(max_examples=30)
@given(detectable_agents(max_states=4), st.data())
def test_the_local_filter_solves_its_riccati_equation(agent, data) -> None:
    S, R = data.draw(weight_blocks(agent.n_states, 2)), data.draw(weight_blocks(agent.n_outputs, 2))
    observer = design(NetworkedAgents(chain(2), agent), LocalKalman(process=S, measurement=R))
    Q, A, C = observer.facts["Q"], agent.A, agent.C
    terms = [A @ Q + Q @ A.T, Q @ C.T @ la.solve(R, C @ Q), S]
    size = max(np.abs(term).max() for term in terms)
    residual = np.abs(terms[0] - terms[1] + terms[2]).max()
    assert residual <= 1e-11 * size, "1e-12 but for hardly observed unstable modes"
    assert observer.facts["riccati_residual"] <= 1e-11
    assert np.array_equal(Q, Q.T)
    assert la.eigvalsh(Q)[0] > 0
    np.testing.assert_allclose(observer.injection, Q @ C.T @ la.inv(R), rtol=1e-9, atol=1e-9 * np.abs(Q).max())
    assert np.linalg.eigvals(A - observer.injection @ C).real.max() < 0


@pytest.mark.parametrize("agent", [LinearAgent.static(3), DOUBLE_INTEGRATOR, OSCILLATOR, RISING, FALLING])
@pytest.mark.parametrize(("process", "measurement"), [(1.0, 1.0), (0.1, 1.0), (1.0, 0.1)])
def test_the_riccati_residual_of_ordinary_agents_is_rounding(agent, process, measurement) -> None:
    S, R = process * np.eye(agent.n_states), measurement * np.eye(agent.n_outputs)
    observer = design(NetworkedAgents(chain(2), agent), LocalKalman(process=S, measurement=R))
    assert observer.facts["riccati_residual"] <= 1e-12


@pytest.mark.parametrize(("process", "diagonal"), [(np.eye(4), np.sqrt(3)), (np.diag([0, 0, 1, 1]), np.sqrt(2))])
def test_the_local_filter_of_the_moving_agents(process, diagonal) -> None:
    """Section 5.3 prints 1.41, which belongs to M = diag(0, 0, 1, 1), not to M = I (E-000-4)."""
    I2, O2 = np.eye(2), np.zeros((2, 2))
    mover = LinearAgent(np.block([[O2, I2], [O2, O2]]), np.hstack([I2, O2]))
    Q = design(NetworkedAgents(chain(8), mover), LocalKalman(process=process)).facts["Q"]
    np.testing.assert_allclose(Q, np.block([[diagonal * I2, I2], [I2, diagonal * I2]]), atol=1e-14)


def test_the_noise_entry_of_the_agent_is_the_default_process_noise() -> None:
    E = np.array([[0.3, 0.0], [1.0, 2.0]])
    plain = NetworkedAgents(chain(3), DOUBLE_INTEGRATOR)
    noisy = NetworkedAgents(chain(3), LinearAgent([[0, 1], [0, 0]], [[1, 0]], E=E))
    given_S = design(plain, LocalKalman(process=E @ E.T))
    assert np.array_equal(design(noisy, LocalKalman()).injection, given_S.injection)
    identity = design(plain, LocalKalman(process=np.eye(2)))
    assert np.array_equal(design(plain, LocalKalman()).injection, identity.injection)
    assert np.abs(given_S.injection - identity.injection).max() > 0.1


# -- Step 2: Theorem 4 -------------------------------------------------------------------------------------------------
@settings(max_examples=200)
@given(problems())
def test_a_gain_just_above_the_bound_makes_every_mode_decay(problem) -> None:
    observer = design(problem, LocalKalman(FromGraph(margin=1.0001)))
    assert observer.decay_rate > 0
    if problem.graph.dimension == 1:
        values = la.eigvalsh(problem.graph.laplacian().toarray())
        modes = problem.agent.A - observer.gain * values[:, None, None] * (observer.injection @ problem.agent.C)
        abscissa = np.linalg.eigvals(modes).real.max()
    else:
        abscissa = np.linalg.eigvals(observer.error_matrix().toarray()).real.max()
    assert abscissa < 0
    assert observer.decay_rate <= -abscissa * (1 + 1e-9)


@settings(max_examples=30)
@given(problems(max_nodes=5, decades=1), st.floats(1.0001, 30.0))
def test_the_assembled_error_matrix_is_stable(problem, margin) -> None:
    observer = design(problem, LocalKalman(FromGraph(margin)))
    H = assembled(problem, observer.injection, observer.gain)
    np.testing.assert_allclose(observer.error_matrix().toarray(), H, atol=1e-13 * np.abs(H).max())
    assert np.linalg.eigvals(H).real.max() < 0
    assert observer.decay_rate <= -np.linalg.eigvals(H).real.max() + 1e-9 * np.abs(H).max()


@settings(max_examples=30)
@given(problems(max_nodes=5), st.floats(0.01, 100.0))
def test_the_guarantee_never_exceeds_the_computed_decay(problem, gain) -> None:
    """For every gain, also one that stabilises nothing."""
    observer = design(problem, LocalKalman(Fixed(gain)))
    size = np.abs(observer.error_matrix().toarray()).max()
    assert observer.decay_rate <= -observer.spectral_abscissa + 1e-9 * size


@settings(max_examples=30)
@given(detectable_agents(), st.floats(0.05, 20.0))
def test_the_guarantee_never_exceeds_the_computed_decay_for_a_lone_node(agent, gain) -> None:
    observer = design(NetworkedAgents(chain(1), agent), LocalKalman(Fixed(gain)))
    abscissa = np.linalg.eigvals(agent.A - gain * observer.injection @ agent.C).real.max()
    size = np.abs(observer.error_matrix().toarray()).max()
    assert observer.spectral_abscissa == pytest.approx(abscissa, abs=1e-12 * size)
    assert observer.decay_rate <= -abscissa + 1e-9 * size


@pytest.mark.slow
@settings(max_examples=1000)
@given(problems(max_nodes=12, decades=4, max_states=4))
def test_theorem_4_on_many_networks(problem) -> None:
    observer = design(problem, LocalKalman(FromGraph(margin=1.0001)))
    assert observer.spectral_abscissa < 0 < observer.decay_rate


@pytest.mark.parametrize(
    ("agent", "threshold"), [(OSCILLATOR, 0.3718), (RISING, np.sqrt(2) - 1)], ids=["oscillator", "rising"]
)
def test_the_exact_threshold_lies_below_the_theorem(agent, threshold) -> None:
    """E-000-12: Theorem 4 asks for gamma lambda > 1; the Riccati gain needs less."""

    def abscissa(gain: float) -> float:
        return design(NetworkedAgents(chain(1), agent), LocalKalman(Fixed(gain))).spectral_abscissa

    low, high = 0.01, 1.0
    assert abscissa(low) > 0 > abscissa(high)
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if abscissa(middle) < 0 else (middle, high)
    assert high == pytest.approx(threshold, abs=5e-5)


@pytest.mark.parametrize("gain", [1e-4, 0.01, 1.0, 1e4])
def test_the_double_integrator_is_stable_for_every_positive_gain(gain) -> None:
    assert (
        design(NetworkedAgents(cycle(5, anchors=(4,)), DOUBLE_INTEGRATOR), LocalKalman(Fixed(gain))).spectral_abscissa
        < 0
    )


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=6, weighted=True, decades=2, externally_connected=True), st.floats(1e-6, 1e6))
def test_constants_are_found_with_every_positive_gain(graph, gain) -> None:
    """Proposition 6."""
    observer = design(NetworkedAgents(graph, LinearAgent.static(2)), LocalKalman(Fixed(gain)))
    rate = gain * la.eigvalsh(graph.laplacian().toarray())[0]
    assert observer.facts["driftless"]
    assert 0 < observer.decay_rate <= rate * (1 + 1e-9)
    assert observer.decay_rate == pytest.approx(rate, rel=1e-6)
    assert observer.spectral_abscissa == pytest.approx(-rate, rel=1e-9)


@settings(max_examples=30)
@given(problems(max_nodes=5, decades=1), st.floats(0.2, 2.0))
def test_a_given_matrix_that_satisfies_8_serves_as_well(problem, share) -> None:
    """Q^-1 of the Riccati equation satisfies A'P + PA - C'C < 0, hence any multiple up to 2 satisfies (8)."""
    Q = design(problem, LocalKalman()).facts["Q"]
    P = share * la.inv(Q)
    P = 0.5 * (P + P.T)
    observer = design(problem, LocalKalman(FromGraph(1.0001), P=P))
    assert observer.facts["local_filter"] == "given P (8)"
    np.testing.assert_allclose(observer.facts["Q"] @ P, np.eye(P.shape[0]), atol=1e-9)
    assert observer.spectral_abscissa < 0
    assert observer.decay_rate > 0


# -- the error matrix and its spectrum ---------------------------------------------------------------------------------
@settings(max_examples=50)
@given(measurement_graphs(max_nodes=6, weighted=True, decades=1), agents(max_states=3), st.integers(0, 99))
def test_the_laplacian_splits_the_error_into_modes(graph, agent, seed) -> None:
    """(U' x I) H (U x I) is block diagonal with A - gamma lambda K C on the diagonal."""
    from trigpoint.observers import DiffusiveObserver

    K = np.random.default_rng(seed).normal(size=(agent.n_states, agent.n_outputs))
    observer = DiffusiveObserver("any", NetworkedAgents(graph, agent), K, 1.7, 0.0, None)
    values, vectors = la.eigh(graph.laplacian().toarray())
    wide = np.kron(vectors, np.eye(agent.n_states))
    modes = la.block_diag(*(agent.A - 1.7 * value * K @ agent.C for value in values))
    turned = wide.T @ observer.error_matrix().toarray() @ wide
    np.testing.assert_allclose(turned, modes, atol=1e-12 * max(np.abs(modes).max(), 1.0))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("weights", ["unit", "scalar", "blocks"])
def test_spectrum_and_abscissa_are_those_of_the_assembled_matrix(seed, weights) -> None:
    rng = np.random.default_rng(seed)
    agent = generic_agent(1 + seed % 3, 1 + seed % 2, rng)
    graph = graph_with_everything()
    if weights == "scalar":
        graph = graph.with_weight(rng.uniform(0.1, 10.0, size=graph.n_arcs))
    if weights == "blocks":
        root = rng.normal(size=(graph.n_arcs, agent.n_outputs, agent.n_outputs))
        graph = graph.with_weight(np.eye(agent.n_outputs) + root @ root.transpose(0, 2, 1))
    problem = NetworkedAgents(graph, agent)
    observer = design(problem, LocalKalman(FromGraph(1.3)))
    H = assembled(problem, observer.injection, observer.gain)
    found = la.eigvals(H)
    size = np.abs(H).max()
    assert observer.spectral_abscissa == pytest.approx(found.real.max(), abs=1e-9 * size)
    assert spectra_gap(la.eigvals(observer.error_matrix().toarray()), found) <= 1e-9 * size
    if weights != "blocks" or agent.n_outputs == 1:
        values = la.eigvalsh(graph.laplacian().toarray())
        modes = [la.eigvals(agent.A - observer.gain * v * observer.injection @ agent.C) for v in values]
        assert spectra_gap(np.concatenate(modes), found) <= 1e-9 * size


def test_large_networks_get_a_computed_abscissa_too() -> None:
    observer = design(NetworkedAgents(chain(2001), DOUBLE_INTEGRATOR), LocalKalman())
    values = 2.0 - 2.0 * np.cos((2 * np.arange(1, 2002) - 1) * np.pi / (2 * 2001 + 1))
    modes = DOUBLE_INTEGRATOR.A - observer.gain * values[:, None, None] * (observer.injection @ DOUBLE_INTEGRATOR.C)
    assert observer.spectral_abscissa == pytest.approx(np.linalg.eigvals(modes).real.max(), rel=1e-9)
    assert 0 < observer.decay_rate <= -observer.spectral_abscissa


def test_large_networks_with_weight_blocks_have_no_computed_abscissa() -> None:
    graph = chain(1001).with_weight(np.broadcast_to(np.eye(2), (1001, 2, 2)))
    observer = design(NetworkedAgents(graph, LinearAgent.static(2)), LocalKalman())
    assert observer.spectral_abscissa is None
    assert observer.decay_rate > 0


# -- weights, anchors, inputs ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("p", [1, 2, 3])
def test_multiples_of_the_identity_are_scalar_weights(p) -> None:
    rng = np.random.default_rng(p)
    agent = generic_agent(3, p, rng)
    weight = rng.uniform(0.5, 4.0, size=7)
    scalar = design(NetworkedAgents(graph_with_everything(weight), agent), LocalKalman(Fixed(2.0)))
    block_weight = weight[:, None, None] * np.eye(p)
    blocks = design(NetworkedAgents(graph_with_everything(block_weight), agent), LocalKalman(Fixed(2.0)))
    ones = design(NetworkedAgents(graph_with_everything(weight[:, None, None]), agent), LocalKalman(Fixed(2.0)))
    for other in (blocks, ones):
        size = np.abs(scalar.error_matrix().toarray()).max()
        gap = np.abs((scalar.error_matrix() - other.error_matrix()).toarray()).max()
        assert gap <= 1e-14 * size
        assert np.abs((scalar.reading_matrix() - other.reading_matrix()).toarray()).max() <= 1e-14 * size
        assert other.verify_design_equations().dynamics <= 1e-13
        assert other.spectral_abscissa == pytest.approx(scalar.spectral_abscissa, abs=1e-11 * size)


def test_precision_weights_are_accepted() -> None:
    network = Network(chain(4), [1.0, 2.0, 3.0, 4.0], [0.1, 0.4, 0.2, 0.3])
    graph = network.graph.with_weight(network.precision_weights())
    observer = design(NetworkedAgents(graph, LinearAgent.static()), LocalKalman())
    assert observer.graph.arc_weights.mean() == pytest.approx(1.0, rel=1e-15)
    assert observer.gain == pytest.approx(1.05 / la.eigvalsh(graph.laplacian().toarray())[0], rel=1e-7)


def test_inputs_may_differ_between_nodes() -> None:
    each = [LinearAgent([[0, 1], [0, 0]], [[1, 0]], B=[[0.0], [k + 1.0]]) for k in range(4)]
    observer = design(NetworkedAgents(graph_with_everything(), each), LocalKalman())
    G = observer.general_form().G.toarray()
    assert np.array_equal(G, la.block_diag(*(agent.B for agent in each)))
    for k in range(4):
        assert np.array_equal(observer.local(k).B, each[k].B)


def test_stable_agents_need_no_anchor_when_the_gain_is_given() -> None:
    problem = NetworkedAgents(cycle(4), FALLING)
    for rule in (Fixed(3.0), WorstCase(4)):
        observer = design(problem, LocalKalman(rule))
        abscissa = np.linalg.eigvals(observer.error_matrix().toarray()).real.max()
        assert abscissa == pytest.approx(-0.5, abs=1e-9), "the common motion decays by itself"
        assert observer.decay_rate <= -abscissa
        assert observer.facts["gain_bound"] is None


def test_the_slowest_grid_of_the_paper() -> None:
    """Section 5.2: 16 agents on a 4 x 4 grid, one anchor, 25 arcs; gamma = 5: slowest time constant 5.59 s."""
    graph = grid(4, 4)
    assert graph.n_arcs == 25
    observer = design(NetworkedAgents(graph, LinearAgent.static(2)), LocalKalman(Fixed(5.0)))
    assert observer.facts["lambda_min"] == pytest.approx(0.0358034, abs=5e-8)
    assert -1 / observer.spectral_abscissa == pytest.approx(5.59, abs=0.005)
    assert np.exp(2 * observer.spectral_abscissa) == pytest.approx(0.699, abs=5e-4)


def test_the_facts_of_a_design_are_consistent() -> None:
    observer = design(NetworkedAgents(chain(8), OSCILLATOR), LocalKalman(FromGraph(1.2)))
    facts = observer.facts
    assert facts["lambda_min_lower"] <= facts["lambda_min"] <= facts["lambda_min_upper"]
    assert facts["gain_bound"] == 1.0 / facts["lambda_min_lower"]
    assert observer.gain == 1.2 / facts["lambda_min_lower"]
    assert facts["decay_rate_at_floor"] == observer.decay_rate
    assert facts["gain_rule"] == "1.2 / lambda_min (Theorem 4)"
    assert not facts["driftless"]
    assert not facts["Q"].flags.writeable


def test_the_problem_is_not_mutated() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, 0, 1], [0, 1, 2], [1.0, 2.0, 3.0])
    problem = NetworkedAgents(graph, OSCILLATOR)
    S = np.diag([2.0, 3.0])
    before = [graph.weight.copy(), OSCILLATOR.A.copy(), S.copy()]
    method = LocalKalman(process=S)
    one, two = design(problem, method), design(problem, method)
    S[0, 0] = 99.0
    assert all(np.array_equal(a, b) for a, b in zip(before[:2], [graph.weight, OSCILLATOR.A], strict=True))
    assert np.array_equal(method.process, before[2])
    assert np.array_equal(one.injection, two.injection)
    assert one.gain == two.gain
