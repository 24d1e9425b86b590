"""The observability decomposition against exact rational arithmetic, and what its numbers say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.analysis.plants.oracle import HAN_A, HAN_C, exact_rank, exact_unobservable, same_subspace
from trigpoint.analysis.observability_split import observability_split


@st.composite
def small_pairs(draw):
    n, p = draw(st.integers(1, 5)), draw(st.integers(0, 2))
    entry = st.sampled_from([-1, 0, 0, 1, 2])
    A = np.array(draw(st.lists(st.lists(entry, min_size=n, max_size=n), min_size=n, max_size=n))).astype(float)
    C = np.array(draw(st.lists(st.lists(entry, min_size=n, max_size=n), min_size=p, max_size=p))).astype(float)
    return A, C.reshape(p, n)


@settings(max_examples=100)
@given(small_pairs(), st.sampled_from([1e-6, 1.0, 1e6]))
def test_against_exact_arithmetic(pair, unit) -> None:
    A, C = pair
    split = observability_split(A, unit * C)
    unseen = exact_unobservable(A, C)
    assert split.unseen.shape == unseen.shape
    assert same_subspace(split.unseen, unseen) < 1e-9
    whole = np.hstack([split.seen, split.unseen])
    np.testing.assert_allclose(whole.T @ whole, np.eye(A.shape[0]), atol=1e-13)
    assert split.leak < 1e-12
    assert split.dropped < 1e-12
    assert split.kept > 1e-3


def test_published_plant() -> None:
    for C, rank in zip(HAN_C, [2, 5, 1, 5], strict=True):
        split = observability_split(HAN_A, np.array(C, dtype=float))
        assert split.seen.shape == (6, rank)
        assert exact_rank(HAN_A, C) == rank


def test_the_tolerance_and_what_it_costs() -> None:
    A, C = np.array([[1.0, 1e-4], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    fine, coarse = observability_split(A, C), observability_split(A, C, 1e-2)
    assert fine.seen.shape == (2, 2)
    assert fine.kept == pytest.approx(1e-4, rel=1e-3)
    assert fine.leak == 0.0
    assert coarse.seen.shape == (2, 1)
    assert coarse.dropped == pytest.approx(1e-4, rel=1e-3)
    assert coarse.leak == pytest.approx(1e-4, rel=1e-3)


def test_nothing_seen() -> None:
    split = observability_split(np.eye(2), np.zeros((0, 2)))
    assert split.seen.shape == (2, 0)
    assert split.kept == np.inf
    np.testing.assert_array_equal(split.unseen, np.eye(2))
