"""The NumPy matrix exponential against SciPy's, against closed forms and against quadrature."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad_vec

from trigpoint.arrays import expm, propagate, transition_and_integral
from trigpoint.errors import ArgumentError


def relative_error(ours, reference) -> float:
    return float(la.norm(ours - reference, 1) / la.norm(reference, 1))


def random_matrix(n: int, norm: float, seed: int) -> np.ndarray:
    matrix = np.random.default_rng(seed).normal(size=(n, n))
    return matrix * (norm / la.norm(matrix, 1))


@pytest.mark.parametrize("n", [1, 2, 3, 6, 17, 64])
@pytest.mark.parametrize("norm", [1e-12, 1e-3, 0.5, 5.3, 5.4, 20.0])
def test_expm_agrees_with_scipy(n, norm) -> None:
    A = random_matrix(n, norm, seed=n)
    assert relative_error(expm(A), la.expm(A)) < 1e-13


def exact_exponential(A) -> np.ndarray:
    """Fifty digits, rounded to the nearest floats."""
    with mpmath.workdps(50):
        return np.array(mpmath.expm(mpmath.matrix(A.tolist())).tolist(), dtype=np.float64)


@settings(max_examples=40)
@given(st.integers(1, 8), st.floats(-6, 1.5), st.integers(0, 2**32 - 1))
def test_expm_of_drawn_matrices_is_right_to_thirteen_digits(n, exponent, seed) -> None:
    A = random_matrix(n, 10.0**exponent, seed)
    assert relative_error(expm(A), exact_exponential(A)) < 1e-13
    # SciPy 1.17 itself is off by up to 1e-12 here (next test), so the two agree to no more than that.
    assert relative_error(expm(A), la.expm(A)) < 1e-11


def test_expm_is_right_where_it_differs_from_scipy() -> None:
    A = random_matrix(2, 10.0, seed=20)
    assert relative_error(expm(A), exact_exponential(A)) < 1e-14
    assert relative_error(expm(A), la.expm(A)) < 1e-11


@pytest.mark.parametrize("norm", [50.0, 200.0, 600.0])
@pytest.mark.parametrize("n", [2, 8, 64])
def test_expm_of_large_norm_is_as_good_as_the_condition_allows(n, norm) -> None:
    A = random_matrix(n, norm, seed=n)
    assert relative_error(expm(A), la.expm(A)) < 1e-13 + 1e-15 * norm


@pytest.mark.parametrize("n", [2, 5, 20])
def test_expm_of_a_nilpotent_matrix_is_its_finite_series(n) -> None:
    A = np.triu(random_matrix(n, 3.0, seed=n), k=1)
    series, term = np.eye(n), np.eye(n)
    for k in range(1, n):
        term = term @ A / k
        series = series + term
    assert relative_error(expm(A), series) < 1e-13


def test_expm_of_stiff_stable_matrices_stays_accurate() -> None:
    stiff = np.array([[-1e6, 1.0], [0.0, -1.0]])
    expected = np.array([[0.0, np.exp(-1.0) / (1e6 - 1.0)], [0.0, np.exp(-1.0)]])
    assert relative_error(expm(stiff), expected) < 1e-10
    Q, _ = la.qr(np.random.default_rng(3).normal(size=(6, 6)))
    rates = -np.array([0.0, 1.0, 10.0, 1e2, 1e3, 1e4])
    symmetric = (Q * rates) @ Q.T
    assert relative_error(expm(symmetric), (Q * np.exp(rates)) @ Q.T) < 1e-11


@pytest.mark.parametrize("angle", [0.1, 10.0, 1000.0])
def test_expm_of_a_rotation_is_orthogonal(angle) -> None:
    rotation = expm(np.array([[0.0, angle], [-angle, 0.0]]))
    expected = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    np.testing.assert_allclose(rotation, expected, rtol=0, atol=1e-13 + 1e-15 * angle)


def test_a_stack_is_exponentiated_one_by_one() -> None:
    rng = np.random.default_rng(3)
    stack = rng.standard_normal((2, 7, 3, 3)) * 10.0 ** rng.uniform(-8, 2, (2, 7, 1, 1))
    for A, found in zip(stack.reshape(-1, 3, 3), expm(stack).reshape(-1, 3, 3), strict=True):
        assert relative_error(found, expm(A)) < 1e-14
    assert expm(np.zeros((0, 3, 3))).shape == (0, 3, 3)


def test_expm_of_zero_is_the_identity_and_the_empty_matrix_is_itself() -> None:
    np.testing.assert_allclose(expm(np.zeros((3, 3))), np.eye(3), rtol=0, atol=1e-15)
    assert expm(np.zeros((0, 0))).shape == (0, 0)


def test_expm_does_not_change_its_argument() -> None:
    A = random_matrix(4, 30.0, seed=0)
    before = A.copy()
    expm(A)
    assert np.array_equal(A, before)


@pytest.mark.parametrize("bad", [np.zeros((2, 3)), np.zeros(3), 3.0, np.zeros((65, 65)), np.zeros((2, 2, 3))])
def test_expm_refuses_what_is_no_small_square_matrix(bad) -> None:
    with pytest.raises(ArgumentError, match="square matrices of at most 64 rows"):
        expm(bad)


def test_expm_refuses_nan() -> None:
    with pytest.raises(ArgumentError, match="A must be finite"):
        expm(np.array([[np.nan]]))


@pytest.mark.parametrize("h", [0.0, 1e-3, 0.7, 4.0])
@pytest.mark.parametrize("n", [1, 3, 6])
def test_transition_and_integral_agree_with_quadrature(n, h) -> None:
    A = random_matrix(n, 2.0, seed=n)
    transition, integral = transition_and_integral(A, h)
    expected, _ = quad_vec(lambda s: la.expm(A * s), 0.0, h, epsabs=1e-13, epsrel=1e-13)
    np.testing.assert_allclose(transition, la.expm(A * h), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(integral, expected, rtol=1e-11, atol=1e-12)


def test_transition_and_integral_of_the_double_integrator() -> None:
    transition, integral = transition_and_integral(np.array([[0.0, 1.0], [0.0, 0.0]]), 2.0)
    np.testing.assert_allclose(transition, [[1.0, 2.0], [0.0, 1.0]], rtol=1e-15)
    np.testing.assert_allclose(integral, [[2.0, 2.0], [0.0, 2.0]], rtol=1e-15)


def test_transition_and_integral_satisfy_their_defining_equation_at_the_size_limit() -> None:
    A = random_matrix(64, 3.0, seed=1)
    transition, integral = transition_and_integral(A, 1.5)
    np.testing.assert_allclose(A @ integral, transition - np.eye(64), rtol=0, atol=1e-11 * la.norm(transition))


@pytest.mark.parametrize("bad", [np.zeros((2, 3)), np.zeros(2), np.zeros((65, 65))])
def test_transition_refuses_what_is_no_small_square_matrix(bad) -> None:
    with pytest.raises(ArgumentError, match="square matrix of at most 64 rows"):
        transition_and_integral(bad, 1.0)


def test_transition_refuses_a_time_step_that_is_not_finite() -> None:
    with pytest.raises(ArgumentError, match="must be finite"):
        transition_and_integral(np.eye(2), np.nan)


@settings(max_examples=60)
@given(st.integers(1, 6), st.floats(-6, 2.5), st.booleans(), st.integers(0, 2**32 - 1))
def test_propagation_of_a_vector_agrees_with_the_exponential(n, decades, back, seed) -> None:
    rng = np.random.default_rng(seed)
    A = random_matrix(n, 10.0**decades, seed)
    A -= (np.abs(np.linalg.eigvals(A).real).max() if not back else -np.abs(np.linalg.eigvals(A).real).max()) * np.eye(n)
    value, drive = rng.normal(size=n), rng.normal(size=n)
    duration = -1.0 if back else 1.0
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A * duration, drive * duration
    exact = exact_exponential(block)
    scale = np.linalg.norm(value) * np.abs(exact[:n, :n]).max() + np.linalg.norm(exact[:n, n]) + 1e-300
    condition = max(1.0, la.norm(A, 1))
    assert np.abs(propagate(A, value, duration) - exact[:n, :n] @ value).max() <= 1e-14 * condition * scale
    driven = exact[:n, :n] @ value + exact[:n, n]
    assert np.abs(propagate(A, value, duration, drive) - driven).max() <= 1e-14 * condition * scale


def test_propagation_of_what_does_not_move_is_exact() -> None:
    value, drive = np.array([1.0, 2.0]), np.array([0.5, -1.0])
    assert propagate(np.zeros((2, 2)), value, 3.0) is value
    np.testing.assert_array_equal(propagate(np.zeros((2, 2)), value, 3.0, drive), value + 3.0 * drive)
    assert propagate(np.eye(2), value, 0.0) is value
