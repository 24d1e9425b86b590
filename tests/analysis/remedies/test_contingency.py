"""The N - 1 study against plain recomputation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from tests.machine import effort
from trigpoint.analysis import smallest_eigenvalue
from trigpoint.analysis.contingency import without_each
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph, chain, grid
from trigpoint.linalg import rank_one
from trigpoint.testing.strategies import measurement_graphs

from . import oracle


def deviations(graph: MeasurementGraph) -> np.ndarray:
    return np.sqrt(np.diag(np.linalg.inv(graph.laplacian().toarray())))


@settings(max_examples=25)
@given(measurement_graphs(max_nodes=8, weighted=True, decades=1, externally_connected=True))
def test_against_recomputation(graph) -> None:
    study = without_each(graph, confirm=1)
    assert sorted(study.arcs.tolist()) == list(range(graph.n_arcs))
    for position, arc in enumerate(study.arcs.tolist()):
        rest = oracle.without(graph, arc)
        lost = oracle.unanchored(rest)
        assert study.floating[position] == len(lost)
        assert study.eigenvalue[position] == pytest.approx(max(oracle.eigenvalue(rest), 0.0), rel=1e-6, abs=1e-9)
        assert study.lower[position] <= study.eigenvalue[position] * (1 + 1e-12)
        assert (study.verdict(position) == "observable") == (not lost)
        if lost:
            assert study.gain_bound[position] == study.deviation_increase[position] == np.inf
            assert study.deviation_node[position] in lost
        else:
            growth = deviations(rest) - deviations(graph)
            assert study.deviation_increase[position] == pytest.approx(growth.max(), rel=1e-6, abs=1e-9)
            assert growth[study.deviation_node[position]] == pytest.approx(growth.max(), rel=1e-6, abs=1e-9)
    assert (np.diff(study.floating) <= 0).all()
    ranked = study.eigenvalue[study.floating == 0]
    assert (np.diff(ranked) >= -1e-8 * ranked[1:]).all()  # equal losses differ by rounding: grouped by nine digits
    assert study.change.max() <= 1e-9
    assert study.confirmed.sum() == (study.floating > 0).sum() + min(1, int((study.floating == 0).sum()))


@pytest.mark.parametrize("anchors", [(0,), (0, 143), tuple(range(0, 144, 2))])
def test_with_some_eigenpairs_only(monkeypatch, anchors) -> None:
    graph = grid(12, 12, anchors=anchors)
    exact = without_each(graph, confirm=0)
    monkeypatch.setattr(rank_one, "COMPLETE_LIMIT", 10)
    study = without_each(graph, confirm=0)
    order, reference = np.argsort(study.arcs), np.argsort(exact.arcs)
    value, truth = study.eigenvalue[order], exact.eigenvalue[reference]
    assert (value >= truth * (1 - 1e-8)).all()  # a Ritz value is never too small
    assert (study.lower[order] <= truth * (1 + 1e-8)).all()
    assert value == pytest.approx(truth, rel=0.05)
    if len(anchors) < 3:
        assert value == pytest.approx(truth, rel=1e-4)


def test_the_worst_ones_are_confirmed_with_rigorous_bounds() -> None:
    graph = grid(5, 5, anchors=(0, 24))
    study = without_each(graph, confirm=4)
    assert study.confirmed[:4].all()
    assert study.confirmed.sum() == 4
    bound = smallest_eigenvalue(graph.without_arcs([int(study.arcs[0])]))
    assert study.gain_bound[0] == 1.0 / bound.lower
    assert study.arcs[0] in np.flatnonzero(graph.is_external)
    assert study.summary(2).count("\n") == 2
    assert "observable" in study.summary()


def test_floating_nodes_are_named() -> None:
    study = without_each(chain(3, anchors=(0,)))
    assert study.verdict(0) == "nodes 0, 1, 2 float"
    assert study.floating.tolist() == [3, 2, 1]
    assert "gain bound inf" in study.summary()


def test_without_arcs_keeps_the_rest() -> None:
    graph = grid(2, 3, anchors=(5,)).with_weight(np.arange(1.0, 9.0))
    rest = graph.without_arcs([1, 7])
    assert rest.weight is not None
    assert rest.weight.tolist() == [1, 3, 4, 5, 6, 7]
    assert rest.names == graph.names
    assert graph.without_arcs([]).n_arcs == 8
    assert chain(2).without_arcs([0]).weight is None


def test_refusals() -> None:
    graph = chain(3)
    with pytest.raises(ArgumentError, match=r"arcs\[1\] = 3 is no index"):
        graph.without_arcs([0, 3])
    with pytest.raises(ArgumentError, match=r"arcs\[0\] = -1 is no index"):
        graph.without_arcs([-1])
    with pytest.raises(ArgumentError, match="one-dimensional"):
        graph.without_arcs([[0]])
    with pytest.raises(ArgumentError, match="confirm must be a whole number"):
        without_each(graph, confirm=-1)
    with pytest.raises(ArgumentError, match="2 x 2 blocks"):
        without_each(graph.with_weight(np.repeat(np.eye(2)[None], 3, axis=0)))
    with pytest.raises(ArgumentError, match="nodes 0, 1, 2 have none"):
        without_each(chain(3, anchors=()))


@pytest.mark.slow
def test_some_thousands_of_arcs_take_seconds() -> None:
    with effort() as spent:
        study = without_each(grid(45, 45, anchors=(0, 2024)))
    assert study.arcs.shape[0] == 3962
    assert spent.units < 3000.0
