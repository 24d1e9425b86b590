"""G16, Propositions 3 and 4, Theorem 1 and Corollary 1: the end-anchored chain is the worst graph."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from trigpoint.analysis import gain_bound, smallest_eigenvalue, worst_case_eigenvalue, worst_case_gain
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph, chain, random_connected

PUBLISHED = [(2, 2.618034, 5e-7), (3, 5.048917, 5e-7), (4, 8.290859, 5e-7), (16, 110.4221, 5e-5), (64, 1686.169, 5e-4)]


def least(graph: MeasurementGraph) -> float:
    return float(np.linalg.eigvalsh(graph.laplacian().toarray())[0])


def phi(n: int) -> np.ndarray:
    """Proposition 4: ``Phi_N = G^{-1}' G^{-1}`` of the chain, by its definition through the incidence matrix."""
    inverse = np.linalg.inv(chain(n).incidence().toarray())
    return inverse.T @ inverse


@pytest.mark.parametrize(("n", "expected", "digits"), PUBLISHED)
def test_published_worst_case_gains(n, expected, digits) -> None:
    assert worst_case_gain(n) == pytest.approx(expected, abs=digits)


def test_worst_case_gains_to_full_precision() -> None:
    assert worst_case_gain(8) == pytest.approx(29.36529789437195, rel=1e-15)
    assert worst_case_gain(100) == pytest.approx(4093.5604746853114, rel=1e-15)
    assert worst_case_gain(1000) == pytest.approx(405690.204, abs=5e-4)
    assert worst_case_gain(1) == pytest.approx(1.0)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 8, 16, 64])
def test_the_worst_case_gain_is_the_largest_eigenvalue_of_phi(n) -> None:
    matrix = phi(n)
    assert np.linalg.norm(matrix, 2) == pytest.approx(worst_case_gain(n), rel=1e-12)
    by_hand = np.array([[n - max(i, j) for j in range(n)] for i in range(n)])
    np.testing.assert_allclose(np.sort(np.linalg.eigvalsh(matrix)), np.linalg.eigvalsh(by_hand), rtol=1e-10, atol=1e-12)
    G = chain(n).incidence().toarray()
    np.testing.assert_allclose(np.linalg.inv(G @ G.T), np.linalg.inv(G).T @ np.linalg.inv(G), atol=1e-10)


def test_the_papers_formula_and_ours_agree() -> None:
    for n in range(1, 30):
        assert worst_case_gain(n) == pytest.approx(1 / (2 + 2 * np.cos(2 * np.pi * n / (2 * n + 1))), rel=1e-11)


@pytest.mark.parametrize("n", range(2, 9))
def test_of_all_trees_and_anchors_the_chain_anchored_at_its_end_is_worst(n) -> None:
    found = []
    for tree in nx.nonisomorphic_trees(n):
        edges = list(tree.edges)
        for anchor in range(n):
            graph = MeasurementGraph(n, [*(u for u, _ in edges), -1], [*(v for _, v in edges), anchor])
            assert graph.is_generalized_tree
            found.append((least(graph), graph.is_chain))
    found.sort()
    worst, is_chain = found[0]
    assert is_chain
    assert worst == pytest.approx(worst_case_eigenvalue(n), abs=1e-14)
    others = [value for value, chain_like in found if not chain_like]
    if others:
        assert min(others) > worst * (1 + 1e-6)
    if n == 8:
        assert min(others) == pytest.approx(0.034836, abs=5e-7)
        assert worst == pytest.approx(0.034054, abs=5e-7)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_of_all_connected_graphs_with_one_anchor_the_chain_is_worst(n) -> None:
    found = []
    for graph in nx.graph_atlas_g():
        if graph.number_of_nodes() == n and nx.is_connected(graph):
            for anchor in graph.nodes:
                measured = MeasurementGraph.from_networkx(graph, anchors=[anchor])
                found.append((least(measured), measured.is_generalized_tree, measured.is_chain))
    found.sort()
    assert found[0][0] == pytest.approx(worst_case_eigenvalue(n), abs=1e-14)
    assert found[0][1:] == (True, True)
    for value, _, is_chain in found:
        assert is_chain or value > found[0][0] + 1e-6


@pytest.mark.parametrize(("n", "components"), [(4, 1), (5, 2), (6, 3), (7, 7)])
def test_with_several_components_the_largest_possible_one_decides(n, components) -> None:
    largest = n - components + 1
    value = worst_case_eigenvalue(n, components)
    assert value == pytest.approx(1 / worst_case_gain(largest))
    starts = [0, *range(largest, n)]
    graph = MeasurementGraph(n, [*range(largest - 1), *(-1 for _ in starts)], [*range(1, largest), *starts])
    assert len(graph.components) == components
    assert least(graph) == pytest.approx(value, abs=1e-14)
    assert value >= worst_case_eigenvalue(n)


def test_of_all_splits_into_components_none_is_worse_than_corollary_1() -> None:
    for n in range(2, 8):
        for components in range(1, n + 1):
            for sizes in _partitions(n, components):
                assert min(1 / worst_case_gain(k) for k in sizes) >= worst_case_eigenvalue(n, components) * (1 - 1e-15)


def _partitions(n: int, parts: int, most: int | None = None) -> list[tuple[int, ...]]:
    most = n if most is None else most
    if parts == 0:
        return [()] if n == 0 else []
    return [(k, *rest) for k in range(1, min(n, most) + 1) for rest in _partitions(n - k, parts - 1, k)]


@pytest.mark.parametrize("seed", range(6))
def test_no_network_needs_more_than_the_worst_case_gain(seed) -> None:
    rng = np.random.default_rng(seed)
    graph = random_connected(int(rng.integers(1, 40)), float(rng.uniform(0.01, 0.5)), rng)
    assert gain_bound(graph) <= worst_case_gain(graph.n_nodes) * (1 + 1e-8)


def test_the_gain_bound_is_never_too_small_and_infinite_without_anchor() -> None:
    bound = smallest_eigenvalue(chain(8))
    assert gain_bound(chain(8)) == gain_bound(bound) == 1 / bound.lower
    assert gain_bound(chain(8)) == pytest.approx(worst_case_gain(8), rel=1e-8)
    assert gain_bound(chain(8)) >= worst_case_gain(8) * (1 - 1e-15)
    assert gain_bound(chain(3, anchors=())) == np.inf


def test_numpy_integers_are_whole_numbers() -> None:
    assert worst_case_gain(np.int64(8)) == worst_case_gain(8)
    assert worst_case_eigenvalue(np.int64(8), np.int64(2)) == worst_case_eigenvalue(8, 2)


@pytest.mark.parametrize("bad", [0, -1, 2.0, True, "8", None])
def test_what_is_no_number_of_nodes_is_refused(bad) -> None:
    with pytest.raises(ArgumentError, match="n_nodes must be a whole number of at least 1"):
        worst_case_gain(bad)


@pytest.mark.parametrize("bad", [0, 5, 1.0, True])
def test_what_is_no_number_of_components_is_refused(bad) -> None:
    with pytest.raises(ArgumentError, match="components must be a whole number from 1 to n_nodes = 4"):
        worst_case_eigenvalue(4, bad)
