"""SpectrumAssignment and SccCascade on theory's test bed: exact blocks, honest spectra, bounded gains, refusals."""

from __future__ import annotations

import sys

import networkx as nx
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings

import trigpoint as tp
from tests.methods.observed_plants import bed, drawn_plants
from trigpoint.certificates import certify, verify
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.precise import precise_eigenvalues
from trigpoint.methods import SccCascade, SpectrumAssignment
from trigpoint.methods.cascade.design import cascade
from trigpoint.methods.cascade.gains import root_injection
from trigpoint.methods.cascade.splitting import split_by_agents
from trigpoint.methods.cascade.targets import deal, nearest_list, parted
from trigpoint.methods.spectrum_assignment import possible_roots
from trigpoint.model import SharedPlant
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing import check_design

KINDS = ["directed ring", "ring", "random"]
SIZES = [(3, 2), (4, 3), (5, 4), (8, 4), (10, 6)]


def reals(problem: SharedPlant, low: float = -4.0, high: float = -1.0) -> list[float]:
    return np.linspace(low, high, problem.n_agents * problem.n_states).tolist()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("m", "n"), SIZES)
def test_the_bed(m, n, kind) -> None:  # theory 4, 4.1
    problem = bed(m, n, kind, 1)
    observer = tp.design(problem, SpectrumAssignment(reals(problem)))
    facts = observer.facts
    assert facts["block_spectrum_error"] <= 1e-9
    assert facts["structural_residual"] <= 1e-12
    assert facts["split_residual"] <= 1e-12
    assert facts["largest_gain"] <= 40.0
    assert observer.verify_design_equations().dynamics <= 1e-13
    assert 0.9 <= observer.decay_rate <= 1.0
    assert facts["true_spectrum_error"] < (1e-5 if kind == "directed ring" else 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("m", "n"), [(20, 6), (50, 10)])
def test_the_large_bed(m, n, kind) -> None:
    problem = bed(m, n, kind, 1)
    observer = tp.design(problem, SpectrumAssignment(reals(problem)))
    assert observer.facts["block_spectrum_error"] <= 1e-9
    assert observer.facts["structural_residual"] <= 1e-12
    assert observer.decay_rate > 0.1
    if (m, kind) == (20, "directed ring"):  # theory 4.3b: the stored matrix is not the block matrix
        assert observer.facts["true_spectrum_error"] > 0.01
        assert observer.facts["dense_spectrum"] == "sensitive"


def test_500_agents_of_10_states_are_designed_and_converge() -> None:
    rng = np.random.default_rng(0)
    points = rng.random((500, 2))
    graph = nx.random_geometric_graph(500, 0.12, pos=dict(enumerate(points)))
    assert nx.is_connected(graph)
    small = bed(10, 10, "ring", 3)
    outputs = [small.outputs[agent % 10] if agent % 7 else None for agent in range(500)]
    problem = SharedPlant(small.A, outputs, graph.to_directed())
    observer = tp.design(problem, SpectrumAssignment(reals(problem, -3.0, -2.0)))
    assert observer.facts["block_spectrum_error"] <= 1e-9
    assert observer.facts["arcs_used"] < 0.8 * graph.number_of_edges() * 2
    assert observer.facts["largest_gain"] < 60.0


@given(drawn_plants())
@settings(max_examples=25, deadline=None)
def test_drawn_plants_obey_the_axioms(problem) -> None:
    observer = check_design(SpectrumAssignment(reals(problem)), problem)
    assert observer.facts["block_spectrum_error"] <= 1e-8


def test_agents_that_sense_nothing_learn_the_state_at_the_asked_rate() -> None:
    problem = SharedPlant([[0.1, 1.0], [-1.0, 0.1]], [[[1.0, 0.0]], None, None], {0: [2], 1: [0], 2: [1]})
    observer = tp.design(problem, SpectrumAssignment([-1.0 - 0.1 * k for k in range(6)]))
    run = simulate(problem, observer, Scenario(np.linspace(0.0, 20.0, 41), np.arange(6.0), 1.0))
    assert run.measured_decay_rate() >= 0.95
    assert 1 not in {label for node in observer.nodes for label in node.reads}, "nobody reads an empty output"


def test_the_design_is_certified() -> None:
    problem = bed(5, 4, "random", 1)
    observer = tp.design(problem, SpectrumAssignment(reals(problem)))
    certificate = certify(problem, observer)
    assert certificate.verdict == "certified"
    assert certificate.records[0].numbers["rate"] >= 0.9
    assert verify(certificate, problem, observer).outcome == "certified"


def weakly_coupled(seed: int) -> SharedPlant:
    """Every agent sees one block clearly and everything a little."""
    rng = np.random.default_rng(seed)
    plant = bed(4, 6, "ring", seed)
    noise = 1e-4
    A = plant.A + noise * rng.normal(size=plant.A.shape)
    outputs = [C + noise * rng.normal(size=C.shape) for C in plant.outputs]
    return SharedPlant(A, outputs, dict(enumerate(plant.hears)))


@pytest.mark.parametrize("seed", range(4))
def test_nobody_is_asked_for_what_it_sees_weakly(seed) -> None:
    problem = weakly_coupled(seed)
    observer = tp.design(problem, SpectrumAssignment(reals(problem)))
    lists = parted(reals(problem))
    takes_all = split_by_agents(problem.A, problem.outputs, [0], 1e-13)
    assert takes_all is not None, "the first agent alone could observe everything"
    greedy = cascade(problem, takes_all, *lists).gains.largest
    assert observer.facts["largest_gain"] <= 0.01 * greedy
    assert observer.spectral_abscissa < -0.5, "the split is inexact, the observer is not unstable"
    assert observer.decay_rate > 0.0


def test_deadbeat_ends_after_the_tree_has_passed_it_on() -> None:
    problem = bed(10, 6, "random", 2)
    step = SharedPlant(la.expm(0.3 * problem.A), problem.outputs, dict(enumerate(problem.hears)))
    observer = tp.design(step, SpectrumAssignment([0.0] * 60, discrete=True))
    H = observer.error_matrix().toarray()
    size = float(np.linalg.norm(H, 2))
    longest = sum(observer.facts["blocks"]) * (observer.facts["depth"] + 1)
    assert np.abs(np.linalg.matrix_power(H, longest)).max() < 1e-9 * size
    run = simulate(step, observer, Scenario(0.3 * np.arange(0, longest + 1), 1.0, period=0.3))
    assert run.error_norm[-1] < 1e-9 * run.error_norm.max()


def test_theorem_1_has_its_further_eigenvalues() -> None:
    problem = bed(3, 2, "ring", 1)
    values = [*reals(problem), -7.0, -8.0]
    observer = check_design(SpectrumAssignment(values, order="theorem-1"), problem)
    got = np.sort(la.eigvals(observer.error_matrix().toarray()).real)
    assert np.abs(got - np.sort(values)).max() < 1e-9


def test_repeated_targets_of_a_single_output() -> None:
    A, C = np.array([[0.0, 1.0, 0], [0, 0, 1.0], [0, 0, 0]]), np.array([[1.0, 0, 0]])
    L = root_injection(A, C, [-1.0, -1.0, -1.0])
    assert np.abs(np.poly(A - L @ C) - [1, 3, 3, 1]).max() < 1e-9


def test_precise_eigenvalues_see_what_doubles_do_not() -> None:
    n = 20
    M = np.diag(np.full(n, -1.0)) + np.diag(np.full(n - 1, 100.0), 1)
    assert np.abs(precise_eigenvalues(M) + 1.0).max() < 1e-12
    assert np.abs(la.eigvals(M + 1e-16 * np.eye(n)[:, ::-1]) + 1.0).max() > 1e-3


def test_without_the_precise_engine_the_fact_is_none(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "flint", None)
    problem = bed(3, 2, "ring", 1)
    assert tp.design(problem, SpectrumAssignment(reals(problem))).facts["true_spectrum_error"] is None


# -- lists -------------------------------------------------------------------------------------------------------------
def test_lists_are_dealt_and_the_nearest_one_is_offered() -> None:
    assert deal([1, 2, 3], [-1.0, -2.0], [-3 + 1j, -4 + 1j]) == [[-1], [-4 + 1j, -4 - 1j], [-2, -3 + 1j, -3 - 1j]]
    assert deal([1, 1], [], [-1 + 1j]) is None
    offered = nearest_list([], [-1 + 0.1j, -2 + 3j], 2)
    assert offered == [-1, -1, -2 + 3j, -2 - 3j]


def test_a_list_that_cannot_be_dealt_is_refused_with_the_nearest() -> None:
    problem = SharedPlant(np.diag([0.0, -1.0, 1.0]), [[[1.0, 1.0, 1.0]], None], {0: [1], 1: [0]})
    values = [-1 + 1j, -1 - 1j, -2 + 1j, -2 - 1j, -3 + 2j, -3 - 2j]
    with pytest.raises(MethodError, match=r"at least 2 real eigenvalues.*The nearest list that can be dealt is"):
        tp.design(problem, SpectrumAssignment(values))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SpectrumAssignment([1j]), "closed under conjugation"),
        (lambda: SpectrumAssignment([np.nan]), "finite numbers"),
        (lambda: SpectrumAssignment([-1.0], order="free"), "order must be"),
        (lambda: SpectrumAssignment([-1.0], tolerance=2.0), "tolerance must be"),
        (lambda: SpectrumAssignment([-1.0]).build(bed(3, 2, "ring", 1)), r"must be 6 numbers \(3 agents x 2 states\)"),
        (lambda: SccCascade(0.0), "rate must be a positive number"),
        (lambda: SccCascade(1.0, "magic"), "inner must be"),
    ],
)
def test_nonsense_is_refused(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


def test_other_problems_are_refused() -> None:
    network = tp.NetworkedAgents(tp.graphs.chain(3), tp.LinearAgent.static())
    for method in (SpectrumAssignment([-1.0]), SccCascade(1.0)):
        with pytest.raises(MethodError, match="a SharedPlant problem"):
            tp.design(network, method)


def test_a_plant_that_is_not_seen_names_who_lacks_what() -> None:
    blind = SharedPlant(np.diag([0.1, 0.2]), [[[1.0, 0.0]], None], {0: [1], 1: [0]})
    with pytest.raises(MethodError, match="agents that can all know the state"):
        tp.design(blind, SpectrumAssignment([-1.0, -2.0, -3.0, -4.0]))


# -- SCC cascade (W17, IV-B) -------------------------------------------------------------------------------------------
def nine_agents() -> SharedPlant:
    """Four strongly connected components, two of them sources: {0, 1, 2}, {3, 4}, {5, 6}, {7, 8}."""
    rng = np.random.default_rng(5)
    A = la.block_diag([[0.1, 1.0], [-1.0, 0.1]], [[0.0, 2.0], [-2.0, 0.0]])
    turn = la.qr(rng.normal(size=(4, 4)))[0]
    C = [np.eye(4)[[0]], np.eye(4)[[2]], None, np.eye(4)[[1]], np.eye(4)[[3]], None, np.eye(4)[[0]], None, None]
    hears = {0: [2], 1: [0], 2: [1], 3: [4], 4: [3], 5: [6, 1], 6: [5], 7: [8, 5], 8: [7, 4]}
    return SharedPlant(turn @ A @ turn.T, [None if row is None else row @ turn.T for row in C], hears)


@pytest.mark.parametrize("inner", ["spectrum-assignment", "coupling-gain"])
def test_nine_agents_in_four_components(inner) -> None:
    problem = nine_agents()
    observer = check_design(SccCascade(1.0, inner), problem)
    assert observer.facts["sources"] == ("0, 1, 2", "3, 4")
    assert observer.facts["block_spectrum_error"] < 1e-9
    assert observer.spectral_abscissa <= -1.0 + 1e-6
    assert observer.decay_rate > 0.9
    if inner == "spectrum-assignment":
        wanted = [*np.linspace(-2, -1, 12), *np.linspace(-2, -1, 8)]
        depth = {5: 1, 6: 2, 7: 2, 8: 1}
        for agent, steps in depth.items():
            rate = 1.25**steps
            wanted += np.linspace(-1.2 * rate, -rate, 4).tolist()
            assert observer.nodes[agent].n_states == 4
        true = precise_eigenvalues(observer.error_matrix().toarray())
        assert np.abs(np.sort(true.real) - np.sort(wanted)).max() < 1e-9


def test_spectrum_assignment_points_to_the_scc_cascade() -> None:
    with pytest.raises(MethodError, match="Use SccCascade"):
        tp.design(nine_agents(), SpectrumAssignment(reals(nine_agents())))


def test_a_source_that_does_not_see_everything_is_refused_and_named() -> None:
    blind = SharedPlant(np.diag([0.1, 0.2, 0.3, 0.4]), [np.eye(4)[[0]], None], {1: [0]})
    with pytest.raises(MethodError, match=r"source components that see the whole plant.*agents 0 do not"):
        tp.design(blind, SccCascade(1.0))


def test_roots_are_agents_that_reach_everybody() -> None:
    problem = SharedPlant([[0.0]], [[[1.0]], None, None], {1: [0], 2: [1]})
    assert possible_roots(problem) == [0]
    observer = tp.design(problem, SpectrumAssignment([-1.0, -2.0, -3.0]))
    assert observer.facts["depth"] == 2


# -- Gauss-Newton on all gains (theory 4.2) ----------------------------------------------------------------------------
def disk(count: int) -> list[complex]:
    """A conjugate-symmetric cloud around -2.5 of radius 1.5, without a real number."""
    rng = np.random.default_rng(0)
    radius, angle = 1.5 * np.sqrt(rng.uniform(0.02, 1.0, count // 2)), rng.uniform(0.05, 0.95, count // 2) * np.pi
    upper = -2.5 + radius * np.exp(1j * angle)
    return [*upper.tolist(), *upper.conj().tolist()]


@pytest.mark.parametrize(("m", "n"), [(3, 2), (4, 3), (5, 4), (8, 4), pytest.param(10, 6, marks=pytest.mark.slow)])
def test_lists_without_a_real_number_are_reached_on_rings(m, n) -> None:
    problem = bed(m, n, "ring", 1)
    observer = tp.design(problem, SpectrumAssignment(disk(m * n), refine="newton"))
    assert observer.facts["refined_error"] <= 1e-8
    assert observer.facts["true_spectrum_error"] <= 1e-8
    assert observer.facts["largest_gain"] < 40.0
    assert observer.verify_design_equations().dynamics < 1e-13


def test_where_the_search_fails_its_residual_is_told() -> None:
    with pytest.raises(MethodError, match=r"that Gauss-Newton reaches .*; got an error of .* after \d+ steps"):
        tp.design(bed(5, 4, "directed ring", 1), SpectrumAssignment(disk(20), refine="newton"))
    with pytest.raises(MethodError, match="at most 150 states"):
        tp.design(bed(31, 5, "ring", 1), SpectrumAssignment([-1.0 - 0.01 * k for k in range(155)], refine="newton"))
    with pytest.raises(ArgumentError, match="refine must be None or 'newton'"):
        SpectrumAssignment([-1.0], refine="luck")
