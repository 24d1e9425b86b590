"""The predicted rate with old messages: against theory for constants, and against the event-driven simulation."""

from __future__ import annotations

import numpy as np
import pytest

import trigpoint as tp
from trigpoint.errors import ArgumentError
from trigpoint.observers.aged import aged_decay_rate, aged_error_map, aged_error_norms, aged_overshoot, settling
from trigpoint.simulation import Channel, Clocks

TURN = tp.LinearAgent([[0, 1], [-1, 0]], [[1, 0]])


def observer(agent, rows=3):
    problem = tp.NetworkedAgents(tp.graphs.grid(rows, rows, anchors=[0]), agent)
    return problem, tp.design(problem, tp.methods.LocalKalman())


def test_without_age_it_is_the_map_of_the_exchange():
    _, found = observer(TURN)
    programs = found.as_programs()
    np.testing.assert_allclose(
        aged_error_map(programs, 0.05, 0.0).toarray(), programs.error_map(0.05).toarray(), atol=1e-13
    )


def test_the_first_order_formula_for_constants():
    """``s (1 + g tau v' Adj v) = g lambda_min`` with tau = age + period/2, to first order in tau."""
    _, found = observer(tp.LinearAgent.static())
    L = found.graph.laplacian().toarray()
    values, vectors = np.linalg.eigh(L)
    v, gain = vectors[:, 0], found.gain * float((found.injection @ found.agent.C).item())
    adjacency = float(v @ (np.diag(L.diagonal()) - L) @ v)
    for period, age in ((1e-4, 0.0), (1e-4, 5e-5), (2e-4, 4e-4)):
        tau = age + period / 2
        formula = gain * values[0] / (1.0 + gain * tau * adjacency)
        rate = aged_decay_rate(found.as_programs(), period, age)
        assert rate == pytest.approx(formula, rel=(gain * tau * adjacency) ** 2)
        assert abs(rate / (gain * values[0]) - 1.0) > 10 * abs(rate / formula - 1.0)  # the correction matters


@pytest.mark.parametrize(("agent", "period", "horizon"), [(tp.LinearAgent.static(), 0.02, 30.0), (TURN, 0.1, 40.0)])
def test_the_simulation_decays_as_predicted(agent, period, horizon):
    """Everybody at the same instant: messages are fresh; at phases of their own: half a period old on average."""
    problem, found = observer(agent)
    rng = np.random.default_rng(3)
    n = agent.n_states
    start = {"initial_error": rng.normal(size=(9, n)), "initial_state": rng.normal(size=(9, n)), "period": period}
    times = np.arange(0.0, horizon, 0.25)
    together = tp.simulate(problem, found, tp.Scenario(times, **start))
    assert together.measured_decay_rate() == pytest.approx(aged_decay_rate(found.as_programs(), period, 0.0), rel=0.01)
    clocks, channel = Clocks(phase=rng.uniform(0.0, period, 9)), Channel(old="propagate")
    apart = tp.simulate(problem, found, tp.Scenario(times, **start, clocks=clocks, channel=channel))
    predicted = aged_decay_rate(found.as_programs(), period, period / 2)
    assert apart.measured_decay_rate() == pytest.approx(predicted, rel=0.01)
    assert together.measured_decay_rate() > 1.2 * predicted


@pytest.mark.parametrize("agent", [tp.LinearAgent.static(), TURN])
def test_the_errors_from_one_start(agent):
    """Without age those of the simulation; with it, their slope ends at the rate of the slowest mode."""
    problem, found = observer(agent)
    n, period = agent.n_states, 0.05
    error = np.random.default_rng(5).normal(size=(9, n))
    scenario = tp.Scenario(period * np.arange(60), initial_error=error, initial_state=np.zeros((9, n)), period=period)
    norms = aged_error_norms(found.as_programs(), period, 0.0, 0.0, error, 59)
    np.testing.assert_allclose(norms, tp.simulate(problem, found, scenario).error_norm, rtol=1e-9)
    norms = aged_error_norms(found.as_programs(), period, 0.03, 0.03, error, 16000)
    last = norms[8000:16000] if norms[-1] > 1e-300 else norms[1000:3000]
    slope = -np.polyfit(period * np.arange(last.shape[0]), np.log(last), 1)[0]
    assert slope == pytest.approx(aged_decay_rate(found.as_programs(), period, 0.03, 0.03), rel=0.01)


def test_whole_periods_of_delay():
    """A constant delay of one period, as the simulation has it."""
    problem, found = observer(tp.LinearAgent.static())
    period = 0.05
    scenario = tp.Scenario(
        np.arange(0.0, 60.0, 0.5), 1.0, 0.0, period=period, channel=Channel(delay=period, old="propagate")
    )  # fmt: skip
    measured = tp.simulate(problem, found, scenario).measured_decay_rate()
    assert measured == pytest.approx(aged_decay_rate(found.as_programs(), period, period), rel=0.01)


def test_large_networks_by_iteration():
    _, small = observer(tp.LinearAgent.static(), 24)
    rate = aged_decay_rate(small.as_programs(), 0.05, 0.02)
    M = aged_error_map(small.as_programs(), 0.05, 0.02)
    assert M.shape[0] > 600
    exact = -np.log(np.abs(np.linalg.eigvals(M.toarray())).max()) / 0.05
    assert rate == pytest.approx(exact, rel=1e-4)


def test_old_readings_are_read_with_rotated_rows():
    """Readings of an age: C e^{-A b} for C; of constants, nothing changes."""
    _, turning = observer(TURN)
    _, static = observer(tp.LinearAgent.static())
    fresh, late = (aged_error_map(turning.as_programs(), 0.02, 0.0, b).toarray() for b in (0.0, 0.3))
    assert np.abs(fresh - late).max() > 1e-3
    a, b = (aged_decay_rate(static.as_programs(), 0.02, 0.01, age) for age in (0.0, 0.3))
    assert a == pytest.approx(b, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0.0, 0.0), "period must be a positive number of seconds; got 0"),
        ((0.1, -1.0), "age must be a number of seconds from 0 to 64 periods; got -1"),
        ((0.1, 7.0), "age must be a number of seconds from 0 to 64 periods; got 7"),
        ((0.1, 0.0, np.nan), "reading_age must be a number of seconds from 0 to 64 periods; got nan"),
    ],
)
def test_impossible_ages_are_refused(given, words):
    with pytest.raises(ArgumentError, match=words):
        aged_decay_rate(observer(TURN)[1].as_programs(), *given)


@pytest.mark.parametrize("agent", [tp.LinearAgent.static(), TURN, tp.LinearAgent([[0, 1], [0, 0]], [[1, 0]])])
@pytest.mark.parametrize("age", [0.0, 0.03, 0.05])
def test_no_error_leaves_the_curve(agent, age):
    """``|e_i| / sqrt(n)`` stays below ``K e^{-rate t}`` from any start below 1; some start comes near it."""
    _, found = observer(agent)
    programs, period = found.as_programs(), 0.05
    rate = 0.9 * aged_decay_rate(programs, period, age, age)
    factor = aged_overshoot(programs, period, age, age, rate)
    n, rng = agent.n_states, np.random.default_rng(1)
    M = aged_error_map(programs, period, age, age).toarray()
    back = tp.arrays.expm(-period * agent.A)
    nearest = 0.0
    for draw in range(40):
        e = rng.normal(size=(9, n)) if draw else np.ones((9, n))
        e *= np.sqrt(n) / np.linalg.norm(e, axis=1)[:, None]
        parts = [e]
        while len(parts) * 9 * n < M.shape[0]:
            parts.append(parts[-1] @ back.T)
        now = np.concatenate([part.ravel() for part in parts])
        for k in range(400):
            worst = np.linalg.norm(now[: 9 * n].reshape(9, n), axis=1).max() / np.sqrt(n)
            assert worst <= factor * np.exp(-rate * k * period) * (1.0 + 1e-9)
            nearest = max(nearest, worst / (factor * np.exp(-rate * k * period)))
            now = M @ now
    assert nearest > 0.3


def test_agents_of_different_sizes_have_a_curve_too():
    agents = [tp.LinearAgent([[-0.5]], [[1.0]]), TURN, tp.LinearAgent([[0, 2], [-2, 0]], [[1, 0]])]
    problem = tp.NetworkedAgents(tp.graphs.cycle(3, anchors=[0, 1]), agents)
    programs = tp.design(problem, tp.methods.Heterogeneous())
    rate, factor = settling(programs, 0.02, 0.02, 0.02, 1.0)
    assert rate > 0.0
    assert factor >= 1.0


def test_no_curve_is_claimed_where_none_is_found():
    _, found = observer(TURN)
    programs = found.as_programs()
    assert aged_overshoot(programs, 0.02, 0.02, 0.02, 0.0) is None
    assert aged_overshoot(programs, 0.02, 0.02, 0.02, 1.01 * aged_decay_rate(programs, 0.02, 0.02, 0.02)) is None
    assert settling(programs, 0.02, 0.02, 0.02, 0.0) == (0.0, 1.0)
    _, large = observer(TURN, 20)
    assert settling(large.as_programs(), 0.02, 0.02, 0.02, 1.0) == (0.0, 1.0)
    assert aged_overshoot(large.as_programs(), 0.02, 0.02, 0.02, 0.01) is None
