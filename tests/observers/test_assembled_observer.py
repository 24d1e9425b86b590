"""Observers given by programs: general form, error dynamics, both paths, documents, refusals."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import scipy.linalg as la
from scipy.integrate import quad_vec

import trigpoint as tp
from tests.observers.given import A, hyper_network, hyper_observer, shared_observer, shared_plant
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.model.documents import problem_document, read_problem
from trigpoint.observers.assembled import AssembledObserver, channels_of
from trigpoint.observers.documents import observer_document, read_observer
from trigpoint.observers.local import LocalObserver
from trigpoint.simulation import Channel, Noise, Scenario, simulate
from trigpoint.testing import check_observer

TIMES = np.linspace(0.0, 2.0, 9)
DOUBLE = tp.LinearAgent([[0, 1], [0, 0]], [[1, 0]], B=[[0], [1]])


@pytest.mark.parametrize("observer", [shared_observer(), hyper_observer()], ids=["shared", "hyper"])
def test_the_axioms_hold(observer) -> None:
    check_observer(observer.problem, observer)


def test_the_error_matrix_of_a_shared_plant_is_written_out() -> None:
    H = shared_observer().error_matrix().toarray()
    eye = np.eye(3)
    C0, C1 = np.array([[1.0, 0, 0]]), np.array([[0, 0, 1.0]])
    zero = np.zeros((3, 3))
    expected = np.block(
        [
            [A - 3 * C0.T @ C0 - 2 * eye, 2 * eye, zero],
            [2 * eye, A - 3 * C1.T @ C1 - 4 * eye, 2 * eye],
            [2 * eye, zero, A - 2 * eye],
        ]
    )
    assert np.array_equal(H, expected)


def test_a_measurement_of_three_nodes_pulls_all_of_them() -> None:
    observer, gain = hyper_observer(), 1.5
    C = hyper_network().stacked_output().toarray()
    expected = hyper_network().stacked_dynamics().toarray() - gain * C.T @ C
    assert np.abs(observer.error_matrix().toarray() - expected).max() < 1e-15


def test_a_diffusive_observer_is_its_programs() -> None:
    problem = tp.NetworkedAgents(tp.graphs.grid(3, 3, anchors=(0, 8)), DOUBLE)
    observer = tp.design(problem, tp.methods.LocalKalman())
    programs = observer.as_programs()
    assert np.abs((programs.error_matrix() - observer.error_matrix()).toarray()).max() < 1e-14
    for period in (None, 0.1):
        scenario = Scenario(TIMES, 1.0, 0.3, period=period, inputs=np.ones((9, 1)))
        one, other = simulate(problem, observer, scenario), simulate(problem, programs, scenario)
        assert np.abs(one.estimate - other.estimate).max() < 1e-12
        assert np.array_equal(one.messages, other.messages)


def test_noise_and_losses_are_drawn_alike_for_both_forms() -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(4), DOUBLE)
    observer = tp.design(problem, tp.methods.LocalKalman())
    noise = Noise(measurement=0.1, process=0.2)
    scenario = Scenario(np.arange(5) * 0.5, 1.0, period=0.1, noise=noise, seed=3)
    one, other = simulate(problem, observer, scenario), simulate(problem, observer.as_programs(), scenario)
    assert np.abs(one.truth - other.truth).max() < 1e-13
    assert np.abs(one.estimate - other.estimate).max() < 1e-12


def test_lost_messages_slow_a_shared_plants_agents_down_but_do_not_stop_them() -> None:
    observer = shared_observer(coupling=6.0)
    lossy = Scenario([0.0, 40.0], 1.0, 0.5, period=0.1, channel=Channel(loss=0.3), seed=1)
    run = simulate(observer.problem, observer, lossy)
    assert run.path == "reference"
    assert run.error_norm[-1] < 1e-3 * run.error_norm[0]


def test_known_inputs_reach_plant_and_agents() -> None:
    problem = shared_plant(B=np.array([[0.0], [1.0], [1.0]]))
    observer = shared_observer(problem)
    for period in (None, 0.1):
        with_input, without = (
            simulate(problem, observer, Scenario(TIMES, 1.0, 0.2, period=period, inputs=u)) for u in ([2.0], None)
        )
        assert np.abs(with_input.truth - without.truth).max() > 0.1
        assert np.abs(with_input.error - without.error).max() < 1e-10
    form = observer.general_form()
    assert form.G is not None
    assert form.G.shape == (9, 1)


def test_inputs_of_agents_that_differ() -> None:
    observer = hyper_observer()
    scenario = Scenario(TIMES, 1.0, inputs=[[1.0], [2.0], [3.0]])
    moved = simulate(observer.problem, observer, scenario)
    assert np.abs(moved.error - simulate(observer.problem, observer, Scenario(TIMES, 1.0)).error).max() < 1e-12


def test_the_error_map_is_what_a_sampled_run_does() -> None:
    observer = hyper_observer()
    M = observer.error_map(0.2).toarray()
    start = np.array([1.0, -2.0, 0.5, 3.0])
    run = simulate(observer.problem, observer, Scenario([0.0, 0.2, 1.0], start, 0.7, period=0.2))
    for k, steps in ((1, 1), (2, 5)):
        expected = np.linalg.matrix_power(M, steps) @ start
        got = np.concatenate([run.error[k, 0, :1], run.error[k, 1], run.error[k, 2, :1]])
        assert np.abs(got - expected).max() < 1e-12


def euler(observer: AssembledObserver, exchange: str, period: float) -> AssembledObserver:
    nodes = tuple(dataclasses.replace(node, exchange=exchange, _memo={}) for node in observer.nodes)
    return dataclasses.replace(observer, nodes=nodes, period=period)


def test_explicit_euler_is_one_step_of_the_derivative() -> None:
    observer = euler(shared_observer(), "euler", 0.1)
    H = observer.error_matrix().toarray()
    assert np.abs(observer.error_map(0.1).toarray() - (np.eye(9) + 0.1 * H)).max() < 1e-15


def test_a_held_innovation_is_integrated_by_the_own_dynamics() -> None:
    observer = euler(hyper_observer(), "innovation-held", 0.1)
    agents = [node.A for node in observer.nodes]
    moments = [quad_vec(lambda s, a=a: la.expm(s * a), 0.0, 0.1)[0] for a in agents]
    Phi = la.block_diag(*moments)
    own = la.block_diag(*agents)
    expected = la.expm(0.1 * own) + Phi @ (observer.error_matrix().toarray() - own)
    assert np.abs(observer.error_map(0.1).toarray() - expected).max() < 1e-12


def discrete_observer() -> AssembledObserver:
    """A plant ``x+ = A x`` and agents that move by the same map."""
    return euler(shared_observer(coupling=0.3), "discrete", 0.1)


def test_a_map_runs_once_an_exchange() -> None:
    given = dataclasses.replace(discrete_observer(), period=None)
    assert given.is_discrete
    assert given.verify_design_equations().dynamics < 1e-15
    run = simulate(given.problem, given, Scenario([0.0, 0.5, 1.0], 1.0, 0.5, period=0.5))
    assert np.abs(run.truth[2, 0] - A @ A @ np.full(3, 0.5)).max() < 1e-15
    with pytest.raises(ArgumentError, match="give the scenario a period"):
        simulate(given.problem, given, Scenario([0.0, 1.0]))


def test_readout_and_feedthrough_make_the_estimate() -> None:
    readout, through = np.array([[1.0, 0.0]]), np.array([[2.0]])
    node = LocalObserver("a", np.zeros((2, 2)), None, (), readout, ((0, through),))
    state = node.init(np.array([3.0, 4.0]))
    assert node.estimate(state, {0: np.array([5.0])}) == np.array([13.0])
    assert np.isnan(node.estimate(state)).all()
    assert node.reads == (0,)


# -- documents ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("observer", [shared_observer(), hyper_observer(), discrete_observer()])
def test_documents_come_back(observer, tmp_path) -> None:
    document = json.loads(json.dumps(observer_document(observer)))
    again = read_observer(document)
    assert json.loads(json.dumps(observer_document(again))) == document
    assert np.array_equal(again.error_matrix().toarray(), observer.error_matrix().toarray())
    tp.save(observer, tmp_path / "observer.json")
    tp.save(observer.problem, tmp_path / "problem.json")
    problem = tp.load(tmp_path / "problem.json")
    one, other = channels_of(problem), observer.channels
    assert (one.A != other.A).nnz == 0
    assert (one.C != other.C).nnz == 0
    assert simulate(problem, tp.load(tmp_path / "observer.json"), Scenario([0.0, 0.1], period=0.1)).error.shape[0] == 2


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("nodes", [], "one program a node"),
        ("nodes", None, "does not fit"),
        ("decay_rate", "fast", "decay_rate must be a number"),
        ("period", "often", "may be null"),
        ("targets", [3], "does not fit"),
        ("problem", {}, "expected kind"),
    ],
)
def test_damaged_documents_are_refused(key, value, words) -> None:
    document = {**observer_document(shared_observer()), key: value}
    with pytest.raises(ProtocolError, match=words):
        read_observer(document)


def test_unknown_forms_are_refused() -> None:
    with pytest.raises(ProtocolError, match="form 'diffusive' or 'programs'"):
        read_observer({**observer_document(shared_observer()), "form": "secret"})
    with pytest.raises(ProtocolError, match="unknown form of problem 'secret'"):
        read_problem({**problem_document(shared_plant()), "form": "secret"})
    with pytest.raises(ProtocolError, match="does not fit"):
        read_problem({**problem_document(hyper_network()), "measurements": [[[0]]]})
    problem = tp.NetworkedAgents(tp.graphs.chain(3), DOUBLE)
    diffusive = observer_document(tp.design(problem, tp.methods.LocalKalman()))
    with pytest.raises(ProtocolError, match="network of equal agents"):
        read_observer({**diffusive, "problem": problem_document(shared_plant())})


# -- refusals ----------------------------------------------------------------------------------------------------------
def test_programs_must_fit_the_problem() -> None:
    observer = shared_observer()
    with pytest.raises(ArgumentError, match="one program a node"):
        dataclasses.replace(observer, nodes=observer.nodes[:2])
    with pytest.raises(ArgumentError, match="its target must have the shape"):
        dataclasses.replace(observer, targets=(np.eye(3), np.eye(3), np.eye(2)))
    with pytest.raises(ArgumentError, match="node must be an index"):
        observer.local(3)


@pytest.mark.parametrize(
    ("scenario", "error", "words"),
    [
        (Scenario([0.0, 1.0], inputs=[1.0, 2.0]), ShapeError, "as B has columns"),
        (Scenario([0.0, 1.0], np.ones(4)), ShapeError, "initial_error must be a scalar"),
        (Scenario([0.0, 1.0], 1.0, np.ones(4)), ShapeError, "hold the 3 states"),
        (Scenario([0.0, 1.0], measurements=[1.0]), ArgumentError, "belong to static agents"),
    ],
)
def test_scenarios_that_do_not_fit_are_refused(scenario, error, words) -> None:
    observer = shared_observer()
    with pytest.raises(error, match=words):
        simulate(observer.problem, observer, scenario)


def test_other_refusals_of_simulate() -> None:
    observer = euler(shared_observer(), "euler", 0.1)
    with pytest.raises(ArgumentError, match=r"designed for a period of 0.1 s; got 0.2 s"):
        simulate(observer.problem, observer, Scenario([0.0, 1.0], period=0.2))
    with pytest.raises(ArgumentError, match="another problem"):
        simulate(hyper_network(), observer, Scenario([0.0, 1.0]))
    diffusive = tp.design(tp.NetworkedAgents(tp.graphs.chain(3), DOUBLE), tp.methods.LocalKalman())
    with pytest.raises(ArgumentError, match="belongs to a network of agents"):
        simulate(shared_plant(), diffusive, Scenario([0.0, 1.0]))
    with pytest.raises(ShapeError, match="equally many inputs"):
        simulate(hyper_network(), hyper_observer(), Scenario([0.0, 1.0], inputs=[[1.0], [2.0]]))
    static = tp.NetworkedAgents(tp.graphs.chain(3), tp.LinearAgent.static())
    programs = tp.design(static, tp.methods.LocalKalman()).as_programs()
    with pytest.raises(ShapeError, match="must hold the 3 readings"):
        simulate(static, programs, Scenario([0.0, 1.0], measurements=[1.0, 2.0]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"neighbour": "nobody"}, "hears 'nobody', which is no node"),
        ({"label": 99}, "uses reading 99; the problem has"),
        ({"label": -1}, "uses reading -1; the problem has"),
        ({"label": None, "output": np.ones((1, 7))}, r"a matrix of shape \(1, 7\)"),
        ({"gain": np.ones((1, 5)), "output": np.ones((5, 1))}, r"by a gain of shape \(1, 5\)"),
    ],
)
def test_what_the_problem_does_not_have_is_an_error_where_the_observer_is_made(change, words) -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(2), tp.LinearAgent.static())
    observer = tp.design(problem, tp.methods.LocalKalman()).as_programs()
    first = observer.nodes[0]
    inner = next(k for k, arc in enumerate(first.arcs) if arc.heard)
    arcs = [dataclasses.replace(arc, **change) if k == inner else arc for k, arc in enumerate(first.arcs)]
    odd = dataclasses.replace(first, arcs=tuple(arcs), _memo={})
    with pytest.raises(ArgumentError, match=words):
        dataclasses.replace(observer, nodes=(odd, *observer.nodes[1:]))
