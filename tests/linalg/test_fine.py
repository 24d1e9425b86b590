"""Products without rounding against fractions: the truth lies inside, and the radius is far below that of a float."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from trigpoint.linalg.balls import Ball, decays, is_negative_along, is_positive, stacked
from trigpoint.linalg.fine import Fine, between, decays_between, product
from trigpoint.linalg.interval_stability import expands

Exact = list[list[Fraction]]


def fractions(matrix: np.ndarray) -> Exact:
    return [[Fraction(float(v)) for v in row] for row in matrix]


def times(A: Exact, B: Exact) -> Exact:
    columns = list(zip(*B, strict=True))
    return [[sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0)) for column in columns] for row in A]


def assert_encloses(fine: Fine, truth: Exact) -> None:
    for middle, low, radius, row in zip(fine.middle, fine.low, fine.radius, truth, strict=True):
        for m, el, r, exact in zip(middle.tolist(), low.tolist(), radius.tolist(), row, strict=True):
            assert abs(exact - Fraction(m) - Fraction(el)) <= Fraction(r)


def drawn(rng: np.random.Generator, rows: int, columns: int, decades: float) -> np.ndarray:
    return rng.standard_normal((rows, columns)) * 10.0 ** rng.uniform(-decades, decades, (rows, columns))


@pytest.mark.parametrize("decades", [0.0, 3.0, 20.0, 120.0])
def test_products_and_their_sums_are_enclosed(decades) -> None:
    rng = np.random.default_rng(int(decades))
    for _ in range(30):
        r, n, c = rng.integers(1, 6, 3)
        A, B, C = drawn(rng, r, n, decades), drawn(rng, n, c, decades), drawn(rng, r, c, decades)
        assert_encloses(product(A, B), times(fractions(A), fractions(B)))
        total = product(A, B) + -Fine.of(Ball.exact(C))
        truth = [[a - Fraction(b) for a, b in zip(x, y, strict=True)] for x, y in zip(
            times(fractions(A), fractions(B)), C.tolist(), strict=True)]  # fmt: skip
        assert_encloses(total, truth)
        ball = total.ball()
        assert all(
            abs(t - Fraction(m)) <= Fraction(d)
            for row in zip(truth, ball.middle.tolist(), ball.radius.tolist(), strict=True)
            for t, m, d in zip(*row, strict=True)
        )


def test_three_factors_are_enclosed_to_twice_the_digits() -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        n = int(rng.integers(1, 6))
        R, A, K, T = (drawn(rng, n, n, 4.0) for _ in range(4))
        H = Fine.of(Ball.exact(A)) + product(K, A)
        inner = [[a + b for a, b in zip(x, y, strict=True)] for x, y in zip(
            fractions(A), times(fractions(K), fractions(A)), strict=True)]  # fmt: skip
        found = between(R, H, T)
        assert_encloses(found, times(times(fractions(R), inner), fractions(T)))
        size = np.abs(R).max(axis=1)[:, None] * np.abs(H.middle).max() * np.abs(T).max(axis=0)
        assert (found.radius <= 1e-24 * size).all()


def test_entries_of_any_size_fall_back_to_a_ball() -> None:
    A = np.array([[1e300, 1.0], [1.0, 1e-300]])
    assert_encloses(product(A, np.eye(2)), fractions(A))


def test_a_condition_that_no_matrix_of_floats_can_hold_is_proved_by_its_factors() -> None:
    """``H = R^-1 [[-1, 0], [1/4, -1]] R``, all exact, with cond R = 1e12: P = R'R has the condition 1e24."""
    R, T = np.array([[1.0, 0.75], [0.0, 2.0**-40]]), np.array([[1.0, -0.75 * 2.0**40], [0.0, 2.0**40]])
    H = -np.eye(2) + 0.25 * np.outer(T[:, 1], R[0])
    fine = Fine.of(Ball.exact(H))
    assert decays_between(R, T, fine, 0.87)
    assert not decays(R.T @ R, Ball.exact(H), 0.87)
    assert not decays_between(R, T, fine, 1.01)
    for spoilt in (0.0 * R, R * 1e200, np.diag([1.0, 0.0]) @ R):
        assert not decays_between(spoilt, T, fine, 0.5)
        assert not decays_between(R, spoilt, fine, 0.5)


def test_a_singular_factor_proves_nothing() -> None:
    """P must be positive definite: on the kernel of a singular R the error may grow."""
    R, H = np.diag([1.0, 0.0]), np.diag([-1.0, 1.0])
    assert not decays_between(R, np.eye(2), Fine.of(Ball.exact(H)), 0.5)
    assert not decays_between(R, R, Fine.of(Ball.exact(H)), 0.5)


def test_signs_and_definiteness_of_balls() -> None:
    assert is_positive(Ball.exact(np.eye(2)))
    assert not is_positive(Ball(np.eye(2), np.full((2, 2), 0.5)))
    assert not is_positive(Ball(np.eye(2), np.full((2, 2), np.inf)))
    assert is_negative_along(np.diag([1.0, -1e-9]), np.array([0.0, 1.0]))
    assert not is_negative_along(np.diag([1.0, -1e-9]), np.array([1.0, 0.0]))
    assert not is_negative_along(np.diag([1.0, -1.0]), np.array([0.0, 1e-170]))  # the product underflows
    both = stacked([[Ball.exact(np.eye(2)), Ball(np.zeros((2, 1)), np.ones((2, 1)))]])
    assert both.middle.shape == both.radius.shape == (2, 3)


def test_a_radius_above_one_is_proved_and_none_below() -> None:
    rng = np.random.default_rng(7)
    for _ in range(40):
        M = rng.standard_normal((4, 4))
        M /= float(np.abs(np.linalg.eigvals(M)).max())
        assert expands(Ball.exact(M * (1.0 + 1e-8)))
        assert not expands(Ball.exact(M * (1.0 - 1e-8)))
        assert not expands(Ball(M * (1.0 + 1e-8), np.full((4, 4), 1e-3)))
