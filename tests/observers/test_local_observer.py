"""``LocalObserver``: pure, local, exact between exchanges, stable for every period, honest about what is missing."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph, chain, cycle, grid
from trigpoint.methods import LocalKalman, design
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers import DiffusiveObserver, LocalState, Message

from .drawn import everything, exchange, observers


def frozen_copy(states, messages, readings) -> list:
    return [
        {k: (s.time, s.sequence, s.estimate.tolist()) for k, s in states.items()},
        {k: (m.sender, m.sequence, m.time, m.estimate.tolist()) for k, m in messages.items()},
        {k: r.tolist() for k, r in readings.items()},
    ]


@settings(max_examples=25)
@given(observers(), st.integers(0, 999))
def test_equal_arguments_give_equal_results_and_nothing_is_mutated(observer, seed) -> None:
    rng = np.random.default_rng(seed)
    states, messages, readings = exchange(observer, rng)
    before = frozen_copy(states, messages, readings)
    name = observer.graph.names[-1]
    used, fresh = observer.local(observer.graph.n_nodes - 1), observer.local(observer.graph.n_nodes - 1)
    first = used.step(states[name], messages, readings, 0.3)
    used.step(used.init(rng.normal(size=used.n_states)), {}, {}, 7.0)
    used.step(first, messages, readings, 0.3)
    again = used.step(states[name], messages, readings, 0.3)
    other = fresh.step(states[name], messages, readings, 0.3)
    assert np.array_equal(first.estimate, again.estimate)
    assert np.array_equal(first.estimate, other.estimate)
    assert (first.time, first.sequence) == (0.3, 1)
    assert not first.estimate.flags.writeable
    assert frozen_copy(states, messages, readings) == before


@settings(max_examples=25)
@given(observers(), st.integers(0, 999))
def test_what_lies_outside_the_neighbourhood_is_never_touched(observer, seed) -> None:
    """Poison test: NaN in every foreign message and reading."""
    rng = np.random.default_rng(seed)
    states, messages, readings = exchange(observer, rng)
    graph = observer.graph
    for node, name in enumerate(graph.names):
        near = {graph.names[j] for j in graph.neighbours(node)}
        own = {arc.label for arc in observer.local(node).arcs}
        poisoned = {
            key: m if key in near else Message(key, 0, 0.0, np.full(m.estimate.shape, np.nan))
            for key, m in messages.items()
        }
        wrong = {k: y if k in own else np.full(y.shape, np.nan) for k, y in readings.items()}
        local = observer.local(node)
        clean = local.step(states[name], messages, readings, 0.4).estimate
        assert np.isfinite(clean).all()
        assert np.array_equal(local.step(states[name], poisoned, wrong, 0.4).estimate, clean)
        assert np.array_equal(
            local.derivative(states[name], poisoned, wrong), local.derivative(states[name], messages, readings)
        )


def without_arcs(observer: DiffusiveObserver, gone: list[int]) -> DiffusiveObserver:
    graph = observer.graph
    keep = np.setdiff1d(np.arange(graph.n_arcs), gone)
    weight = None if graph.weight is None else graph.weight[keep]
    smaller = MeasurementGraph(graph.n_nodes, graph.tail[keep], graph.head[keep], weight, graph.names)
    return dataclasses.replace(observer, problem=NetworkedAgents(smaller, observer.problem.agents))


@settings(max_examples=25)
@given(observers(), st.integers(0, 999), st.data())
def test_a_missing_reading_removes_its_arc(observer, seed, data) -> None:
    graph = observer.graph
    gone = data.draw(st.lists(st.sampled_from(range(graph.n_arcs)), unique=True) if graph.n_arcs else st.just([]))
    states, messages, readings = exchange(observer, np.random.default_rng(seed))
    smaller = without_arcs(observer, gone)
    keep = [k for k in range(graph.n_arcs) if k not in gone]
    for node, name in enumerate(graph.names):
        heard = {k: readings[k] for k in keep}
        there = {new: readings[old] for new, old in enumerate(keep)}
        one = observer.local(node).step(states[name], messages, heard, 0.5).estimate
        other = smaller.local(node).step(states[name], messages, there, 0.5).estimate
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)


@settings(max_examples=25)
@given(observers(), st.integers(0, 999), st.data())
def test_a_missing_message_removes_all_arcs_to_that_neighbour(observer, seed, data) -> None:
    graph = observer.graph
    node = data.draw(st.sampled_from(range(graph.n_nodes)))
    silent = data.draw(
        st.sets(st.sampled_from(graph.neighbours(node).tolist())) if len(graph.neighbours(node)) else st.just(set())
    )
    states, messages, readings = exchange(observer, np.random.default_rng(seed))
    ends = [(int(t), int(h)) for t, h in zip(graph.tail, graph.head, strict=True)]
    gone = [k for k, (t, h) in enumerate(ends) if (t == node and h in silent) or (h == node and t in silent)]
    gone = [k for k in gone if not graph.is_external[k]]
    smaller = without_arcs(observer, gone)
    there = {new: readings[old] for new, old in enumerate(k for k in range(graph.n_arcs) if k not in gone)}
    heard = {name: m for name, m in messages.items() if graph.index(name) not in silent}
    state = states[graph.names[node]]
    one = observer.local(node).step(state, heard, readings, 0.5).estimate
    other = smaller.local(node).step(state, messages, there, 0.5).estimate
    np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)


def test_a_node_that_hears_nothing_runs_its_model_alone() -> None:
    from scipy.linalg import expm

    observer = everything()
    node = observer.local(3)
    state = node.init(np.array([1.0, -2.0, 0.5]))
    alone = node.step(state, {}, {}, 1.7).estimate
    np.testing.assert_allclose(alone, expm(1.7 * node.A) @ state.estimate, rtol=1e-13)


@settings(max_examples=20)
@given(observers(), st.sampled_from([0.01, 0.3, 1.5]), st.integers(0, 999))
def test_a_step_integrates_its_own_equation_exactly(observer, period, seed) -> None:
    """z' = A z + B u + sum gain (sign y + C_j z_j(0) - C z) - with the model's share of the own motion excluded.

    The innovation is r(0) - C (w - e^{A t} z(0)): the held reading is compared with the corrected part of the own
    value, so that z = e^{A t} z(0) + drive + w with w' = (A - sum gain C) w + sum gain r(0).
    """
    rng = np.random.default_rng(seed)
    states, messages, readings = exchange(observer, rng)
    node = observer.graph.n_nodes - 1
    local = observer.local(node)
    state = states[local.name]
    u = rng.normal(size=observer.agent.n_inputs)
    pull = local.derivative(state, messages, readings) - local.A @ state.estimate
    closed = local.A - sum((arc.gain @ arc.output for arc in local.arcs), np.zeros_like(local.A))
    n = local.n_states

    def slope(_, both):
        free, correction = both[:n], both[n:]
        return np.concatenate([local.A @ free + local.B @ u, closed @ correction + pull])

    start = np.concatenate([state.estimate, np.zeros(n)])
    end = solve_ivp(slope, (0, period), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    stepped = local.step(state, messages, readings, period, u).estimate
    np.testing.assert_allclose(stepped, end[:n] + end[n:], rtol=1e-9, atol=1e-9 * max(np.abs(end).max(), 1.0))


@settings(max_examples=20)
@given(observers(static=True), st.sampled_from([0.01, 0.3, 1.5]), st.integers(0, 999))
def test_a_static_step_solves_the_held_differential_equation(observer, period, seed) -> None:
    """For A = 0: z' = sum gain (sign y + C_j z_j(0) - C z(t)), own value continuous, everything else held (6-F2)."""
    states, messages, readings = exchange(observer, np.random.default_rng(seed))
    local = observer.local(0)

    def slope(time, value):
        return local.derivative(LocalState(time, 0, value), messages, readings)

    start = states[local.name]
    end = solve_ivp(slope, (0, period), start.estimate, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    stepped = local.step(start, messages, readings, period).estimate
    np.testing.assert_allclose(stepped, end, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("period", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize(
    "graph", [chain(5), cycle(6, anchors=(5,)), grid(3, 3, anchors=(8,))], ids=["chain", "ring", "grid"]
)
def test_static_states_converge_for_every_period(graph, period) -> None:
    """Theory 6-F2: one exchange is a contraction whatever the period; for a long one it is Jacobi's iteration."""
    weight = np.random.default_rng(1).uniform(0.1, 10.0, size=graph.n_arcs)
    problem = NetworkedAgents(graph.with_weight(weight), LinearAgent.static())
    observer = DiffusiveObserver("static", problem, np.eye(1), 2.0, 0.0, None)
    nodes = [observer.local(k) for k in range(graph.n_nodes)]
    columns = []
    for unit in np.eye(graph.n_nodes):
        states = [node.init(np.array([value])) for node, value in zip(nodes, unit, strict=True)]
        inbox = {node.name: node.emit(state) for node, state in zip(nodes, states, strict=True)}
        zero = {k: np.zeros(1) for k in range(graph.n_arcs)}
        columns.append([node.step(s, inbox, zero, period).estimate[0] for node, s in zip(nodes, states, strict=True)])
    step = np.array(columns).T
    assert (step >= -1e-15).all()  # the own share 1 - d / d is zero to rounding
    assert (step.sum(axis=1) <= 1 + 1e-15).all()
    assert np.abs(np.linalg.eigvals(step)).max() < 1
    if period == 1e6:
        L = problem.graph.laplacian().toarray()
        jacobi = np.eye(graph.n_nodes) - L / np.diag(L)[:, None]
        np.testing.assert_allclose(step, jacobi, atol=1e-14)


def test_messages_carry_what_the_state_says() -> None:
    node = everything().local(2)
    state = node.step(node.init(np.array([1.0, 2.0, 3.0]), time=5.0), {}, {}, 0.25)
    message = node.emit(state)
    assert (message.sender, message.sequence, message.time) == ("c d", 1, 5.25)
    assert np.array_equal(message.estimate, node.estimate(state))


def test_the_first_state_is_a_frozen_copy() -> None:
    node = everything().local(0)
    guess = np.array([1.0, 2.0, 3.0])
    state = node.init(guess)
    guess[0] = 99.0
    assert state.estimate.tolist() == [1.0, 2.0, 3.0]
    assert node.init().estimate.tolist() == [0.0, 0.0, 0.0]
    with pytest.raises(ArgumentError, match=r"estimate of node 'a' must have shape \(3,\); got \(2,\)"):
        node.init(np.zeros(2))


@pytest.mark.parametrize("u", [np.zeros(3), np.zeros((2, 1)), np.float64(1.0)])
def test_inputs_must_fit(u) -> None:
    node = everything().local(0)
    with pytest.raises(ArgumentError, match=r"u of node 'a' must fit B \(3, 2\); got"):
        node.derivative(node.init(), {}, {}, u)


def test_a_node_without_inputs_refuses_them() -> None:
    node = dataclasses.replace(everything().local(0), B=None)
    with pytest.raises(ArgumentError, match=r"must fit B None; got \(2,\)"):
        node.step(node.init(), {}, {}, 1.0, np.zeros(2))


def test_the_memo_of_maps_stays_bounded() -> None:
    node = everything().local(1)
    state = node.init(np.ones(3))
    results = [node.step(state, {}, {}, 0.001 * (k + 1)).estimate for k in range(600)]
    assert len(node._memo) <= 257
    assert np.array_equal(node.step(state, {}, {}, 0.001).estimate, results[0])


def test_a_hub_that_misses_a_few_of_many_steps_without_them_and_remembers_little() -> None:
    star = MeasurementGraph(80, [0] * 79 + [-1], [*range(1, 80), 0])
    problem = NetworkedAgents(star, LinearAgent([[0, 1], [-1, 0]], [[1, 0]]))
    hub = design(problem, LocalKalman()).local(0)
    rng = np.random.default_rng(0)
    state = hub.init(rng.normal(size=2))
    messages = {name: Message(name, 0, 0.0, rng.normal(size=2)) for name in hub.hears}
    readings = {label: rng.normal(size=1) for label in hub.reads}
    for _ in range(100):
        inbox = {name: message for name, message in messages.items() if rng.random() > 0.2}
        left = tuple(arc for arc in hub.arcs if arc.neighbour is None or arc.neighbour in inbox)
        alone = dataclasses.replace(hub, arcs=left, _memo={})
        found = hub.step(state, inbox, readings, 0.1).estimate
        np.testing.assert_array_equal(found, alone.step(state, inbox, readings, 0.1).estimate)
    assert len(hub._memo) <= 50


@settings(max_examples=25)
@given(st.floats(0.0, 3.0), st.integers(0, 999))
def test_an_old_estimate_moves_as_the_model_does(age, seed) -> None:
    rng = np.random.default_rng(seed)
    A, B, value, u = rng.normal(size=(2, 2)), rng.normal(size=(2, 1)), rng.normal(size=2), rng.normal(size=1)
    program = dataclasses.replace(chain_program(), A=A, B=B, arcs=())
    free = program.step(LocalState(0.0, 0, value), {}, {}, max(age, 1e-9), u).estimate
    np.testing.assert_allclose(program.moved(value, age, u), free, rtol=1e-7, atol=1e-7)
    other = rng.normal(size=(2, 2))
    alone = dataclasses.replace(program, A=other, B=None, _memo={})
    np.testing.assert_array_equal(program.moved(value, age, model=other), alone.moved(value, age))


def test_a_map_and_what_is_of_now_do_not_move() -> None:
    program, value = chain_program(), np.array([1.0, 2.0])
    assert program.moved(value, 0.0) is value
    assert program.moved(value, -1.0) is value
    assert dataclasses.replace(program, exchange="discrete").moved(value, 1.0) is value


def test_innovations_are_what_the_correction_is_made_of() -> None:
    program = chain_program()
    state, inbox = LocalState(0.0, 0, np.array([1.0, 2.0])), {"0": Message("0", 0, 0.0, np.array([0.5, 1.0]))}
    readings = {arc.label: np.array([3.0]) for arc in program.arcs}
    found = program.innovations(state, inbox, readings)
    assert [one is None for one in found] == [arc.neighbour != "0" for arc in program.arcs]
    corrected = program.derivative(state, inbox, readings) - program.A @ state.estimate
    total = sum(arc.gain @ one for arc, one in zip(program.arcs, found, strict=True) if one is not None)
    np.testing.assert_allclose(corrected, total, rtol=1e-14)


def chain_program():
    """The middle node of three double integrators in a row."""
    problem = NetworkedAgents(chain(3, anchors=[0]), LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]]))
    return design(problem, LocalKalman()).local(1)
