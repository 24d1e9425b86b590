"""Ensembles, noise and changing topologies against theory: covariances, mean squares, limits."""

from __future__ import annotations

import builtins
import itertools

import networkx as nx
import numpy as np
import pytest
import scipy.linalg as la

import trigpoint as tp
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle, grid
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.simulation import Absence, Channel, Noise, Scenario, Topology, ensemble, simulate

DOUBLE = LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]], E=[[0.0], [1.0]])


def watts_strogatz() -> MeasurementGraph:
    """The test graph of theory 6."""
    arcs = sorted((min(a, b), max(a, b)) for a, b in nx.connected_watts_strogatz_graph(12, 4, 0.3, seed=1).edges)
    return MeasurementGraph(12, [a for a, _ in arcs] + [EXTERNAL], [b for _, b in arcs] + [0])


WORLD = NetworkedAgents(watts_strogatz(), LinearAgent.static())
HIGH = float(np.linalg.eigvalsh(WORLD.graph.laplacian().toarray())[-1])
EULER = tp.design(WORLD, tp.methods.Sampled(1.0 / HIGH, "euler", tp.methods.LocalKalman(tp.Fixed(1.0))))


def test_the_mean_square_rate_under_lost_arcs_is_the_predicted_one() -> None:
    """Theory 6-F4: .99201 for p = .5, h gamma = 1 / lambda_max; no start but the slowest mode."""
    assert tp.analysis.sampling.mean_square_radius(WORLD.graph, 1.0 / HIGH, 0.5) == pytest.approx(0.99201, abs=5e-6)
    steps = np.arange(0, 401, 50) / HIGH
    found = ensemble(WORLD, EULER, Scenario(steps, 1.0, period=1.0 / HIGH, seed=3), 3000, arrival=0.5)
    rate = (found.mean_square[-1] / found.mean_square[2]) ** (1.0 / 300.0)
    assert rate == pytest.approx(0.99201, abs=2e-4)


def test_workers_do_not_change_a_bit() -> None:
    scenario = Scenario([0.0, 5.0 / HIGH], 1.0, period=1.0 / HIGH, noise=Noise(0.3), seed=5)
    one, two = (ensemble(WORLD, EULER, scenario, 300, arrival=0.7, workers=k) for k in (1, 2))
    assert np.array_equal(one.covariance, two.covariance)
    assert np.array_equal(one.mean_square, two.mean_square)


@pytest.mark.parametrize("arrival", [1.0, 0.6])
@pytest.mark.parametrize("noise", [None, Noise(0.3, 0.5)])
def test_the_compiled_engine_gives_the_same_numbers(arrival, noise) -> None:
    agent = LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]])
    problem = NetworkedAgents(grid(3, 3, anchors=(0,)), agent)
    observer = tp.design(problem, tp.methods.Sampled(0.01, "innovation-held"))
    scenario = Scenario([0.0, 0.1, 3.0], 1.0, period=0.01, noise=noise, seed=9)
    slow, fast = (ensemble(problem, observer, scenario, 150, arrival=arrival, engine=e) for e in ("numpy", "jax"))
    np.testing.assert_allclose(fast.covariance, slow.covariance, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(fast.node_mean_square, slow.node_mean_square, rtol=1e-9)


def test_without_jax_the_message_names_the_extra(monkeypatch) -> None:
    whole = builtins.__import__

    def without(name, *rest, **options):
        if name == "jax":
            raise ImportError(name)
        return whole(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match="jax"):
        ensemble(WORLD, EULER, Scenario([1.0 / HIGH], period=1.0 / HIGH), 2, engine="jax")


def test_the_sampled_steady_covariance_solves_its_stein_equation() -> None:
    problem = NetworkedAgents(cycle(5, anchors=(0, 2)), DOUBLE)
    observer = tp.design(problem, tp.methods.LocalKalman(tp.FromGraph(2.0)))
    h = 0.2
    scenario = Scenario([0.0, 30.0], 0.0, period=h, noise=Noise(0.3, 0.4), seed=1)
    found = ensemble(problem, observer, scenario, 4000)
    programs = observer.as_programs()
    M = programs.error_map(h).toarray()
    maps = [node.maps(h)[2] for node in programs.nodes]
    K = la.block_diag(*maps) @ observer.reading_matrix().toarray()
    factor = tp.simulation.plant.noise_factor(DOUBLE.A, 0.4 * DOUBLE.E, h)
    Q = 0.09 * K @ K.T + np.kron(np.eye(5), factor @ factor.T)
    X = la.solve_discrete_lyapunov(M, Q)
    spread = np.sqrt((X * X + np.outer(np.diagonal(X), np.diagonal(X))) / 4000.0)
    assert (np.abs(found.covariance - X) <= 5.0 * spread).all()
    assert abs(found.mean_square[-1] - np.trace(X)) <= 5.0 * found.standard_error[-1]


def test_continuous_noise_has_the_covariance_of_the_lyapunov_equation() -> None:
    """One long run: its time average over independent stretches."""
    problem = NetworkedAgents(cycle(4, anchors=(0,)), DOUBLE)
    observer = tp.design(problem, tp.methods.LocalKalman(tp.FromGraph(2.0)))
    gap = 12.0 / observer.decay_rate
    result = simulate(problem, observer, Scenario(gap * np.arange(1, 1201), 0.0, noise=Noise(0.5, 0.3), seed=2))
    assert result.path == "modal"
    K = observer.reading_matrix().toarray()
    noise = 0.25 * K @ K.T + 0.09 * np.kron(np.eye(4), DOUBLE.E @ DOUBLE.E.T)
    X = la.solve_continuous_lyapunov(observer.error_matrix().toarray(), -noise)
    e = result.error.reshape(1200, -1)
    S = e.T @ e / 1200.0
    spread = np.sqrt((X * X + np.outer(np.diagonal(X), np.diagonal(X))) / 1200.0)
    assert (np.abs(S - X) <= 5.0 * spread).all()


def test_a_changing_topology_is_exact_between_its_changes() -> None:
    problem = NetworkedAgents(grid(2, 3, anchors=(0,)), DOUBLE)
    observer = tp.design(problem, tp.methods.LocalKalman(tp.FromGraph(1.2)))
    topology = Topology.random(problem.graph.n_arcs, 0.3, 0.6, 3.0, seed=8)
    times = np.array([0.0, 0.45, 1.0, 2.9])
    result = simulate(problem, observer, Scenario(times, 1.0, topology=topology))
    error, now, k = np.ones(12), 0.0, 0
    expected = [error]
    instants = sorted({*topology.times.tolist(), *times.tolist()})
    for time in instants[1:]:
        part = topology.graph_at(problem.graph, now)
        H = np.kron(np.eye(6), DOUBLE.A) - observer.gain * np.kron(
            part.laplacian().toarray(), observer.injection @ DOUBLE.C
        )
        error, now = la.expm(H * (time - now)) @ error, time
        if k + 1 < len(times) and time == times[k + 1]:
            expected.append(error)
            k += 1
    np.testing.assert_allclose(result.error.reshape(4, -1), np.array(expected), atol=1e-11)
    part = topology.graph_at(problem.graph, 1.0)
    assert result.lambda_min[2] == pytest.approx(max(0.0, np.linalg.eigvalsh(part.laplacian().toarray())[0]), abs=1e-12)
    # The reference path, exchanging often, comes as near as its period.
    fine = simulate(problem, observer, Scenario(times, 1.0, topology=topology, period=1e-3))
    assert fine.path == "reference"
    assert np.abs(fine.error - result.error).max() < 0.02


def test_one_function_decreases_on_every_topology_of_a_family() -> None:
    """G16, Theorem 6: e' (I x P) e falls while the topology alternates among externally connected graphs."""
    graphs = [chain(5), cycle(5, anchors=(3,)), grid(1, 5, anchors=(2, 4))]
    everything = MeasurementGraph(
        5,
        np.concatenate([g.tail for g in graphs]),
        np.concatenate([g.head for g in graphs]),
    )
    sizes = np.cumsum([0] + [g.n_arcs for g in graphs])
    rows = [np.arange(a, b) for a, b in itertools.pairwise(sizes)]
    rng = np.random.default_rng(0)
    changes = [(0.2 * k, rows[int(rng.integers(3))].tolist()) for k in range(40)]
    problem = NetworkedAgents(everything, DOUBLE)
    observer = tp.design(problem, tp.methods.LocalKalman(tp.Fixed(1.05 * max(tp.gain_bound(g) for g in graphs))))
    times = np.linspace(0.0, 8.0, 161)
    result = simulate(problem, observer, Scenario(times, 1.0, topology=Topology.schedule(everything, changes)))
    P = np.linalg.inv(observer.facts["Q"])
    V = np.einsum("tni,ij,tnj->t", result.error, P, result.error)
    assert (np.diff(V) < 0.0).all()


def test_gossip_contracts_as_predicted() -> None:
    """Theory 6-F5: mean square below (1 - lambda_min / |G|_F^2)^t = .99875^t; measured there .99152."""
    energy = float((WORLD.graph.incidence().toarray() ** 2).sum())
    bound = tp.analysis.sampling.gossip_rate(1.0 / tp.gain_bound(WORLD.graph), energy)
    assert bound == pytest.approx(0.99875, abs=5e-6)
    observer = tp.design(WORLD, tp.methods.LocalKalman())
    squares = []
    for seed in range(40):
        start = np.random.default_rng(seed).normal(size=12)
        options = {"period": 1.0, "gossip": True, "seed": seed}
        result = simulate(WORLD, observer, Scenario([0.0, 200.0, 400.0], start, **options))
        squares.append(result.error_norm**2)
    mean = np.mean(squares, axis=0)
    assert result.path == "gossip"
    assert (mean[1] / mean[0]) ** (1.0 / 200.0) < bound
    assert (mean[2] / mean[0]) ** (1.0 / 400.0) == pytest.approx(0.99152, abs=2e-3)


def test_the_delay_limit_is_seen_from_both_sides() -> None:
    """Theory 6-F3, the whole innovation late: at .99 and 1.01 of pi / (2 gain lambda_max), with the predicted rates."""
    limit = tp.analysis.sampling.delay_margin(1.0, HIGH)
    L = WORLD.graph.laplacian().toarray()
    values, vectors = la.eigh(L)
    for share, rate in ((0.99, -0.0350), (1.01, 0.0340)):
        delay, parts = limit * share, 500
        h = delay / parts
        predicted = tp.analysis.sampling.delayed_abscissa(values, delay)
        assert predicted == pytest.approx(rate, abs=2e-4)
        late, now, sizes = [vectors[:, -1]] * (parts + 1), vectors[:, -1], []
        for _ in range(200 * parts):
            old, new = late[-parts - 1], late[-parts]
            now = now - h * L @ (0.5 * (old + new))  # the trapezoid rule, exact to h^2
            late.append(now)
            sizes.append(float(now @ now))
        energy = np.array(sizes).reshape(-1, 4 * parts).max(axis=1)  # one swing is four delays
        slope = np.polyfit(4.0 * delay * np.arange(10, 50), 0.5 * np.log(energy[10:50]), 1)[0]
        assert slope == pytest.approx(predicted, rel=0.05)


def test_late_messages_alone_never_make_it_unstable() -> None:
    """Theory 6-F3: with the own value undelayed stable for every delay; abscissae -.0435, -.0121 at .1 and 1 s."""
    observer = tp.design(WORLD, tp.methods.LocalKalman(tp.Fixed(1.0)))
    for delay, rate in ((0.1, 0.0435), (1.0, 0.0121)):
        horizon = 3.0 / rate
        times = np.linspace(0.5 * horizon, horizon, 21)
        scenario = Scenario(times, 1.0, period=0.01, channel=Channel(delay=delay, old="use"))
        norm = simulate(WORLD, observer, scenario).error_norm
        assert -np.polyfit(times, np.log(norm), 1)[0] == pytest.approx(rate, rel=0.02)


def test_many_networks_in_one_call_are_each_one_alone() -> None:
    networks = []
    for graph in (chain(3), cycle(4, anchors=(1,)), chain(3)):
        problem = NetworkedAgents(graph, DOUBLE)
        networks.append((problem, tp.design(problem, tp.methods.LocalKalman(tp.FromGraph(2.0)))))
    scenario = Scenario([0.0, 1.0], 1.0, period=0.1, noise=Noise(0.3, 0.1), seed=4)
    for workers in (1, 2):
        several = tp.simulation.ensembles(networks, scenario, 200, workers=workers)
        for (problem, observer), found in zip(networks, several, strict=True):
            alone = ensemble(problem, observer, scenario, 200, workers=1)
            assert np.array_equal(found.covariance, alone.covariance)
            assert np.array_equal(found.node_mean_square, alone.node_mean_square)


@pytest.mark.parametrize("seed", range(0, 200, 10))
def test_the_error_decays_at_least_at_the_certified_rate(seed) -> None:
    """20 drawn networks here, 200 in the slow test."""
    check_rate(seed)


@pytest.mark.slow
def test_two_hundred_networks_decay_at_their_certified_rate() -> None:
    """Constants at that rate to 1 %, moving agents at least at it."""
    for seed in range(200):
        check_rate(seed)
        check_rate(seed, AGENTS[0])


AGENTS = (LinearAgent.static(), DOUBLE, LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]]))


def check_rate(seed: int, given: LinearAgent | None = None) -> None:
    rng = np.random.default_rng(seed)
    agent = AGENTS[seed // 10 % 3] if given is None else given
    graph = tp.graphs.random_connected(int(rng.integers(3, 12)), float(rng.uniform(0.1, 0.8)), rng)
    problem = NetworkedAgents(graph, agent)
    observer = tp.design(problem, tp.methods.LocalKalman())
    record = tp.certify(problem, observer).records[1]
    assert record.verdict == "certified"
    proved = record.numbers["rate"]
    horizon = 40.0 / proved
    result = simulate(
        problem, observer, Scenario(np.linspace(0.0, horizon, 801), rng.normal(size=(graph.n_nodes, agent.n_states)))
    )
    # Over the later half the slope is that of the slowest mode, which the computed abscissa names.
    norm = np.maximum(result.error_norm, 1e-300)
    usable = norm > 1e-9 * norm[0]
    rate = -np.polyfit(result.times[usable][10:], np.log(norm[usable][10:]), 1)[0]
    assert rate >= 0.99 * proved
    if agent is AGENTS[0]:
        last = np.flatnonzero(usable)[-1]
        first = max(last // 2, 1)
        slope = np.log(norm[first] / norm[last]) / (result.times[last] - result.times[first])
        assert slope == pytest.approx(proved, rel=0.01)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ensemble(WORLD, EULER, Scenario([1.0 / HIGH], period=1.0 / HIGH), 1), "runs >= 2"),
        (lambda: ensemble(WORLD, EULER, Scenario([0.1], period=1.0 / HIGH), 5), "must be multiples of the period"),
        (
            lambda: ensemble(WORLD, EULER, Scenario([1.0 / HIGH], period=1.0 / HIGH, channel=Channel(0.1)), 5),
            "covers noise and lost arcs; got channel",
        ),
        (
            lambda: ensemble(WORLD, EULER, Scenario([1.0 / HIGH], period=1.0 / HIGH, absences=[Absence(0, 1.0)]), 5),
            "absences or gossip",
        ),
        (
            lambda: ensemble(WORLD, tp.design(WORLD, tp.methods.LocalKalman()), Scenario([1.0]), 5),
            "give the scenario a period",
        ),
        (
            lambda: ensemble(
                WORLD, tp.design(WORLD, tp.methods.LocalKalman()), Scenario([1.0], period=1.0), 5, arrival=0.5
            ),
            "must not depend on who is heard",
        ),
        (lambda: ensemble(WORLD, None, Scenario([1.0], period=1.0), 5), "runs observers made by design"),
    ],
)
def test_what_an_ensemble_does_not_cover_is_refused(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"topology": Topology([0.0], np.ones((1, 3), dtype=bool))}, "the topology switches 3 arcs; the network has"),
        ({"noise": Noise(1.0), "measurements": np.zeros(25)}, "belong to a fixed topology without noise"),
        ({"absences": [Absence(1, 1.0)], "path": "stacked"}, "goes mode by mode"),
        ({"gossip": True, "period": 1.0, "path": "stacked"}, "gossip has a path of its own"),
        ({"gossip": True, "period": 1.0, "noise": Noise(process=1.0)}, "no process noise"),
    ],
)
def test_what_no_path_can_do_is_refused(options, words) -> None:
    observer = tp.design(WORLD, tp.methods.LocalKalman())
    with pytest.raises(ArgumentError, match=words):
        simulate(WORLD, observer, Scenario([1.0], **options))


def test_noise_and_changes_need_equal_agents_and_unit_weights() -> None:
    heavy = NetworkedAgents(chain(3).with_weight([1.0, 2.0, 1.0]), DOUBLE)
    with pytest.raises(ArgumentError, match="unit weights"):
        simulate(heavy, tp.design(heavy, tp.methods.LocalKalman()), Scenario([1.0], noise=Noise(1.0)))
    with pytest.raises(ArgumentError, match="for equal agents with one gain"):
        simulate(WORLD, EULER, Scenario([1.0], noise=Noise(1.0)))
    moving = NetworkedAgents(chain(3), DOUBLE)
    with pytest.raises(ArgumentError, match="gossip is for constants that are measured"):
        simulate(
            moving, tp.design(moving, tp.methods.LocalKalman()), Scenario([1.0], period=1.0, gossip=True)
        )  # fmt: skip
