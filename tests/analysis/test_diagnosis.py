"""Diagnosis: which nodes cannot be known, why, and what to add."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis import diagnose
from trigpoint.errors import ArgumentError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, grid
from trigpoint.model import LinearAgent, Network, NetworkedAgents
from trigpoint.testing.strategies import agents, measurement_graphs

DOUBLE_INTEGRATOR = LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]])
HURWITZ = LinearAgent([[-1.0, 1.0], [0.0, -2.0]], [[1.0, 0.0]])
UNSEEN_UNSTABLE = LinearAgent(np.diag([-1.0, 0.5]), [[1.0, 0.0]])
UNSEEN_STABLE = LinearAgent(np.diag([-1.0, 0.5]), [[0.0, 1.0]])


@settings(max_examples=60)
@given(st.one_of(measurement_graphs(), measurement_graphs(weighted=True), measurement_graphs(blocks=2)))
def test_a_graph_is_observable_exactly_when_externally_connected(graph) -> None:
    found = diagnose(graph)
    assert found.observable is found.detectable is graph.is_externally_connected
    islands = [finding.nodes for finding in found.findings]
    floating = [tuple(c.tolist()) for c, a in zip(graph.components, graph.component_is_anchored, strict=True) if not a]
    assert islands == floating
    assert all(finding.kind == "island" for finding in found.findings)


def kalman_rank(A, C) -> int:
    rows = [C]
    for _ in range(A.shape[0] - 1):
        rows.append(rows[-1] @ A)
    return int(np.linalg.matrix_rank(np.vstack(rows)))


@settings(max_examples=60)
@given(measurement_graphs(max_nodes=4), agents(max_states=2))
def test_the_verdict_agrees_with_the_rank_of_the_whole_network(graph, agent) -> None:
    problem = NetworkedAgents(graph, agent)
    A, C = problem.stacked_dynamics().toarray(), problem.stacked_output().toarray()
    found = diagnose(problem)
    if found.observable is not None:
        assert found.observable == (kalman_rank(A, C) == A.shape[0] if C.size else False)


@settings(max_examples=40)
@given(measurement_graphs(max_nodes=4), agents(max_states=2))
def test_detectability_agrees_with_the_rank_test_at_every_unstable_eigenvalue(graph, agent) -> None:
    problem = NetworkedAgents(graph, agent)
    A, C = problem.stacked_dynamics().toarray(), problem.stacked_output().toarray()
    found = diagnose(problem)
    eigenvalues = np.linalg.eigvals(agent.A)
    if found.detectable is None or (np.abs(eigenvalues.real) < 1e-6).any() or np.ptp(eigenvalues) < 1e-6:
        return
    n = A.shape[0]
    unstable = [s for s in eigenvalues if s.real >= 0]
    ranks = [np.linalg.matrix_rank(np.vstack([s * np.eye(n) - A, C]), tol=1e-9) for s in unstable]
    assert found.detectable == all(rank == n for rank in ranks)


def test_an_anchored_double_integrator_network_is_observable() -> None:
    found = diagnose(NetworkedAgents(grid(3, 3, anchors=(8,)), DOUBLE_INTEGRATOR))
    assert (found.observable, found.detectable, found.findings) == (True, True, ())
    assert found.margin > 1e-3
    assert found.summary() == "observable: yes; detectable: yes (G16, Theorem 3 and Corollary 2)"


def test_every_node_of_a_floating_island_is_listed() -> None:
    graph = MeasurementGraph(20, [EXTERNAL, *range(1, 14), *range(15, 19)], [0, *range(2, 15), *range(16, 20)])
    found = diagnose(graph)
    assert [finding.nodes for finding in found.findings] == [tuple(range(1, 15)), tuple(range(15, 20))]
    first, second = found.findings
    assert "nodes 1, 2, 3, 4, 5, 6, 7, 8 and 6 more" in first.text
    assert "common level" in first.text
    assert "unknown" in first.text
    assert "Add one absolute reading" in first.remedy
    assert "nodes 15, 16, 17, 18, 19 " in second.text
    assert found.summary().count("\n") == 2
    assert found.summary().startswith("observable: no; detectable: no")


def test_the_island_of_the_last_node_alone_is_named() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, 0], [0, 1], names=["a", "b", "lost"])
    (finding,) = diagnose(graph).findings
    assert finding.nodes == (2,)
    assert finding.text.startswith("node lost")


def test_hurwitz_agents_on_a_floating_island_are_detectable_but_not_observable() -> None:
    found = diagnose(NetworkedAgents(chain(4, anchors=()), HURWITZ))
    assert found.observable is False
    assert found.detectable is True
    (finding,) = found.findings
    assert finding.nodes == (0, 1, 2, 3)
    assert "dies out by itself" in finding.text


@pytest.mark.parametrize("seed", range(30))
def test_oscillators_on_a_floating_island_are_not_detectable_in_any_coordinates(seed) -> None:
    Q, _ = la.qr(np.random.default_rng(seed).normal(size=(2, 2)))
    agent = LinearAgent(Q @ np.array([[0.0, 1.7], [-1.7, 0.0]]) @ Q.T, np.eye(2))
    found = diagnose(NetworkedAgents(chain(3, anchors=()), agent))
    assert found.detectable is False
    (finding,) = found.findings
    assert "unknown" in finding.text
    assert "1.7j" in finding.text
    assert "-0" not in finding.text


@pytest.mark.parametrize("agent", [LinearAgent.static(2), DOUBLE_INTEGRATOR, HURWITZ], ids=repr)
def test_the_direction_of_an_island_is_a_motion_that_no_measurement_notices(agent) -> None:
    graph = MeasurementGraph(4, [EXTERNAL, 1, 2], [0, 2, 3])
    problem = NetworkedAgents(graph, agent)
    (finding,) = diagnose(problem).findings
    assert finding.nodes == (1, 2, 3)
    assert finding.direction.shape == (3, agent.n_states)
    assert np.linalg.norm(finding.direction) == pytest.approx(1.0)
    state = np.zeros((4, agent.n_states), dtype=complex)
    state[list(finding.nodes)] = finding.direction
    motion = state.ravel()
    assert np.linalg.norm(problem.stacked_output() @ motion) < 1e-14
    moved = problem.stacked_dynamics() @ motion
    assert np.linalg.norm(moved - (motion.conj() @ moved) * motion) < 1e-7


def test_undetectable_agents_are_found_on_any_network() -> None:
    found = diagnose(NetworkedAgents(chain(3), UNSEEN_UNSTABLE))
    assert (found.observable, found.detectable) == (False, False)
    (finding,) = found.findings
    assert finding.kind == "agent-undetectable"
    assert finding.nodes == (0, 1, 2)
    assert "s = 0.5" in finding.text


def test_agents_with_a_stable_unseen_mode_are_detectable() -> None:
    found = diagnose(NetworkedAgents(chain(3), UNSEEN_STABLE))
    assert (found.observable, found.detectable) == (False, True)
    assert [finding.kind for finding in found.findings] == ["agent-unobservable"]
    assert "s = -1" in found.findings[0].text


def test_both_reasons_are_given_together() -> None:
    found = diagnose(NetworkedAgents(chain(3, anchors=()), UNSEEN_UNSTABLE))
    assert [finding.kind for finding in found.findings] == ["agent-undetectable", "island"]
    assert (found.observable, found.detectable) == (False, False)


def test_what_rounding_decides_is_left_undecided() -> None:
    agent = LinearAgent(np.diag([1.0, 2.0]), [[3e-11, 1.0]])
    found = diagnose(NetworkedAgents(chain(2), agent))
    assert (found.observable, found.detectable) == (None, None)
    assert found.findings[0].kind == "undecided"
    assert "cannot be decided at this precision" in found.summary()
    assert diagnose(NetworkedAgents(chain(2, anchors=()), agent)).observable is False


def test_measured_networks_stand_for_unknown_constants() -> None:
    assert diagnose(Network(chain(2), np.zeros((2, 3)))).observable is True
    assert diagnose(Network(chain(2, anchors=()), [0.0])).detectable is False


def test_agents_that_differ_are_judged_together_and_other_things_are_refused() -> None:
    mixed = NetworkedAgents(chain(2), [LinearAgent([[0.3]], [[1.0]]), LinearAgent([[0.8]], [[1.0]])])
    assert diagnose(mixed).observable is True
    with pytest.raises(ArgumentError, match=r"diagnose takes one of AgreementDynamics, .*, SharedPlant; got int"):
        diagnose(3)
