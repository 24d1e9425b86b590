"""Gains that move eigenvalues, and the left null vector of a Laplacian, against exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from trigpoint.analysis.pairs import pair_margin
from trigpoint.linalg.injection import assigned_injection, rate_injection, spectrum_error
from trigpoint.linalg.stationary import stationary_vector


@st.composite
def pairs(draw):
    n = draw(st.integers(1, 6))
    p = draw(st.integers(1, n))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    A, C = rng.normal(size=(n, n)), rng.normal(size=(p, n))
    assume(pair_margin(A, C).margin > 1e-2)
    return A, C


@settings(max_examples=60)
@given(pairs(), st.floats(0.05, 5.0), st.sampled_from([1e-6, 1.0, 1e6]))
def test_rate_is_reached_in_any_units(pair, rate, unit) -> None:
    A, C = pair
    K = rate_injection(A, unit * C, rate)
    abscissa = la.eigvals(A - K @ (unit * C)).real.max()
    assert abscissa < -rate
    np.testing.assert_allclose(K * unit, rate_injection(A, C, rate), rtol=1e-3, atol=1e-6 * np.abs(K * unit).max())


def test_the_rightmost_mode_is_close_to_the_rate() -> None:
    K = rate_injection(np.array([[0.2, 1.0], [-1.0, 0.2]]), np.array([[1.0, 0.0]]), 3.0)
    assert -3.1 < la.eigvals(np.array([[0.2, 1.0], [-1.0, 0.2]]) - K @ [[1.0, 0.0]]).real.max() < -3.0


def test_what_is_not_seen_keeps_its_place() -> None:
    A, C = np.diag([0.5, -2.0]), np.array([[1.0, 0.0]])
    assert la.eigvals(A - rate_injection(A, C, 1.0) @ C).real.max() < -1.0
    with pytest.raises(np.linalg.LinAlgError, match="no gain found"):
        rate_injection(A, C, 3.0)
    assert rate_injection(np.zeros((0, 0)), np.zeros((1, 0)), 1.0).shape == (0, 1)
    assert rate_injection(-2.0 * np.eye(2), np.zeros((0, 2)), 1.0).shape == (2, 0)


@settings(max_examples=60)
@given(pairs(), st.integers(0, 100), st.booleans())
def test_eigenvalues_are_placed(pair, seed, repeated) -> None:
    A, C = pair
    if repeated:  # dependent rows see nothing new
        C = np.vstack([C, 3.0 * C[:1]])
    n = A.shape[0]
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, n // 2 + 1))
    upper = -rng.uniform(1.0, 2.0, count) + 1j * (1.0 + np.arange(count))
    wanted = np.concatenate([upper, upper.conj(), -1.0 - 0.5 * np.arange(n - 2 * count)])
    K = assigned_injection(A, C, wanted if count else wanted.real)
    closed = A - K @ C
    condition = np.linalg.cond(la.eig(closed)[1])
    assert spectrum_error(closed, wanted) <= 1e-13 * condition * (np.abs(K).max() * np.abs(C).max() + 10.0)


def test_what_cannot_be_placed() -> None:
    with pytest.raises(ValueError, match="repeated"):
        assigned_injection(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]]), np.array([-1.0, -1.0]))


def test_spectrum_error_matches_best() -> None:
    assert spectrum_error(np.diag([1.0, 2.0, 3.0]), np.array([3.0, 1.0, 2.0])) == 0.0
    assert spectrum_error(np.diag([1.0, 2.0]), np.array([2.1, 1.0])) == pytest.approx(0.1)


# -- the left null vector ----------------------------------------------------------------------------------------------
@settings(max_examples=60)
@given(st.integers(1, 7), st.integers(0, 1000))
def test_stationary_vector(m, seed) -> None:
    rng = np.random.default_rng(seed)
    rates = rng.integers(0, 3, size=(m, m)).astype(float)
    rates[np.arange(m), (np.arange(m) + 1) % m] += 1.0  # a ring, so strongly connected
    r = stationary_vector(rates)
    off = rates - np.diag(np.diag(rates))
    L = np.diag(off.sum(axis=1)) - off
    assert (r > 0.0).all()
    assert r.mean() == pytest.approx(1.0)
    assert np.abs(r @ L).max() <= 1e-14 * m * r.max() * (np.abs(L).max() + 1.0)


def test_tiny_entries_keep_their_digits() -> None:
    """A walk that is drawn to one end: r falls by 1000 a step, known exactly."""
    m = 30
    rates = np.diag(np.full(m - 1, 1.0), 1) + np.diag(np.full(m - 1, 1000.0), -1)
    exact = [Fraction(1, 1000) ** k for k in range(m)]
    mean = sum(exact) / m
    np.testing.assert_allclose(stationary_vector(rates), [float(value / mean) for value in exact], rtol=1e-13)
