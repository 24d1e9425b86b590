"""Sampled exchange and acceleration: every limit holds at 0.99 and fails at 1.01 of itself; published numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.analysis import sampling
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.balls import Ball
from trigpoint.linalg.interval_stability import contraction_on_interval
from trigpoint.methods import Accelerated, DiscreteKalman, Fixed, LocalKalman, Sampled
from trigpoint.methods.accelerated import convergence_factor, heavy_ball, predicted_exchanges
from trigpoint.observers.acceleration import chebyshev_factor
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing import check_design
from trigpoint.testing.strategies import measurement_graphs

# theory, section 6: a small world of 12 nodes, one anchor
ARCS = "0-2 0-4 0-10 1-3 1-7 1-11 2-3 2-4 3-4 3-6 4-6 4-7 5-7 5-9 5-10 6-7 6-8 7-9 7-11 8-9 8-10 9-10 9-11 10-11"
PAIRS = [tuple(map(int, pair.split("-"))) for pair in ARCS.split()]
WORLD = tp.MeasurementGraph(12, [i for i, _ in PAIRS] + [-1], [j for _, j in PAIRS] + [0])
VALUES = np.linalg.eigvalsh(WORLD.laplacian().toarray())
LOW, HIGH = float(VALUES[0]), float(VALUES[-1])
STATIC, DOUBLE = tp.LinearAgent.static(), tp.LinearAgent([[0, 1], [0, 0]], [[1, 0]])


def test_the_graph_is_that_of_the_theory() -> None:
    assert pytest.approx(0.06103, abs=5e-6) == LOW
    assert pytest.approx(7.614, abs=5e-4) == HIGH


def test_euler_limit_and_best_period() -> None:  # 6-F1
    limit = sampling.euler_limit(1.0, HIGH)
    for factor, stable in ((0.99, True), (1.01, False)):
        assert (np.abs(1.0 - factor * limit * VALUES).max() < 1.0) == stable
    period, radius = sampling.best_euler(1.0, LOW, HIGH)
    assert radius == pytest.approx(0.98410, abs=5e-6)
    assert np.abs(1.0 - period * VALUES).max() == pytest.approx(radius, rel=1e-12)


@pytest.mark.parametrize("period", [1e-3, 1.0, 1e6])
def test_held_neighbours_are_stable_for_every_period(period) -> None:  # 6-F2
    observer = tp.design(tp.NetworkedAgents(WORLD, STATIC), Sampled(period, base=LocalKalman(Fixed(1.0))))
    radius = observer.facts["spectral_radius"]
    assert radius < 1.0
    M = observer.error_map(period).toarray()
    assert (M >= 0.0).all(), "nonnegative, rows summing to at most 1"
    assert M.sum(axis=1).max() <= 1.0 + 1e-12
    if period == 1e6:
        assert radius == pytest.approx(0.98508, abs=5e-6)  # Jacobi


def test_delay_margin() -> None:  # 6-F3
    margin = sampling.delay_margin(1.0, HIGH)
    assert sampling.delayed_abscissa(VALUES, 0.99 * margin) == pytest.approx(-0.0350, abs=5e-5)
    assert sampling.delayed_abscissa(VALUES, 1.01 * margin) == pytest.approx(0.0340, abs=5e-5)
    assert sampling.delayed_abscissa(VALUES, 0.0) == -LOW


def limit_of(arrival: float) -> float:
    low, high = 1e-3, 2.0
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sampling.mean_square_radius(WORLD, middle, arrival) < 1.0 else (low, middle)
    return low


@pytest.mark.parametrize(
    ("arrival", "exact", "sufficient"), [(1.0, 0.2627, 0.2627), (0.5, 0.4604, 0.4161), (0.2, 0.7282, 0.6404)]
)
def test_mean_square_limits(arrival, exact, sufficient) -> None:  # 6-F4
    assert limit_of(arrival) == pytest.approx(exact, abs=5e-5)
    assert sampling.mean_square_limit(1.0, HIGH, arrival) == pytest.approx(sufficient, abs=5e-5)
    assert sampling.mean_square_radius(WORLD, 0.99 * limit_of(arrival), arrival) < 1.0
    assert sampling.mean_square_radius(WORLD, 1.01 * limit_of(arrival), arrival) > 1.0


def test_the_mean_square_rate_is_that_of_the_big_operator_and_of_drawn_losses() -> None:
    step, p = 1.0 / HIGH, 0.5
    rate = sampling.mean_square_radius(WORLD, step, p)
    assert rate == pytest.approx(0.99201, abs=5e-6)
    G, eye = WORLD.incidence().toarray(), np.eye(12)
    M = eye - step * p * G @ G.T
    S = np.kron(M, M) + step**2 * p * (1 - p) * sum(np.kron(np.outer(g, g), np.outer(g, g)) for g in G.T)
    assert np.abs(np.linalg.eigvals(S)).max() == pytest.approx(rate, rel=1e-10)
    rng = np.random.default_rng(0)
    errors = rng.normal(size=(4000, 12))
    norms = []
    for _ in range(300):
        arrived = rng.random((4000, WORLD.n_arcs)) < p
        errors = errors - step * ((errors @ G) * arrived) @ G.T
        norms.append((errors**2).sum(axis=1).mean())
    measured = (norms[299] / norms[99]) ** (1 / 200)
    assert measured == pytest.approx(rate, abs=2e-4)


def test_gossip_is_faster_than_its_bound() -> None:  # 6-F5
    G = WORLD.incidence().toarray()
    energy = float((G**2).sum())
    bound = sampling.gossip_rate(LOW, energy)
    assert bound == pytest.approx(0.99875, abs=5e-6)
    rng, errors = np.random.default_rng(1), np.random.default_rng(2).normal(size=(2000, 12))
    start = (errors**2).sum(axis=1).mean()
    weights = (G**2).sum(axis=0)
    for _ in range(400):
        g = G[:, rng.choice(WORLD.n_arcs, size=2000, p=weights / energy)].T
        errors = errors - g * ((errors * g).sum(axis=1) / (g * g).sum(axis=1))[:, None]
    assert ((errors**2).sum(axis=1).mean() / start) ** (1 / 400) < bound


def test_innovation_held_limits_of_the_double_integrator() -> None:  # 6-F7, with (q1, q2) = (sqrt 2, 1)
    K = np.array([[np.sqrt(2.0)], [1.0]])
    for value, expected in ((LOW, 2.828427), (1.0, 1.414214), (HIGH, 0.185733)):
        limit = sampling.period_limit("innovation-held", DOUBLE.A, K, DOUBLE.C, 1.0, (value, value))
        assert limit == pytest.approx(expected, abs=5e-7)
        assert limit == pytest.approx(min(2 * np.sqrt(2.0), 2.0 / (value * np.sqrt(2.0))), rel=1e-8)
    limit = sampling.period_limit("innovation-held", DOUBLE.A, K, DOUBLE.C, 1.0, (LOW, HIGH))
    for factor, stable in ((0.99, True), (1.01, False)):
        mode = sampling.sampled_mode("innovation-held", DOUBLE.A, K, DOUBLE.C, factor * limit)
        assert sampling.sampled_stability(mode, 1.0, LOW, HIGH).stable is stable


@given(st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_no_interval_is_called_stable_that_is_not(seed) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    M0, M1 = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    M0, M1 = M0 * rng.uniform(0.3, 1.2) / np.linalg.norm(M0, 2), M1 * 0.4 / np.linalg.norm(M1, 2)
    found = contraction_on_interval(Ball.exact(M0), Ball.exact(M1), 0.0, 1.0)
    radii = [np.abs(np.linalg.eigvals(M0 + s * M1)).max() for s in np.linspace(0, 1, 1001)]
    if found.stable is True:
        assert max(radii) < 1.0
    elif found.stable is False:
        assert max(radii) > 1.0 - 1e-6
    else:
        assert abs(max(radii) - 1.0) < 1e-3


@pytest.mark.parametrize("form", ["euler", "innovation-held"])
def test_a_period_beyond_the_limit_is_refused_with_the_limit(form) -> None:
    problem = tp.NetworkedAgents(WORLD, DOUBLE)
    observer = tp.design(problem, Sampled(1e-3, form))
    limit = observer.facts["period_limit"]
    assert observer.decay_rate > 0.0
    with pytest.raises(MethodError, match=f"a period below {limit:.6g} s"):
        tp.design(problem, Sampled(1.01 * limit, form))
    below = tp.design(problem, Sampled(0.99 * limit, form))
    assert np.abs(np.linalg.eigvals(below.error_map(below.period).toarray())).max() < 1.0


@given(
    measurement_graphs(max_nodes=6, externally_connected=True), st.sampled_from(["held", "euler", "innovation-held"])
)
@settings(max_examples=25, deadline=None)
def test_sampled_designs_obey_the_axioms(graph, form) -> None:
    limit = 1.0 / float(graph.laplacian().toarray().trace())
    check_design(Sampled(0.5 * limit, form, LocalKalman(Fixed(1.0))), tp.NetworkedAgents(graph, STATIC))


def test_a_sampled_run_contracts_as_computed() -> None:
    observer = tp.design(tp.NetworkedAgents(WORLD, DOUBLE), Sampled(0.004, "innovation-held"))
    times = 0.004 * np.arange(0, 4001, 400)
    run = simulate(observer.problem, observer, Scenario(times, 1.0))
    measured = -np.log(run.error_norm[-1] / run.error_norm[-2]) / 1.6
    assert measured == pytest.approx(-observer.spectral_abscissa, rel=0.05)
    assert observer.decay_rate <= measured * 1.02


def test_discrete_agents() -> None:  # 6-F8
    graph = tp.graphs.cycle(4, anchors=(0, 1, 2, 3))  # spectrum {1, 3, 3, 5}; bound of lambda_max 6
    slow = tp.LinearAgent([[1.1]], [[1.0]])
    observer = tp.design(tp.NetworkedAgents(graph, slow), DiscreteKalman())
    assert observer.facts["existence"] < 1.0
    assert np.abs(np.linalg.eigvals(observer.error_matrix().toarray())).max() < 1.0
    check_design(DiscreteKalman(), tp.NetworkedAgents(graph, tp.LinearAgent([[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]])))
    fast = tp.LinearAgent([[1.5]], [[1.0]])  # kappa <= 6: (6 + 1) / (6 - 1) = 1.4
    with pytest.raises(MethodError, match=r"below \(kappa \+ 1\) / \(kappa - 1\) = 1.4"):
        tp.design(tp.NetworkedAgents(graph, fast), DiscreteKalman())
    with pytest.raises(MethodError, match="an island"):
        tp.design(tp.NetworkedAgents(tp.graphs.cycle(4), slow), DiscreteKalman())
    with pytest.raises(MethodError, match="A = 0, after which every state is zero"):
        tp.design(tp.NetworkedAgents(graph, tp.LinearAgent.static()), DiscreteKalman())
    with pytest.raises(MethodError, match="equal agents and scalar weights"):
        tp.design(tp.NetworkedAgents(graph, [slow, slow, slow, fast]), DiscreteKalman())


# -- acceleration (7-H4) -----------------------------------------------------------------------------------------------
GRID = tp.graphs.grid(70, 128, anchors=(8959,))


def counted(scheme: str, low: float, high: float) -> int:
    """Exchanges until the constant error on the 70 x 128 grid is below 1 %, by the stacked recurrences."""
    L = GRID.laplacian()
    e, last, start = np.ones(8960), np.ones(8960), np.sqrt(8960.0)
    a, b = heavy_ball(low, high)
    rho = (high - low) / (high + low)
    for k in range(4000):
        if scheme == "heavy-ball":
            e, last = e - a * (L @ e) + b * (e - last), e
        else:
            omega = chebyshev_factor(k, rho)
            e, last = omega * (e - 2.0 / (low + high) * (L @ e)) + (1.0 - omega) * last, e
        if np.linalg.norm(e) < 0.01 * start:
            return k + 1
    return 0


@pytest.mark.parametrize(("scheme", "published"), [("heavy-ball", 1736), ("chebyshev", 1387)])
def test_exchanges_on_the_image_grid(scheme, published) -> None:
    low, high = tp.smallest_eigenvalue(GRID).value, 7.99738
    measured, predicted = counted(scheme, low, high), predicted_exchanges(scheme, low, high)
    assert measured == pytest.approx(published, rel=0.05)
    assert predicted == pytest.approx(measured, rel=0.01)


def test_the_semi_iterations_factor_obeys_its_recurrence() -> None:
    rho, omega = 0.999, 1.0
    assert chebyshev_factor(0, rho) == 1.0
    assert chebyshev_factor(1, rho) == pytest.approx(1.0 / (1.0 - rho**2 / 2.0), rel=1e-14)
    omega = chebyshev_factor(1, rho)
    for k in range(2, 200):
        omega = 1.0 / (1.0 - rho**2 * omega / 4.0)
        assert chebyshev_factor(k, rho) == pytest.approx(omega, rel=1e-12)


@given(
    measurement_graphs(max_nodes=6, externally_connected=True),
    st.sampled_from(["heavy-ball", "chebyshev", "second-order"]),
)
@settings(max_examples=30, deadline=None)
def test_accelerated_designs_obey_the_axioms(graph, scheme) -> None:
    check_design(Accelerated(scheme), tp.NetworkedAgents(graph, tp.LinearAgent.static(2)))


@pytest.mark.parametrize("scheme", ["heavy-ball", "chebyshev", "second-order"])
def test_a_run_is_as_fast_as_promised(scheme) -> None:
    problem = tp.NetworkedAgents(tp.graphs.grid(6, 7), STATIC)
    observer = tp.design(problem, Accelerated(scheme))
    horizon = 8.0 / observer.decay_rate
    times = np.linspace(0.0, np.round(horizon), 9)
    period = None if scheme == "second-order" else 1.0
    run = simulate(problem, observer, Scenario(np.round(times), 1.0, period=period))
    assert run.error_norm[-1] < 20.0 * np.exp(-observer.decay_rate * times[-1]) * run.error_norm[0]
    plain = tp.design(problem, LocalKalman(Fixed(1.0)))
    if scheme == "second-order":
        assert observer.decay_rate > 5.0 * plain.decay_rate
        assert convergence_factor(scheme, plain.facts["lambda_min"], 8.0) == pytest.approx(
            np.exp(-np.sqrt(plain.facts["lambda_min"]))
        )


def test_a_wrong_bound_costs_speed_and_the_guarantee_not_stability() -> None:
    problem = tp.NetworkedAgents(tp.graphs.grid(6, 7), STATIC)
    low = tp.smallest_eigenvalue(problem.graph).value
    for factor in (0.1, 10.0, 100.0):
        observer = tp.design(problem, Accelerated("heavy-ball", lambda_min=factor * low))
        assert np.abs(np.linalg.eigvals(observer.error_matrix().toarray())).max() < 1.0
        assert (observer.decay_rate > 0.0) == (factor < 1.0)
        assert ("not proved" in observer.facts["guarantee"]) == (factor > 1.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Sampled(0.0), "period must be a positive number"),
        (lambda: Sampled(1.0, "leapfrog"), "form must be one of held, euler, innovation-held"),
        (lambda: Accelerated("nesterov"), "scheme must be one of heavy-ball"),
        (lambda: Accelerated(lambda_min=-1.0), "lambda_min must be a positive number"),
        (lambda: Accelerated(period=np.inf), "period must be a positive number"),
        (lambda: sampling.mean_square_radius(tp.graphs.chain(51), 0.1, 0.5), "up to 50 nodes"),
        (lambda: sampling.mean_square_limit(1.0, 1.0, 0.0), "arrival must be a probability"),
        (lambda: sampling.sampled_mode("held", np.eye(1), np.eye(1), np.eye(1), 1.0), "form must be 'euler'"),
    ],
)
def test_nonsense_is_refused(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


BLOCKS = tp.graphs.chain(3).with_weight(np.stack([np.diag([1.0, 2.0])] * 3))


@pytest.mark.parametrize(
    ("method", "problem", "words"),
    [
        (Sampled(0.1, base=Accelerated()), tp.NetworkedAgents(WORLD, STATIC), "a base method for equal agents"),
        (Sampled(0.1, "euler"), tp.NetworkedAgents(BLOCKS, tp.LinearAgent.static(2)), "scalar arc weights"),
        (Sampled(50.0), tp.NetworkedAgents(WORLD, tp.LinearAgent([[0.5]], [[1.0]])), "sampled error contracts"),
        (Accelerated(), tp.NetworkedAgents(WORLD, DOUBLE), "constants that are measured directly"),
        (Accelerated(), tp.graphs.chain(3), "a NetworkedAgents problem"),
        (Accelerated(), tp.NetworkedAgents(tp.graphs.cycle(4), STATIC), "an island"),
        (Accelerated(lambda_min=9.0, lambda_max=8.0), tp.NetworkedAgents(WORLD, STATIC), "lambda_min below lambda_max"),
    ],
)
def test_what_does_not_fit_is_refused(method, problem, words) -> None:
    with pytest.raises(MethodError, match=words):
        tp.design(problem, method)
