"""The stacked path against the reference path, matrix exponentials, and exact modes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph, chain, cycle
from trigpoint.methods import Fixed, LocalKalman, design
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.simulation import Noise, Scenario, simulate, stacked
from trigpoint.simulation.world import World, drawn_from

from .drawn import AGENTS, everywhere, observed, start


def both_paths(observer, *arguments, **options):
    scenarios = [Scenario(*arguments, **options, path=path) for path in ("stacked", "reference")]
    return [simulate(observer.problem, observer, scenario) for scenario in scenarios]


def assert_same_runs(stacked, reference) -> None:
    size = max(np.abs(reference.estimate).max(), np.abs(reference.truth).max(), 1.0)
    np.testing.assert_allclose(stacked.truth, reference.truth, atol=1e-12 * size)
    np.testing.assert_allclose(stacked.estimate, reference.estimate, atol=1e-9 * size)
    assert np.array_equal(stacked.messages, reference.messages)
    assert np.array_equal(stacked.status, reference.status)
    assert (stacked.path, reference.path) == ("stacked", "reference")


@settings(max_examples=15)
@given(observed(), st.integers(0, 999), st.sampled_from([1e-2, 0.13, 1.0]), st.booleans())
def test_sampled_runs_are_the_nodes_own_programs(observer, seed, period, with_inputs) -> None:
    """Output times on and off the exchange grid; inputs; the stacked maps are assembled independently."""
    error, state, inputs = start(observer, seed)
    times = period * np.array([0.0, 0.5, 1.0, 1.25, 1.75, 3.0, 7.1])
    assert_same_runs(*both_paths(observer, times, error, state, period=period, inputs=inputs if with_inputs else None))


@settings(max_examples=15)
@given(observed(), st.integers(0, 999), st.floats(0.01, 1.0))
def test_both_paths_draw_the_same_noise(observer, seed, period) -> None:
    error, state, inputs = start(observer, seed)
    noise = Noise(measurement=0.3, process=0.2)
    runs = both_paths(
        observer, period * np.arange(6), error, state, period=period, noise=noise, inputs=inputs, seed=seed
    )
    assert_same_runs(*runs)
    silent = simulate(observer.problem, observer, Scenario(period * np.arange(6), error, state, period=period))
    assert np.abs(silent.estimate - runs[0].estimate).max() > 1e-6


@settings(max_examples=8)
@given(observed(max_nodes=3), st.integers(0, 999))
def test_continuous_runs_are_the_nodes_own_derivatives(observer, seed) -> None:
    error, state, inputs = start(observer, seed)
    H = observer.error_matrix().toarray()
    horizon = 3.0 / np.abs(H).max()
    runs = both_paths(observer, horizon * np.array([0.3, 1.0]), error, state, inputs=inputs)
    assert_same_runs(*runs)


@settings(max_examples=15)
@given(observed(), st.integers(0, 999), st.sampled_from([1e-6, 1e-3, 1.0]))
def test_continuous_errors_are_matrix_exponentials(observer, seed, scale) -> None:
    """Exact to rounding at every time scale, microseconds included."""
    error, state, inputs = start(observer, seed)
    H = observer.error_matrix().toarray()
    unit = scale * 5.0 / np.abs(H).max()
    times = unit * np.array([0.0, 0.1, 0.25, 1.0])
    run = simulate(observer.problem, observer, Scenario(times, error, state, inputs=inputs))
    for k, time in enumerate(times):
        exact = la.expm(H * time) @ error.ravel()
        np.testing.assert_allclose(run.error[k].ravel(), exact, atol=1e-11 * max(np.abs(exact).max(), 1.0))


@pytest.mark.parametrize("weight", [1e6, 1e9])
def test_fast_networks_are_exact_too(weight) -> None:
    observer = design(
        NetworkedAgents(chain(3).with_weight(np.full(3, weight)), LinearAgent.static()), LocalKalman(Fixed(1))
    )
    times = np.linspace(0.0, 10.0 / weight, 31)
    run = simulate(observer.problem, observer, Scenario(times))
    H = observer.error_matrix().toarray()
    exact = np.stack([la.expm(H * time) @ np.ones(3) for time in times])
    np.testing.assert_allclose(run.error[:, :, 0], exact, atol=1e-11)


@settings(max_examples=15)
@given(st.sampled_from(AGENTS), st.integers(0, 999))
def test_the_truth_follows_its_own_equation(agent, seed) -> None:
    observer = design(NetworkedAgents(everywhere(), agent), LocalKalman(Fixed(1.0)))
    error, state, inputs = start(observer, seed)
    run = simulate(observer.problem, observer, Scenario([0.4, 1.3], error, state, inputs=inputs))
    n = agent.n_states
    for k, time in enumerate((0.4, 1.3)):
        for node in range(4):
            drive = np.zeros(n) if inputs is None else agent.B @ inputs[node]
            block = np.zeros((n + 1, n + 1))
            block[:n, :n], block[:n, n] = agent.A, drive
            exact = (la.expm(time * block) @ np.append(state[node], 1.0))[:n]
            np.testing.assert_allclose(run.truth[k, node], exact, rtol=1e-12, atol=1e-12)


def chain_modes(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and unit eigenvectors of the chain anchored at node 0, in closed form."""
    angle = (2 * np.arange(1, n + 1) - 1) * np.pi / (2 * n + 1)
    vectors = np.sin(np.outer(np.arange(1, n + 1), angle))
    return 2 - 2 * np.cos(angle), vectors / np.linalg.norm(vectors, axis=0)


DOUBLE_INTEGRATOR = LinearAgent([[0, 1], [0, 0]], [[1, 0]])
SIZES = [pytest.param(120, 100, id="small"), pytest.param(1501, 1500, id="large", marks=pytest.mark.slow)]


@pytest.mark.parametrize(("n", "limit"), SIZES)
@pytest.mark.parametrize("agent", [LinearAgent.static(), DOUBLE_INTEGRATOR], ids=["static", "double integrator"])
def test_large_networks_follow_their_exact_modes(monkeypatch, agent, n, limit) -> None:
    """Above 1500 states (here lowered) the implicit Runge-Kutta path runs; the chain's modes have a closed form."""
    monkeypatch.setattr(stacked, "DENSE_LIMIT", limit)
    observer = design(NetworkedAgents(chain(n), agent), LocalKalman(Fixed(2.0)))
    values, vectors = chain_modes(n)
    error = np.random.default_rng(3).normal(size=(n, agent.n_states))
    times = np.array([0.0, 0.2, 1.0, 3.0])
    run = simulate(observer.problem, observer, Scenario(times, error, path="stacked"))
    amplitudes = vectors.T @ error
    modes = agent.A - observer.gain * values[:, None, None] * (observer.injection @ agent.C)
    for k, time in enumerate(times):
        exact = vectors @ np.einsum("kij,kj->ki", la.expm(time * modes), amplitudes)
        assert np.abs(run.error[k] - exact).max() <= 1e-7 * np.abs(exact).max()


@pytest.mark.parametrize(("n", "limit"), SIZES)
def test_large_networks_settle_where_contradicting_readings_say(monkeypatch, n, limit) -> None:
    monkeypatch.setattr(stacked, "DENSE_LIMIT", limit)
    observer = design(NetworkedAgents(chain(n), LinearAgent.static()), LocalKalman(Fixed(1.0)))
    values, vectors = chain_modes(n)
    offset = np.random.default_rng(4).normal(size=n)
    run = simulate(observer.problem, observer, Scenario([0.0, 2.5], 0.0, 0.0, measurements=offset, path="stacked"))
    push = vectors.T @ (observer.graph.incidence() @ offset)
    exact = vectors @ (push * -np.expm1(-values * 2.5) / values)
    assert np.abs(run.error[0]).max() == 0.0
    assert np.abs(run.error[1, :, 0] - exact).max() <= 1e-7 * np.abs(exact).max()


def test_the_change_of_integrator_is_where_the_documentation_says() -> None:
    assert stacked.DENSE_LIMIT == 1500
    assert "1500 states" in stacked.continuous.__doc__


def test_the_measured_slope_is_the_computed_abscissa() -> None:
    observer = design(NetworkedAgents(cycle(6, anchors=(5,)), AGENTS[0]), LocalKalman(Fixed(2.0)))
    run = simulate(observer.problem, observer, Scenario(np.linspace(0, 20, 201) / observer.decay_rate, 1.0))
    assert run.measured_decay_rate() == pytest.approx(-observer.spectral_abscissa, rel=1e-6)
    assert observer.decay_rate <= run.measured_decay_rate() * (1 + 1e-6)
    assert run.error_norm[-1] < 1e-8 * run.error_norm[0]


@settings(max_examples=25)
@given(observed(), st.integers(0, 999))
def test_single_readings_and_noise_drawn_at_once_are_those_of_all_one_by_one(observer, seed) -> None:
    world = World.of(observer.as_programs(), Scenario([0.0, 1.0], period=0.1))
    rng = np.random.default_rng(seed)
    state = rng.normal(size=world.channels.A.shape[0])
    for label, value in world.read(state).items():
        np.testing.assert_array_equal(world._reading(state, world._places[label]), value)
    factors = world.noise_factors(0.7, 0.1)
    for chosen in (factors, [*factors, rng.normal(size=(1, 3))]):
        one, other = np.random.default_rng(seed), np.random.default_rng(seed)
        singly = np.concatenate([factor @ other.standard_normal(factor.shape[1]) for factor in chosen])
        np.testing.assert_array_equal(drawn_from(chosen, one), singly)
        assert one.random() == other.random()


@settings(max_examples=25)
@given(observed())
def test_messages_are_counted_once_a_neighbour(observer) -> None:
    scenario = Scenario([0.0, 0.5], period=0.1)
    run = simulate(observer.problem, observer, scenario)
    assert run.path == "stacked"
    graph = observer.graph
    told = [graph.neighbours(node).shape[0] for node in range(graph.n_nodes)]
    assert run.messages[-1].tolist() == [5 * count for count in told]


def test_the_reference_path_is_as_exact_at_outputs_as_at_its_steps() -> None:
    """A stiff network whose outputs lie between long steps; interpolated, they were 1e-8 off."""
    graph = MeasurementGraph(3, [-1, 0, -1, -1, 0, -1], [0, 1, 2, 1, 1, 0], weight=[1.0, 1.0, 0.1, 1.0, 1.0, 10.0])
    problem = tp.NetworkedAgents(graph, tp.LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]]))
    observer = tp.design(problem, tp.methods.LocalKalman(tp.FromGraph(1.5)))
    times = np.array([0.0, 0.25, 1.0]) / abs(observer.spectral_abscissa)
    start, error = np.random.default_rng(2).normal(size=(2, 6))
    stacked, reference = (
        tp.simulate(problem, observer, tp.Scenario(times, error, start, path=path)) for path in ("stacked", "reference")
    )
    np.testing.assert_allclose(
        reference.estimate, stacked.estimate, rtol=0.0, atol=1e-10 * np.abs(stacked.estimate).max()
    )


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_programs_that_leave_all_numbers_are_told_when() -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(2), tp.LinearAgent.static())
    growing = dataclasses.replace(tp.design(problem, tp.methods.LocalKalman()), gain=-900.0)
    with pytest.raises(ArgumentError, match=r"the programs could not be integrated beyond 0\.\d+ s: "):
        tp.simulate(problem, growing, tp.Scenario([0.0, 1.0], 1.0, path="reference"))
