"""Incidence matrices and Laplacians: the properties of G16, Section 2, on drawn networks."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.testing.strategies import measurement_graphs

any_graph = measurement_graphs(weighted=True, decades=2)
unit_graph = measurement_graphs()


def dense_laplacian(graph: MeasurementGraph) -> np.ndarray:
    return graph.laplacian().toarray()


def naive_laplacian(graph: MeasurementGraph) -> np.ndarray:
    """Readable oracle: one arc after the other."""
    d = graph.dimension
    L = np.zeros((graph.n_nodes, d, graph.n_nodes, d))
    for k in range(graph.n_arcs):
        w = np.atleast_2d(graph.arc_weights[k])
        tail, head = int(graph.tail[k]), int(graph.head[k])
        L[head, :, head, :] += w
        if tail != EXTERNAL:
            L[tail, :, tail, :] += w
            L[head, :, tail, :] -= w
            L[tail, :, head, :] -= w
    return L.reshape(graph.n_nodes * d, graph.n_nodes * d)


def with_arc(graph: MeasurementGraph, tail: int, head: int) -> MeasurementGraph:
    weight = None if graph.weight is None else [*graph.weight, 1.0]
    return MeasurementGraph(graph.n_nodes, [*graph.tail, tail], [*graph.head, head], weight)


@settings(max_examples=50)
@given(unit_graph)
def test_column_sums_are_zero_for_internal_and_one_for_external_arcs(graph) -> None:
    sums = graph.incidence().sum(axis=0)
    assert np.array_equal(sums, graph.is_external.astype(float))
    assert not np.any(graph.extended_incidence().sum(axis=0))


@settings(max_examples=50)
@given(unit_graph)
def test_columns_hold_minus_one_at_the_tail_and_plus_one_at_the_head(graph) -> None:
    G = graph.incidence().toarray()
    assert G.shape == (graph.n_nodes, graph.n_arcs)
    assert set(np.unique(G)) <= {-1.0, 0.0, 1.0}
    for k in range(graph.n_arcs):
        assert G[graph.head[k], k] == 1.0
        assert np.count_nonzero(G[:, k]) == (1 if graph.is_external[k] else 2)
        if not graph.is_external[k]:
            assert G[graph.tail[k], k] == -1.0


@settings(max_examples=50)
@given(unit_graph)
def test_deleting_row_zero_of_the_extended_incidence_gives_the_incidence(graph) -> None:
    extended = graph.extended_incidence().toarray()
    assert np.array_equal(extended[1:], graph.incidence().toarray())
    assert np.array_equal(extended[0], -graph.is_external.astype(float))


@settings(max_examples=50)
@given(any_graph)
def test_the_laplacian_is_incidence_times_weight_times_its_transpose(graph) -> None:
    G, L = graph.incidence().toarray(), dense_laplacian(graph)
    np.testing.assert_allclose(L, G @ np.diag(graph.arc_weights) @ G.T, rtol=0, atol=1e-13 * np.abs(L).max(initial=0))
    np.testing.assert_allclose(L, naive_laplacian(graph), rtol=0, atol=1e-13 * np.abs(L).max(initial=0))
    assert np.array_equal(L, L.T)


@settings(max_examples=40)
@given(st.one_of(measurement_graphs(blocks=2, decades=2), measurement_graphs(blocks=3, decades=2)))
def test_block_weights_give_the_kronecker_form(graph) -> None:
    d = graph.dimension
    Gd = np.kron(graph.incidence().toarray(), np.eye(d))
    W = la.block_diag(*graph.arc_weights) if graph.n_arcs else np.zeros((0, 0))
    L = dense_laplacian(graph)
    assert L.shape == (graph.n_nodes * d, graph.n_nodes * d)
    np.testing.assert_allclose(L, Gd @ W @ Gd.T, rtol=0, atol=1e-13 * np.abs(L).max(initial=0))
    np.testing.assert_allclose(L, naive_laplacian(graph), rtol=0, atol=1e-13 * np.abs(L).max(initial=0))


@settings(max_examples=50)
@given(any_graph)
def test_row_sums_equal_the_external_weight(graph) -> None:
    external = np.bincount(graph.head[graph.is_external], graph.arc_weights[graph.is_external], minlength=graph.n_nodes)
    L = dense_laplacian(graph)
    np.testing.assert_allclose(L.sum(axis=1), external, rtol=0, atol=1e-13 * np.abs(L).max(initial=0))


@settings(max_examples=50)
@given(measurement_graphs(weighted=True), st.data())
def test_flipping_any_internal_arc_leaves_the_laplacian_unchanged(graph, data) -> None:
    flip = np.array(data.draw(st.lists(st.booleans(), min_size=graph.n_arcs, max_size=graph.n_arcs)), dtype=bool)
    flip &= ~graph.is_external
    tail, head = np.where(flip, graph.head, graph.tail), np.where(flip, graph.tail, graph.head)
    flipped = MeasurementGraph(graph.n_nodes, tail, head, graph.weight)
    L = dense_laplacian(graph)
    np.testing.assert_allclose(dense_laplacian(flipped), L, rtol=1e-13, atol=1e-13 * np.abs(L).max(initial=0))


@settings(max_examples=40)
@given(measurement_graphs(externally_connected=True))
def test_a_path_to_the_environment_from_every_node_makes_the_laplacian_definite(graph) -> None:
    assert graph.is_externally_connected
    assert np.linalg.eigvalsh(dense_laplacian(graph))[0] > 1e-3  # N <= 8: at least 0.034
    assert np.linalg.matrix_rank(graph.incidence().toarray()) == graph.n_nodes


@settings(max_examples=40)
@given(measurement_graphs(externally_connected=False))
def test_a_node_without_path_to_the_environment_makes_the_laplacian_singular(graph) -> None:
    assert not graph.is_externally_connected
    assert abs(np.linalg.eigvalsh(dense_laplacian(graph))[0]) < 1e-13 * (1 + graph.n_arcs)
    assert not graph.n_arcs or np.linalg.matrix_rank(graph.incidence().toarray()) < graph.n_nodes


@settings(max_examples=50)
@given(measurement_graphs(min_nodes=2), st.data())
def test_adding_an_arc_never_lowers_an_eigenvalue(graph, data) -> None:
    head = data.draw(st.integers(0, graph.n_nodes - 1))
    tail = data.draw(st.integers(EXTERNAL, graph.n_nodes - 1).filter(lambda k: k != head))
    before = np.linalg.eigvalsh(dense_laplacian(graph))
    after = np.linalg.eigvalsh(dense_laplacian(with_arc(graph, tail, head)))
    assert (after >= before - 1e-13 * (1 + after[-1])).all()


@settings(max_examples=50)
@given(any_graph)
def test_the_laplacian_is_block_diagonal_over_the_components(graph) -> None:
    L = dense_laplacian(graph)
    order = np.concatenate(graph.components)
    parts = [dense_laplacian(part) for part in graph.split()]
    assert np.array_equal(L[np.ix_(order, order)], la.block_diag(*parts))
    least = min(np.linalg.eigvalsh(part)[0] for part in parts)
    assert np.linalg.eigvalsh(L)[0] == pytest.approx(least, abs=1e-13 * (1 + np.abs(L).max()))


@settings(max_examples=40)
@given(measurement_graphs(), st.randoms(use_true_random=False))
def test_one_anchor_on_every_node_gives_eigenvalue_one(graph, random) -> None:
    inner = ~graph.is_external
    nodes = list(range(graph.n_nodes))
    random.shuffle(nodes)
    everywhere = MeasurementGraph(
        graph.n_nodes, [*graph.tail[inner], *(EXTERNAL for _ in nodes)], [*graph.head[inner], *nodes]
    )
    H = graph.incidence().toarray()[:, inner]
    assert np.array_equal(dense_laplacian(everywhere), np.eye(graph.n_nodes) + H @ H.T)
    assert np.linalg.eigvalsh(dense_laplacian(everywhere))[0] == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("weight", [None, [], np.zeros((0, 2, 2))])
def test_a_graph_without_arcs_has_the_zero_laplacian(weight) -> None:
    graph = MeasurementGraph(3, [], [], weight)
    assert graph.laplacian().shape == (3 * graph.dimension, 3 * graph.dimension)
    assert graph.laplacian().nnz == 0
    assert graph.incidence().shape == (3, 0)
    assert graph.extended_incidence().shape == (4, 0)
