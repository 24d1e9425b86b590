"""Automorphisms: they commute with the Laplacian, and both engines find the same orbits."""

from __future__ import annotations

import importlib
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis import symmetry
from trigpoint.analysis.symmetry import Symmetry, find_symmetry, refine_colours
from trigpoint.analysis.zero_forcing import simple_adjacency
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, complete, cycle, grid, star
from trigpoint.model.agreement import AgreementDynamics
from trigpoint.testing.strategies import measurement_graphs


@pytest.fixture
def without_igraph(monkeypatch) -> None:
    real = importlib.import_module

    def refuse(name, *arguments):
        if name == "igraph":
            raise ImportError(name)
        return real(name, *arguments)

    monkeypatch.setattr(symmetry.importlib, "import_module", refuse)


def exhaustive_orbits(graph, fixed) -> set[tuple[int, ...]]:
    L = AgreementDynamics(graph, [0]).laplacian().toarray()
    images = [set() for _ in range(graph.n_nodes)]
    for image in itertools.permutations(range(graph.n_nodes)):
        p = np.array(image)
        if all(p[k] == k for k in fixed) and np.array_equal(L[np.ix_(p, p)], L):
            for node in range(graph.n_nodes):
                images[node].add(image[node])
    return {tuple(sorted(orbit)) for orbit in images if len(orbit) > 1}


def check(graph, fixed) -> None:
    found = find_symmetry(graph, fixed)
    expected = exhaustive_orbits(graph, fixed)
    assert set(found.orbits if found else ()) == expected
    if found:
        p = np.array(found.generator)
        L = AgreementDynamics(graph, [0]).laplacian().toarray()
        np.testing.assert_array_equal(L[np.ix_(p, p)], L)
        assert (p[list(fixed)] == list(fixed)).all()
        assert (p != np.arange(graph.n_nodes)).any()


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=5), st.data())
def test_orbits_agree_with_all_permutations(graph, data) -> None:
    check(graph, data.draw(st.lists(st.integers(0, graph.n_nodes - 1), max_size=2, unique=True)))


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=5), st.data())
def test_orbits_of_weighted_networks(graph, data) -> None:
    weights = data.draw(st.lists(st.sampled_from([1.0, 2.0]), min_size=graph.n_arcs, max_size=graph.n_arcs))
    check(graph.with_weight(weights), data.draw(st.lists(st.integers(0, graph.n_nodes - 1), max_size=2, unique=True)))


@pytest.mark.usefixtures("without_igraph")
def test_the_fallback_finds_the_same_orbits() -> None:
    rng = np.random.default_rng(3)
    for _ in range(60):
        n = int(rng.integers(2, 6))
        tail, head = rng.integers(n, size=(2, int(rng.integers(1, 9))))
        keep = tail != head
        graph = MeasurementGraph(n, tail[keep], head[keep], rng.integers(1, 3, size=int(keep.sum())))
        check(graph, [int(rng.integers(n))] if n > 2 else [])


@pytest.mark.usefixtures("without_igraph")
def test_the_fallback_on_two_hundred_nodes_and_the_refusal_above() -> None:
    found = find_symmetry(cycle(100), [0])
    assert found is not None
    assert found.is_mirror
    assert found.generator[0] == 0
    with pytest.raises(MissingExtraError, match=r"more than 200 nodes .*trigpoint\[symmetry\]"):
        find_symmetry(cycle(301), [0])
    assert find_symmetry(chain(301), [0]) is None  # the colour refinement alone decides


def test_the_mirror_of_a_chain() -> None:
    found = find_symmetry(chain(7), [3])
    assert found == Symmetry(((0, 6), (1, 5), (2, 4)), (6, 5, 4, 3, 2, 1, 0))
    assert found.is_mirror
    assert found.cycles == ((0, 6), (1, 5), (2, 4))
    assert find_symmetry(chain(7), [2]) is None
    assert find_symmetry(chain(7, anchors=(0, 0))) is not None  # external arcs play no part


def test_orbits_of_known_graphs() -> None:
    assert find_symmetry(star(5), [0]).orbits == ((1, 2, 3, 4),)
    assert find_symmetry(complete(4), [1]).orbits == ((0, 2, 3),)
    assert find_symmetry(grid(3, 3), [0]).orbits == ((1, 3), (2, 6), (5, 7))
    assert find_symmetry(MeasurementGraph(1, [], [])) is None


def test_a_symmetry_that_is_no_mirror_names_its_cycles() -> None:
    turning = Symmetry(((0, 1, 2),), (1, 2, 0, 3))
    assert not turning.is_mirror
    assert turning.cycles == ((0, 1, 2),)


def test_weights_break_a_symmetry_and_parallel_arcs_add_up() -> None:
    tail, head = [0, 1, EXTERNAL], [1, 2, 2]
    assert find_symmetry(MeasurementGraph(3, tail, head, [1.0, 2.0, 1.0]), [1]) is None
    assert find_symmetry(MeasurementGraph(3, [0, 1, 2], [1, 2, 1], [1.0, 0.5, 0.5]), [1]).is_mirror
    shuffled = MeasurementGraph(3, [0, 0, 1, 2, 1, 1], [1, 1, 0, 1, 2, 2], [0.1, 0.2, 0.3, 0.3, 0.1, 0.2])
    assert find_symmetry(shuffled, [1]).is_mirror  # equal bundles in another order


def test_refinement_separates_by_distance() -> None:
    colours = refine_colours(simple_adjacency(chain(6)), [1, 0, 0, 0, 0, 0])
    assert np.unique(colours).size == 6
    assert np.unique(refine_colours(simple_adjacency(cycle(6)), [0] * 6)).size == 1
    assert np.unique(refine_colours(simple_adjacency(cycle(6)), [1, 0, 0, 0, 0, 0])).size == 4


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(ArgumentError, match=r"fixed\[0\] = 9 is no index"):
        find_symmetry(chain(3), [9])
    blocks = MeasurementGraph(2, [0], [1], [np.eye(2)])
    with pytest.raises(ArgumentError, match="symmetries need scalar arc weights; got 2 x 2 blocks"):
        find_symmetry(blocks)
