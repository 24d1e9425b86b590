"""``DiffusiveObserver``: one observer in three forms (stacked, general, local) that agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError
from trigpoint.graphs import chain
from trigpoint.methods import LocalKalman, design
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers import DiffusiveObserver

from .drawn import everything, exchange, observers


def relative_gap(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max(initial=0.0)) / max(float(np.abs(other).max(initial=0.0)), 1.0)


@settings(max_examples=30)
@given(observers())
def test_the_general_form_is_the_stacked_one(observer) -> None:
    form = observer.general_form()
    assert relative_gap(form.H.toarray(), observer.error_matrix().toarray()) <= 1e-14
    assert relative_gap(form.K.toarray(), observer.reading_matrix().toarray()) <= 1e-14
    assert np.array_equal(form.M.toarray(), np.eye(observer.states.total))
    assert not form.N.nnz


@settings(max_examples=30)
@given(observers())
def test_the_design_equations_hold(observer) -> None:
    residuals = observer.verify_design_equations()
    assert residuals.dynamics <= 1e-13
    assert residuals.output <= 1e-13
    form, problem = observer.general_form(), observer.problem
    A, C = problem.stacked_dynamics().toarray(), problem.stacked_output().toarray()
    assert relative_gap(form.H.toarray() + form.K.toarray() @ C, A) <= 1e-13 * max(np.abs(form.H.toarray()).max(), 1.0)


@settings(max_examples=25)
@given(observers())
def test_nodes_hear_their_neighbours_only(observer) -> None:
    """The sparsity of H and K is the network: block (i, j) is zero unless i and j share an arc."""
    form, n, p = observer.general_form(), observer.agent.n_states, observer.problem.n_outputs
    H, K = form.H.toarray(), form.K.toarray()
    graph = observer.graph
    for i in range(graph.n_nodes):
        near = {i, *graph.neighbours(i).tolist()}
        assert observer.local(i).hears == tuple(
            dict.fromkeys(graph.names[j] for j in _ends(graph, i) if j is not None)
        ), "each neighbour once, in the order of the arcs"
        for j in set(range(graph.n_nodes)) - near:
            assert not H[n * i : n * i + n, n * j : n * j + n].any()
        for k in range(graph.n_arcs):
            if i != graph.head[k] and (graph.is_external[k] or i != graph.tail[k]):
                assert not K[n * i : n * i + n, p * k : p * k + p].any()


def _ends(graph, node):
    for k in range(graph.n_arcs):
        if graph.head[k] == node:
            yield None if graph.is_external[k] else int(graph.tail[k])
        elif not graph.is_external[k] and graph.tail[k] == node:
            yield int(graph.head[k])


@settings(max_examples=25)
@given(observers(), st.integers(0, 999))
def test_local_derivatives_are_the_rows_of_the_general_form(observer, seed) -> None:
    rng = np.random.default_rng(seed)
    states, messages, readings = exchange(observer, rng)
    form = observer.general_form()
    u = {name: rng.normal(size=observer.agent.n_inputs) for name in observer.graph.names}
    z = np.concatenate([states[name].estimate for name in observer.graph.names])
    y = np.concatenate([readings[k] for k in range(observer.graph.n_arcs)] or [np.zeros(0)])
    rows = form.H @ z + form.K @ y + form.G @ np.concatenate(list(u.values()))
    stepped = [
        observer.local(k).derivative(states[name], messages, readings, u[name])
        for k, name in enumerate(observer.graph.names)
    ]
    np.testing.assert_allclose(np.concatenate(stepped), rows, atol=1e-12 * max(np.abs(rows).max(), 1.0))


@settings(max_examples=25)
@given(observers(), st.floats(1e-3, 2.0), st.integers(0, 999))
def test_sampled_maps_are_the_local_steps(observer, period, seed) -> None:
    rng = np.random.default_rng(seed)
    states, messages, readings = exchange(observer, rng)
    transition, correction = observer.sampled_maps(period)
    p, graph = observer.problem.n_outputs, observer.graph
    z = np.concatenate([states[name].estimate for name in graph.names])
    y = np.concatenate([readings[k] for k in range(graph.n_arcs)] or [np.zeros(0)])
    innovation = np.zeros((graph.n_nodes, p))
    residual = (y - observer.problem.stacked_output() @ z).reshape(graph.n_arcs, p)
    for k in range(graph.n_arcs):
        weight = graph.arc_weights[k]
        pull = (weight * np.eye(p) if graph.dimension == 1 else weight) @ residual[k]
        innovation[graph.head[k]] += pull
        if not graph.is_external[k]:
            innovation[graph.tail[k]] -= pull
    expected = transition @ z + correction @ innovation.ravel()
    stepped = [
        observer.local(k).step(states[name], messages, readings, period).estimate for k, name in enumerate(graph.names)
    ]
    np.testing.assert_allclose(np.concatenate(stepped), expected, atol=1e-11 * max(np.abs(expected).max(), 1.0))


@pytest.mark.parametrize("node", [-1, 4, 10**9])
def test_a_node_outside_the_network_is_refused(node) -> None:
    with pytest.raises(ArgumentError, match=f"node must be an index from 0 to 3; got {node}"):
        everything().local(node)


def test_without_inputs_there_is_no_input_matrix() -> None:
    assert design(NetworkedAgents(chain(3), LinearAgent.static()), LocalKalman()).general_form().G is None


def test_nothing_is_seen_where_nothing_is_measured() -> None:
    """A network without any arc: every node runs its model alone."""
    from trigpoint.graphs import MeasurementGraph

    problem = NetworkedAgents(MeasurementGraph(2, [], []), LinearAgent(-1.0, 1.0))
    observer = DiffusiveObserver("none", problem, np.ones((1, 1)), 1.0, 0.0, None)
    assert np.array_equal(observer.error_matrix().toarray(), -np.eye(2))
    assert observer.verify_design_equations().dynamics == 0.0
    assert observer.local(1).hears == ()


def test_its_name_says_what_it_is() -> None:
    assert repr(everything()) == "DiffusiveObserver(test, 4 nodes, gain 0.7)"
