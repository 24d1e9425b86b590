"""The gallery: closed forms of the spectra, edge cases, and the random network of G16, Section 5.1."""

from __future__ import annotations

import numpy as np
import pytest

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, complete, cycle, grid, random_connected, star
from trigpoint.graphs import within_radius as near


def spectrum(graph: MeasurementGraph) -> np.ndarray:
    return np.linalg.eigvalsh(graph.laplacian().toarray())


@pytest.mark.parametrize("n", [1, 2, 3, 8, 50])
@pytest.mark.parametrize("last", [False, True])
def test_spectrum_of_the_chain_anchored_at_either_end(n, last) -> None:
    k = np.arange(1, n + 1)
    expected = 2 - 2 * np.cos((2 * k - 1) * np.pi / (2 * n + 1))
    np.testing.assert_allclose(spectrum(chain(n, anchors=(n - 1 if last else 0,))), expected, atol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 5, 10])
def test_smallest_eigenvalue_of_the_complete_graph_and_the_hub_anchored_star(n) -> None:
    expected = ((n + 1) - np.sqrt((n + 1) ** 2 - 4)) / 2
    assert spectrum(complete(n, anchors=(n - 1,)))[0] == pytest.approx(expected, rel=1e-12)
    assert spectrum(star(n))[0] == pytest.approx(expected, rel=1e-12)


def test_published_values_for_ten_nodes() -> None:
    assert spectrum(complete(10, anchors=(3,)))[0] == pytest.approx(0.0916730868, abs=5e-11)
    assert spectrum(star(10))[0] == pytest.approx(0.0916730868, abs=5e-11)
    assert spectrum(star(10, anchors=(9,)))[0] == pytest.approx(0.0515900548, abs=5e-11)


def test_spectrum_of_the_ring() -> None:
    np.testing.assert_allclose(spectrum(cycle(7)), np.sort(2 - 2 * np.cos(2 * np.pi * np.arange(7) / 7)), atol=1e-13)


def test_spectrum_of_the_grid_is_the_sum_of_two_paths() -> None:
    rows, cols = 4, 3
    path = [2 - 2 * np.cos(np.pi * np.arange(m) / m) for m in (rows, cols)]
    expected = np.sort(np.add.outer(*path).ravel())
    np.testing.assert_allclose(spectrum(grid(rows, cols, anchors=())), expected, atol=1e-13)


def test_the_grid_is_row_major_with_arcs_to_the_right_and_downwards() -> None:
    graph = grid(2, 3, anchors=(5,))
    arcs = set(zip(graph.tail.tolist(), graph.head.tolist(), strict=True))
    assert arcs == {(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (1, 4), (2, 5), (EXTERNAL, 5)}
    assert graph.neighbours(4).tolist() == [1, 3, 5]


def test_the_grid_of_g16_section_5_2() -> None:
    graph = grid(4, 4)
    assert graph.n_arcs == 25
    assert spectrum(graph)[0] == pytest.approx(0.0358034, abs=5e-8)


def test_smallest_members() -> None:
    for single in (chain(1), complete(1, anchors=(0,)), star(1), grid(1, 1)):
        assert (single.n_nodes, single.n_arcs) == (1, 1)
        assert single.is_chain
    two = cycle(2)
    assert sorted(zip(two.tail.tolist(), two.head.tolist(), strict=True)) == [(0, 1), (1, 0)]
    assert np.array_equal(two.laplacian().toarray(), [[2, -2], [-2, 2]])
    assert np.array_equal(grid(1, 5).laplacian().toarray(), chain(5).laplacian().toarray())
    assert np.array_equal(grid(5, 1).laplacian().toarray(), chain(5).laplacian().toarray())


def test_an_anchor_may_stand_several_times() -> None:
    graph = chain(2, anchors=(1, 1, 0))
    assert graph.is_external.sum() == 3
    assert graph.laplacian().toarray().tolist() == [[2, -1], [-1, 3]]


@pytest.mark.parametrize("n", [1, 2, 10, 30])
@pytest.mark.parametrize("connectivity", [0.1, 0.5, 1.0])
def test_random_networks_have_the_papers_number_of_arcs(n, connectivity) -> None:
    graph = random_connected(n, connectivity, np.random.default_rng(n))
    assert graph.n_arcs == max(n, round(connectivity * n * (n - 1) / 2))
    assert graph.is_externally_connected
    again = random_connected(n, connectivity, np.random.default_rng(n))
    assert np.array_equal(graph.tail, again.tail)
    assert np.array_equal(graph.head, again.head)


def test_within_radius_agrees_with_all_pairs() -> None:
    rng = np.random.default_rng(5)
    positions, marks = rng.random((40, 2)), rng.random((3, 2))
    graph = near(positions, 0.25, anchors=[39], anchor_positions=marks)
    distance = np.linalg.norm(positions[:, None] - positions, axis=2)
    expected = [(i, j) for i in range(40) for j in range(i + 1, 40) if distance[i, j] <= 0.25]
    inner = ~graph.is_external
    assert list(zip(graph.tail[inner].tolist(), graph.head[inner].tolist(), strict=True)) == expected
    reached = [i for mark in marks for i in range(40) if np.linalg.norm(positions[i] - mark) <= 0.25]
    assert sorted(graph.head[graph.is_external].tolist()) == sorted([39, *reached])


def test_within_radius_of_one_node_and_of_no_pair() -> None:
    assert near([[0.0, 0.0]], 1.0, anchors=[0]).is_chain
    assert near([[0.0], [5.0]], 1.0).n_arcs == 0
    assert near([[0.0], [1.0]], 1.0).n_arcs == 1


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: chain(0), ArgumentError, "n must be a whole number of at least 1; got 0"),
        (lambda: chain(2.0), ArgumentError, "n must be a whole number"),
        (lambda: chain(True), ArgumentError, "n must be a whole number"),
        (lambda: chain(3, anchors=(3,)), ArgumentError, r"anchors\[0\] = 3 is no index"),
        (lambda: chain(3, anchors=(-1,)), ArgumentError, r"anchors\[0\] = -1 is no index"),
        (lambda: cycle(1), ArgumentError, "n must be a whole number of at least 2"),
        (lambda: grid(0, 3), ArgumentError, "rows must be"),
        (lambda: grid(3, 0), ArgumentError, "cols must be"),
        (lambda: random_connected(5, 30, np.random.default_rng(0)), ArgumentError, "connectivity must be a fraction"),
        (lambda: random_connected(5, 0.0, np.random.default_rng(0)), ArgumentError, "0 < connectivity <= 1"),
        (lambda: near([0.0, 1.0], 1.0), ShapeError, r"positions must have shape \(N, d\)"),
        (lambda: near(np.zeros((0, 2)), 1.0), ShapeError, "N >= 1"),
        (lambda: near([[0.0]], 0.0), ArgumentError, "radius must be positive"),
        (lambda: near([[0.0]], np.nan), ArgumentError, "radius must be positive"),
        (lambda: near([[np.nan]], 1.0), ArgumentError, "positions must be finite"),
        (lambda: near([[0.0]], 1.0, anchors=[1]), ArgumentError, "anchors"),
        (lambda: near([[0.0]], 1.0, anchor_positions=[[0.0, 1.0]]), ShapeError, r"shape \(A, 1\) like positions"),
    ],
)
def test_every_refusal_says_what_is_wrong(call, kind, words) -> None:
    with pytest.raises(kind, match=words):
        call()
