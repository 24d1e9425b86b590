"""Agents in motion: reflections exact over many bounces, links that appear and vanish at their exact instants."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import trigpoint as tp
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.simulation import Bouncing, Trajectory, proximity, within_reach


def reflected(x: Fraction, v: Fraction, time: Fraction, side: Fraction) -> tuple[Fraction, Fraction]:
    """Bounce by bounce, in exact arithmetic."""
    while True:
        wall = side if v > 0 else Fraction(0)
        needed = (wall - x) / v
        if needed > time:
            return x + v * time, v
        x, v, time = wall, -v, time - needed


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 60.0))
def test_a_place_is_that_of_every_single_bounce(seed, time) -> None:
    rng = np.random.default_rng(seed)
    motion = Bouncing.drawn(3, 2.0, (0.5, 1.0), rng)
    state = motion.at(time)
    for agent in range(3):
        for axis in range(2):
            exact = (motion.position[agent, axis], motion.velocity[agent, axis], time, 2)
            x, v = reflected(*(Fraction(value) for value in exact))
            assert abs(state[agent, axis] - float(x)) <= 1e-13 * (1.0 + time)
            assert state[agent, 2 + axis] == float(v) or min(float(x), 2.0 - float(x)) < 1e-12 * (1.0 + time)


def test_energy_is_kept_to_the_last_bit_over_a_hundred_thousand_bounces() -> None:
    motion = Bouncing.drawn(8, 1.0, (0.5, 1.0), np.random.default_rng(1))
    until = 1e5 / float(np.abs(motion.velocity).sum())
    instants = motion.bounces(until)
    assert 0.99e5 < instants.shape[0] < 1.01e5
    energy = (motion.velocity**2).sum(axis=1)
    for time in np.linspace(0.0, until, 300):
        state = motion.at(float(time))
        assert np.array_equal((state[:, 2:] ** 2).sum(axis=1), energy)
        assert (state[:, :2] >= 0.0).all()
        assert (state[:, :2] <= 1.0).all()
    # At a bounce somebody is at a wall: to the rounding of v t.
    for time in instants[:: len(instants) // 50].tolist():
        place = motion.positions(time)
        assert np.minimum(place, 1.0 - place).min() < 1e-11 * (1.0 + time)


@pytest.mark.parametrize("seed", range(4))
def test_links_change_when_the_distance_is_the_radius(seed) -> None:
    motion = Bouncing.drawn(6, 2.0, (0.5, 1.0), np.random.default_rng(seed))
    pairs = list(combinations(range(6), 2))
    topology = proximity(motion, pairs, 1.2, 12.0, always=2)
    assert topology.active[:, -2:].all()

    def distances(time: float) -> np.ndarray:
        place = motion.positions(time)
        return np.array([np.linalg.norm(place[a] - place[b]) for a, b in pairs])

    for k, time in enumerate(topology.times.tolist()[1:], start=1):
        changed = np.flatnonzero(topology.active[k] != topology.active[k - 1])
        assert changed.size
        np.testing.assert_allclose(distances(time)[changed], 1.2, atol=1e-12)
    for time in np.random.default_rng(seed).uniform(0.0, 12.0, 400).tolist():
        gap = distances(time)
        clear = np.abs(gap - 1.2) > 1e-6
        assert np.array_equal(topology.at(time)[:-2][clear], (gap <= 1.2)[clear])


def test_a_table_is_straight_between_its_rows_and_stands_outside_them() -> None:
    motion = Trajectory([0.0, 1.0, 3.0], [[[0.0]], [[2.0]], [[4.0]]])
    assert [float(motion.at(t)[0, 0]) for t in (-1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 9.0)] == [0, 0, 1, 2, 3, 4, 4]
    assert float(Trajectory([2.0], [[[7.0]]]).at(0.0)[0, 0]) == 7.0


def test_reflections_that_nobody_announces_disturb_by_the_jump_of_the_velocity() -> None:
    """Between reflections the error moves by itself; at each one it takes the jump, which the reference path feels."""
    plane = tp.LinearAgent(np.kron([[0.0, 1.0], [0.0, 0.0]], np.eye(2)), np.kron([[1.0, 0.0]], np.eye(2)))
    problem = tp.NetworkedAgents(tp.graphs.cycle(3, anchors=(0,)), plane)
    observer = tp.design(problem, tp.methods.LocalKalman())
    motion = Bouncing.drawn(3, 1.0, (0.5, 1.0), np.random.default_rng(6), known=False)
    times = np.linspace(0.0, 3.0, 31)
    exact = tp.simulate(problem, observer, tp.Scenario(times, 0.0, motion=motion))
    coarse, fine = (
        tp.simulate(problem, observer, tp.Scenario(times, 0.0, motion=motion, period=h)) for h in (8e-3, 2e-3)
    )
    told = Bouncing(motion.position, motion.velocity, 1.0)
    assert np.abs(tp.simulate(problem, observer, tp.Scenario(times, 0.0, motion=told)).error).max() < 1e-12
    assert np.abs(exact.error).max() > 0.3
    np.testing.assert_array_equal(fine.truth[0], motion.at(0.0))
    gaps = [np.abs(exact.error - run.error)[:, :, :2].max() for run in (coarse, fine)]
    assert gaps[1] < 0.4 * gaps[0] < 0.1  # first order in the period
    H, error, now, k = observer.error_matrix().toarray(), np.zeros(12), 0.0, 1
    for time in sorted({*motion.bounces(3.0).tolist(), *times[1:].tolist()}):
        error, now = la.expm(H * (time - now)) @ error, time
        if k < 31 and time == times[k]:
            np.testing.assert_allclose(exact.error[k].ravel(), error, atol=1e-9)
            k += 1
        else:
            jump = motion.at(time + 1e-7)[:, 2:] - motion.at(time - 1e-7)[:, 2:]
            error = error - np.concatenate([np.zeros((3, 2)), jump], axis=1).ravel()


def test_a_table_that_nobody_announces_disturbs_through_the_closed_loop() -> None:
    """``e' = H e - (x' - A x)`` piece by piece, against an integrator."""
    agent = tp.LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]])
    problem = tp.NetworkedAgents(tp.graphs.cycle(3, anchors=(0,)), agent)
    observer = tp.design(problem, tp.methods.LocalKalman())
    table = np.random.default_rng(2).normal(size=(4, 3, 2))
    motion = Trajectory([0.0, 0.7, 1.1, 2.0], table, known=False)
    times = np.array([0.0, 0.5, 0.9, 1.5, 2.0, 2.6])
    run = tp.simulate(problem, observer, tp.Scenario(times, 0.3, motion=motion))
    H, A = observer.error_matrix().toarray(), np.kron(np.eye(3), agent.A)
    error, now, k = np.full(6, 0.3), 0.0, 1
    for time in sorted({*motion.times.tolist()[1:], *times.tolist()[1:]}):
        speed = (motion.at(time) - motion.at(now)).ravel() / (time - now)

        def slope(t, e, now=now, speed=speed):
            return H @ e - (speed - A @ (motion.at(now).ravel() + (t - now) * speed))

        error = solve_ivp(slope, (now, time), error, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        now = time
        if k < 6 and time == times[k]:
            np.testing.assert_allclose(run.error[k].ravel(), error, atol=1e-9)
            k += 1
    assert k == 6


def test_nonsense_radii_are_refused() -> None:
    motion = Bouncing.drawn(2, 1.0, (0.5, 1.0), np.random.default_rng(0))
    with pytest.raises(ArgumentError, match="radius and until must be positive"):
        proximity(motion, [(0, 1)], -1.0, 1.0)
    with pytest.raises(ShapeError, match="the motion has 2 agents; the graph has 3 nodes"):
        within_reach(motion, tp.graphs.chain(3), 1.0, 1.0)


def test_anchors_stay_and_arcs_come_and_go() -> None:
    motion, graph = Bouncing.drawn(4, 2.0, (0.5, 1.0), np.random.default_rng(1)), tp.graphs.cycle(4, anchors=(0, 2))
    topology = within_reach(motion, graph, 1.0, 6.0)
    assert topology.active[:, graph.is_external].all()
    inner = ~graph.is_external
    for time in (0.5, 2.2, 5.7):
        place = motion.positions(time)
        gaps = np.linalg.norm(place[graph.tail[inner]] - place[graph.head[inner]], axis=1)
        assert np.array_equal(topology.at(time)[inner], gaps <= 1.0)
