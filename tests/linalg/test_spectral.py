"""The smallest eigenpair: dense below the limit, Lanczos above, and the two agree."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence

from trigpoint.graphs import MeasurementGraph, chain, complete, grid, star, within_radius
from trigpoint.linalg import spectral
from trigpoint.linalg.spectral import DENSE_LIMIT, smallest_eigenpair


def blocked(graph: MeasurementGraph, block: list[list[float]]) -> MeasurementGraph:
    d = len(block)
    return graph.with_weight(np.broadcast_to(np.array(block), (graph.n_arcs, d, d)))


def proximity() -> MeasurementGraph:
    graph = within_radius(np.random.default_rng(2).random((900, 2)), 0.07, anchors=[899])
    return graph.subgraph(graph.components[graph.component_labels[899]])


ABOVE = {
    "chain": chain(DENSE_LIMIT + 1),
    "chain anchored everywhere (the start vector is the ground state)": chain(600, anchors=range(600)),
    "star": star(700, anchors=(699,)),
    "grid": grid(25, 25, anchors=(312,)),
    "proximity": proximity(),
    "correlated blocks (ground state orthogonal to all ones)": blocked(grid(18, 18), [[2.0, 1.0], [1.0, 2.0]]),
    "correlated blocks, dense": blocked(complete(260, anchors=(0,)), [[1.0, 0.99], [0.99, 1.0]]),
}


@pytest.mark.parametrize("name", ABOVE)
def test_above_the_limit_lanczos_agrees_with_the_dense_solver(name) -> None:
    matrix = ABOVE[name].laplacian()
    assert matrix.shape[0] > DENSE_LIMIT
    value, vector = smallest_eigenpair(matrix)
    expected = la.eigh(matrix.toarray(), eigvals_only=True, subset_by_index=(0, 0))[0]
    size = abs(matrix).max()
    assert value == pytest.approx(expected, abs=1e-12 * size)
    assert np.linalg.norm(vector) == pytest.approx(1.0)
    assert np.linalg.norm(matrix @ vector - value * vector) < 1e-10 * size
    assert vector.sum() >= 0


@pytest.mark.parametrize("n", [DENSE_LIMIT - 1, DENSE_LIMIT, DENSE_LIMIT + 1, DENSE_LIMIT + 2])
def test_the_chain_on_both_sides_of_the_limit(n) -> None:
    value, vector = smallest_eigenpair(chain(n).laplacian())
    assert value == pytest.approx(4 * np.sin(np.pi / (4 * n + 2)) ** 2, rel=1e-8)
    assert (vector > 0).all()


def test_the_result_is_deterministic() -> None:
    matrix = grid(25, 25).laplacian()
    first, second = smallest_eigenpair(matrix), smallest_eigenpair(matrix)
    assert first[0] == second[0]
    assert np.array_equal(first[1], second[1])


def test_without_convergence_inverse_iteration_gives_a_value(monkeypatch) -> None:
    def gives_up(*args, **options):
        raise ArpackNoConvergence("no", np.zeros(0), np.zeros((0, 0)))

    monkeypatch.setattr(spectral, "eigsh", gives_up)
    matrix = sp.csr_array(chain(600).laplacian())
    value, _ = smallest_eigenpair(matrix)
    assert value == pytest.approx(4 * np.sin(np.pi / 2402) ** 2, rel=1e-6)
