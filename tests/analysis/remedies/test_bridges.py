"""Bridges against networkx on drawn multigraphs, and at sizes where recursion would break."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from tests.machine import effort
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle, grid, star
from trigpoint.graphs.bridges import bridge_table, bridges
from trigpoint.testing.strategies import measurement_graphs

from . import oracle


@settings(max_examples=80)
@given(measurement_graphs(max_nodes=9, max_extra_arcs=12))
def test_drawn_multigraphs(graph) -> None:
    tail, head = graph.tail.copy(), graph.head.copy()
    assert bridges(graph).tolist() == oracle.bridges(graph)
    assert np.array_equal(tail, graph.tail)
    assert np.array_equal(head, graph.head)


@settings(max_examples=40)
@given(measurement_graphs(max_nodes=8, max_extra_arcs=6))
def test_what_lies_behind_a_bridge(graph) -> None:
    table = bridge_table(graph)
    assert sorted(table.order.tolist()) == list(range(graph.n_nodes))
    for position, arc in enumerate(table.arcs.tolist()):
        behind = table.behind(position)
        assert behind.shape[0] == table.count[position]
        rest = oracle.without(graph, arc)
        here = {int(label) for label in rest.component_labels[behind]}
        assert len(here) == 1
        assert not rest.component_is_anchored[here.pop()]


@pytest.mark.parametrize("seed", range(6))
def test_sparse_random_networks(seed) -> None:
    rng = np.random.default_rng(seed)
    n = 400
    tail, head = rng.integers(-1, n, 430 + 40 * seed), rng.integers(0, n, 430 + 40 * seed)
    keep = tail != head
    graph = MeasurementGraph(n, tail[keep], head[keep])
    assert bridges(graph).tolist() == oracle.bridges_by_networkx(graph)


def test_known_networks() -> None:
    assert bridges(chain(5, anchors=(4,))).tolist() == [0, 1, 2, 3, 4]
    assert bridges(chain(5, anchors=(0, 4))).tolist() == []
    assert bridges(cycle(4, anchors=(3,))).tolist() == [4]
    assert bridges(cycle(2)).tolist() == []
    assert bridges(star(4, anchors=())).tolist() == [0, 1, 2]
    assert bridges(MeasurementGraph(2, [EXTERNAL, EXTERNAL], [1, 1])).tolist() == []
    assert bridges(MeasurementGraph(1, [], [])).tolist() == []


def test_a_hundred_thousand_nodes_take_no_time() -> None:
    for graph, count in ((chain(100_000, anchors=(99_999,)), 100_000), (grid(300, 300), 1)):
        with effort() as spent:
            assert bridges(graph).shape[0] == count
        assert spent.units < 500.0


@pytest.mark.slow
def test_a_million_nodes() -> None:
    graph = grid(1000, 1000, anchors=(999_999,))
    with effort() as spent:
        assert bridges(graph).tolist() == [graph.n_arcs - 1]
        assert bridge_table(graph).count.tolist() == [1_000_000]
    assert spent.units < 2000.0
