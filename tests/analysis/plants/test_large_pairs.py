"""The sparse margin against the dense one, and the splitting into invariant subspaces."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from trigpoint.analysis import large_pairs
from trigpoint.analysis.invariant import candidate_modes, invariant_pieces, shared_unstable
from trigpoint.analysis.large_pairs import large_pair_margin
from trigpoint.analysis.pairs import pair_margin
from trigpoint.linalg.blocks import diagonal_of


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("n", [12, 80, 150])
def test_the_smallest_singular_value_at_one_mode(n, seed) -> None:
    rng = np.random.default_rng(seed)
    A = sp.csc_array(sp.random_array((n, n), density=4.0 / n, rng=rng) + sp.eye_array(n))
    C = sp.csc_array(sp.random_array((n // 2, n), density=4.0 / n, rng=rng))
    s = la.eigvals(A.toarray())[0]
    found = large_pair_margin(A, C, np.array([s]))
    pencil = np.vstack([found.mode * np.eye(n) - A.toarray(), C.toarray()])
    pair = abs(sp.vstack([A, C]))
    size = np.sqrt(pair.sum(axis=0).max() * pair.sum(axis=1).max())
    assert found.margin == pytest.approx(la.svdvals(pencil)[-1] / size, rel=0.05, abs=1e-15)
    assert np.linalg.norm(pencil @ found.direction) == pytest.approx(found.margin * size, rel=1e-6, abs=1e-13)


def test_it_agrees_with_the_small_margin() -> None:
    rng = np.random.default_rng(3)
    A = la.block_diag(*(rng.normal(size=(2, 2)) for _ in range(10)))
    C = rng.normal(size=(6, 20))
    for hidden in (False, True):
        C[:, :2] *= not hidden
        dense, sparse = pair_margin(A, C), large_pair_margin(sp.csc_array(A), sp.csc_array(C), la.eigvals(A))
        assert sparse.verdict is dense.verdict is not hidden


def test_unseen_inside_large_jordan_chains() -> None:
    n = 90
    A = diagonal_of([np.eye(3, k=1)] * (n // 3))
    C = sp.lil_array((n, n))
    C.setdiag([0.0, 1.0, 1.0] * (n // 3))
    found = large_pair_margin(A, C, np.array([1e-5 + 1e-5j, 0.0]))
    assert found.verdict is False
    assert np.linalg.norm(C @ found.direction) < 1e-12


def test_only_unstable_modes_count_where_asked() -> None:
    A, C = sp.diags_array(np.linspace(-2.0, -1.0, 70)), sp.csc_array((1, 70))
    assert large_pair_margin(A, C, np.linspace(-2.0, -1.0, 70)).verdict is False
    held = large_pair_margin(A, C, np.linspace(-2.0, -1.0, 70), unstable_only=True)
    assert held.verdict is True
    assert held.margin == np.inf


def test_too_many_candidates_are_undecided(monkeypatch) -> None:
    monkeypatch.setattr(large_pairs, "_MOST_CANDIDATES", 20)
    values = np.linspace(1.0, 2.0, 21)
    A, C = sp.diags_array(values), sp.eye_array(21)
    assert large_pair_margin(A, C, values).verdict is None
    assert large_pair_margin(A, C, values[:20]).verdict is True


def test_pieces_are_invariant_and_complete() -> None:
    rng = np.random.default_rng(2)
    matrices = [rng.normal(size=(n, n)) for n in (1, 2, 3, 5, 8)]
    matrices += [0.5 * np.eye(3) + np.eye(3, k=1), matrices[2], np.zeros((2, 2))]
    pieces = invariant_pieces(matrices)
    for piece in pieces:
        A = matrices[piece.node]
        np.testing.assert_allclose(A @ piece.Q, piece.Q @ piece.T, atol=1e-12)
        np.testing.assert_allclose(piece.Q.T @ piece.Q, np.eye(piece.Q.shape[1]), atol=1e-13)
    for node, A in enumerate(matrices):
        found = np.sort_complex(np.concatenate([p.values for p in pieces if p.node == node]))
        np.testing.assert_allclose(found, np.sort_complex(la.eigvals(A)), atol=1e-4)
    twins = [{p.cluster for p in pieces if p.node == node} for node in (2, 6)]
    assert twins[0] == twins[1]
    assert len([p for p in pieces if p.node == 5]) == 1, "a Jordan block stays together"


def test_conjugates_stay_together_and_others_do_not() -> None:
    pieces = invariant_pieces([la.block_diag([[0.0, 1.0], [-1.0, 0.0]], 3.0, 3.0 + 1e-7, 2.0)])
    assert sorted(p.T.shape[0] for p in pieces) == [1, 2, 2]


def test_what_is_unstable_and_what_is_marginal() -> None:
    cases = {
        "stable": (np.diag([-1.0]), False, True),
        "constant": (np.zeros((1, 1)), True, True),
        "oscillator": (np.array([[0.0, 2.0], [-0.5, 0.0]]), True, True),
        "growing": (np.array([[0.5]]), True, False),
        "double": (np.eye(2, k=1), True, False),
        "spiral": (np.array([[0.1, 1.0], [-1.0, 0.1]]), True, False),
    }
    for matrix, unstable, marginal in cases.values():
        (piece,) = invariant_pieces([matrix])
        assert piece.is_unstable is unstable
        assert piece.is_marginal is marginal


def test_who_shares_an_unstable_mode() -> None:
    shared = shared_unstable(invariant_pieces([np.diag([0.5, -1.0]), np.diag([-1.0, 0.7]), 0.5 * np.eye(1)]))
    assert [piece.node for piece in shared] == [0, 2]
    assert shared_unstable(invariant_pieces([np.diag([-1.0]), np.diag([-1.0])])) == []
    near = invariant_pieces([np.array([[0.5]]), np.array([[0.5 + 1e-6]])])
    assert shared_unstable(near) == []
    chain, block = np.eye(3, k=1), np.zeros((1, 1))
    Q = la.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert len(shared_unstable(invariant_pieces([Q @ chain @ Q.T, block]))) == 2
    assert candidate_modes(near).shape == (6,)
