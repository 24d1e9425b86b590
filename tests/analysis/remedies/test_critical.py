"""Critical arcs and anchors against plain removal."""

from __future__ import annotations

import pytest
from hypothesis import given, settings

from trigpoint.analysis.critical import critical
from trigpoint.errors import ArgumentError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, grid
from trigpoint.testing.strategies import measurement_graphs

from . import oracle


@settings(max_examples=50)
@given(measurement_graphs(max_nodes=9, max_extra_arcs=10))
def test_against_removal(graph) -> None:
    found = critical(graph)
    before = oracle.unanchored(graph)
    assert set(found.floating.tolist()) == before
    arcs, anchors = {}, {}
    for k in range(graph.n_arcs):
        lost = oracle.unanchored(oracle.without(graph, k)) - before
        assert set(found.lost_without(k).tolist()) == lost
        if lost:
            (anchors if graph.is_external[k] else arcs)[k] = len(lost)
    assert dict(zip(found.arcs.tolist(), found.arc_losses.tolist(), strict=True)) == arcs
    assert dict(zip(found.anchors.tolist(), found.anchor_losses.tolist(), strict=True)) == anchors
    assert set(found.redundant.tolist()) == set(range(graph.n_arcs)) - set(oracle.bridges(graph))
    assert list(found.arc_losses) == sorted(found.arc_losses, reverse=True)
    assert found.is_robust == (not arcs and not anchors and not before)
    held_once = [
        k
        for k, nodes in enumerate(graph.components)
        if sum(graph.is_external & (graph.component_labels[graph.head] == k)) == 1
    ]
    assert found.single_anchor.tolist() == held_once
    assert found.summary()


def test_the_summary_names_nodes_and_losses() -> None:
    graph = MeasurementGraph(4, [EXTERNAL, 0, 0], [1, 1, 2], names=["a", "b", "c", "d"])
    text = critical(graph).summary()
    assert "node d float already" in text
    assert "anchor environment -> b is critical: without it 3 float (nodes a, b, c)" in text
    assert "arc a -> c is critical: without it 1 float (node c)" in text
    assert "may be lost" in critical(grid(2, 2, anchors=(0, 3))).summary()
    assert "and 10 critical arcs more" in critical(chain(21)).summary()


@pytest.mark.parametrize("arc", [-1, 5])
def test_no_such_arc(arc) -> None:
    with pytest.raises(ArgumentError, match="does not exist; expected 0 <= arc < 5"):
        critical(chain(5)).lost_without(arc)
