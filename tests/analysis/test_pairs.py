"""Observability of a small pair: unobservable pairs inside Jordan blocks are never called observable."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis.pairs import pair_margin

JORDAN_2 = np.eye(2, k=1)
JORDAN_3 = np.eye(3, k=1)


def rotated(A, C, seed) -> tuple[np.ndarray, np.ndarray]:
    Q, _ = la.qr(np.random.default_rng(seed).normal(size=A.shape))
    return Q @ A @ Q.T, C @ Q.T


def kalman_rank(A, C) -> int:
    rows = [C]
    for _ in range(A.shape[0] - 1):
        rows.append(rows[-1] @ A)
    return int(np.linalg.matrix_rank(np.vstack(rows)))


@pytest.mark.parametrize(
    ("A", "C", "expected"),
    [
        (JORDAN_2, [[1.0, 0.0]], True),
        (JORDAN_2, [[0.0, 1.0]], False),
        (JORDAN_3, [[1.0, 0.0, 0.0]], True),
        (JORDAN_3, [[0.0, 1.0, 0.0]], False),
        (JORDAN_3, [[0.0, 0.0, 1.0]], False),
        (JORDAN_3 + 2 * np.eye(3), [[1.0, 5.0, 0.0]], True),
        (np.zeros((2, 2)), [[1.0, 1.0]], False),
        (np.zeros((2, 2)), np.eye(2), True),
        (np.zeros((1, 1)), [[0.0]], False),
        (np.diag([1.0, 1.0, 2.0]), [[1.0, 0.0, 1.0]], False),
        (la.block_diag([[0.0, 1.0], [-1.0, 0.0]], 2.0), [[0.0, 0.0, 1.0]], False),  # E-001-1: the mode is complex
        (np.array([[0.0, 1.0], [-1.0, 0.0]]), [[1.0, 0.0]], True),
    ],
)
def test_pairs_known_by_hand(A, C, expected) -> None:
    found = pair_margin(A, np.array(C))
    assert found.verdict is expected
    if expected is False:
        assert found.margin < 1e-12


def test_the_witness_of_an_unobservable_mode() -> None:
    A, C = rotated(la.block_diag([[0.0, 2.0], [-2.0, 0.0]], -1.0), np.array([[0.0, 0.0, 1.0]]), seed=1)
    found = pair_margin(A, C)
    assert abs(abs(found.mode.imag) - 2.0) < 1e-12
    assert np.linalg.norm(found.direction) == pytest.approx(1.0)
    assert np.linalg.norm(A @ found.direction - found.mode * found.direction) < 1e-11
    assert np.linalg.norm(C @ found.direction) < 1e-11


@settings(max_examples=60)
@given(st.integers(1, 3), st.integers(0, 2), st.floats(-2, 2), st.integers(0, 2**32 - 1))
def test_unobservable_inside_a_rotated_jordan_block(size, more, eigenvalue, seed) -> None:
    rng = np.random.default_rng(seed)
    block = eigenvalue * np.eye(size) + np.eye(size, k=1)
    A = la.block_diag(block, np.diag(rng.normal(size=more))) if more else block
    C = rng.normal(size=(1, size + more))
    C[0, 0] = 0.0  # the block's eigenvector does not show
    assert pair_margin(*rotated(A, C, seed)).verdict is False


@settings(max_examples=25)
@given(st.integers(1, 3), st.floats(-1, 1), st.floats(0.1, 2), st.integers(0, 2**32 - 1))
def test_unobservable_inside_a_rotated_complex_jordan_block(size, real, imaginary, seed) -> None:
    rotation = np.array([[real, imaginary], [-imaginary, real]])
    A = np.kron(np.eye(size), rotation) + np.kron(np.eye(size, k=1), np.eye(2))
    C = np.random.default_rng(seed).normal(size=(1, 2 * size))
    C[0, :2] = 0.0
    assert pair_margin(*rotated(A, C, seed)).verdict is False


@settings(max_examples=60)
@given(st.integers(1, 6), st.integers(1, 2), st.integers(0, 2**32 - 1))
def test_random_observable_pairs_are_never_called_unobservable(n, p, seed) -> None:
    rng = np.random.default_rng(seed)
    A, C = rng.normal(size=(n, n)), rng.normal(size=(p, n))
    assert pair_margin(A, C).verdict is not False


@settings(max_examples=40)
@given(st.integers(2, 5), st.integers(0, 2**32 - 1))
def test_small_integer_pairs_agree_with_the_exact_rank(n, seed) -> None:
    rng = np.random.default_rng(seed)
    A, C = rng.integers(-1, 2, size=(n, n)).astype(float), rng.integers(-1, 2, size=(1, n)).astype(float)
    found = pair_margin(A, C)
    assert found.verdict is (kalman_rank(A, C) == n)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-6, 1.0, 1e6]))
def test_the_margin_does_not_depend_on_the_unit(seed, scale) -> None:
    rng = np.random.default_rng(seed)
    A, C = rng.normal(size=(3, 3)), rng.normal(size=(1, 3))
    assert pair_margin(scale * A, scale * C).margin == pytest.approx(pair_margin(A, C).margin, rel=1e-3, abs=1e-12)


def test_detectability_looks_at_unstable_modes_only() -> None:
    A, C = np.diag([-1.0, 0.5]), np.array([[0.0, 1.0]])
    assert pair_margin(A, C).verdict is False
    assert pair_margin(A, C, unstable_only=True).verdict is True
    assert pair_margin(-A, C, unstable_only=True).verdict is False
    hurwitz = pair_margin(-np.eye(2), np.zeros((1, 2)), unstable_only=True)
    assert hurwitz.verdict is True
    assert hurwitz.margin == np.inf


@pytest.mark.parametrize("seed", range(20))
def test_an_unseen_mode_on_the_axis_is_undetectable_in_any_coordinates(seed) -> None:
    oscillator = la.block_diag([[0.0, 1.3], [-1.3, 0.0]], -1.0)
    assert pair_margin(*rotated(oscillator, np.array([[0.0, 0.0, 1.0]]), seed), unstable_only=True).verdict is False
    integrator = la.block_diag(JORDAN_3, -1.0)
    assert (
        pair_margin(*rotated(integrator, np.array([[0.0, 1.0, 0.0, 1.0]]), seed), unstable_only=True).verdict is False
    )


@pytest.mark.parametrize(("gap", "expected"), [(1e-6, True), (3e-11, None), (1e-14, False)])
def test_between_the_thresholds_nothing_is_decided(gap, expected) -> None:
    assert pair_margin(np.diag([1.0, 2.0]), np.array([[gap, 1.0]])).verdict is expected


def test_the_zero_pair_has_margin_zero() -> None:
    found = pair_margin(np.zeros((2, 2)), np.zeros((1, 2)))
    assert found.verdict is False
    assert found.margin == 0.0
