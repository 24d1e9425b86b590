"""Rigorous bounds of the smallest eigenvalue: never wrong, and tight where they should be."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis import EigenvalueBound, smallest_eigenvalue, worst_case_eigenvalue
from trigpoint.analysis.modes import largest_eigenvalue_bound
from trigpoint.graphs import MeasurementGraph, chain, complete, grid, star, within_radius
from trigpoint.linalg.verified import collatz_wielandt_lower
from trigpoint.testing.strategies import measurement_graphs

from .exact import DIGITS, exact_laplacian, exact_smallest_eigenvalue, resolution


def check_against_fifty_digits(graph: MeasurementGraph) -> EigenvalueBound:
    bound = smallest_eigenvalue(graph)
    exact, slack = exact_smallest_eigenvalue(graph), resolution(graph)
    with mpmath.workdps(DIGITS):
        assert bound.lower <= exact + slack, f"lower {bound.lower!r} > {mpmath.nstr(exact, 20)}"
        assert bound.upper >= exact - slack, f"upper {bound.upper!r} < {mpmath.nstr(exact, 20)}"
    assert 0.0 <= bound.lower <= bound.value <= bound.upper
    return bound


@settings(max_examples=60)
@given(measurement_graphs(max_nodes=7))
def test_unit_weights(graph) -> None:
    bound = check_against_fifty_digits(graph)
    assert bound.relative_width < 1e-6
    assert (bound.value > 0) == graph.is_externally_connected


@settings(max_examples=80)
@given(measurement_graphs(max_nodes=6, weighted=True, decades=6, externally_connected=True))
def test_weights_over_twelve_orders_of_magnitude(graph) -> None:
    check_against_fifty_digits(graph)


@settings(max_examples=25)
@given(measurement_graphs(max_nodes=3, max_extra_arcs=4, blocks=2, decades=6, externally_connected=True))
def test_blocks_over_twelve_orders_of_magnitude(graph) -> None:
    check_against_fifty_digits(graph)


@settings(max_examples=25)
@given(measurement_graphs(max_nodes=3, max_extra_arcs=4, blocks=3, decades=0, externally_connected=True))
def test_blocks_of_similar_size_are_bounded_tightly(graph) -> None:
    assert check_against_fifty_digits(graph).relative_width < 1e-6


@pytest.mark.parametrize("seed", range(30))
def test_blocks_with_all_digits_in_use(seed) -> None:
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(3, 2, 2))
    blocks = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(2)
    graph = MeasurementGraph(2, [0, -1, -1], [1, 1, 0], 0.5 * (blocks + blocks.transpose(0, 2, 1)))
    assert check_against_fifty_digits(graph.subgraph([int(seed % 2)])).relative_width < 1e-6
    assert check_against_fifty_digits(graph).relative_width < 1e-6


def test_blocks_whose_sums_cancel() -> None:
    tilted = np.array([[1.0, 1.0 - 1e-9], [1.0 - 1e-9, 1.0]])
    mirrored = tilted * np.array([[1.0, -1.0], [-1.0, 1.0]])
    graph = chain(3, anchors=(2, 2)).with_weight(np.stack([tilted, mirrored, tilted, mirrored]))
    check_against_fifty_digits(graph)


@settings(max_examples=40)
@given(measurement_graphs(max_nodes=8, weighted=True, decades=1))
def test_the_attributes_say_what_they_promise(graph) -> None:
    bound = smallest_eigenvalue(graph)
    L = graph.laplacian().toarray()
    assert np.linalg.norm(bound.vector) == pytest.approx(1.0)
    assert np.linalg.norm(L @ bound.vector - bound.value * bound.vector) < 1e-11 * (1 + np.abs(L).max())
    assert bound.residual < 1e-11 * (1 + np.abs(L).max())
    outside = np.setdiff1d(np.arange(graph.n_nodes), bound.nodes)
    assert not bound.vector[outside].any()
    assert any(np.array_equal(bound.nodes, component) for component in graph.components)
    anchored = graph.component_is_anchored[graph.component_labels]
    assert np.array_equal(bound.unanchored, np.flatnonzero(~anchored))
    assert (bound.value == 0.0) == bool(bound.unanchored.size)


def test_the_witness_proves_the_lower_bound() -> None:
    from trigpoint.analysis.eigenvalue import couplings

    graph = grid(7, 5, anchors=(34,))
    bound = smallest_eigenvalue(graph)
    assert (bound.witness > 0).all()
    assert collatz_wielandt_lower(couplings(graph), bound.witness) == bound.lower


@pytest.mark.parametrize("blocks", [None, 2])
def test_a_floating_component_gives_zero_exactly(blocks) -> None:
    graph = MeasurementGraph(5, [-1, 1, 0], [4, 2, 4])
    if blocks:
        graph = graph.with_weight(np.broadcast_to(np.eye(blocks), (3, blocks, blocks)))
    bound = smallest_eigenvalue(graph)
    assert (bound.value, bound.lower, bound.upper, bound.residual, bound.relative_width) == (0, 0, 0, 0, 0)
    assert bound.nodes.tolist() == [1, 2]
    assert bound.unanchored.tolist() == [1, 2, 3]
    assert np.linalg.norm(graph.laplacian() @ bound.vector) == 0.0
    assert np.linalg.norm(bound.vector) == pytest.approx(1.0)


def test_the_smallest_component_decides() -> None:
    graph = MeasurementGraph(6, [-1, 0, -1, 2, 3, 4], [0, 1, 5, 3, 4, 5])
    bound = smallest_eigenvalue(graph)
    assert bound.value == pytest.approx(worst_case_eigenvalue(4), rel=1e-12)
    assert bound.nodes.tolist() == [2, 3, 4, 5]


def test_a_single_node() -> None:
    bound = smallest_eigenvalue(chain(1))
    assert bound.lower <= 1.0 <= bound.upper
    assert bound.relative_width < 1e-14
    assert smallest_eigenvalue(chain(1).with_weight([1e-9])).value == pytest.approx(1e-9)


@pytest.mark.parametrize("n", [2, 8, 100, 500, 501, 2000])
@pytest.mark.parametrize("last", [False, True])
def test_the_chain_is_within_its_closed_form(n, last) -> None:
    bound = smallest_eigenvalue(chain(n, anchors=(n - 1 if last else 0,)))
    exact = worst_case_eigenvalue(n)
    assert bound.lower <= exact * (1 + 1e-15)
    assert bound.upper >= exact * (1 - 1e-15)
    assert bound.lower >= exact * (1 - 1e-3)
    assert bound.relative_width < 1e-6


@pytest.mark.parametrize("n", [2, 30, 600])
def test_the_complete_graph_and_the_star_are_within_their_closed_form(n) -> None:
    exact = 2 / ((n + 1) + np.sqrt((n + 1) ** 2 - 4))
    graphs = [star(n)] if n > 100 else [star(n), complete(n, anchors=(n - 1,))]
    for graph in graphs:
        bound = smallest_eigenvalue(graph)
        assert bound.lower <= exact * (1 + 1e-14)
        assert bound.upper >= exact * (1 - 1e-14)
        assert bound.relative_width < 1e-6


def random_tree(n: int, rng: np.random.Generator, anchors: list[int]) -> MeasurementGraph:
    parents = [int(rng.integers(k)) for k in range(1, n)]
    return MeasurementGraph(n, [*parents, *(-1 for _ in anchors)], [*range(1, n), *anchors])


def anchored_share(n: int, share: float, rng: np.random.Generator) -> list[int]:
    return sorted(rng.choice(n, size=max(1, round(share * n)), replace=False).tolist())


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5], ids=["one anchor", "1 % anchored", "50 % anchored"])
@pytest.mark.parametrize("kind", ["grid", "radius", "tree"])
@pytest.mark.parametrize("n", [400, 5000])
def test_the_bounds_are_tight_whatever_the_share_of_anchors(kind, n, share) -> None:
    rng = np.random.default_rng(n)
    anchors = anchored_share(n, share, rng)
    if kind == "grid":
        graph = grid(20, n // 20, anchors=anchors)
    elif kind == "tree":
        graph = random_tree(n, rng, anchors)
    else:
        whole = within_radius(rng.random((n, 2)), 2.2 / np.sqrt(n), anchors)
        graph = whole.subgraph(np.flatnonzero(whole.component_is_anchored[whole.component_labels]))
    bound = smallest_eigenvalue(graph)
    assert 0 < bound.lower <= bound.value <= bound.upper
    assert bound.relative_width < 1e-6


def test_the_chain_with_half_its_nodes_anchored() -> None:
    """The caution of theory 8-G1: the plain Barta quotient gives [-74, 154] here."""
    bound = smallest_eigenvalue(chain(200, anchors=range(100, 200)))
    assert bound.relative_width < 1e-6
    assert bound.value == pytest.approx(2.4e-4, rel=0.05)


def test_the_image_grid_of_r23() -> None:
    bound = smallest_eigenvalue(grid(70, 128, anchors=(70 * 128 - 1,)))
    assert bound.lower >= 2.919739455067e-5 * (1 - 1e-9)
    assert bound.upper <= 2.919739455301e-5 * (1 + 1e-9)
    assert bound.lower <= 2.91973945518e-5 <= bound.upper


@pytest.mark.slow
def test_a_grid_of_ninety_thousand_nodes() -> None:
    bound = smallest_eigenvalue(grid(300, 300))
    assert bound.relative_width < 1e-6
    assert 0 < bound.lower <= bound.value <= bound.upper


def test_inputs_are_not_changed_and_results_are_deterministic() -> None:
    graph = grid(6, 6).with_weight(np.linspace(0.5, 2.0, grid(6, 6).n_arcs))
    first, second = smallest_eigenvalue(graph), smallest_eigenvalue(graph)
    assert (first.lower, first.value, first.upper) == (second.lower, second.value, second.upper)
    assert np.array_equal(first.vector, second.vector)


# -- the upper end of the spectrum -------------------------------------------------------------------------------------
@settings(max_examples=40)
@given(st.one_of(measurement_graphs(max_nodes=5, weighted=True), measurement_graphs(max_nodes=3, blocks=2)))
def test_the_degree_bound_is_above_the_largest_eigenvalue(graph) -> None:
    with mpmath.workdps(DIGITS):
        largest = max(mpmath.eigsy(exact_laplacian(graph), eigvals_only=True))
        assert largest <= largest_eigenvalue_bound(graph) * (1 + 1e-12) + resolution(graph)
