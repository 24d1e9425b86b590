"""Shared plants and hyper-networks as values: what they hold, and every refusal."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import chain
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.model.hyper_network import HyperNetwork
from trigpoint.model.shared_plant import SharedPlant
from trigpoint.testing.strategies import agents, measurement_graphs


def test_a_shared_plant() -> None:
    problem = SharedPlant(np.eye(2), [[[1, 0]], None, []], {0: [2, 1, 1, 0], 2: iter([0])}, B=[[1.0], [0.0]])
    assert (problem.n_agents, problem.n_states, problem.n_inputs) == (3, 2, 1)
    assert problem.hears == ((1, 2), (), (0,))
    assert [C.shape for C in problem.outputs] == [(1, 2), (0, 2), (0, 2)]
    assert problem.stacked_output().shape == (1, 2)
    assert sorted(problem.digraph().edges) == [(0, 2), (1, 0), (2, 0)]
    assert list(problem.digraph().nodes) == [0, 1, 2]
    assert repr(problem) == "SharedPlant(2 states, 3 agents, 3 arcs)"
    assert SharedPlant(1.0, [2.0], {}).outputs[0].shape == (1, 1)
    assert SharedPlant(1.0, [2.0], {}).n_inputs == 0


def test_a_digraph_says_who_is_heard() -> None:
    graph = nx.DiGraph([(0, 1), (1, 2), (2, 2)])
    problem = SharedPlant(np.eye(1), [None] * 4, graph)
    assert problem.hears == ((), (0,), (1,), ())
    again = SharedPlant(np.eye(1), [None] * 4, problem.digraph())
    assert again.hears == problem.hears


def test_arrays_are_copied_and_read_only() -> None:
    A, C = np.eye(2), np.ones((1, 2))
    problem = SharedPlant(A, [C], {})
    A[0, 0] = C[0, 0] = 7.0
    assert problem.A[0, 0] == problem.outputs[0][0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        problem.A[0, 0] = 2.0


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((np.ones((2, 3)), [], {}), ShapeError, r"A must be square .*\(2, 3\)"),
        ((np.eye(2), [], {}), ArgumentError, "at least one agent; got none"),
        ((np.eye(2), [[[1, 0]], np.ones((1, 3))], {}), ShapeError, r"agent 1, outputs\[1\].*\(2, 2\).*got \(1, 3\)"),
        ((np.eye(2), [[1, 0]], {}), ShapeError, r"agent 0.*\(any, 2\); got \(2,\)"),
        ((np.eye(2), [[[1, np.nan]]], {}), ArgumentError, r"outputs\[0\] must be finite"),
        ((np.eye(2), [None], {}, np.ones((3, 1))), ShapeError, r"B must have one row a state of A \(2, 2\).*\(3, 1\)"),
        ((np.eye(2), [None], {3: []}), ArgumentError, "key 3, which is no agent; .* 0 to 0"),
        ((np.eye(2), [None] * 2, {0: [2]}), ArgumentError, "agent 0 hears 2, which is no agent"),
        ((np.eye(2), [None] * 2, {0: [True]}), ArgumentError, "agent 0 hears True"),
        ((np.eye(2), [None] * 2, {0: "1"}), ArgumentError, r"neighbours\[0\] must list the agents"),
        ((np.eye(2), [None] * 2, {0: 1}), ArgumentError, r"neighbours\[0\] must list the agents"),
        ((np.eye(2), [None] * 2, [[1], [0]]), ArgumentError, "networkx.DiGraph; got list"),
        ((np.eye(2), [None] * 2, nx.Graph([(0, 1)])), ArgumentError, "undirected"),
        ((np.eye(2), [None] * 2, nx.DiGraph([("a", "b")])), ArgumentError, "node 'a', which is no agent"),
    ],
)
def test_shared_plants_that_are_refused(arguments, error, message) -> None:
    with pytest.raises(error, match=message):
        SharedPlant(*arguments)


def test_a_hyper_network() -> None:
    blocks = [{0: [[1.0, 2.0], [0.0, 1.0]], 2: [[3.0], [4.0]]}, {1: 5.0}]
    problem = HyperNetwork([np.eye(2), LinearAgent(-1.0, 1.0, B=2.0), 0.5], blocks, names=["a", "b", "c"])
    assert (problem.n_nodes, problem.n_states) == (3, 4)
    assert problem.offsets.tolist() == [0, 2, 3, 4]
    assert problem.states(1) == slice(2, 3)
    assert problem.agents[1].n_inputs == 1
    assert np.array_equal(problem.stacked_dynamics().toarray(), la.block_diag(np.eye(2), -1.0, 0.5))
    expected = [[1.0, 2.0, 0.0, 3.0], [0.0, 1.0, 0.0, 4.0], [0.0, 0.0, 5.0, 0.0]]
    assert np.array_equal(problem.stacked_output().toarray(), expected)
    assert repr(problem) == "HyperNetwork(3 agents, 4 states, 2 measurements)"
    assert HyperNetwork([1.0], []).stacked_output().shape == (0, 1)
    assert HyperNetwork([1.0], [{0: 0.0}]).stacked_output().shape == (1, 1)


@settings(max_examples=40)
@given(measurement_graphs(max_nodes=4), st.data())
def test_a_network_of_arcs_keeps_its_matrices(graph, data) -> None:
    networked = NetworkedAgents(graph, [data.draw(agents(n_outputs=2)) for _ in range(graph.n_nodes)])
    problem = HyperNetwork.of_networked(networked)
    assert problem.names == graph.names
    assert np.array_equal(problem.stacked_dynamics().toarray(), networked.stacked_dynamics().toarray())
    assert np.array_equal(problem.stacked_output().toarray(), networked.stacked_output().toarray())


def test_equal_agents_may_be_converted_too() -> None:
    problem = HyperNetwork.of_networked(NetworkedAgents(chain(3), LinearAgent.static()))
    assert len(problem.measurements) == 3
    assert problem.stacked_output().shape == (3, 3)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([], []), ArgumentError, "at least one node; got none"),
        (([np.ones((1, 2))], []), ShapeError, r"agents\[0\] must be .* square matrix A_i; got shape \(1, 2\)"),
        (([1.0], [{}]), ArgumentError, r"measurements\[0\] must map nodes to blocks"),
        (([1.0], [[1.0]]), ArgumentError, r"measurements\[0\] must map nodes to blocks"),
        (([1.0], [{0: 1.0}, {1: 1.0}]), ArgumentError, r"measurements\[1\] names node 1; expected 0 to 0"),
        (([1.0], [{"a": 1.0}]), ArgumentError, "names node 'a'"),
        (([np.eye(2)], [{0: 1.0}]), ShapeError, r"measurements\[0\] at node 0 .*\(2, 2\).*got shape \(1, 1\)"),
        (
            ([1.0, 1.0], [{0: 1.0, 1: [[1.0], [2.0]]}]),
            ShapeError,
            r"equally many rows; got \(1, 1\) at node 0 and \(2, 1\)",
        ),
        (([1.0], [{0: np.inf}]), ArgumentError, r"measurements\[0\]\[0\] must be finite"),
        (([1.0, 2.0], [], ["a", "a"]), ArgumentError, "names must be 2 different texts"),
        (([1.0, 2.0], [], ["a"]), ArgumentError, "names must be 2 different texts"),
    ],
)
def test_hyper_networks_that_are_refused(arguments, error, message) -> None:
    with pytest.raises(error, match=message):
        HyperNetwork(*arguments)
