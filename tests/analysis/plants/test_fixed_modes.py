"""Decentralized fixed modes: classical examples, drawn systems, rotated Jordan blocks, and every refusal."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis.fixed_modes import check_complementary, fixed_modes
from trigpoint.errors import ArgumentError, ShapeError

E3 = np.eye(3)


def values(modes) -> list[complex]:
    return [mode.value for mode in modes]


def test_a_decoupled_system_keeps_the_mode_that_has_no_channel() -> None:
    A = np.diag([1.0, 2.0, 3.0])
    channels = [(E3[:, k : k + 1], E3[k : k + 1]) for k in range(3)]
    (mode,) = fixed_modes(A, [B for B, _ in channels[:2]], [C for _, C in channels[:2]])
    assert mode.value == 3.0
    assert mode.fixed is True
    assert mode.gain_margin <= 1e-12
    assert mode.subset_margin <= 1e-12
    assert fixed_modes(A, [B for B, _ in channels], [C for _, C in channels]) == ()


def test_controllable_and_observable_but_fixed() -> None:
    """Each mode is reached by one channel and seen by the other only: no loop through one channel closes."""
    A = np.diag([1.0, 2.0])
    e = np.eye(2)
    (mode,) = fixed_modes(np.diag([1.0, 2.0]), [e[:, :1], e[:, 1:]], [e[1:], np.array([[0.0, 1.0]])])
    assert mode.value == 1.0
    crossed = fixed_modes(A, [e[:, :1], np.zeros((2, 1))], [np.zeros((1, 2)), e[:1]])
    assert values(crossed) == [2.0, 1.0]
    joined = fixed_modes(A, [np.hstack([e[:, :1], e[:, 1:]])], [e])
    assert joined == ()


def test_a_triangular_chain_is_fixed_through_both_channels() -> None:
    """Joint controllability and observability hold, yet inputs of one channel act below the other's output."""
    A = np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 1.0, 3.0]])
    B, C = [E3[:, 2:], E3[:, :1]], [E3[:1], E3[2:]]
    assert np.linalg.matrix_rank(np.hstack([np.linalg.matrix_power(A, k) @ np.hstack(B) for k in range(3)])) == 3
    modes = fixed_modes(A, B, C)
    subsets = {mode.value.real: mode.subset for mode in modes}
    for mode in modes:
        assert mode.fixed is True
        S = mode.subset
        rest = [i for i in range(2) if i not in S]
        top = np.hstack([A - mode.value.real * np.eye(3), *(B[i] for i in S)])
        low = np.hstack([np.vstack([np.zeros((0, 3)), *(C[i] for i in rest)]), np.zeros((len(rest), len(S)))])
        assert np.linalg.matrix_rank(np.vstack([top, low])) < 3
    assert subsets == {mode.value.real: mode.subset for mode in modes}


@settings(max_examples=25)
@given(st.integers(2, 6), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_random_systems_have_none(n, channels, seed) -> None:
    rng = np.random.default_rng(seed)
    B = [rng.normal(size=(n, 1)) for _ in range(channels)]
    C = [rng.normal(size=(1, n)) for _ in range(channels)]
    assert all(mode.fixed is not True for mode in fixed_modes(rng.normal(size=(n, n)), B, C))


@settings(max_examples=25)
@given(st.integers(1, 3), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_a_hidden_block_is_fixed_in_any_coordinates(hidden, channels, seed) -> None:
    """Its eigenvalues are moved by no gain, whatever they couple to: spectra of closed loops are the oracle."""
    rng = np.random.default_rng(seed)
    block = rng.normal(size=(hidden, hidden))
    A = la.block_diag(block, rng.normal(size=(3, 3)))
    A[hidden:, :hidden] = rng.normal(size=(3, hidden))
    Q = la.qr(rng.normal(size=A.shape))[0]
    B = [Q @ np.vstack([np.zeros((hidden, 1)), rng.normal(size=(3, 1))]) for _ in range(channels)]
    C = [rng.normal(size=(1, hidden + 3)) for _ in range(channels)]
    A = Q @ A @ Q.T
    found = [mode for mode in fixed_modes(A, B, C) if mode.fixed]
    for value in la.eigvals(block):
        if value.imag >= 0:
            assert min(abs(mode.value - value) for mode in found) < 1e-6
    closed = A + sum(b @ rng.normal(size=(1, 1)) @ c for b, c in zip(B, C, strict=True))
    for mode in found:
        assert np.abs(la.eigvals(closed) - mode.value).min() < 1e-5


@pytest.mark.parametrize("size", [2, 3, 4])
def test_a_jordan_block_is_one_fixed_mode(size) -> None:
    A = la.block_diag(2.0 * np.eye(size) + np.eye(size, k=1), -1.0)
    Q = la.qr(np.random.default_rng(size).normal(size=A.shape))[0]
    (mode,) = fixed_modes(Q @ A @ Q.T, [Q[:, -1:]], [Q[:, -1:].T])
    assert mode.fixed is True
    assert mode.value == pytest.approx(2.0, abs=1e-6)


def test_a_fixed_pair_is_named_once() -> None:
    A = la.block_diag([[0.0, 3.0], [-3.0, 0.0]], 1.0)
    (mode,) = fixed_modes(A, [E3[:, 2:]], [E3[2:]])
    assert mode.value == pytest.approx(3.0j)


def test_two_near_modes_stay_two() -> None:
    found = fixed_modes(np.diag([1.0, 1.00001, 5.0]), [E3[:, 2:]], [E3[2:]])
    assert values(found) == pytest.approx([1.00001, 1.0])


@pytest.mark.parametrize(("gap", "expected"), [(1e-3, []), (1e-11, [None]), (1e-15, [True])])
def test_between_the_thresholds_nothing_is_decided(gap, expected) -> None:
    found = fixed_modes(np.diag([1.0, 2.0]), [[[gap], [1.0]]], [[[1.0, 1.0]]])
    assert [mode.fixed for mode in found] == expected


def test_more_than_twelve_channels_leave_the_subset_test_out() -> None:
    A = np.diag([1.0, 2.0])
    B, C = [np.eye(2)[:, :1]] * 13, [np.eye(2)[:1]] * 13
    (mode,) = fixed_modes(A, B, C)
    assert mode.fixed is None
    assert np.isnan(mode.subset_margin)
    assert fixed_modes(A, [*B, np.eye(2)[:, 1:]], [*C, np.eye(2)[1:]]) == ()


def test_channels_without_inputs_or_outputs() -> None:
    found = fixed_modes(np.diag([1.0, 2.0]), [np.zeros((2, 0)), np.eye(2)], [np.eye(2), np.zeros((0, 2))])
    assert sorted(mode.value.real for mode in found) == [1.0, 2.0]


def test_complementary_subsystems() -> None:
    A, e = np.diag([1.0, 2.0]), np.eye(2)
    both = check_complementary(A, [np.ones((2, 1))] * 2, [np.ones((1, 2)), np.array([[1.0, 2.0]])])
    assert [found.subset for found in both] == [(0,), (1,)]
    assert all(found.complete for found in both)
    apart = check_complementary(A, [e[:, :1], e[:, 1:]], [e[:1], e[1:]])
    assert [found.complete for found in apart] == [False, False]
    assert apart[0].transfer == 0.0, "nothing goes from one channel to the other"
    assert len(check_complementary(np.eye(3), [E3] * 4, [E3] * 4)) == 14
    lost = check_complementary(np.diag([1.0, 2.0, 2.0]), [E3[:, :1], E3[:, :1]], [E3[:1], E3[:1]])
    assert all(found.complete is False and found.transfer > 0.01 and found.margin == 0.0 for found in lost)
    none = check_complementary(A, [np.zeros((2, 0)), e], [e, e])
    assert [found.complete for found in none] == [False, True]


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((np.ones((1, 2)), [], []), ShapeError, r"A must be square .*\(1, 2\)"),
        ((np.eye(2), [np.eye(2)], []), ShapeError, "one matrix a channel each; got 1 and 0"),
        ((np.eye(2), [], []), ArgumentError, "at least one channel; got none"),
        (
            (np.eye(2), [np.eye(2), np.eye(3)], [np.eye(2)] * 2),
            ShapeError,
            r"B_list\[1\].*\(2, 2\); got shape \(3, 3\)",
        ),
        (
            (np.eye(2), [np.eye(2)] * 2, [np.eye(2), np.eye(3)]),
            ShapeError,
            r"C_list\[1\].*\(2, 2\); got shape \(3, 3\)",
        ),
        ((np.eye(2), [np.full((2, 1), np.nan)], [np.eye(2)]), ArgumentError, r"B_list\[0\] must be finite"),
    ],
)
def test_channels_that_are_refused(arguments, error, message) -> None:
    with pytest.raises(error, match=message):
        fixed_modes(*arguments)
    with pytest.raises(error, match=message):
        check_complementary(*arguments)


@pytest.mark.parametrize("count", [1, 13])
def test_complementary_subsystems_need_a_few_channels(count) -> None:
    with pytest.raises(ArgumentError, match=f"2 to 12 channels; got {count}"):
        check_complementary(np.eye(1), [np.eye(1)] * count, [np.eye(1)] * count)
