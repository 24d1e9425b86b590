"""``Centralised``: W17, section III, in all three kinds; python-control in and out; refusals."""

from __future__ import annotations

import sys

import control
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.methods.observed_plants import drawn_plants
from trigpoint.analysis.pairs import pair_margin
from trigpoint.errors import ArgumentError, MethodError, MissingExtraError, ShapeError
from trigpoint.graphs import chain
from trigpoint.linalg.injection import spectrum_error
from trigpoint.methods.centralised import Centralised
from trigpoint.model import LinearAgent, NetworkedAgents, SharedPlant
from trigpoint.model.control_systems import plant_from_control, plant_to_control
from trigpoint.observers.centralised import CentralisedObserver, reduced_pair
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing.observers import check_observer

OSCILLATOR = LinearAgent([[0.0, 1.0], [-1.0, 0.1]], [[1.0, 0.0]], [[0.0], [1.0]])


@st.composite
def plants(draw) -> SharedPlant:
    """Generic, so observable; outputs of rank below n, some rows repeated."""
    n, m = draw(st.integers(2, 6)), draw(st.integers(1, 3))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    rows = [rng.normal(size=(1, n)) if k < n - 1 else None for k in range(m)]
    if draw(st.booleans()):
        rows[-1] = rows[0] if rows[-1] is None else np.vstack([rows[-1], 2.0 * rows[0]])
    B = rng.normal(size=(n, draw(st.integers(1, 2)))) if draw(st.booleans()) else None
    A = rng.normal(size=(n, n))
    assume(pair_margin(A, np.vstack([row for row in rows if row is not None])).margin > 1e-2)
    return SharedPlant(A, rows, {k: [(k + 1) % m] for k in range(m)}, B)


# -- the three constructors --------------------------------------------------------------------------------------------
@settings(max_examples=60)
@given(plants(), st.sampled_from(["full", "reduced", "extended"]), st.sampled_from([None, 0.5, 3.0]))
def test_design_equations_and_decay(plant, kind, rate) -> None:
    extra = ([[0.0]], np.ones((plant.n_states, 1))) if kind == "extended" else None
    method = Centralised(kind, rate=rate, extra=extra)
    matrices, observer = method.observer(plant), method.build(plant)
    C = plant.stacked_output()
    residuals = matrices.residuals(plant.A, C)
    # The reduced observer divides by what C shows: its residual grows with the gain.
    size = max(1.0, np.abs(matrices.K).max(), np.abs(matrices.N).max(initial=0.0), np.abs(matrices.V).max())
    assert residuals.dynamics <= 1e-13 * size
    assert residuals.output <= 1e-13 * size
    assert (
        matrices.order
        == {
            "full": plant.n_states,
            "extended": plant.n_states + 1,
            "reduced": plant.n_states - np.linalg.matrix_rank(C),
        }[kind]
    )
    abscissa = float(la.eigvals(matrices.H).real.max())
    assert observer.spectral_abscissa == pytest.approx(abscissa)
    assert abscissa <= -observer.decay_rate
    assert abscissa < -(rate or 0.0)
    np.testing.assert_allclose(observer.error_matrix().toarray(), matrices.H, atol=1e-9 * np.abs(matrices.H).max())


@settings(max_examples=30)
@given(plants(), st.sampled_from(["full", "reduced"]), st.integers(0, 100))
def test_eigenvalues_are_placed(plant, kind, seed) -> None:
    rng = np.random.default_rng(seed)
    method = Centralised(kind)
    order = method.observer(plant).order
    pairs = int(rng.integers(0, order // 2 + 1))
    complex_ones = -rng.uniform(1.0, 3.0, size=pairs) + 1j * (1.0 + np.arange(pairs))
    wanted = [*complex_ones, *complex_ones.conj(), *(-1.0 - np.arange(order - 2 * pairs) / 2)]
    observer = Centralised(kind, eigenvalues=wanted).build(plant)
    assert observer.facts["spectrum_error"] == pytest.approx(spectrum_error(observer.error_matrix().toarray(), wanted))
    assert observer.facts["spectrum_error"] <= 1e-12 * (1.0 + observer.facts["gain_size"]) ** 2


def test_full_state_is_the_textbook() -> None:
    A, C, K = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[1.0, 0.0]]), np.array([[4.0], [1.0]])
    observer = CentralisedObserver.full_state(A, C, K)
    np.testing.assert_array_equal(observer.H, [[-4.0, 1.0], [-3.0, -3.0]])
    assert observer.residuals(A, C).dynamics == 0.0


def test_reduced_order_by_hand() -> None:
    """x1 read, x2 observed: ``H = a22 - G a12``."""
    A, C = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[1.0, 0.0]])
    pair = reduced_pair(A, C)
    np.testing.assert_allclose(np.abs(pair[0]), [[4.0]])
    np.testing.assert_allclose(np.abs(pair[1]), [[2.0]])
    observer = CentralisedObserver.reduced_order(A, C, 3.0 * np.sign(pair[1]))
    np.testing.assert_allclose(observer.H, [[-2.0]])
    assert max(vars_of(observer.residuals(A, C))) < 1e-15


def vars_of(residuals) -> tuple[float, float]:
    return residuals.dynamics, residuals.output


@settings(max_examples=40)
@given(st.integers(1, 4), st.integers(1, 3), st.integers(1, 3), st.integers(0, 1000))
def test_extended_holds_whatever_the_loop(n, p, size, seed) -> None:
    rng = np.random.default_rng(seed)
    A, C = rng.normal(size=(n, n)), rng.normal(size=(p, n))
    inner, enter, leave, direct = (rng.normal(size=s) for s in ((size, size), (size, p), (n, size), (n, p)))
    observer = CentralisedObserver.extended(A, C, inner, enter, leave, direct)
    assert max(vars_of(observer.residuals(A, C))) <= 1e-14
    np.testing.assert_array_equal(observer.H[:n, n:], leave)
    np.testing.assert_array_equal(observer.K, -np.vstack([direct, enter]))


def test_a_constant_disturbance_leaves_no_error_in_the_extended_observer() -> None:
    """``x' = A x + c``: the state that follows c is what the full observer lacks."""
    A, C, push = np.array([[0.0, 1.0], [-1.0, 0.1]]), np.array([[1.0, 0.0]]), np.array([[0.0], [1.0]])
    extended = Centralised("extended", rate=1.0, extra=([[0.0]], push)).observer(SharedPlant(A, [C], {}))
    full = Centralised("full", rate=1.0).observer(SharedPlant(A, [C], {}))
    # In the steady state of z - V x: H e = V c.
    left = extended.M @ la.solve(extended.H, extended.V @ push)
    assert np.abs(left).max() < 1e-12
    assert np.abs(la.solve(full.H, push)).max() > 1e-2


# -- as an observer of the house ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", ["full", "reduced", "extended"])
def test_axioms_and_simulation_with_known_input(kind) -> None:
    rng = np.random.default_rng(1)
    outputs = [rng.normal(size=(1, 4)), None, rng.normal(size=(1, 4))]
    plant = SharedPlant(rng.normal(size=(4, 4)), outputs, {0: [1], 1: [2], 2: [0]}, rng.normal(size=(4, 2)))
    extra = ([[0.0]], np.ones((4, 1))) if kind == "extended" else None
    observer = Centralised(kind, rate=1.0, extra=extra).build(plant)
    assert observer.names == ("0",)
    assert observer.problem.outputs[0].shape == (2, 4)
    check_observer(observer.problem, observer)
    times, x = np.linspace(0.0, 5.0, 6), np.ones(4)
    still, driven = (
        simulate(observer.problem, observer, Scenario(times, 1.0, x, inputs=u)) for u in (None, np.array([1.0, -2.0]))
    )
    assert np.abs(still.truth[-1] - driven.truth[-1]).max() > 0.1
    np.testing.assert_allclose(still.error, driven.error, atol=1e-7 * np.abs(driven.truth).max())
    assert still.error_norm[-1] < 0.2 * still.error_norm[0]


def test_one_agent_and_a_linear_agent() -> None:
    single = SharedPlant(OSCILLATOR.A, [OSCILLATOR.C], {}, OSCILLATOR.B)
    assert Centralised().build(single).problem is single
    observer = Centralised().build(OSCILLATOR)
    np.testing.assert_array_equal(
        observer.error_matrix().toarray(), Centralised().build(single).error_matrix().toarray()
    )
    assert observer.local(0).B is not None


@settings(max_examples=20)
@given(drawn_plants())
def test_undisturbed_by_what_dies_out_unseen(plant) -> None:
    """Detectable is enough for the Kalman gain: a stable mode that nobody sees keeps its own rate."""
    A = la.block_diag(plant.A, [[-0.3]])
    outputs = [np.hstack([C, np.zeros((C.shape[0], 1))]) for C in plant.outputs]
    observer = Centralised().build(SharedPlant(A, outputs, dict(enumerate(plant.hears))))
    assert observer.spectral_abscissa >= -0.3 - 1e-9
    assert observer.decay_rate > 0.0
    with pytest.raises(MethodError, match="no gain found that moves all modes"):
        Centralised(rate=1.0).build(SharedPlant(A, outputs, {}))
    with pytest.raises(MethodError, match="a pair that is not observable"):
        Centralised(eigenvalues=-1.0 - np.arange(A.shape[0])).build(SharedPlant(A, outputs, {}))


# -- python-control ----------------------------------------------------------------------------------------------------
@settings(max_examples=20)
@given(plants())
def test_plants_go_out_and_come_back(plant) -> None:
    system = plant_to_control(plant)
    C = plant.stacked_output()
    if plant.B is not None:
        s = 0.3 + 0.7j
        np.testing.assert_allclose(
            system(s, squeeze=False), C @ la.solve(s * np.eye(plant.n_states) - plant.A, plant.B), rtol=1e-8, atol=1e-10
        )
    back = plant_from_control(system)
    assert back.n_agents == 1
    np.testing.assert_array_equal(back.outputs[0], C)
    np.testing.assert_array_equal(back.A, plant.A)
    assert (back.B is None) == (plant.B is None)


def test_rows_and_neighbours() -> None:
    system = control.ss(np.diag([0.1, 0.2]), np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)))
    plant = plant_from_control(system, rows=[[0], [1], []], neighbours={0: [1], 1: [2], 2: [0]})
    assert [C.shape[0] for C in plant.outputs] == [1, 1, 0]
    assert plant.hears == ((1,), (2,), (0,))


@settings(max_examples=20)
@given(plants(), st.sampled_from(["full", "reduced", "extended"]))
def test_observers_go_out_and_come_back(plant, kind) -> None:
    extra = ([[0.0]], np.ones((plant.n_states, 1))) if kind == "extended" else None
    observer = Centralised(kind, extra=extra).observer(plant)
    p = plant.stacked_output().shape[0]
    system = observer.to_control(plant.B)
    assert system.ninputs == p + plant.n_inputs
    assert system.noutputs == plant.n_states
    back = CentralisedObserver.from_control(system, observer.V, p)
    for name in "HKMNV":
        np.testing.assert_array_equal(getattr(back, name), getattr(observer, name))


def test_control_simulates_what_we_simulate() -> None:
    """The StateSpace, driven by true readings and inputs, gives our estimate."""
    observer = Centralised("reduced", rate=1.0).observer(OSCILLATOR)
    times, u = np.linspace(0.0, 4.0, 401), np.ones((1, 401))
    truth = control.forced_response(
        control.ss(OSCILLATOR.A, OSCILLATOR.B, np.eye(2), np.zeros((2, 1))), times, u, [1.0, 0.0]
    ).outputs
    fed = np.vstack([OSCILLATOR.C @ truth, u])
    estimate = control.forced_response(observer.to_control(OSCILLATOR.B), times, fed, observer.V @ [1.0, 0.0]).outputs
    np.testing.assert_allclose(estimate, truth, atol=1e-4)


def test_python_control_is_optional(monkeypatch) -> None:
    plant = SharedPlant(OSCILLATOR.A, [OSCILLATOR.C], {})
    system, observer = plant_to_control(plant), Centralised().observer(plant)
    monkeypatch.setitem(sys.modules, "control", None)
    calls = (
        lambda: plant_to_control(plant),
        lambda: plant_from_control(system),
        lambda: observer.to_control(),
        lambda: CentralisedObserver.from_control(system, observer.V, 1),
    )
    for call in calls:
        with pytest.raises(MissingExtraError, match=r"pip install 'trigpoint\[control\]'"):
            call()


def test_systems_that_are_refused() -> None:
    A, B, C = np.eye(2), np.ones((2, 1)), np.ones((1, 2))
    with pytest.raises(ArgumentError, match=r"must be a control\.StateSpace"):
        plant_from_control("system")
    for dt in (True, 0.1):
        with pytest.raises(ArgumentError, match="must be in continuous time"):
            plant_from_control(control.ss(A, B, C, 0, dt))
    with pytest.raises(ArgumentError, match="must have D = 0"):
        plant_from_control(control.ss(A, B, C, [[1.0]]))
    with pytest.raises(ArgumentError, match=r"rows\[1\] must list outputs 0 to 0"):
        plant_from_control(control.ss(A, B, C, 0), rows=[[0], [1]])
    with pytest.raises(ArgumentError, match="n_outputs must be 0 to 1"):
        CentralisedObserver.from_control(control.ss(A, B, np.eye(2), np.zeros((2, 1))), np.eye(2), 2)


# -- refusals ----------------------------------------------------------------------------------------------------------
def test_arguments() -> None:
    with pytest.raises(ArgumentError, match="kind must be one of full, reduced, extended"):
        Centralised("whole")
    with pytest.raises(ArgumentError, match="not both"):
        Centralised(eigenvalues=[-1.0], rate=1.0)
    for rate in (0.0, np.nan):
        with pytest.raises(ArgumentError, match="rate must be a positive"):
            Centralised(rate=rate)
    for choices in ({"kind": "extended"}, {"extra": ([[0.0]], [[1.0]])}):
        with pytest.raises(ArgumentError, match="extra = "):
            Centralised(**choices)
    with pytest.raises(ArgumentError, match="conjugate pairs"):
        Centralised(eigenvalues=[-1.0 + 1j, -1.0])
    with pytest.raises(ArgumentError, match="eigenvalues must be finite"):
        Centralised(eigenvalues=[np.nan])
    with pytest.raises(ShapeError, match="eigenvalues must be one list"):
        Centralised(eigenvalues=[[-1.0]])


def test_problems_that_are_refused() -> None:
    with pytest.raises(MethodError, match="needs a SharedPlant or a LinearAgent; got NetworkedAgents"):
        Centralised().build(NetworkedAgents(chain(3), OSCILLATOR))
    unseen = SharedPlant(np.diag([0.1, 0.2]), [[[1.0, 0.0]]], {})
    with pytest.raises(MethodError, match=r"a pair that is not detectable at s = 0\.2"):
        Centralised().build(unseen)
    with pytest.raises(MethodError, match="a state that C does not show at once"):
        Centralised("reduced").build(SharedPlant(np.eye(2), [np.eye(2)], {}))
    with pytest.raises(MethodError, match=r"2 eigenvalues, one a state of the full observer; got 3"):
        Centralised(eigenvalues=[-1.0, -2.0, -3.0]).build(OSCILLATOR)
    with pytest.raises(MethodError, match="repeat no eigenvalue more often"):
        Centralised(eigenvalues=[-1.0, -1.0]).build(OSCILLATOR)
    with pytest.raises(MethodError, match="decays at -1 1/s only"):
        Centralised(eigenvalues=[1.0, -1.0]).build(OSCILLATOR)


def test_shapes() -> None:
    A, C = np.eye(2), np.ones((1, 2))
    square = [[0.0]]
    with pytest.raises(ShapeError, match="A must be square"):
        CentralisedObserver.full_state(np.ones((1, 2)), C, np.ones((2, 1)))
    with pytest.raises(ShapeError, match="a_bar must be square"):
        CentralisedObserver.extended(A, C, np.ones((1, 2)), square, np.ones((2, 1)), np.ones((2, 1)))
    with pytest.raises(ShapeError, match="a_bar must be square"):
        Centralised("extended", extra=(np.ones((1, 2)), np.ones((2, 1)))).build(SharedPlant(A, [np.eye(2)], {}))
    with pytest.raises(ShapeError, match="H must be square"):
        CentralisedObserver(np.ones((1, 2)), [[1.0]], [[1.0]], [[1.0]], [[1.0]])
    with pytest.raises(ShapeError, match="M must have shape"):
        CentralisedObserver([[1.0]], [[1.0]], np.ones((2, 2)), [[1.0]], [[1.0]])
