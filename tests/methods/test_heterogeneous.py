"""``Heterogeneous``: the five steps, the numbers of the theory, the structure and the guarantee of what comes out."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.graphs import MeasurementGraph, chain
from trigpoint.methods.heterogeneous import Heterogeneous
from trigpoint.model import HyperNetwork, LinearAgent, NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.documents import observer_document, read_observer
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing import check_observer

from .drawn import DOUBLE_INTEGRATOR
from .drawn_heterogeneous import (
    TWO,
    is_clearly_detectable,
    marginal_networks,
    ring_without_anchor,
    rotation,
    unstable_network,
    with_stable_parts,
)


def network_of(observer: AssembledObserver) -> HyperNetwork:
    problem = observer.problem
    return problem if isinstance(problem, HyperNetwork) else HyperNetwork.of_networked(problem)


def gains_of(observer: AssembledObserver) -> np.ndarray:
    """L as the programs have it, stacked (only where nobody carries further states)."""
    return -observer.general_form().K.toarray()


def check_structure(observer: AssembledObserver) -> None:
    """Definition 4: an entry of L only where the block of C' is not zero; one arc for each measurement and node."""
    network = network_of(observer)
    for node, program in enumerate(observer.nodes):
        named = [j for j, blocks in enumerate(network.measurements) if node in blocks]
        assert [arc.label for arc in program.arcs] == named
        for arc in program.arcs:
            block = network.measurements[arc.label][node]
            assert block.any() or not arc.gain.any()
            assert {name for name, _ in arc.heard} == {
                network.names[k] for k in network.measurements[arc.label] if k != node
            }


def check_guarantee(observer: AssembledObserver) -> None:
    """The rate is that of P, for the matrix assembled independently of the programs' own path."""
    H, P = observer.error_matrix().toarray(), observer.facts["P"]
    assert 0.0 < observer.decay_rate <= -observer.spectral_abscissa + 1e-12
    assert la.eigvalsh(P)[0] > 0.0
    motion = P @ H + H.T @ P + 2.0 * observer.decay_rate * P
    assert la.eigvalsh(motion)[-1] < 0.0


# -- step 2 ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("gamma", "abscissa"), [(0.05, -0.0499), (0.5, -0.4114), (2.0, -0.3266)])
def test_a_ring_without_anchor_has_the_abscissae_of_the_theory(gamma, abscissa) -> None:
    observer = Heterogeneous(gamma=gamma).build(ring_without_anchor())
    assert observer.facts["step"] == "marginal"
    assert abs(observer.spectral_abscissa - abscissa) < 5e-5
    assert np.abs(gains_of(observer) + gamma * network_of(observer).stacked_output().toarray().T).max() < 1e-15
    check_guarantee(observer)
    check_observer(observer.problem, observer)


def test_a_scan_of_gamma_is_at_least_as_fast_as_any_of_them() -> None:
    best = Heterogeneous().build(ring_without_anchor())
    assert best.spectral_abscissa < -0.8
    assert best.decay_rate > 0.99 * -best.spectral_abscissa


@settings(max_examples=40)
@given(marginal_networks(), st.floats(-2.0, 2.0))
def test_any_gamma_serves_marginal_agents(network, decade) -> None:
    assume(is_clearly_detectable(network))
    observer = Heterogeneous(gamma=10.0**decade, only="marginal").build(network)
    assert observer.spectral_abscissa < 0.0
    assert max(observer.facts["modal_residual"]) < 1e-12
    check_structure(observer)


def test_shared_eigenvalues_on_the_axis_do_no_harm() -> None:
    agent = LinearAgent(rotation(1.0), [[1.0, 0.0]])
    measurements = [{0: [[1.0, 0.0]], 1: [[1.0, 0.0]]}, {0: [[0.0, 1.0]], 1: [[2.0, 0.0]]}]
    observer = Heterogeneous().build(HyperNetwork([agent.A, agent.A], measurements))
    assert observer.facts["step"] == "marginal"
    check_guarantee(observer)


def test_large_marginal_networks_are_designed_without_a_proved_rate() -> None:
    speeds = np.linspace(0.5, 4.0, 301)
    agents = [LinearAgent(rotation(w), [[1.0, 0.0]]) for w in speeds]
    observer = Heterogeneous().build(NetworkedAgents(MeasurementGraph(301, np.arange(300), np.arange(1, 301)), agents))
    assert observer.decay_rate == 0.0
    assert observer.spectral_abscissa is None
    assert observer.facts["proof"] == "none: 602 states, at most 600"
    check_structure(observer)


# -- step 3 ------------------------------------------------------------------------------------------------------------
def test_one_external_arc_makes_the_block_diagonal_inequality_feasible() -> None:
    """Theory, section 5: 32 of 32 drawn instances."""
    rng = np.random.default_rng(2016)
    for _ in range(32):
        observer = Heterogeneous(only="inequality").build(unstable_network("external", rng))
        assert observer.facts["step"] == "inequality"
        assert max(observer.facts["inequality_margin"]) < 0.0
        check_guarantee(observer)
        check_structure(observer)


def test_no_block_diagonal_inequality_for_two_agents_and_one_arc() -> None:
    """E-000-13: A = diag(.3, .8), C = [1 1]; Z proves it, and the search finds a structured L all the same."""
    observer = Heterogeneous().build(TWO)
    assert observer.facts["step"] == "abscissa"
    Z = observer.facts["Z"]
    assert np.abs(Z - [[0.5, -0.5], [-0.5, 0.5]]).max() < 1e-8
    assert any("no block-diagonal P, proved by Z" in note for note in observer.facts["notes"])
    check_guarantee(observer)
    check_structure(observer)
    check_observer(TWO, observer)


def test_a_certificate_contradicts_every_block_diagonal_matrix() -> None:
    """tr(Z (A'P + PA)) = sum tr(P_i (AZ + ZA')_ii) >= 0, while Z >= 0 and C Z = 0 would make it negative."""
    network = unstable_network("path", np.random.default_rng(7))
    Z = Heterogeneous().build(network).facts["Z"]
    A, C = network.stacked_dynamics().toarray(), network.stacked_output().toarray()
    assert la.eigvalsh(Z)[0] > -1e-14
    assert np.trace(Z) == pytest.approx(1.0)
    assert np.abs(C @ Z).max() < 1e-12
    motion = A @ Z + Z @ A.T
    blocks = [motion[network.states(k), network.states(k)] for k in range(network.n_nodes)]
    assert min(la.eigvalsh(block)[0] for block in blocks) > -1e-14  # zero on stable coordinates
    rng = np.random.default_rng(1)
    for _ in range(20):
        roots = [rng.normal(size=block.shape) for block in blocks]
        P = la.block_diag(*[root @ root.T for root in roots])
        assert np.trace(Z @ (A.T @ P + P @ A)) > 0.0


def test_equal_double_integrators_on_an_anchored_grid() -> None:
    observer = Heterogeneous().build(NetworkedAgents(tp.graphs.grid(3, 3, anchors=(8,)), DOUBLE_INTEGRATOR))
    assert observer.facts["step"] == "inequality"
    check_guarantee(observer)
    check_structure(observer)


def test_where_only_large_gains_satisfy_the_inequality_the_search_goes_on() -> None:
    rng = np.random.default_rng(10)
    agents = [LinearAgent(rng.normal(size=(3, 3)), rng.normal(size=(1, 3))) for _ in range(10)]
    problem = NetworkedAgents(tp.graphs.random_connected(10, 0.3, rng), agents)
    observer, forced = Heterogeneous().build(problem), Heterogeneous(only="inequality").build(problem)
    assert any("with large gains only" in note for note in observer.facts["notes"])
    assert np.abs(gains_of(observer)).max() < 0.1 * np.abs(gains_of(forced)).max()
    check_guarantee(observer)


# -- step 4 ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("factor", "abscissa"), [(0.2, 0.117), (0.5, -1.325), (0.9, 1.175)])
def test_the_order_of_time_scales_matters(factor, abscissa) -> None:
    """Theory, section 5: L = (k rho / a_2, -rho) is stable for large rho if and only if a_1 < k < a_2."""
    slow, fast, rho = 0.3, 0.8, 10.0
    H = np.diag([slow, fast]) + np.outer([factor * rho / fast, -rho], [1.0, 1.0])
    assert np.linalg.eigvals(H).real.max() == pytest.approx(abscissa, abs=5e-4)


def test_most_drawn_trees_and_paths_have_a_structured_gain() -> None:
    """Theory, section 5: 113 of 120 by the search alone. Here 62 of 64 or more, where no P is block-diagonal."""
    rng, found = np.random.default_rng(120), 0
    for kind in ["tree", "path"] * 32:
        observer = Heterogeneous().build(unstable_network(kind, rng))
        found += observer.facts["step"] != "dynamic"
        check_guarantee(observer)
    assert found >= 62


# -- step 5 ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_one_agent_with_states_of_its_own_stabilises(rate) -> None:
    observer = Heterogeneous(only="dynamic", rate=rate).build(TWO)
    assert observer.facts["step"] == "dynamic"
    assert sorted(node.n_states for node in observer.nodes) == [1, 3]
    assert observer.decay_rate > rate
    check_guarantee(observer)
    check_structure(observer)
    check_observer(TWO, observer)


def test_further_states_carry_inputs_and_a_larger_network() -> None:
    problem = NetworkedAgents(chain(3), LinearAgent([[0, 1], [0, 0]], [[1, 0]], B=[[0], [1]]))
    observer = Heterogeneous(only="dynamic").build(problem)
    check_guarantee(observer)
    check_observer(problem, observer)
    scenario = Scenario([0.0, 5.0, 200.0], 1.0, 0.5, inputs=[[3.0], [-1.0], [2.0]])
    run = simulate(problem, observer, scenario)
    assert run.error_norm[-1] < 1e-6 * run.error_norm[0]


# -- stable parts, structure, guarantee --------------------------------------------------------------------------------
def test_stable_parts_ride_along() -> None:
    network = with_stable_parts(np.random.default_rng(3), (0.4, 0.9, 0.2))
    observer = Heterogeneous().build(network)
    values = np.linalg.eigvals(observer.error_matrix().toarray())
    stable = [value for agent in network.agents for value in np.linalg.eigvals(agent.A) if value.real < 0]
    assert len(stable) == 6
    for value in stable:
        assert np.abs(values - value).min() < 1e-6
    for node, agent in enumerate(network.agents):
        gain = np.hstack([arc.gain for arc in observer.nodes[node].arcs])
        mode = np.linalg.eig(agent.A)
        unstable = mode[1][:, np.argmax(mode[0].real)].real
        assert np.linalg.matrix_rank(np.column_stack([gain, unstable]), tol=1e-9 * np.abs(gain).max()) == 1
    check_guarantee(observer)
    check_observer(network, observer)


def test_a_network_that_dies_out_needs_no_correction() -> None:
    observer = Heterogeneous().build(HyperNetwork([[[-1.0]], [[-2.0]]], [{0: [[1.0]], 1: [[1.0]]}]))
    assert observer.facts["step"] == "stable"
    assert not gains_of(observer).any()
    assert observer.decay_rate == pytest.approx(1.0, rel=2e-3)


def test_a_wanted_rate_speeds_up_slow_modes_too() -> None:
    network = HyperNetwork([[[-0.1]], [[0.2]]], [{0: [[1.0]], 1: [[1.0]]}, {1: [[1.0]]}])
    assert Heterogeneous().build(network).decay_rate <= 0.1
    observer = Heterogeneous(rate=1.0).build(network)
    assert observer.decay_rate > 1.0
    check_guarantee(observer)


def test_parts_that_no_measurement_joins_are_designed_one_by_one() -> None:
    agents = [[[0.3]], [[0.8]], rotation(1.0), [[-1.0]]]
    measurements = [{0: [[1.0]], 1: [[1.0]]}, {2: [[1.0, 0.0]], 3: [[5.0]]}, {3: [[1.0]]}]
    observer = Heterogeneous().build(HyperNetwork(agents, measurements, ["a", "b", "c", "d"]))
    assert observer.facts["parts"] == ("nodes a, b: abscissa", "node c: marginal")
    assert observer.facts["step"] == "abscissa"
    check_guarantee(observer)
    check_structure(observer)


def test_hyper_arcs_and_blocks_that_are_zero() -> None:
    """A measurement of three nodes, one with a block of zeros: that node is told, and must not use it."""
    agents = [[[0.3]], rotation(1.0) + 0.1 * np.eye(2), [[0.5]]]
    measurements = [
        {0: [[1.0], [0.0]], 1: [[1.0, 0.0], [0.0, 2.0]], 2: [[1.0], [1.0]]},
        {0: [[1.0]], 1: [[0.0, 0.0]], 2: [[-3.0]]},
    ]
    network = HyperNetwork(agents, measurements)
    observer = Heterogeneous().build(network)
    assert not observer.nodes[1].arcs[1].gain.any()
    check_structure(observer)
    check_guarantee(observer)
    check_observer(network, observer)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["external", "ring", "tree", "path"]))
def test_drawn_networks_get_an_observer_that_keeps_its_promise(seed, kind) -> None:
    network = unstable_network(kind, np.random.default_rng(seed))
    assume(is_clearly_detectable(network, 3e-2))
    observer = Heterogeneous().build(network)
    check_guarantee(observer)
    check_structure(observer)
    residuals = observer.verify_design_equations()
    assert residuals.dynamics < 1e-12
    assert residuals.output == 0.0


@settings(max_examples=20)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_units_do_not_matter(time, reading) -> None:
    """Seconds become 10^time s, readings are multiplied: the same step, and rates that scale."""
    base = unstable_network("path", np.random.default_rng(11))
    speed, factor = 10.0**time, 10.0**reading
    agents = [speed * agent.A for agent in base.agents]
    measurements = [{k: factor * b for k, b in blocks.items()} for blocks in base.measurements]
    one, other = Heterogeneous().build(base), Heterogeneous().build(HyperNetwork(agents, measurements))
    assert other.facts["step"] == one.facts["step"]
    assert other.decay_rate > 0.0


def test_errors_stay_below_the_promised_envelope() -> None:
    network = unstable_network("tree", np.random.default_rng(5))
    observer = Heterogeneous().build(network)
    times = np.linspace(0.0, 10.0 / observer.decay_rate, 21)
    start = np.random.default_rng(2).normal(size=network.n_states)
    run = simulate(network, observer, Scenario(times, start))
    P = observer.facts["P"]
    energy = [np.concatenate([run.error[k, i, : a.n_states] for i, a in enumerate(network.agents)]) for k in range(21)]
    values = np.array([e @ P @ e for e in energy])
    bound = values[0] * np.exp(-2.0 * observer.decay_rate * times)
    assert (values <= bound * (1.0 + 1e-6) + 1e-12 * values[0]).all()


@pytest.mark.parametrize("choice", [{}, {"only": "dynamic"}])
def test_certificates_and_documents_take_the_observer(choice) -> None:
    observer = Heterogeneous(**choice).build(TWO)
    certificate = tp.certify(TWO, observer)
    assert tp.verify(certificate, TWO, observer).outcome == "certified"
    document = json.loads(json.dumps(observer_document(observer)))
    again = read_observer(document)
    assert np.array_equal(again.error_matrix().toarray(), observer.error_matrix().toarray())
    assert again.facts["parts"] == observer.facts["parts"]


def test_the_same_seed_gives_the_same_observer() -> None:
    one, other = (Heterogeneous(seed=4).build(TWO) for _ in range(2))
    assert np.array_equal(gains_of(one), gains_of(other))
