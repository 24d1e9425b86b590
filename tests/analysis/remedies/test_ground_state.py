"""One factorization for eigenpair and bounds: as tight as the bounds of ``smallest_eigenvalue``, never wrong."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.sparse.linalg import ArpackNoConvergence
from scipy.spatial import Delaunay

from tests.analysis.exact import DIGITS, exact_smallest_eigenvalue, resolution
from trigpoint.analysis import smallest_eigenvalue, worst_case_eigenvalue
from trigpoint.analysis.eigenvalue import couplings
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, complete, grid, star, within_radius
from trigpoint.linalg import ground_state as module
from trigpoint.linalg.ground_state import GroundState, ground_state
from trigpoint.testing.strategies import measurement_graphs


def found(graph: MeasurementGraph) -> GroundState:
    return ground_state(couplings(graph), graph.laplacian())


def width(state: GroundState) -> float:
    return (state.upper - state.lower) / state.value


def anchored(graph: MeasurementGraph, share: float) -> MeasurementGraph:
    nodes = np.random.default_rng(3).choice(graph.n_nodes, round(share * graph.n_nodes), replace=False)
    tail = np.concatenate([graph.tail, np.full(nodes.shape[0], EXTERNAL)])
    return MeasurementGraph(graph.n_nodes, tail, np.concatenate([graph.head, nodes]))


def planar(count: int) -> MeasurementGraph:
    corners = Delaunay(np.random.default_rng(2).random((count, 2))).simplices
    pairs = np.unique(np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]])), axis=0)
    return MeasurementGraph(count, np.append(pairs[:, 0], EXTERNAL), np.append(pairs[:, 1], count - 1))


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=7, weighted=True, decades=3, externally_connected=True))
def test_the_exact_value_lies_between_the_bounds(graph) -> None:
    state = found(graph)
    exact, slack = exact_smallest_eigenvalue(graph), resolution(graph)
    with mpmath.workdps(DIGITS):
        assert state.lower <= exact + slack
        assert state.upper >= exact - slack
    assert 0.0 < state.lower <= state.value <= state.upper
    assert (state.positive > 0).all()
    assert np.linalg.norm(state.vector) == pytest.approx(1.0)


NETWORKS = {
    "grid": lambda: grid(70, 128),
    "planar": lambda: planar(4000),
    "chain": lambda: chain(2000),
    "long chain": lambda: chain(20_000),
    "star": lambda: star(700),
    "complete": lambda: complete(60, anchors=(59,)),
    "half of a chain": lambda: chain(200, anchors=tuple(range(100, 200))),
    "half of a long chain": lambda: chain(3000, anchors=tuple(range(1500, 3000))),
    "grid, 1 % anchored": lambda: anchored(grid(60, 60, anchors=()), 0.01).subgraph(np.arange(3600)),
    "grid, 50 % anchored": lambda: anchored(grid(60, 60, anchors=()), 0.5),
    "planar, 1 % anchored": lambda: anchored(planar(4000), 0.01),
    "disc, 1 % anchored": lambda: disc(),
    "two equal parts": lambda: MeasurementGraph(4, [EXTERNAL, 0, EXTERNAL, 2], [0, 1, 2, 3]),
}


def disc() -> MeasurementGraph:
    rng = np.random.default_rng(0)
    graph = within_radius(rng.random((4000, 2)), 0.03, anchors=rng.choice(4000, 40, replace=False))
    return graph.subgraph(np.flatnonzero(graph.component_is_anchored[graph.component_labels]))


@pytest.mark.parametrize("name", NETWORKS)
def test_as_tight_as_two_factorizations(name) -> None:
    graph = NETWORKS[name]()
    state, bound = found(graph), smallest_eigenvalue(graph)
    assert state.value == pytest.approx(bound.value, rel=1e-9)
    assert width(state) <= max(1.5 * bound.relative_width, 1e-9)
    assert state.lower <= bound.upper
    assert bound.lower <= state.upper
    L = graph.laplacian()
    assert np.linalg.norm(L @ state.vector - state.value * state.vector) < 1e-9 * abs(L).max()


def test_few_anchors_need_few_solves() -> None:
    assert found(grid(50, 50)).solves <= 14
    assert found(chain(500)).value == pytest.approx(worst_case_eigenvalue(500), rel=1e-9)


def test_without_convergence_there_is_a_looser_bound(monkeypatch) -> None:
    graph = anchored(grid(30, 30, anchors=()), 0.5)

    def gives_up(*_: object, **__: object) -> None:
        raise ArpackNoConvergence("no convergence", np.zeros(0), np.zeros((900, 0)))

    monkeypatch.setattr(module, "eigsh", gives_up)
    state, bound = found(graph), smallest_eigenvalue(graph)
    assert 0.0 <= state.lower <= bound.upper
    assert state.upper >= bound.lower


@pytest.mark.slow
def test_a_hundred_thousand_nodes() -> None:
    state = found(grid(316, 316))
    assert width(state) < 1e-8
    assert state.solves <= 14
