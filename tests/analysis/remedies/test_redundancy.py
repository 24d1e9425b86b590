"""Redundancy numbers against the dense formula."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from hypothesis import given, settings

from trigpoint.analysis.redundancy import redundancy
from trigpoint.graphs import MeasurementGraph, chain, cycle, grid
from trigpoint.graphs.bridges import bridges
from trigpoint.testing.strategies import measurement_graphs

from . import oracle


def check(graph: MeasurementGraph) -> None:
    numbers = redundancy(graph)
    assert numbers.shape == (graph.n_arcs,)
    assert numbers == pytest.approx(oracle.redundancy(graph), abs=1e-8)
    floating = int((~graph.component_is_anchored).sum())
    assert numbers.sum() == pytest.approx(graph.n_arcs - graph.n_nodes + floating, abs=1e-7)
    assert (numbers[bridges(graph)] == 0.0).all()
    assert ((numbers >= 0.0) & (numbers <= 1.0)).all()


@settings(max_examples=30)
@given(measurement_graphs(max_nodes=8, weighted=True, decades=1))
def test_scalar_weights(graph) -> None:
    check(graph)


@settings(max_examples=20)
@given(measurement_graphs(max_nodes=5, blocks=2, decades=1))
def test_blocks(graph) -> None:
    check(graph)


def test_a_ring_shares_one_surplus_measurement() -> None:
    assert redundancy(cycle(5)) == pytest.approx(np.full(5, 0.2))
    assert redundancy(chain(4, anchors=(3,))).tolist() == [0.0] * 4


def test_selected_inversion_gives_the_same(monkeypatch) -> None:
    graph = grid(12, 11, anchors=(5, 131)).with_weight(np.linspace(0.5, 2.0, 12 * 10 + 11 * 11 + 2))
    plain = redundancy(graph)
    module = importlib.import_module("trigpoint.linalg.selected_inverse")
    monkeypatch.setattr(module, "_BY_SOLVES", 0)
    assert redundancy(graph) == pytest.approx(plain, abs=1e-12)
    diagonal = np.repeat(np.eye(2)[None], graph.n_arcs, axis=0)
    assert redundancy(graph.with_weight(diagonal)) == pytest.approx(redundancy(graph.with_weight(None)), abs=1e-12)


def test_large_enough_for_selected_inversion() -> None:
    graph = grid(40, 40)
    assert redundancy(graph).sum() == pytest.approx(graph.n_arcs - graph.n_nodes, abs=1e-6)
