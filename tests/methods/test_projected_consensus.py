"""``ProjectedConsensus``: the hybrid observer of theory 4b-B3, on fixed and on switching digraphs, and its refusals."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.analysis.plants.oracle import HAN_A, HAN_C, HAN_HEARS
from tests.methods.observed_plants import bed, drawn_plants, hears_of
from trigpoint.errors import ArgumentError, MethodError, ShapeError
from trigpoint.methods.contraction import Contraction
from trigpoint.methods.projected_consensus import ProjectedConsensus
from trigpoint.model import SharedPlant
from trigpoint.observers.local import Message
from trigpoint.observers.projected import ProjectedConsensusObserver, averaging_matrix


def radius(matrix: np.ndarray) -> float:
    return float(np.abs(la.eigvals(matrix)).max())


def drawn_error(observer: ProjectedConsensusObserver, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(len(observer.nodes), observer.problem.n_states))


def stacked(observer: ProjectedConsensusObserver, error: np.ndarray) -> np.ndarray:
    """``(w_i, x_i)`` errors of nodes that begin at their guesses."""
    return np.concatenate([np.concatenate([node.seen.T @ e, e]) for node, e in zip(observer.nodes, error, strict=True)])


def estimates(observer: ProjectedConsensusObserver, stack: np.ndarray) -> np.ndarray:
    parts = [stack[observer.states.slice(k)] for k in range(len(observer.nodes))]
    return np.array([part[node.n_seen :] for node, part in zip(observer.nodes, parts, strict=True)])


# -- the guarantee -----------------------------------------------------------------------------------------------------
@settings(max_examples=40)
@given(drawn_plants(), st.floats(0.2, 4.0), st.floats(0.05, 1.0))
def test_the_spectrum_keeps_the_rate(plant, rate, period) -> None:
    observer = ProjectedConsensus(rate, period).build(plant)
    assert observer.decay_rate == pytest.approx(rate)
    assert np.log(max(radius(observer.period_matrix()), 1e-300)) / period <= -rate + 1e-6
    assert observer.spectral_abscissa <= -rate + 1e-6
    residuals = observer.verify_design_equations()
    assert max(residuals.dynamics, residuals.output) <= 1e-12


@settings(max_examples=25)
@given(drawn_plants(max_agents=4, max_states=4), st.integers(1, 12))
def test_norm_of_given_rounds_against_the_definition(plant, rounds) -> None:
    period = 0.3
    observer = ProjectedConsensus(1.0, period, rounds).build(plant)
    unseen = la.block_diag(*[np.eye(plant.n_states) - node.seen @ node.seen.T for node in observer.nodes])
    average = np.kron(averaging_matrix(plant.hears).toarray(), np.eye(plant.n_states))
    move = np.kron(np.eye(plant.n_agents), la.expm(plant.A * period))
    coupled = move @ np.linalg.matrix_power(unseen @ average, rounds) @ unseen
    assert radius(coupled) <= observer.facts["norm"] + 1e-9
    assert observer.facts["spectral_radius"] <= observer.facts["contraction"] + 1e-9
    assert observer.facts["contraction"] <= 1.0 + 1e-12
    bound = np.linalg.norm(move, 2) * observer.facts["contraction"] ** rounds
    assert observer.facts["norm"] <= bound * (1.0 + 1e-9)
    growth = -np.log(max(radius(observer.period_matrix()), 1e-300)) / period
    assert growth >= observer.decay_rate - 1e-6


@settings(max_examples=25)
@given(drawn_plants(), st.floats(0.5, 4.0))
def test_no_fewer_rounds_would_do(plant, rate) -> None:
    observer = ProjectedConsensus(rate, 0.2).build(plant)
    if observer.rounds > 1:
        fewer = ProjectedConsensus(rate, 0.2, observer.rounds - 1).build(plant)
        assert fewer.facts["norm"] > np.exp(-rate * 0.2)
        assert fewer.decay_rate < rate


@settings(max_examples=15)
@given(drawn_plants(max_agents=4, max_states=3), st.integers(0, 100))
def test_programs_and_period_matrix_agree(plant, seed) -> None:
    observer = ProjectedConsensus(1.0, 0.4).build(plant)
    error = drawn_error(observer, seed)
    run = observer.run(error, np.ones(plant.n_states), 4)
    believed = stacked(observer, error)
    for k in range(5):
        np.testing.assert_allclose(run.error[k], estimates(observer, believed), atol=1e-9)
        believed = observer.period_matrix() @ believed


# -- numbers -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("m", "n", "kind", "rounds"), [(10, 6, "ring", 30), (50, 10, "random", 100)])
def test_the_bed_is_as_fast_as_its_local_observers(m, n, kind, rounds) -> None:
    """Theory 4b-B3: local rate 3, T = .5, measured 2.96 and 2.95 per second with q = 30 and 100."""
    observer = ProjectedConsensus(2.0, 0.5, rounds, local_rate=3.0).build(bed(m, n, kind))
    assert 0.8 < observer.facts["contraction"] < 0.995
    assert observer.facts["predicted_rate"] == pytest.approx(3.0)
    assert -observer.spectral_abscissa == pytest.approx(3.0, rel=0.02)
    run = observer.run(drawn_error(observer), np.zeros(n), 18)
    assert run.measured_decay_rate() >= 2.95


def test_han_trentelman_wang_shen() -> None:
    observer = ProjectedConsensus(1.0, 0.25).build(SharedPlant(HAN_A, HAN_C, HAN_HEARS))
    run = observer.run(0.0 - np.array([[1.0, 3.0, -2.0, -3.0, -1.0, 2.0]] * 4), [1.0, 3.0, -2.0, -3.0, -1.0, 2.0], 40)
    assert run.error_norm[-1] < 2e-4 * run.error_norm[0]
    assert run.measured_decay_rate() >= 1.0


# -- digraphs that change ----------------------------------------------------------------------------------------------
@settings(max_examples=15)
@given(st.integers(2, 5), st.integers(1, 4), st.integers(0, 1000))
def test_a_digraph_that_switches_every_period(m, n, seed) -> None:
    rng = np.random.default_rng(seed)
    plant = bed(m, n, "directed ring", seed)
    others = tuple(hears_of(kind, m, rng) for kind in ("ring", "random", "random"))
    observer = ProjectedConsensus(1.5, 0.3, graphs=others).build(plant)
    family = [dict(enumerate(plant.hears)), *others]
    assert observer.decay_rate == pytest.approx(1.5)
    order = rng.integers(0, len(family), size=24)
    error = drawn_error(observer, seed)
    run = observer.run(error, np.ones(n), 24, hears_at=lambda k: family[order[k]])
    product = np.eye(observer.states.total)
    for k in order:
        product = observer.period_matrix(family[k]) @ product
    np.testing.assert_allclose(run.error[-1], estimates(observer, product @ stacked(observer, error)), atol=1e-8)
    # A product of 24 periods: the guarantee up to its constant, the local observers' transient.
    assert np.linalg.norm(product, 2) <= 1e3 * np.exp(-1.5 * 0.3 * 24)


def test_alternating_rings() -> None:
    """Clockwise at one event, anticlockwise at the next."""
    plant = bed(6, 4, "directed ring", 3)
    back = {i: [(i + 1) % 6] for i in range(6)}
    observer = ProjectedConsensus(2.0, 0.5, graphs=(back,)).build(plant)
    run = observer.run(drawn_error(observer), np.ones(4), 30, hears_at=lambda k: back if k % 2 else plant_hears(plant))
    assert run.measured_decay_rate() >= 2.0


def plant_hears(plant: SharedPlant) -> dict[int, tuple[int, ...]]:
    return dict(enumerate(plant.hears))


def test_without_a_shared_null_vector_row_sums_serve_all() -> None:
    uneven = np.array([[0.5, 0.5, 0.0], [1 / 3, 1 / 3, 1 / 3], [0.5, 0.0, 0.5]])
    even = np.full((3, 3), 1.0 / 3.0)
    projections = [np.diag(row) for row in ([0.0, 1.0], [1.0, 0.0], [1.0, 1.0])]
    alone, together = (Contraction(np.eye(2), projections, family) for family in ([uneven], [uneven, even]))
    assert alone.weights is not None
    assert together.weights is None
    assert alone.norm(8) <= together.norm(8) < 1.0
    assert together.rounds_for(1.0, 1.0, 1000) is not None


# -- the pieces --------------------------------------------------------------------------------------------------------
def test_known_input_leaves_no_error() -> None:
    plant = bed(4, 3, "ring", 2, inputs=2)
    observer = ProjectedConsensus(1.0, 0.5).build(plant)
    error = drawn_error(observer)
    still, driven = (observer.run(error, np.ones(3), 6, inputs=u) for u in (None, [1.0, -2.0]))
    assert np.abs(still.truth[-1] - driven.truth[-1]).max() > 0.1
    np.testing.assert_allclose(still.error, driven.error, atol=1e-9)
    assert observer.local(0).B.shape == (observer.nodes[0].n_seen + 3, 2)


def test_flow_of_a_program_is_the_flow_of_the_error() -> None:
    """Between events the pure program, stepped finely with held readings, follows the matrix."""
    plant = bed(3, 2, "ring", 1)
    observer = ProjectedConsensus(1.0, 0.1).build(plant)
    node, x, h = observer.nodes[0], np.array([1.0, -1.0]), 0.1 / 2000
    e = np.array([0.3, 0.2])
    state, error = node.init(x + e), np.concatenate([node.seen.T @ e, e])
    step = la.expm(plant.A * h)
    for _ in range(2000):
        ahead = step @ x
        state, x = node.flow.step(state, {}, {0: plant.outputs[0] @ (x + ahead) / 2}, h), ahead
    part = observer.states.slice(0)
    expected = observer.flow_matrix().toarray()[part, part] @ error
    np.testing.assert_allclose(state.estimate - np.concatenate([node.seen.T @ x, x]), expected, atol=1e-4)


def test_rounds_are_pure_and_local() -> None:
    plant = bed(4, 3, "ring", 1)
    node = ProjectedConsensus(1.0, 0.5).build(plant).nodes[1]
    state = node.init(np.array([1.0, 2.0, 3.0]))
    inbox = {"0": Message("0", 0, 0.0, np.ones(3)), "2": Message("2", 0, 0.0, np.zeros(3))}
    once, again = node.round(state, inbox), node.round(state, inbox)
    np.testing.assert_array_equal(once.estimate, again.estimate)
    assert once.sequence == 1
    assert once.time == state.time
    np.testing.assert_array_equal(node.estimate(state), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(node.seen.T @ node.estimate(once), once.estimate[: node.n_seen], atol=1e-14)
    np.testing.assert_array_equal(node.estimate(node.round(state, {})), node.estimate(state))
    np.testing.assert_array_equal(node.emit(state).estimate, [1.0, 2.0, 3.0])
    with pytest.raises(ArgumentError, match=r"estimate of node '1' must have shape \(3,\)"):
        node.init(np.zeros(2))


def test_the_program_reaches_numpy_only() -> None:
    import trigpoint.observers.projection as module

    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    imported = {
        node.module.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module
    }
    imported |= {
        name.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names
    }
    assert imported - set(sys.stdlib_module_names) <= {"numpy", "trigpoint"}


def test_the_observer_as_a_value() -> None:
    plant = bed(4, 3, "ring", 1)
    observer = ProjectedConsensus(1.0, 0.5).build(plant)
    assert observer.names == ("0", "1", "2", "3")
    form = observer.general_form()
    np.testing.assert_allclose(form.H.toarray(), observer.error_matrix().toarray(), atol=1e-12)
    assert "4 agents, 3 states" in repr(observer)
    jump = observer.jump_matrix({i: [(i + 1) % 4] for i in range(4)}).toarray()
    V = observer.between_events.target_matrix().toarray()
    np.testing.assert_allclose(jump @ V, V, atol=1e-14)
    run = observer.run(1.0, np.zeros(3), 2)
    np.testing.assert_array_equal(run.messages[:, 0], observer.rounds * np.arange(3))
    np.testing.assert_allclose(run.times, [0.0, 0.5, 1.0])


def test_agents_that_see_everything_need_one_round() -> None:
    plant = SharedPlant([[0.0, 1.0], [0.0, 0.0]], [[[1.0, 0.0]]] * 3, {0: [1], 1: [2], 2: [0]})
    observer = ProjectedConsensus(1.0, 0.5).build(plant)
    assert observer.rounds == 1
    assert observer.facts["coupled_rate"] is None
    assert observer.spectral_abscissa <= -1.0


# -- refusals ----------------------------------------------------------------------------------------------------------
def test_arguments() -> None:
    for choices in ({"rate": 0.0}, {"rate": np.nan}, {"period": -1.0}, {"local_rate": 0.0}):
        with pytest.raises(ArgumentError, match="must be positive and finite"):
            ProjectedConsensus(**{"rate": 1.0, "period": 1.0, **choices})
    for rounds in (0, 1.5, True):
        with pytest.raises(ArgumentError, match="rounds must be a whole number"):
            ProjectedConsensus(1.0, 1.0, rounds)
    with pytest.raises(ArgumentError, match="shorten the period"):
        ProjectedConsensus(1e3, 1.0)


def test_run_arguments() -> None:
    observer = ProjectedConsensus(1.0, 0.5).build(bed(3, 2, "ring"))
    with pytest.raises(ShapeError, match="initial_state must have shape"):
        observer.run(1.0, np.zeros(3), 1)
    with pytest.raises(ShapeError, match="initial_error must be a scalar or"):
        observer.run(np.zeros(3), np.zeros(2), 1)
    with pytest.raises(ArgumentError, match="events must be a whole number"):
        observer.run(1.0, np.zeros(2), 0)
    with pytest.raises(ShapeError, match="inputs must have shape"):
        observer.run(1.0, np.zeros(2), 1, inputs=[1.0])


def test_problems_that_are_refused() -> None:
    rows = np.eye(2)
    A = np.diag([0.1, 0.2])
    with pytest.raises(MethodError, match="needs a SharedPlant; got str"):
        ProjectedConsensus(1.0, 1.0).build("plant")
    with pytest.raises(MethodError, match=r"agent 0 hears nobody else.*Let agent 0 hear agent 1"):
        ProjectedConsensus(1.0, 1.0).build(SharedPlant(A, [rows[:1], rows[1:]], {1: [0]}))
    listener = SharedPlant(A, [rows, None], {1: [0]})
    with pytest.raises(MethodError, match="strongly connected digraphs; got the problem's digraph with 2 components"):
        ProjectedConsensus(1.0, 1.0).build(listener)
    both = SharedPlant(A, [rows[:1], rows[1:]], {0: [1], 1: [0]})
    with pytest.raises(MethodError, match=r"graphs\[0\] with 2 components"):
        ProjectedConsensus(1.0, 1.0, graphs=({0: [1]},)).build(both)


def test_rounding_and_weak_sight() -> None:
    nearly = SharedPlant(0.1 * np.eye(2), [[[1.0, 0.0]], [[1.0, 1e-5]]], {0: [1], 1: [0]})
    with pytest.raises(MethodError, match="rounds a period reach"):
        ProjectedConsensus(1.0, 1.0).build(nearly)
    weak = [[1.0, 1e-5, 0.0], [0.0, 1.0, 1e-5], [0.0, 0.0, 1.0]]
    with pytest.raises(MethodError, match="clearly enough for its own observer"):
        ProjectedConsensus(1.0, 1.0).build(SharedPlant(weak, [[[1.0, 0.0, 0.0]], np.eye(3)], {0: [1], 1: [0]}))
    unclear = [[5.0, 2e-8, 0.0], [0.0, 5.0, 2e-8], [0.0, 0.0, 5.0]]
    with pytest.raises(MethodError, match="a clear gap"):
        ProjectedConsensus(1.0, 1.0).build(SharedPlant(unclear, [[[1.0, 0.0, 0.0]], np.eye(3)], {0: [1], 1: [0]}))
