"""Networks of agents: stacked matrices against Kronecker products and node-by-node sums."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.graphs import chain
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.model.documents import problem_document, read_problem
from trigpoint.testing.strategies import agents, measurement_graphs


@settings(max_examples=40)
@given(measurement_graphs(max_nodes=5), agents())
def test_equal_agents_give_kronecker_products(graph, agent) -> None:
    problem = NetworkedAgents(graph, agent)
    assert problem.is_homogeneous
    assert problem.agent is agent
    assert problem.n_outputs == agent.n_outputs
    assert (problem.states.count, problem.states.size) == (graph.n_nodes, agent.n_states)
    assert np.array_equal(problem.stacked_dynamics().toarray(), np.kron(np.eye(graph.n_nodes), agent.A))
    assert np.array_equal(problem.stacked_output().toarray(), np.kron(graph.incidence().toarray().T, agent.C))


@settings(max_examples=40)
@given(measurement_graphs(max_nodes=4), st.data())
def test_each_arc_measures_head_minus_tail(graph, data) -> None:
    each = [data.draw(agents(n_outputs=2)) for _ in range(graph.n_nodes)]
    problem = NetworkedAgents(graph, each)
    assert np.array_equal(problem.stacked_dynamics().toarray(), la.block_diag(*(a.A for a in each)))
    states = [np.random.default_rng(k).normal(size=a.n_states) for k, a in enumerate(each)]
    measured = (problem.stacked_output() @ np.concatenate(states)).reshape(graph.n_arcs, 2)
    for k in range(graph.n_arcs):
        head = int(graph.head[k])
        expected = each[head].C @ states[head]
        if not graph.is_external[k]:
            tail = int(graph.tail[k])
            expected = expected - each[tail].C @ states[tail]
        np.testing.assert_allclose(measured[k], expected, atol=1e-13)


def test_agents_that_differ_are_named() -> None:
    one, other = LinearAgent(-1.0, 1.0), LinearAgent(-2.0, 1.0)
    problem = NetworkedAgents(chain(3), [one, one, other])
    assert not problem.is_homogeneous
    with pytest.raises(ArgumentError, match=r"the agents differ: node '2'.*problem.agents"):
        _ = problem.agent
    with pytest.raises(ArgumentError, match="the agents differ"):
        _ = problem.states
    same = NetworkedAgents(chain(2), [one, LinearAgent(-1.0, 1.0, B=1.0)])
    assert same.is_homogeneous, "known inputs may differ"
    for noise in (1.0, 2.0):
        assert not NetworkedAgents(
            chain(2), [LinearAgent(-1.0, 1.0, E=0.5), LinearAgent(-1, 1, E=noise)]
        ).is_homogeneous
    assert not NetworkedAgents(chain(2), [one, LinearAgent(-1.0, 1.0, E=1.0)]).is_homogeneous


def test_every_refusal_says_what_is_wrong() -> None:
    agent = LinearAgent.static(2)
    with pytest.raises(ShapeError, match=r"one agent or one a node \(3\); got 2"):
        NetworkedAgents(chain(3), [agent, agent])
    with pytest.raises(ShapeError, match=r"equally many outputs.*got \[1, 2\]"):
        NetworkedAgents(chain(2), [agent, LinearAgent.static(1)])
    blocks = chain(2).with_weight(np.broadcast_to(np.eye(3), (2, 3, 3)))
    with pytest.raises(ShapeError, match=r"weight blocks are 3 x 3.*2 numbers"):
        NetworkedAgents(blocks, agent)


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=4, weighted=True), agents(inputs=True))
def test_a_problem_comes_back_from_its_document(graph, agent) -> None:
    problem = NetworkedAgents(graph, agent)
    document = problem_document(problem)
    back = read_problem(document)
    assert problem_document(back) == document
    assert len(document["agents"]) == 1
    assert np.array_equal(back.stacked_output().toarray(), problem.stacked_output().toarray())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "other"}, "expected kind 'trigpoint/problem'"),
        ({"version": 99}, "version 99"),
        ({"agents": []}, "does not fit"),
        ({"agents": None}, "does not fit"),
        ({"graph": {}}, "does not fit"),
        ({"agent_of_node": {"type": "i8", "shape": [2], "base64": "//////////8AAAAAAAAAAA=="}}, "does not fit"),
        ({"agent_of_node": {}}, "agent_of_node must be an object"),
    ],
)
def test_a_damaged_document_is_a_protocol_error(change, words) -> None:
    document = problem_document(NetworkedAgents(chain(2), LinearAgent.static()))
    with pytest.raises(ProtocolError, match=words):
        read_problem({**document, **change})
