"""``CouplingGain``: the guarantee of theory 4b-B1 against drawn problems, an oracle, published plants, and refusals."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import expm_multiply

from tests.analysis.plants.oracle import HAN_A, HAN_C, HAN_HEARS, thermal_network
from tests.methods.observed_plants import bed, drawn_plants, oracle
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.graphs import chain
from trigpoint.methods.coupling import CoupledPart
from trigpoint.methods.coupling_gain import CouplingGain, coupling_margin, link_loss_rates
from trigpoint.model import LinearAgent, NetworkedAgents, SharedPlant
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing.observers import check_observer


def dense_abscissa(observer) -> float:
    return float(la.eigvals(observer.error_matrix().toarray()).real.max())


# -- the guarantee -----------------------------------------------------------------------------------------------------
@settings(max_examples=40)
@given(drawn_plants(), st.floats(0.1, 5.0))
def test_measured_abscissa_is_left_of_the_rate(plant, rate) -> None:
    observer = CouplingGain(rate).build(plant)
    assert observer.decay_rate == rate
    assert observer.spectral_abscissa == pytest.approx(dense_abscissa(observer))
    assert observer.spectral_abscissa <= -rate + 1e-9
    residuals = observer.verify_design_equations()
    assert max(residuals.dynamics, residuals.output) <= 1e-12


@settings(max_examples=25)
@given(drawn_plants())
def test_r_mu_lam_against_the_oracle(plant) -> None:
    facts = CouplingGain(1.0, margin=1.0).build(plant).facts
    r, mu, lam = oracle(plant)
    np.testing.assert_allclose(facts["r"], r, rtol=1e-9)
    if np.isinf(lam):
        assert facts["lam"] is None
        assert facts["gain"] == 0.0
        return
    assert facts["lam"] == pytest.approx(lam, rel=1e-8, abs=1e-11)
    assert facts["mu"] == pytest.approx(mu, rel=1e-9, abs=1e-9)
    assert facts["gain"] == pytest.approx(max(0.0, 2.0 * r.max() * (mu + 1.0) / lam), rel=1e-6)
    assert facts["least_gain"] <= facts["gain"] * (1.0 + 1e-9)
    assert facts["coupled_rate"] >= 1.0 - 1e-9


@settings(max_examples=20)
@given(drawn_plants())
def test_the_least_gain_still_keeps_the_rate(plant) -> None:
    least = CouplingGain(1.0).build(plant).facts["least_gain"]
    observer = CouplingGain(1.0, gain=1.0001 * least).build(plant)
    assert observer.decay_rate == pytest.approx(1.0)
    assert observer.spectral_abscissa <= -1.0 + 1e-9


def test_structure_and_axioms() -> None:
    for plant in (bed(4, 3, "directed ring", 1, inputs=2), SharedPlant(HAN_A, HAN_C, HAN_HEARS)):
        observer = CouplingGain(1.0).build(plant)
        check_observer(plant, observer)
        for agent, others in enumerate(plant.hears):
            assert set(observer.local(agent).hears) <= {str(other) for other in others}
            assert set(observer.local(agent).reads) <= {agent}


def test_agents_that_see_everything_are_not_told_anything() -> None:
    plant = SharedPlant([[0.0, 1.0], [0.0, 0.0]], [[[1.0, 0.0]]] * 3, {0: [1], 1: [2], 2: [0]})
    observer = CouplingGain(2.0).build(plant)
    assert observer.facts["gain"] == 0.0
    assert all(node.hears == () for node in observer.nodes)
    assert observer.spectral_abscissa < -2.0


# -- numbers -----------------------------------------------------------------------------------------------------------
def test_theory_4_agents_3_states_directed_ring() -> None:
    """Theory 4b-B1: lam = 2, gamma = 1.207 for mu = .207, abscissa -1.0001 (tight)."""
    A = la.block_diag([[0.207, 1.3], [-1.3, 0.207]], [[-0.2]])
    outputs = [[[1.0, 0.4, 0.0]], [[0.0, 0.0, 1.0]], [[0.7, 1.0, 0.0]], [[0.0, 0.0, 1.0]]]
    observer = CouplingGain(1.0, margin=1.0).build(SharedPlant(A, outputs, {i: [(i - 1) % 4] for i in range(4)}))
    assert observer.facts["lam"] == pytest.approx(2.0)
    assert observer.facts["gain"] == pytest.approx(1.207)
    assert observer.spectral_abscissa == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("m", "n", "kind"), [(10, 6, "ring"), (10, 6, "directed ring"), (50, 10, "random"), (50, 10, "ring")]
)
def test_the_bed(m, n, kind) -> None:
    observer = CouplingGain(1.0, margin=1.0).build(bed(m, n, kind))
    assert -1.55 < observer.spectral_abscissa <= -1.0 + 1e-6  # between the coupled and the local rate
    assert 1.0 < observer.facts["gain"] < 100.0
    assert observer.facts["leak"] < 1e-12


def test_han_trentelman_wang_shen() -> None:
    """The published plant: left null vector (.8, 1.6, .8, .8), wanted decay 1."""
    observer = CouplingGain(1.0).build(SharedPlant(HAN_A, HAN_C, HAN_HEARS))
    np.testing.assert_allclose(observer.facts["r"], [0.8, 1.6, 0.8, 0.8], rtol=1e-12)
    assert observer.spectral_abscissa <= -1.0
    start = np.array([1.0, 3.0, -2.0, -3.0, -1.0, 2.0])
    scenario = Scenario(np.linspace(0.0, 12.0, 61), -np.tile(start, 4), start)
    run = simulate(observer.problem, observer, scenario)
    assert run.measured_decay_rate() >= 1.0
    assert run.error_norm[-1] < 1e-4 * run.error_norm[0]


@pytest.mark.parametrize("ring", [{0: [1, 3], 1: [0, 2], 2: [1, 3], 3: [2, 0]}, {0: [1, 2, 3], 1: [0], 2: [3], 3: [1]}])
def test_the_nine_rooms(ring) -> None:
    A, outputs = thermal_network()
    observer = CouplingGain(0.5).build(SharedPlant(A, outputs, ring))
    assert observer.spectral_abscissa <= -0.5


def test_known_input_leaves_no_error() -> None:
    plant = bed(4, 3, "ring", 2, inputs=2)
    observer = CouplingGain(1.0).build(plant)
    times, error = np.linspace(0.0, 6.0, 7), np.ones(12)
    runs = [
        simulate(plant, observer, Scenario(times, error, np.ones(3), inputs=u)) for u in (None, np.array([1.0, -2.0]))
    ]
    assert np.abs(runs[0].truth[-1] - runs[1].truth[-1]).max() > 0.1
    np.testing.assert_allclose(runs[0].error, runs[1].error, atol=1e-9)


@pytest.mark.slow
def test_500_agents_of_10_states() -> None:
    """Theory 4b-B1: gamma 4.5, stiffness 100, measured rate 1.35 at rate 1 on another geometric graph."""
    plant = bed(500, 10, "ring", 0)
    graph = nx.random_geometric_graph(500, 0.09, seed=3)
    assert nx.is_connected(graph)
    plant = SharedPlant(plant.A, plant.outputs, graph.to_directed())
    observer = CouplingGain(1.0).build(plant)
    assert 1.0 < observer.facts["gain"] < 20.0
    H = observer.error_matrix().tocsc()
    start = np.random.default_rng(0).normal(size=H.shape[0])
    early, late = (np.linalg.norm(expm_multiply(H * t, start)) for t in (4.0, 8.0))
    assert np.log(early / late) / 4.0 >= 1.0


# -- digraphs that are not strongly connected, and states that nobody sees ---------------------------------------------
def test_component_after_component() -> None:
    A = np.diag([0.3, 0.1, -0.2])
    rows = np.eye(3)
    outputs = [rows[:1], rows[1:], None, rows[:1], None]
    plant = SharedPlant(A, outputs, {0: [1], 1: [0], 2: [1, 3], 3: [2], 4: [3]})
    observer = CouplingGain(1.0).build(plant)
    assert observer.facts["components"] == 3
    assert observer.spectral_abscissa <= -1.0
    check_observer(plant, observer)


@settings(max_examples=25)
@given(drawn_plants(max_agents=4), drawn_plants(max_agents=3, max_states=1), st.integers(0, 3))
def test_a_listening_component(source, listeners, into) -> None:
    """Whoever hears a component that knows everything reaches the rate too, sensing nothing."""
    m = source.n_agents
    hears = {i: list(others) for i, others in enumerate(source.hears)}
    hears |= {m + i: [m + other for other in others] for i, others in enumerate(listeners.hears)}
    hears[m] = [*hears[m], into % m]
    plant = SharedPlant(source.A, [*source.outputs, *[None] * listeners.n_agents], hears)
    observer = CouplingGain(1.0).build(plant)
    assert observer.facts["components"] == 2
    assert observer.spectral_abscissa <= -1.0 + 1e-9


def test_motions_that_die_out_need_not_be_seen() -> None:
    turn = la.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    A = turn @ np.diag([0.3, 0.1, -2.0, -5.0]) @ turn.T
    rows = turn.T
    plant = SharedPlant(A, [rows[:1], rows[1:2], None], {0: [1], 1: [2], 2: [0]})
    observer = CouplingGain(1.0).build(plant)
    assert observer.spectral_abscissa <= -1.0
    check_observer(plant, observer)
    with pytest.raises(MethodError, match=r"dies out at 2 1/s.*ask for a rate below 2 1/s"):
        CouplingGain(2.5).build(plant)


def test_nobody_need_see_a_plant_that_dies_out_by_itself() -> None:
    plant = SharedPlant(np.diag([-2.0, -3.0]), [None, None], {0: [1]})
    observer = CouplingGain(1.0).build(plant)
    assert observer.facts["gain"] == 0.0
    assert observer.spectral_abscissa == pytest.approx(-2.0)


# -- links that are lost -----------------------------------------------------------------------------------------------
@settings(max_examples=20)
@given(drawn_plants(max_agents=5), st.floats(1.0, 3.0))
def test_margin_after_link_loss_is_a_guarantee(plant, margin) -> None:
    observer = CouplingGain(1.0, margin=margin).build(plant)
    assert coupling_margin(plant, observer) >= 1.0 - 1e-9
    for (agent, lost), rate in link_loss_rates(plant, observer).items():
        hears = {i: [j for j in others if (i, j) != (agent, lost)] for i, others in enumerate(plant.hears)}
        left = SharedPlant(plant.A, plant.outputs, hears)
        assert rate >= 0.0
        assert dense_abscissa(with_links(observer, left)) <= -rate + 1e-8 or rate == 0.0


def with_links(observer, plant):
    """The same programs where some neighbours are never heard again."""
    from dataclasses import replace

    nodes = []
    for agent, node in enumerate(observer.nodes):
        kept = {str(other) for other in plant.hears[agent]}
        nodes.append(replace(node, arcs=tuple(a for a in node.arcs if a.neighbour is None or a.neighbour in kept)))
    return replace(observer, problem=plant, nodes=tuple(nodes))


def test_a_ring_with_a_margin_survives_any_link() -> None:
    plant = bed(10, 6, "ring")
    observer = CouplingGain(1.0, margin=2.0).build(plant)
    rates = link_loss_rates(plant, observer)
    assert len(rates) == 20
    assert min(rates.values()) > 0.0
    assert max(rates.values()) <= observer.facts["seen_rate"]
    alone = coupling_margin(plant, observer, {})
    assert alone == 0.0


def test_the_rate_of_a_given_gain() -> None:
    plant = bed(10, 6, "ring")
    full = CouplingGain(1.0).build(plant).facts["gain"]
    half = CouplingGain(1.0, gain=0.5 * full).build(plant)
    assert half.decay_rate < 1.0
    assert half.spectral_abscissa <= -half.decay_rate + 1e-9
    assert CouplingGain(1.0, gain=0.0).build(plant).decay_rate <= 0.0


# -- refusals ----------------------------------------------------------------------------------------------------------
def test_arguments() -> None:
    for rate in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ArgumentError, match="rate must be a positive"):
            CouplingGain(rate)
    with pytest.raises(ArgumentError, match="margin must be at least 1"):
        CouplingGain(1.0, margin=0.9)
    with pytest.raises(ArgumentError, match="gain must not be negative"):
        CouplingGain(1.0, gain=-1.0)
    with pytest.raises(ArgumentError, match="tolerance must lie between"):
        CouplingGain(1.0, tolerance=0.0)


def test_another_problem() -> None:
    with pytest.raises(MethodError, match="needs a SharedPlant; got NetworkedAgents"):
        CouplingGain(1.0).build(NetworkedAgents(chain(3), LinearAgent(0.0, 1.0)))


def test_agents_that_lack_something_are_named() -> None:
    rows = np.eye(2)
    one_way = SharedPlant(np.diag([0.1, 0.2]), [rows[:1], rows[1:]], {1: [0]})
    with pytest.raises(MethodError, match=r"agent 0 hears nobody else.*\+x\[1\].*Let agent 0 hear agent 1"):
        CouplingGain(1.0).build(one_way)
    blind = SharedPlant(np.diag([0.1, 0.2]), [rows[:1], None], {0: [1], 1: [0]})
    with pytest.raises(MethodError, match=r"all agents together do not see .*x\[1\].*Sense x\[1\]"):
        CouplingGain(1.0).build(blind)


def nearly_parallel(angle: float) -> SharedPlant:
    return SharedPlant(0.1 * np.eye(2), [[[1.0, 0.0]], [[1.0, angle]]], {0: [1], 1: [0]})


def test_rounding_decides() -> None:
    with pytest.raises(MethodError, match="a state that the agents see clearly, or clearly do not"):
        CouplingGain(1.0).build(nearly_parallel(1e-10))
    with pytest.raises(MethodError, match=r"lam = .* zero to rounding"):
        CouplingGain(1.0).build(nearly_parallel(1e-7))
    assert CouplingGain(1.0).build(nearly_parallel(1e-2)).spectral_abscissa <= -1.0 + 1e-9


def seen_weakly(d: float) -> SharedPlant:
    A = [[1.0, d, 0.0], [0.0, 1.0, d], [0.0, 0.0, 1.0]]
    return SharedPlant(A, [[[1.0, 0.0, 0.0]], np.eye(3)], {0: [1], 1: [0]})


def test_what_an_agent_sees_weakly_is_better_told_to_it() -> None:
    plant = seen_weakly(1e-5)
    with pytest.raises(MethodError, match=r"agent 0 with a smallest relative .*Raise the tolerance"):
        CouplingGain(1.0).build(plant)
    observer = CouplingGain(1.0, tolerance=1e-3).build(plant)
    assert observer.facts["leak"] == pytest.approx(1e-5, rel=1e-3)
    assert observer.spectral_abscissa <= -1.0
    assert max(float(np.abs(arc.gain).max()) for node in observer.nodes for arc in node.arcs) < 10.0
    assert coupling_margin(plant, observer) == 0.0
    check_observer(plant, observer)


def test_no_clear_gap() -> None:
    A = [[1.0, 0.5], [3.0, 1.0]]
    plant = SharedPlant(A, [[[1.0, 0.0]], [[0.0, 1.0]]], {0: [1], 1: [0]})
    assert CouplingGain(1.0).build(plant).spectral_abscissa <= -1.0
    with pytest.raises(MethodError, match=r"a clear gap .* misses the rate"):
        CouplingGain(1.0, tolerance=0.99).build(plant)


def test_margin_of_another_method() -> None:
    plant = bed(3, 2, "ring")
    with pytest.raises(ArgumentError, match="must come from CouplingGain"):
        coupling_margin(plant, "nothing")


def test_the_stiffness_bound_of_many_agents() -> None:
    m = 1001
    hears = tuple(((k - 1) % m, (k + 1) % m) for k in range(m))
    assert CoupledPart(np.zeros((1, 1)), (np.ones((1, 1)),) * m, hears).spread == 4.0
    small = CoupledPart(
        np.zeros((1, 1)), (np.ones((1, 1)),) * 10, tuple(((k - 1) % 10, (k + 1) % 10) for k in range(10))
    )
    assert small.spread == pytest.approx(4.0)
