"""Recommendations against brute force and published values."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis import placement, search, smallest_eigenvalue
from trigpoint.analysis.recommend import Recommendation, recommend_anchors, recommend_arcs
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, complete, cycle, grid
from trigpoint.linalg import rank_one
from trigpoint.testing.strategies import measurement_graphs

from . import oracle

OBJECTIVES = ["lambda_min", "total_variance"]


def value(graph: MeasurementGraph, objective: str) -> float:
    return max(oracle.eigenvalue(graph), 0.0) if objective == "lambda_min" else oracle.variance(graph)


def check(graph: MeasurementGraph, found: Recommendation) -> None:
    """What is said of each step is true of the graph with these additions."""
    assert found.before == pytest.approx(value(graph, found.objective), rel=1e-6, abs=1e-9)
    assert found.graph.n_arcs == graph.n_arcs + len(found.arcs)
    for k in range(len(found.arcs)):
        now = oracle.added(graph, list(found.arcs[: k + 1]), found.graph.arc_weights[graph.n_arcs :][: k + 1].tolist())
        assert found.values[k] == pytest.approx(value(now, found.objective), rel=1e-6, abs=1e-9)
        assert found.eigenvalues[k] == pytest.approx(max(oracle.eigenvalue(now), 0.0), rel=1e-6, abs=1e-9)
        assert found.eigenvalues[k] <= found.ceilings[k] * (1 + 1e-9)
        assert found.gain_bounds[k] >= (1 - 1e-12) / max(found.eigenvalues[k], 1e-300)
    assert found.summary()


def best_next(graph: MeasurementGraph, arcs: list[tuple[int, int]], objective: str) -> float:
    values = [value(oracle.added(graph, [arc], [1.0]), objective) for arc in arcs]
    return max(values) if objective == "lambda_min" else min(values)


@pytest.mark.parametrize("objective", OBJECTIVES)
@settings(max_examples=20)
@given(graph=measurement_graphs(max_nodes=6, weighted=True, decades=1), count=st.integers(1, 4))
def test_every_greedy_step_is_the_best_next_one(objective, graph, count) -> None:
    candidates = list(range(graph.n_nodes))
    found = recommend_anchors(graph, count, objective, candidates)
    check(graph, found)
    now, left = graph, set(candidates)
    for k, node in enumerate(found.nodes):
        if now.is_externally_connected and (objective == "total_variance" or now.is_internally_connected):
            best = best_next(now, [(EXTERNAL, i) for i in sorted(left)], objective)
            assert found.values[k] == pytest.approx(best, rel=1e-6, abs=1e-12)
        now = oracle.added(now, [(EXTERNAL, node)], [1.0])
        left.remove(node)


@pytest.mark.parametrize("objective", OBJECTIVES)
@settings(max_examples=15)
@given(graph=measurement_graphs(max_nodes=6), count=st.integers(1, 3))
def test_the_first_anchors_go_one_to_a_component_and_are_the_best(objective, graph, count) -> None:
    count = min(count, graph.n_nodes - graph.anchored_nodes.shape[0])
    if not count:
        return
    found = recommend_anchors(graph, count, objective)
    floating = [nodes for nodes, held in zip(graph.components, graph.component_is_anchored, strict=True) if not held]
    labels = graph.component_labels[list(found.nodes[: len(floating)])]
    assert len(set(labels.tolist())) == len(labels)
    sizes = [int((graph.component_labels == label).sum()) for label in labels]
    assert sizes[: len(floating)] == sorted((len(nodes) for nodes in floating), reverse=True)[:count]
    for node, label in zip(found.nodes, labels.tolist(), strict=False):
        part = graph.subgraph(graph.components[label])
        best = best_next(part, [(EXTERNAL, i) for i in range(part.n_nodes)], objective)
        here = oracle.added(part, [(EXTERNAL, int(np.searchsorted(graph.components[label], node)))], [1.0])
        assert value(here, objective) == pytest.approx(best, rel=1e-6)


@pytest.mark.parametrize("objective", OBJECTIVES)
@settings(max_examples=20)
@given(graph=measurement_graphs(max_nodes=5), count=st.integers(1, 3))
def test_exhaustive_search_against_brute_force(objective, graph, count) -> None:
    count = min(count, graph.n_nodes)
    found = recommend_anchors(graph, count, objective, np.arange(graph.n_nodes), exact=True)
    check(graph, found)
    best = oracle.best_value(graph, [(EXTERNAL, i) for i in range(graph.n_nodes)], count, objective)
    assert found.values[-1] == pytest.approx(best, rel=1e-6, abs=1e-9)
    assert "exhaustive" in found.guarantee or "still have no anchor" in found.guarantee


@settings(max_examples=15)
@given(graph=measurement_graphs(min_nodes=3, max_nodes=6, externally_connected=True), count=st.integers(1, 3))
def test_the_variance_guarantee_holds(graph, count) -> None:
    nodes = np.arange(graph.n_nodes)
    greedy = recommend_anchors(graph, count, "total_variance", nodes)
    best = oracle.best_value(graph, [(EXTERNAL, i) for i in range(graph.n_nodes)], count, "total_variance")
    assert greedy.before - greedy.values[-1] >= (1 - 1 / np.e) * (greedy.before - best) * (1 - 1e-9)
    assert "63 %" in greedy.guarantee


@pytest.mark.parametrize("objective", OBJECTIVES)
@settings(max_examples=15)
@given(graph=measurement_graphs(min_nodes=2, max_nodes=6), count=st.integers(1, 3))
def test_arcs_of_any_kind(objective, graph, count) -> None:
    pairs = [*itertools.combinations(range(graph.n_nodes), 2), (EXTERNAL, graph.n_nodes - 1)]
    found = recommend_arcs(graph, count, pairs, objective)
    check(graph, found)
    assert len(set(found.arcs)) == len(found.arcs)
    if graph.is_externally_connected and (objective == "total_variance" or graph.is_internally_connected):
        assert found.values[0] == pytest.approx(best_next(graph, pairs, objective), rel=1e-6)


def test_theory_7_h1_on_the_grid_of_thirty() -> None:
    """Published to three digits: optimum, greedy on J, greedy on lambda_min, and the worst placement."""
    graph = grid(5, 6, anchors=())
    by_value, by_variance = recommend_anchors(graph, 3), recommend_anchors(graph, 3, "total_variance")
    assert by_value.values == pytest.approx([0.0250, 0.0500, 0.0755], abs=5e-5)
    assert by_variance.eigenvalues == pytest.approx([0.0250, 0.0500, 0.0745], abs=5e-5)
    assert by_value.ceilings == pytest.approx([1 / 30, 2 / 30, 3 / 30])
    optimum = [recommend_anchors(graph, k, exact=True).values[-1] for k in (1, 2, 3)]
    assert optimum == pytest.approx([0.0250, 0.0519, 0.0788], abs=5e-5)
    for k, least in ((1, 0.0171), (2, 0.0290)):
        values = [
            oracle.eigenvalue(oracle.added(graph, [(EXTERNAL, i) for i in nodes], [1.0] * k))
            for nodes in itertools.combinations(range(30), k)
        ]
        assert min(values) == pytest.approx(least, abs=5e-5)
    assert by_value.nodes[0] in (14, 15)


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("anchors", [(), (0, 3)])
def test_large_network_methods_choose_like_the_small_ones(monkeypatch, objective, anchors) -> None:
    graph = grid(8, 9, anchors=anchors)
    small = recommend_anchors(graph, 4, objective)
    for module in (rank_one, placement, search):
        monkeypatch.setattr(module, "COMPLETE_LIMIT", 10)
    monkeypatch.setattr(placement, "_SHORTLIST", 30)
    large = recommend_anchors(graph, 4, objective)
    assert large.values == pytest.approx(small.values, rel=1e-6)


def test_costs_and_budget() -> None:
    graph = chain(5, anchors=(0,))
    plain = recommend_anchors(graph, 1, "total_variance")
    dear = np.where(np.arange(1, 5) == plain.nodes[0], 100.0, 1.0)
    assert recommend_anchors(graph, 1, "total_variance", costs=dear).nodes != plain.nodes
    assert "benefit per cost" in recommend_anchors(graph, 1, "total_variance", costs=dear).guarantee
    assert plain.nodes[0] not in recommend_anchors(graph, 4, costs=dear, budget=50.0).nodes
    assert len(recommend_anchors(graph, 4, budget=2.0).nodes) == 2
    exact = recommend_anchors(graph, 4, costs=dear, budget=2.0, exact=True)
    assert len(exact.nodes) == 2
    assert plain.nodes[0] not in exact.nodes
    floating = recommend_anchors(chain(3, anchors=()), 1, "total_variance", costs=[1.0, 50.0, 1.0])
    assert floating.nodes == (0,)


def test_weighted_arcs_and_repeated_anchors() -> None:
    graph = chain(3, anchors=(2,))
    strong = recommend_arcs(graph, 1, [(EXTERNAL, 2), (EXTERNAL, 2, 10.0)], "total_variance")
    assert strong.graph.arc_weights[-1] == 10.0
    assert "63 %" in strong.guarantee
    assert recommend_anchors(graph, 1, candidates=[2]).nodes == (2,)
    inner = recommend_arcs(graph, 1, [(0, 2)], "total_variance")
    assert "not supermodular" in inner.guarantee
    assert inner.nodes == ()


def test_when_nothing_can_be_attached() -> None:
    islands = MeasurementGraph(4, [0, EXTERNAL], [1, 3])
    for objective in OBJECTIVES:
        found = recommend_arcs(islands, 2, [(0, 1)], objective)
        assert found.arcs == ()
        assert "2 components still have no anchor" in found.guarantee
    joined = recommend_arcs(islands, 2, [(0, 2), (2, 3)], "total_variance")
    assert np.isinf(joined.values[0]) != np.isinf(joined.before) or np.isfinite(joined.values[-1])


def test_candidates_away_from_the_deciding_component() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, 0, EXTERNAL], [0, 1, 2])
    found = recommend_anchors(graph, 1, candidates=[2])
    assert found.nodes == (2,)
    assert found.values[0] == pytest.approx(smallest_eigenvalue(graph).value)


def test_nothing_is_changed_and_nothing_is_random() -> None:
    graph = cycle(7, anchors=(6,))
    weight = graph.arc_weights.copy()
    first, second = (recommend_anchors(graph, 3) for _ in range(2))
    assert first.nodes == second.nodes
    assert np.array_equal(weight, graph.arc_weights)
    assert graph.n_arcs == 8


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"count": 0}, "count must be a whole number of at least 1; got 0"),
        ({"count": True}, "count must be a whole number"),
        ({"objective": "best"}, "objective must be one of lambda_min, total_variance; got 'best'"),
        ({"candidates": []}, "candidates must hold at least one choice"),
        ({"candidates": [9]}, "no index"),
        ({"costs": [1.0]}, "costs must hold one number a candidate"),
        ({"costs": [1.0, 0.0, 1.0]}, "costs must be positive; got 0.0"),
        ({"budget": 0.5}, "budget 0.5 buys none of the candidates"),
        ({"budget": float("nan")}, "budget nan buys none"),
    ],
)
def test_refusals(arguments, message) -> None:
    with pytest.raises(ArgumentError, match=message):
        recommend_anchors(chain(4), **{"count": 1, **arguments})


def test_more_refusals() -> None:
    with pytest.raises(ArgumentError, match="2 x 2 blocks"):
        recommend_anchors(chain(2).with_weight(np.repeat(np.eye(2)[None], 2, axis=0)), 1)
    with pytest.raises(ArgumentError, match="exact search would try 184756 sets on 30 nodes"):
        recommend_anchors(complete(30), 10, candidates=np.arange(20), exact=True)
    with pytest.raises(ShapeError, match="must be \\(tail, head\\)"):
        recommend_arcs(chain(3), 1, [(0,)])
    with pytest.raises(ArgumentError, match=r"candidates\[1\] = \(1, 1\) must join two nodes"):
        recommend_arcs(chain(3), 1, [(0, 1), (1, 1)])
    with pytest.raises(ArgumentError, match="positive weight"):
        recommend_arcs(chain(3), 1, [(0, 1, -1.0)])


@pytest.mark.slow
def test_three_anchors_of_thirty_at_their_worst() -> None:
    graph = grid(5, 6, anchors=())
    values = [
        oracle.eigenvalue(oracle.added(graph, [(EXTERNAL, i) for i in nodes], [1.0] * 3))
        for nodes in itertools.combinations(range(30), 3)
    ]
    assert min(values) == pytest.approx(0.0384, abs=5e-5)
    assert max(values) == pytest.approx(0.0788, abs=5e-5)
