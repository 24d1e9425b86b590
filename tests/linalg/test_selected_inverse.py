"""Selected entries of an inverse: by elimination, by solves, and what each needs."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

import trigpoint.linalg.selected_inverse as module
from trigpoint.graphs import grid, random_connected
from trigpoint.linalg.selected_inverse import entries_of_inverse, selected_inverse
from trigpoint.linalg.sparse import factorize


@pytest.fixture(params=["grid", "random"])
def matrix(request):
    rng = np.random.default_rng(3)
    graph = grid(7, 9) if request.param == "grid" else random_connected(50, 0.1, rng)
    return graph.with_weight(rng.uniform(0.1, 10.0, graph.n_arcs)).laplacian()


def pattern(matrix):
    coordinates = sp.coo_array(matrix)
    return coordinates.row.astype(np.int64), coordinates.col.astype(np.int64)


def test_elimination_gives_the_entries_of_the_dense_inverse(matrix):
    rows, columns = pattern(matrix)
    inverse = selected_inverse(factorize(matrix))
    assert inverse is not None
    dense = np.linalg.inv(matrix.toarray())
    np.testing.assert_allclose(inverse.entries(rows, columns), dense[rows, columns], rtol=1e-11)


@pytest.mark.parametrize("limit", [0, 10**6], ids=["elimination", "solves"])
def test_both_ways_agree(matrix, limit, monkeypatch):
    monkeypatch.setattr(module, "_BY_SOLVES", limit)
    rows, columns = pattern(matrix)
    dense = np.linalg.inv(matrix.toarray())
    found = entries_of_inverse(factorize(matrix), matrix.shape[0], rows, columns)
    np.testing.assert_allclose(found, dense[rows, columns], rtol=1e-11)


def test_chunks_of_solves_fit_together(matrix, monkeypatch):
    monkeypatch.setattr(module, "_CHUNK_ENTRIES", 3 * matrix.shape[0])
    rows, columns = pattern(matrix)
    found = entries_of_inverse(factorize(matrix), matrix.shape[0], rows, columns)
    np.testing.assert_allclose(found, np.linalg.inv(matrix.toarray())[rows, columns], rtol=1e-11)


def test_positions_outside_the_pattern_are_solved_for(matrix, monkeypatch):
    monkeypatch.setattr(module, "_BY_SOLVES", 0)
    n = matrix.shape[0]
    rows, columns = (axis.ravel() for axis in np.indices((n, n)))
    inverse = selected_inverse(factorize(matrix))
    assert inverse is not None
    assert inverse.entries(rows, columns) is None
    found = entries_of_inverse(factorize(matrix), n, rows, columns)
    np.testing.assert_allclose(found.reshape(n, n), np.linalg.inv(matrix.toarray()), rtol=1e-10, atol=1e-14)


def test_a_factor_with_exchanged_pivots_is_refused():
    turned = sp.csc_array(np.array([[1e-3, 1.0, 0.0], [1.0, 1e-3, 0.5], [0.0, 0.5, 2.0]]))
    assert selected_inverse(splu(turned)) is None
