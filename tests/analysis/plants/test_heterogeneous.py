"""Agents that differ: by hand, against exact rational arithmetic, and thousands at once."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.analysis.plants.oracle import exact_unobservable
from tests.machine import effort
from trigpoint.analysis import heterogeneous
from trigpoint.analysis.heterogeneous import diagnose_heterogeneous
from trigpoint.graphs import MeasurementGraph, cycle
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.model.hyper_network import HyperNetwork


def rotation(frequency: float) -> np.ndarray:
    return np.array([[0.0, frequency], [-frequency, 0.0]])


def kinds(diagnosis) -> list[str]:
    return [finding.kind for finding in diagnosis.findings]


def check_direction(problem, finding) -> None:
    """The direction is an eigenvector of the stacked dynamics that no measurement sees."""
    x = np.zeros(problem.n_states, dtype=complex)
    for row, node in enumerate(finding.nodes):
        size = problem.agents[node].n_states
        x[problem.states(node)] = finding.direction[row, :size]
        assert not finding.direction[row, size:].any()
    A, C = problem.stacked_dynamics(), problem.stacked_output()
    moved = A @ x
    s = x.conj() @ moved
    scale = max(1.0, abs(A).max())
    assert np.linalg.norm(x) == pytest.approx(1.0)
    assert np.linalg.norm(moved - s * x) < 1e-6 * scale
    assert np.linalg.norm(C @ x) < 1e-6 * max(1.0, abs(C).sum())


# -- by hand -----------------------------------------------------------------------------------------------------------
def test_two_unstable_agents_that_differ_and_one_measurement() -> None:
    found = diagnose_heterogeneous(HyperNetwork([0.3, 0.8], [{0: 1.0, 1: 1.0}]))  # E-000-13
    assert found.observable is True
    assert found.detectable is True
    assert found.findings == ()
    assert found.theorem.startswith("G16, Theorem 2 (no shared")


def test_an_integrator_and_three_oscillators_on_a_ring_without_anchor() -> None:
    agents = [LinearAgent(0.0, 1.0), *(LinearAgent(rotation(w), [[1.0, 0.0]]) for w in (1.0, 2.0, 3.5))]
    found = diagnose_heterogeneous(HyperNetwork.of_networked(NetworkedAgents(cycle(4), agents)))
    assert found.observable is True
    assert found.detectable is True
    assert found.findings == ()
    assert found.theorem.startswith("G16, Theorem 2 (no shared")


def test_two_equal_unstable_agents_joined_by_one_arc() -> None:
    problem = HyperNetwork([0.5, 0.5], [{0: -1.0, 1: 1.0}])
    found = diagnose_heterogeneous(problem)
    assert found.observable is False
    assert found.detectable is False
    assert kinds(found) == ["undetectable-mode"]
    assert found.findings[0].nodes == (0, 1)
    np.testing.assert_allclose(found.findings[0].direction, np.ones((2, 1)) / np.sqrt(2.0), atol=1e-12)
    assert "a common motion of nodes 0, 1 with the mode s = 0.5" in found.summary()
    assert "does not cover" in found.theorem


def test_an_absolute_reading_mends_it_but_the_theorem_stays_silent() -> None:
    found = diagnose_heterogeneous(HyperNetwork([0.5, 0.5], [{0: -1.0, 1: 1.0}, {1: 1.0}]))
    assert found.observable is True
    assert found.detectable is True
    assert kinds(found) == ["shared-unstable-modes"]
    assert found.findings[0].nodes == (0, 1)


def test_shared_modes_on_the_axis_do_no_harm() -> None:
    problem = HyperNetwork([rotation(2.0), rotation(2.0)], [{0: [[1.0, 0.0]]}, {0: [[1.0, 0.0]], 1: [[-1.0, 0.0]]}])
    found = diagnose_heterogeneous(problem)
    assert found.detectable is True
    assert found.findings == ()
    assert "semisimple" in found.theorem
    double = [[0.0, 1.0], [0.0, 0.0]]
    found = diagnose_heterogeneous(HyperNetwork([double, double], [{0: [[1.0, 0.0]]}, {1: [[1.0, 0.0]]}]))
    assert kinds(found) == ["shared-unstable-modes"], "a double integrator is not semisimple"
    assert "s = 0)" in found.findings[0].text


def test_two_equal_oscillators_and_one_arc() -> None:
    problem = HyperNetwork([rotation(2.0), rotation(2.0)], [{0: [[1.0, 0.0]], 1: [[-1.0, 0.0]]}], names=["p", "q"])
    found = diagnose_heterogeneous(problem)
    assert found.detectable is False
    assert "nodes p, q with the mode s = 0 +- 2i" in found.findings[0].text
    check_direction(problem, found.findings[0])
    np.testing.assert_allclose(found.findings[0].direction[0], found.findings[0].direction[1], atol=1e-9)


def test_hyper_arcs_on_three_nodes() -> None:
    sums = [{0: 1.0, 1: 1.0, 2: 1.0}, {0: 1.0, 1: -1.0, 2: 0.0}]
    found = diagnose_heterogeneous(HyperNetwork([1.0, 1.0, 1.0], sums))
    assert found.detectable is False
    np.testing.assert_allclose(found.findings[0].direction[:, 0] * np.sqrt(6.0) * -1.0, [1.0, 1.0, -2.0], atol=1e-9)
    whole = diagnose_heterogeneous(HyperNetwork([1.0, 1.0, 1.0], [*sums, {0: 1.0, 1: 1.0, 2: -1.0}]))
    assert whole.observable is True
    differing = diagnose_heterogeneous(HyperNetwork([1.0, 2.0, 3.0], sums[:1]))
    assert differing.observable is True
    assert differing.theorem.startswith("G16, Theorem 2")


def test_a_mode_that_never_enters_an_output_is_one_nodes_own() -> None:
    problem = HyperNetwork([np.diag([-1.0, 2.0, -3.0]), 0.5], [{0: [[1.0, 1.0, 0.0]], 1: 1.0}])
    found = diagnose_heterogeneous(problem)
    assert found.observable is False
    assert found.detectable is True
    assert kinds(found) == ["unobservable-mode"]
    assert found.findings[0].nodes == (0,)
    assert "dies out" in found.findings[0].text
    np.testing.assert_allclose(found.findings[0].direction, [[0.0, 0.0, 1.0]], atol=1e-9)


def test_agents_without_any_measurement() -> None:
    found = diagnose_heterogeneous(HyperNetwork([1.0, -1.0], []))
    assert found.observable is False
    assert found.detectable is False
    assert sorted(kinds(found)) == ["undetectable-mode", "unobservable-mode"]


@pytest.mark.parametrize("size", [2, 3, 4])
@pytest.mark.parametrize("seed", range(4))
def test_unseen_inside_jordan_blocks_of_several_agents(size, seed) -> None:
    rng = np.random.default_rng(seed)
    agents, blocks, bases = [], {}, []
    for node in range(3):
        block = la.block_diag(0.4 * np.eye(size) + np.eye(size, k=1), -1.0 - node)
        Q = la.qr(rng.normal(size=block.shape))[0]
        C = rng.normal(size=(2, size + 1))
        C[:, 0] = [[1.0, 1.0], [1.0, -2.0], [1.0, 1.0]][node]
        agents.append(Q @ block @ Q.T)
        blocks[node] = C @ Q.T
        bases.append(Q[:, 0])
    problem = HyperNetwork(agents, [blocks])
    found = diagnose_heterogeneous(problem)
    assert found.observable is False
    assert found.detectable is False
    finding = found.findings[0]
    check_direction(problem, finding)
    assert finding.nodes == (0, 2)
    expected = np.array([bases[0], -bases[2]]) / np.sqrt(2.0)
    assert min(np.abs(finding.direction - sign * expected).max() for sign in (1, -1)) < 1e-6


@pytest.mark.parametrize(("gap", "expected"), [(1e-6, True), (3e-11, None), (1e-14, False)])
def test_between_the_thresholds_nothing_is_decided(gap, expected) -> None:
    found = diagnose_heterogeneous(HyperNetwork([1.0, 1.0], [{0: 1.0, 1: 1.0}, {0: 1.0, 1: 1.0 + gap}]))
    assert found.observable is expected
    assert found.detectable is expected
    assert ("undecided" in kinds(found)) is (expected is None)


def test_units_of_measurements_do_not_matter() -> None:
    for unit in (1e-14, 1e10):
        assert diagnose_heterogeneous(HyperNetwork([1.0, 1.0], [{0: unit}, {1: 1.0}])).observable is True


def test_agents_of_very_different_speed() -> None:
    agents = [np.diag([1e-6, 2e-6]), np.diag([1e3, -2e3])]
    seen = HyperNetwork(agents, [{0: [[1.0, 1.0]]}, {1: [[1.0, 1.0]]}])
    assert diagnose_heterogeneous(seen).observable is not False
    unseen = diagnose_heterogeneous(HyperNetwork(agents, [{0: [[1.0, 0.0]]}, {1: [[1.0, 1.0]]}]))
    assert unseen.observable is False
    assert unseen.findings[0].nodes == (0,)


def test_a_contradiction_is_undecided(monkeypatch) -> None:
    problem = HyperNetwork([0.3, 0.8], [{0: 1.0, 1: 1.0}])
    monkeypatch.setattr(heterogeneous, "_whole_pair", lambda *_: False)
    found = diagnose_heterogeneous(problem)
    assert found.observable is None
    assert found.detectable is None
    assert kinds(found) == ["undecided"]


# -- against exact arithmetic ------------------------------------------------------------------------------------------
@st.composite
def small_networks(draw):
    entry = st.sampled_from([-1, 0, 0, 1, 2])

    def matrix(rows: int, columns: int) -> np.ndarray:
        cells = st.lists(entry, min_size=rows * columns, max_size=rows * columns)
        return np.array(draw(cells), dtype=float).reshape(rows, columns)

    sizes = draw(st.lists(st.integers(1, 3), min_size=1, max_size=3))
    agents = [matrix(n, n) for n in sizes]
    measurements = []
    for _ in range(draw(st.integers(0, 3))):
        rows = draw(st.integers(1, 2))
        nodes = draw(st.sets(st.integers(0, len(sizes) - 1), min_size=1))
        measurements.append({node: matrix(rows, sizes[node]) for node in sorted(nodes)})
    return HyperNetwork(agents, measurements)


@settings(max_examples=100)
@given(small_networks())
def test_small_networks_against_exact_rank(problem) -> None:
    found = diagnose_heterogeneous(problem)
    A, C = problem.stacked_dynamics().toarray(), problem.stacked_output().toarray()
    unseen = exact_unobservable(A, C)
    assert found.observable is (unseen.shape[1] == 0)
    abscissa = la.eigvals(unseen.T @ A @ unseen).real.max() if unseen.size else -np.inf
    if abs(abscissa) > 1e-3:
        assert found.detectable is bool(abscissa < 0)
    for finding in found.findings:
        if finding.direction is not None:
            check_direction(problem, finding)


# -- many agents -------------------------------------------------------------------------------------------------------
def masses(count: int, seed: int) -> list[LinearAgent]:
    """Position, velocity and a lag of its own for each: all share the double eigenvalue 0, nothing else."""
    rng = np.random.default_rng(seed)
    lags = rng.uniform(0.5, 2.0, size=count)
    return [LinearAgent([[0, 1, 0], [0, 0, 0], [0, 0, -lag]], [[1.0, 0.0, 1.0]]) for lag in lags]


@pytest.mark.parametrize("count", [40, 80, 300])
def test_masses_in_a_grown_network(count) -> None:
    rng = np.random.default_rng(count)
    tail, head = [int(rng.integers(0, k)) for k in range(1, count)], list(range(1, count))
    free = HyperNetwork.of_networked(NetworkedAgents(MeasurementGraph(count, tail, head), masses(count, count)))
    found = diagnose_heterogeneous(free)
    assert found.observable is False
    assert found.detectable is False
    assert found.findings[0].nodes == tuple(range(count))
    expected = np.tile([1.0, 0.0, 0.0], (count, 1)) / np.sqrt(count)
    np.testing.assert_allclose(found.findings[0].direction, expected, atol=1e-6)
    graph = MeasurementGraph(count, [*tail, -1], [*head, count - 1])
    held = diagnose_heterogeneous(HyperNetwork.of_networked(NetworkedAgents(graph, masses(count, count))))
    assert held.observable is True
    assert held.detectable is True
    assert kinds(held) == ["shared-unstable-modes"]


def test_velocities_alone_never_tell_the_position() -> None:
    count = 60
    agents = [LinearAgent(agent.A, [[0.0, 1.0, 1.0]]) for agent in masses(count, 5)]
    arcs = MeasurementGraph(count, [-1, *range(count - 1)], list(range(count)))
    found = diagnose_heterogeneous(HyperNetwork.of_networked(NetworkedAgents(arcs, agents)))
    assert found.detectable is False


def test_two_thousand_agents_in_seconds() -> None:
    rng = np.random.default_rng(0)
    count = 2000
    agents = [rng.normal(size=(2, 2)) for _ in range(count)]
    ring = [{i: rng.normal(size=(1, 2)), (i + 1) % count: rng.normal(size=(1, 2))} for i in range(count)]
    with effort() as spent:
        found = diagnose_heterogeneous(HyperNetwork(agents, ring))
    assert spent.units < 3000.0
    assert found.observable is True
    assert found.theorem.startswith("G16, Theorem 2")


@pytest.mark.slow
@pytest.mark.parametrize("anchored", [False, True])
def test_two_thousand_agents_that_all_share_a_double_mode(anchored) -> None:
    count = 2000
    arcs = MeasurementGraph(
        count, [*range(count - 1), *([-1] * anchored)], [*range(1, count), *([count - 1] * anchored)]
    )
    found = diagnose_heterogeneous(HyperNetwork.of_networked(NetworkedAgents(arcs, masses(count, 1))))
    assert found.observable is anchored
    assert found.detectable is anchored


def test_a_part_that_is_all_rounding_is_not_called_seen() -> None:
    """The mode 0 of this agent is (1, -1), which the output does not see; what is left of it is rounding."""
    problem = HyperNetwork([np.array([[2.0, 2.0], [1.0, 1.0]])], [{0: np.array([[-1.0, -1.0]])}])
    assert diagnose_heterogeneous(problem).observable is False
