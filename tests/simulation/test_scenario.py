"""What a scenario promises: times, starts, recorded readings, seeds, noise, loss, messages, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle
from trigpoint.methods import Fixed, LocalKalman, design
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers import DiffusiveObserver
from trigpoint.simulation import Channel, Noise, Scenario, simulate
from trigpoint.simulation.plant import Disturbances
from trigpoint.testing.strategies import measurement_graphs

from .drawn import AGENTS, everywhere

STATIC = LinearAgent.static()


def observer_of(graph, agent=STATIC, gain=1.0) -> DiffusiveObserver:
    return design(NetworkedAgents(graph, agent), LocalKalman(Fixed(gain)))


def lone_nodes(count, agent, injection) -> DiffusiveObserver:
    """Many nodes that share nothing, each with an absolute reading: as many independent samples."""
    graph = MeasurementGraph(count, [EXTERNAL] * count, np.arange(count))
    return DiffusiveObserver("given", NetworkedAgents(graph, agent), injection, 1.0, 0.0, 0.0)


def run(observer, *arguments, **options):
    return simulate(observer.problem, observer, Scenario(*arguments, **options))


# -- times and starts --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("options", [{}, {"period": 0.1}, {"period": 0.1, "path": "reference"}, {"path": "reference"}])
@pytest.mark.parametrize("times", [[0.3], [0.0], [0.0, 0.1, 0.30000000000000004], [1 / 3, 2.0], 1.5])
def test_times_come_back_exactly(times, options) -> None:
    result = run(observer_of(chain(3)), times, **options)
    assert result.times.tolist() == np.atleast_1d(times).tolist()
    assert result.error.shape == (len(result.times), 3, 1)


@pytest.mark.parametrize("options", [{}, {"period": 0.2}, {"path": "reference"}])
def test_starts_may_be_a_number_a_vector_or_a_table(options) -> None:
    observer = observer_of(chain(3), AGENTS[1])
    flat = np.arange(6.0)
    one = run(observer, [0.0, 1.0], flat, 2.0 * flat, **options)
    table = run(observer, [0.0, 1.0], flat.reshape(3, 2), 2.0 * flat.reshape(3, 2), **options)
    assert np.array_equal(one.estimate, table.estimate)
    np.testing.assert_allclose(one.error[0], flat.reshape(3, 2), atol=1e-15)
    assert np.array_equal(one.truth[0], 2.0 * flat.reshape(3, 2))
    same = run(observer, [0.0], 3.0, -1.0, **options)
    assert np.array_equal(same.truth[0], np.full((3, 2), -1.0))
    assert np.array_equal(same.estimate[0], np.full((3, 2), 2.0))


def test_a_static_truth_never_moves() -> None:
    result = run(observer_of(chain(4)), np.linspace(0, 1e3, 7), 1.0, 1 / 3, period=0.7)
    assert (result.truth == 1 / 3).all()


def test_times_a_hair_off_an_exchange_count_as_on_it() -> None:
    observer = observer_of(chain(3))
    period = 0.1
    off = [3 * period * (1 - 1e-11), 7 * period * (1 + 1e-11)]
    on = run(observer, [3 * period, 7 * period], period=period)
    near = run(observer, off, period=period)
    assert near.times.tolist() == off
    assert np.array_equal(on.estimate, near.estimate)
    assert np.array_equal(on.messages, near.messages)


# -- recorded readings: the observer finds the weighted least-squares answer -------------------------------------------
@settings(max_examples=10)
@given(measurement_graphs(max_nodes=5, weighted=True, decades=1, externally_connected=True), st.integers(0, 999))
def test_recorded_readings_lead_to_weighted_least_squares(graph, seed) -> None:
    """e(inf) = L^-1 G W delta (theory 000-40), continuously and in sampled time, from any start."""
    rng = np.random.default_rng(seed)
    observer = observer_of(graph)
    readings = rng.normal(size=graph.n_arcs)
    G = graph.incidence().toarray()
    W = np.diag(graph.arc_weights)
    best = la.solve(G @ W @ G.T, G @ W @ readings, assume_a="pos")
    settle = 60.0 / observer.decay_rate
    slow = np.diag(G @ W @ G.T).max() / observer.decay_rate
    runs = [run(observer, [settle], rng.normal(size=graph.n_nodes), measurements=readings)]
    if slow < 50:
        count = 40 * (slow + 1)
        runs += [run(observer, [1e3 * count], 5.0, measurements=readings, period=1e3)]
    for result in runs:
        assert np.abs(result.estimate[-1, :, 0] - best).max() <= 1e-9 * max(np.abs(best).max(), 1.0)


def test_vector_readings_with_weight_blocks_lead_to_weighted_least_squares() -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 2, 2))
    weight = np.eye(2) + root @ root.transpose(0, 2, 1)
    graph = everywhere(weight)
    observer = observer_of(graph, LinearAgent.static(2))
    readings = rng.normal(size=(6, 2))
    D = np.kron(graph.incidence().toarray(), np.eye(2))
    W = la.block_diag(*weight)
    best = la.solve(D @ W @ D.T, D @ W @ readings.ravel(), assume_a="pos").reshape(4, 2)
    times = [60.0 / observer.decay_rate]
    for options in ({}, {"period": 0.05}):
        result = run(observer, times, measurements=readings, **options)
        np.testing.assert_allclose(result.estimate[-1], best, atol=1e-9)
    flat = run(observer, times, measurements=readings.ravel())
    np.testing.assert_allclose(flat.estimate[-1], best, atol=1e-9)


def test_the_level_of_an_unanchored_component_stays_where_it_was() -> None:
    graph = everywhere().subgraph([0, 1, 2])
    problem = NetworkedAgents(graph, STATIC)
    observer = DiffusiveObserver("given", problem, np.eye(1), 1.0, 0.0, 0.0)
    readings = np.array([1.0, -1.0, 2.0])
    result = simulate(problem, observer, Scenario([50.0], 0.0, 0.0, measurements=readings))
    np.testing.assert_allclose(np.diff(result.estimate[-1, :, 0]), [1.0, 2.0], atol=1e-9)
    assert result.estimate[-1].mean() == pytest.approx(0.0, abs=1e-9)
    assert result.status.tolist() == [["relative"] * 3]


# -- randomness --------------------------------------------------------------------------------------------------------
def test_equal_seeds_give_equal_runs() -> None:
    options = {"period": 0.1, "noise": Noise(0.5), "channel": Channel(0.4)}
    observer = observer_of(cycle(5, anchors=(4,)))
    one, two = (run(observer, [1.0, 2.0], seed=7, **options) for _ in range(2))
    other = run(observer, [1.0, 2.0], seed=8, **options)
    assert np.array_equal(one.estimate, two.estimate)
    assert np.abs(one.estimate - other.estimate).max() > 1e-3
    assert one.attributes == two.attributes
    assert one.attributes["seed"] == 7
    assert one.attributes["loss"] == 0.4


def test_reading_noise_has_the_asked_size() -> None:
    """The stationary variance of one anchored constant: z+ = q z + (1 - q) (x + noise), q = e^-gh."""
    n, period = 1500, 0.5
    result = run(lone_nodes(n, STATIC, np.eye(1)), [40.0], 0.0, period=period, noise=Noise(measurement=2.0), seed=1)
    q = np.exp(-period)
    expected = 4.0 * (1 - q) ** 2 / (1 - q**2)
    assert result.error[0].var() == pytest.approx(expected, rel=4 * np.sqrt(2 / n))
    assert abs(result.error[0].mean()) < 4 * np.sqrt(expected / n)


@pytest.mark.parametrize("period", [1e-3, 0.3, 5.0, 500.0])
@pytest.mark.parametrize("number", range(len(AGENTS)))
def test_process_noise_has_the_covariance_of_the_lyapunov_equation(number, period) -> None:
    """int_0^h e^As E E' e^A's ds, for fast stable agents over long periods too, where e^-Ah overflows."""
    base = AGENTS[number]
    n = base.n_states
    A = base.A - 3.0 * np.eye(n) if period > 1 else base.A
    E = np.random.default_rng(number).normal(size=(n, n))
    agent = LinearAgent(A, base.C, E=E)
    problem = NetworkedAgents(chain(2), agent)
    drawn = Disturbances.of(problem, Scenario([period], period=period, noise=Noise(process=0.7)))
    found = drawn.process @ drawn.process.T
    S = 0.49 * E @ E.T
    nodes, weights = np.polynomial.legendre.leggauss(40)
    if period > 1:
        Phi = la.expm(A * period)
        exact = la.solve_continuous_lyapunov(A, Phi @ S @ Phi.T - S)
    else:
        at = [la.expm(A * period * (x + 1) / 2) for x in nodes]
        exact = sum(w * period / 2 * T @ S @ T.T for w, T in zip(weights, at, strict=True))
    np.testing.assert_allclose(found, exact, atol=1e-12 * np.abs(exact).max())


def test_drawn_process_noise_has_its_covariance() -> None:
    agent = LinearAgent([[0, 1], [0, 0]], [[1, 0]], E=[[0.0], [2.0]])
    n, period = 2000, 0.5
    observer = lone_nodes(n, agent, np.ones((2, 1)))
    result = run(observer, [period], 0.0, period=period, noise=Noise(process=1.0), seed=3)
    exact = 4.0 * np.array([[period**3 / 3, period**2 / 2], [period**2 / 2, period]])
    found = result.truth[0].T @ result.truth[0] / n
    spread = np.sqrt((np.outer(np.diag(exact), np.diag(exact)) + exact**2) / n)
    assert (np.abs(found - exact) < 4 * spread).all()


@pytest.mark.parametrize("loss", [0.2, 0.7])
def test_messages_are_lost_as_often_as_asked(loss) -> None:
    """A leaf whose only message comes with probability 1 - loss: E z = 1 - (loss + (1 - loss) e^-h)^k."""
    n, period = 800, 1.0
    graph = MeasurementGraph(n + 1, np.full(n, n), np.arange(n))
    problem = NetworkedAgents(graph, STATIC)
    observer = DiffusiveObserver("given", problem, np.eye(1), 1.0, 0.0, 0.0)
    start = np.ones(n + 1)
    start[n] = 0.0
    result = simulate(problem, observer, Scenario([period], start, period=period, channel=Channel(loss), seed=5))
    leaves = result.error[0, :n, 0]
    heard = np.isclose(leaves, np.exp(-period), atol=1e-12)
    assert (heard | (leaves == 1.0)).all(), "a leaf either hears the hub or stays"
    assert heard.mean() == pytest.approx(1 - loss, abs=4 * np.sqrt(loss * (1 - loss) / n))
    assert result.path == "reference"
    assert result.messages[0, n] == n, "lost messages were sent, too"


def test_a_lossy_channel_still_converges() -> None:
    observer = observer_of(cycle(5, anchors=(4,)))
    result = run(observer, [400.0], period=1.0, channel=Channel(0.5), seed=2)
    assert result.error_norm[-1] < 1e-6


def test_no_loss_needs_no_reference_path() -> None:
    assert run(observer_of(chain(2)), [1.0], period=0.5, channel=Channel(0.0)).path == "stacked"
    assert run(observer_of(chain(2)), [1.0]).path == "stacked"
    assert run(observer_of(chain(2)), [1.0], path="reference").path == "reference"


# -- messages ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("path", ["stacked", "reference"])
def test_each_exchange_sends_one_message_to_each_neighbour(path) -> None:
    """Parallel arcs share a message; at an output on the grid the exchange of that moment has not happened yet."""
    observer = observer_of(everywhere())
    result = run(observer, [0.0, 0.5, 1.0, 2.75], period=1.0, path=path)
    degree = np.array([1, 2, 2, 1])
    assert np.array_equal(result.messages, np.outer([0, 1, 1, 3], degree))


def test_continuous_exchange_counts_no_messages() -> None:
    assert not run(observer_of(chain(3)), [1.0, 2.0]).messages.any()


def test_progress_sees_every_exchange() -> None:
    seen = []

    def watch(ticks):
        for tick in ticks:
            seen.append(tick.number)
            yield tick

    observer = observer_of(chain(3))
    for path in ("stacked", "reference"):
        simulate(observer.problem, observer, Scenario([0.0, 2.0], period=0.5, path=path), progress=watch)
    assert seen == [0, 1, 2, 3, 4] * 2


# -- refusals ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Scenario([]), "times must be ascending"),
        (lambda: Scenario([1.0, 1.0]), "times must be ascending"),
        (lambda: Scenario([2.0, 1.0]), "times must be ascending"),
        (lambda: Scenario([-0.1, 1.0]), "times must be ascending"),
        (lambda: Scenario([[1.0, 2.0]]), "times must be ascending"),
        (lambda: Scenario([np.nan]), "times must be finite"),
        (lambda: Scenario([1.0], period=0.0), "period must be a positive number of seconds; got 0"),
        (lambda: Scenario([1.0], period=np.inf), "period must be a positive number"),
        (lambda: Scenario([1.0], path="fast"), "path must be one of auto, stacked, modal, reference; got 'fast'"),
        (lambda: Scenario([1.0], channel=Channel()), "channel needs sampled exchange: give a period"),
        (lambda: Scenario([1.0], initial_error=np.nan), "initial_error must be finite"),
        (lambda: Scenario([1.0], initial_state=[np.inf]), "initial_state must be finite"),
        (lambda: Scenario([1.0], inputs=[["a"]]), "inputs must be an array of real numbers"),
        (lambda: Scenario([1.0], measurements=[np.nan]), "measurements must be finite"),
        (lambda: Noise(measurement=-1.0), "noise measurement must be a number of at least 0; got -1"),
        (lambda: Noise(process=np.nan), "noise process must be a number of at least 0; got nan"),
        (lambda: Channel(loss=1.0), "0 <= loss < 1; got 1"),
        (lambda: Channel(loss=-0.1), "0 <= loss < 1"),
        (lambda: Channel(loss=np.nan), "0 <= loss < 1"),
    ],
)
def test_scenarios_refuse_nonsense(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


MOVING = NetworkedAgents(chain(3), AGENTS[1])


@pytest.mark.parametrize(
    ("problem", "options", "kind", "words"),
    [
        (
            MOVING,
            {"initial_error": np.zeros(3)},
            ShapeError,
            r"initial_error must be a scalar, \(6,\) or \(3, 2\); got",
        ),
        (MOVING, {"initial_state": np.zeros((2, 3))}, ShapeError, r"initial_state must be .*got shape \(2, 3\)"),
        (MOVING, {"inputs": np.zeros(3)}, ShapeError, r"inputs must have shape \(N, m\) = \(3, 1\); got \(3,\)"),
        (MOVING, {"measurements": np.zeros(3)}, ArgumentError, r"static agents \(A = 0\)"),
        (
            NetworkedAgents(chain(3), STATIC),
            {"measurements": np.zeros(4)},
            ShapeError,
            r"measurements must have shape \(M, p\) = \(3, 1\); got \(4,\)",
        ),
        (
            NetworkedAgents(chain(2), [LinearAgent(0.0, 1.0), LinearAgent(0.0, 1.0, B=1.0)]),
            {"inputs": np.zeros((2, 1))},
            ArgumentError,
            r"equally many inputs; got \[0, 1\]",
        ),
        (
            MOVING,
            {"period": 0.4, "noise": Noise(process=1.0)},
            ArgumentError,
            "with process noise the output times must be multiples of the period",
        ),
        (
            MOVING,
            {"period": 0.5, "channel": Channel(0.1), "path": "stacked"},
            ArgumentError,
            "the stacked path knows no message loss",
        ),
    ],
)
def test_scenarios_must_fit_the_problem(problem, options, kind, words) -> None:
    observer = design(problem, LocalKalman())
    with pytest.raises(kind, match=words):
        simulate(problem, observer, Scenario([1.0], **options))


def test_inputs_of_no_numbers_are_no_inputs() -> None:
    observer = observer_of(chain(3))
    for path in ("stacked", "reference"):
        with_none = run(observer, [1.0], period=0.5, path=path, inputs=np.zeros((3, 0)))
        assert np.array_equal(with_none.estimate, run(observer, [1.0], period=0.5, path=path).estimate)


def test_the_observer_must_belong_to_the_problem() -> None:
    observer = observer_of(chain(3), AGENTS[1])
    with pytest.raises(ArgumentError, match="the observer belongs to another network: MeasurementGraph"):
        simulate(NetworkedAgents(chain(4), AGENTS[1]), observer, Scenario([1.0]))
    with pytest.raises(ArgumentError, match="its arcs join other nodes"):
        simulate(NetworkedAgents(chain(3, anchors=(2,)), AGENTS[1]), observer, Scenario([1.0]))
    with pytest.raises(ArgumentError, match="other agents: node '0' has another A, B or C"):
        simulate(NetworkedAgents(chain(3), LinearAgent([[0, 2], [0, 0]], [[1, 0]])), observer, Scenario([1.0]))
    equal = NetworkedAgents(chain(3), LinearAgent([[0, 1], [0, 0]], [[1, 0]], B=[[0.0], [1.0]]))
    assert simulate(equal, observer, Scenario([1.0])).error.shape == (1, 3, 2)


def test_only_designed_observers_run() -> None:
    with pytest.raises(ArgumentError, match=r"observers made by design\(\); got str"):
        simulate(MOVING, "observer", Scenario([1.0]))


def test_inputs_are_not_mutated() -> None:
    error, state = np.ones((3, 2)), np.zeros((3, 2))
    scenario = Scenario([0.5, 1.0], error, state, period=0.1)
    error[:] = 99.0
    observer = design(MOVING, LocalKalman())
    before = [scenario.initial_error.copy(), scenario.initial_state.copy()]
    first = simulate(MOVING, observer, scenario)
    second = simulate(MOVING, observer, scenario)
    assert np.array_equal(first.estimate, second.estimate)
    assert np.array_equal(scenario.initial_error, before[0])
    assert np.array_equal(scenario.initial_state, before[1])
    assert scenario.initial_error.max() == 1.0
