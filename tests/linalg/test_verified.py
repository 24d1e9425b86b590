"""Rigorous bounds against exact rational arithmetic: a bound may be loose, it may never be wrong."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.linalg.verified import (
    UNIT_ROUNDOFF,
    Couplings,
    collatz_wielandt_lower,
    collatz_wielandt_upper,
    down,
    gam,
    is_positive_definite,
    rayleigh_upper,
    up,
)

from .exact import exact_apply, exact_quotient, is_exactly_positive_definite


@st.composite
def couplings(draw: st.DrawFn) -> Couplings:
    n = draw(st.integers(1, 7))
    node = st.integers(0, n - 1)
    pairs = draw(st.lists(st.tuples(node, node).filter(lambda p: p[0] != p[1]), max_size=15)) if n > 1 else []
    ground = draw(st.lists(node, max_size=5))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    weights = 10.0 ** rng.uniform(-6, 6, size=len(pairs) + len(ground))
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return Couplings(n, first, second, weights[: len(pairs)], np.array(ground, dtype=np.int64), weights[len(pairs) :])


def vectors(seed: int, n: int, decades: float) -> np.ndarray:
    """Positive vectors, nearly constant ones among them: there the differences cancel."""
    rng = np.random.default_rng(seed)
    return 10.0 ** rng.uniform(-decades, decades, size=n)


seeds = st.integers(0, 2**32 - 1)
spreads = st.sampled_from([1e-15, 1e-8, 0.1, 3.0, 30.0])


def exact_least_eigenvalue(matrix: Couplings) -> mpmath.mpf:
    with mpmath.workdps(50):
        dense = mpmath.zeros(matrix.size)
        for i, j, w in zip(matrix.first.tolist(), matrix.second.tolist(), matrix.weight.tolist(), strict=True):
            dense[i, i] += w
            dense[j, j] += w
            dense[i, j] -= w
            dense[j, i] -= w
        for i, w in zip(matrix.ground.tolist(), matrix.ground_weight.tolist(), strict=True):
            dense[i, i] += w
        return min(mpmath.eigsy(dense, eigvals_only=True))


@settings(max_examples=80)
@given(couplings(), seeds, spreads, st.booleans())
def test_the_error_bound_of_apply_covers_the_exact_error(matrix, seed, decades, signed) -> None:
    x = vectors(seed, matrix.size, decades)
    if signed:
        x = x * np.random.default_rng(seed).choice([-1.0, 1.0], size=matrix.size)
    value, error = matrix.apply(x)
    for computed, bound, exact in zip(value, error, exact_apply(matrix, x), strict=True):
        assert abs(Fraction(float(computed)) - exact) <= Fraction(float(bound))


@settings(max_examples=60)
@given(couplings(), seeds, spreads)
def test_the_quadratic_form_lies_between_its_bounds(matrix, seed, decades) -> None:
    x = vectors(seed, matrix.size, decades)
    low, high = matrix.quadratic_form(x)
    exact = sum((Fraction(float(a)) * b for a, b in zip(x, exact_apply(matrix, x), strict=True)), Fraction(0))
    assert Fraction(low) <= exact <= Fraction(high)


@settings(max_examples=60)
@given(couplings(), seeds, spreads)
def test_the_quotient_bounds_hold_for_the_exact_quotients(matrix, seed, decades) -> None:
    x = vectors(seed, matrix.size, decades)
    quotients = [p / Fraction(float(v)) for p, v in zip(exact_apply(matrix, x), x, strict=True)]
    assert Fraction(collatz_wielandt_lower(matrix, x)) <= min(quotients)
    assert Fraction(collatz_wielandt_upper(matrix, x)) >= max(quotients)
    assert Fraction(rayleigh_upper(matrix, x)) >= exact_quotient(matrix, x)


@pytest.mark.parametrize("seed", range(40))
def test_the_quotient_bounds_hold_where_everything_cancels(seed) -> None:
    """At the ground state of a long chain what flows in and out of a node is far larger than their difference."""
    rng = np.random.default_rng(seed)
    n = 60
    weight, ground = rng.uniform(0.5, 2.0, size=n - 1), np.array([0])
    matrix = Couplings(n, np.arange(n - 1), np.arange(1, n), weight, ground, np.ones(1))
    dense = np.zeros((n, n))
    dense[0, 0] = 1.0
    for k in range(n - 1):
        dense[k : k + 2, k : k + 2] += weight[k] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    x = np.abs(la.eigh(dense, subset_by_index=(0, 0))[1][:, 0])
    quotients = [p / Fraction(float(v)) for p, v in zip(exact_apply(matrix, x), x, strict=True)]
    assert Fraction(collatz_wielandt_lower(matrix, x)) <= min(quotients)
    assert Fraction(collatz_wielandt_upper(matrix, x)) >= max(quotients)


@settings(max_examples=40)
@given(couplings(), seeds, spreads)
def test_any_positive_vector_bounds_the_smallest_eigenvalue(matrix, seed, decades) -> None:
    x = vectors(seed, matrix.size, decades)
    exact = exact_least_eigenvalue(matrix)
    with mpmath.workdps(50):
        slack = mpmath.mpf(10) ** -38 * (1 + mpmath.mpf(float(matrix.weight.sum() + matrix.ground_weight.sum())))
        assert collatz_wielandt_lower(matrix, x) <= exact + slack
        assert collatz_wielandt_upper(matrix, x) >= exact - slack
        assert rayleigh_upper(matrix, x) >= exact - slack


@pytest.mark.parametrize(
    "x", [[1.0, 0.0], [1.0, -1.0], [1.0, np.nan], [1.0, np.inf], [-1.0, -1.0], [1.0, 1e-320], [1.0, 1e-290]]
)
def test_vectors_that_are_not_clearly_positive_give_no_bound(x) -> None:
    matrix = Couplings(2, np.array([0]), np.array([1]), np.ones(1), np.array([0]), np.ones(1))
    assert collatz_wielandt_lower(matrix, np.array(x)) == -np.inf
    assert collatz_wielandt_upper(matrix, np.array(x)) == np.inf


def test_the_zero_vector_and_infinity_have_no_rayleigh_quotient() -> None:
    matrix = Couplings(2, np.array([0]), np.array([1]), np.ones(1), np.array([0]), np.ones(1))
    assert rayleigh_upper(matrix, np.zeros(2)) == np.inf
    assert rayleigh_upper(matrix, np.array([np.inf, 1.0])) == np.inf
    assert rayleigh_upper(matrix, np.array([1e-200, -1e-200])) == pytest.approx(2.5)


def test_gam_is_rounded_up() -> None:
    for k in (1, 2, 3, 10, 1000, 10**6):
        u = Fraction(1, 2**53)
        assert Fraction(float(gam(k))) >= k * u / (1 - k * u)
    assert float(gam(1)) == pytest.approx(UNIT_ROUNDOFF, rel=1e-14)


def test_up_and_down_are_the_neighbouring_floats() -> None:
    assert down(1.0) < 1.0 < up(1.0)
    assert (up(1.0) - 1.0, 1.0 - down(1.0)) == (2.0**-52, 2.0**-53)


# -- verified Cholesky -------------------------------------------------------------------------------------------------
@settings(max_examples=150)
@given(
    st.integers(1, 6),
    seeds,
    st.sampled_from([0.0, 1e-16, -1e-16, 3e-16, -3e-16, 1e-15, 1e-14, -1e-14, 1e-12, 1e-8, -1e-8]),
    st.sampled_from([1e-12, 1.0, 1e12]),
)
def test_never_called_definite_when_it_is_not(n, seed, planted, scale) -> None:
    rng = np.random.default_rng(seed)
    Q, _ = la.qr(rng.normal(size=(n, n)))
    spectrum = np.concatenate([[planted], 10.0 ** rng.uniform(-6, 0, size=n - 1)])
    matrix = scale * (Q * spectrum) @ Q.T
    matrix = 0.5 * (matrix + matrix.T)
    if is_positive_definite(matrix):
        assert is_exactly_positive_definite(matrix)
    elif planted >= 1e-12 * n:
        pytest.fail("an eigenvalue a thousand times above rounding was not recognized")


def test_where_plain_cholesky_is_fooled_the_verified_one_is_not() -> None:
    fooled, n = 0, 12
    for seed in range(40):
        Q, _ = la.qr(np.random.default_rng(seed).normal(size=(n, n)))
        matrix = (Q * np.concatenate([[-5e-17], np.ones(n - 1)])) @ Q.T
        matrix = 0.5 * (matrix + matrix.T)
        if is_exactly_positive_definite(matrix):
            continue
        assert not is_positive_definite(matrix)
        try:
            np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            continue
        fooled += 1
    assert fooled > 0, "the matrices are too easy to tell anything"


@settings(max_examples=60)
@given(st.integers(2, 6), seeds)
def test_exactly_singular_integer_matrices_are_never_called_definite(n, seed) -> None:
    root = np.random.default_rng(seed).integers(-50, 51, size=(n, n - 1)).astype(float)
    gram = root @ root.T
    assert not is_exactly_positive_definite(gram)
    assert not is_positive_definite(gram)


@settings(max_examples=60)
@given(st.integers(1, 5), seeds, st.floats(-12, 0))
def test_the_radius_covers_every_matrix_within_it(n, seed, exponent) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    matrix = root @ root.T + 1e-6 * np.eye(n)
    matrix = 0.5 * (matrix + matrix.T)
    radius = 10.0**exponent
    if not is_positive_definite(matrix, radius):
        return
    for _ in range(5):
        sign = rng.choice([-1.0, 1.0], size=(n, n))
        sign = np.triu(sign) + np.triu(sign, 1).T
        inside = matrix + 0.999 * radius * sign
        assert is_exactly_positive_definite(inside)
    worst = matrix - 0.999 * radius * np.outer(np.sign(root[:, 0]), np.sign(root[:, 0]))
    assert is_exactly_positive_definite(0.5 * (worst + worst.T))


@pytest.mark.parametrize("seed", range(5))
def test_planted_eigenvalues_at_fifty_digits(seed) -> None:
    rng = np.random.default_rng(seed)
    n = 10
    Q, _ = la.qr(rng.normal(size=(n, n)))
    for planted in (1e-16, -1e-16, 0.0, 1e-15, 1e-13):
        matrix = (Q * np.concatenate([[planted], np.ones(n - 1)])) @ Q.T
        matrix = 0.5 * (matrix + matrix.T)
        with mpmath.workdps(50):
            exact = min(mpmath.eigsy(mpmath.matrix(matrix.tolist()), eigvals_only=True))
        assert not (is_positive_definite(matrix) and exact <= 0)
    assert is_positive_definite(matrix), "the last one, 1e-13, is far enough from zero"


@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 0.5], [0.4, 1.0]],
        [[0.0]],
        [[-1.0]],
        [[np.nan]],
        [[np.inf, 0.0], [0.0, 1.0]],
        [[1.0, 2.0], [2.0, 1.0]],
        [[1.0, 1.0], [1.0, 1.0]],
    ],
)
def test_what_is_not_symmetric_finite_or_definite_is_not_proved(matrix) -> None:
    assert not is_positive_definite(np.array(matrix))


def test_clear_cases_are_proved_and_the_argument_is_left_alone() -> None:
    matrix = np.array([[2.0, -1.0], [-1.0, 2.0]])
    before = matrix.copy()
    assert is_positive_definite(matrix)
    assert is_positive_definite(matrix, 0.4)
    assert not is_positive_definite(matrix, 0.6)
    assert is_positive_definite(np.array([[5e-200]]))
    assert np.array_equal(matrix, before)


@pytest.mark.parametrize(("n", "rel"), [(8, 1e-12), (100, 1e-8), (500, 1e-4)])
def test_verified_cholesky_bounds_the_chain_from_below(n, rel) -> None:
    exact = 4 * np.sin(np.pi / (4 * n + 2)) ** 2
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    chain[-1, -1] = 1.0
    assert is_positive_definite(chain - exact * (1 - rel) * np.eye(n), 4 * UNIT_ROUNDOFF * np.eye(n))
    assert not is_positive_definite(chain - exact * (1 + rel) * np.eye(n))


def test_a_run_that_overflows_proves_nothing() -> None:
    """Some libraries pass over a pivot that is not a number."""
    tiny = 1e-250
    assert not is_positive_definite(np.array([[tiny, 0.0, 1e200], [0.0, tiny, 0.0], [1e200, 0.0, tiny]]))


@pytest.mark.parametrize("radius", [np.nan, np.inf])
def test_a_radius_that_is_no_number_proves_nothing(radius) -> None:
    assert not is_positive_definite(np.eye(2), radius)
    assert not is_positive_definite(np.eye(2), np.array([[0.0, 0.0], [radius, 0.0]]))


def test_squares_that_underflow_before_a_large_weight_are_not_lost() -> None:
    matrix = Couplings(2, np.array([0]), np.array([1]), np.array([1e-200]), np.array([1]), np.array([1e300]))
    x = np.array([1.0, 1e-170])
    low, high = matrix.quadratic_form(x)
    exact = sum((Fraction(float(a)) * b for a, b in zip(x, exact_apply(matrix, x), strict=True)), Fraction(0))
    assert Fraction(low) <= exact <= Fraction(high)
