"""networkx in and out: nodes, arcs and weights survive the round trip, and the environment is the empty name."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain
from trigpoint.testing.strategies import measurement_graphs


def arcs_of(graph: MeasurementGraph) -> list[tuple[str, list[float]]]:
    return sorted((graph.arc_label(k), np.ravel(graph.arc_weights[k]).tolist()) for k in range(graph.n_arcs))


@settings(max_examples=60)
@given(st.one_of(measurement_graphs(), measurement_graphs(weighted=True), measurement_graphs(blocks=2)))
def test_round_trip_keeps_nodes_arcs_and_weights(graph) -> None:
    back = MeasurementGraph.from_networkx(graph.to_networkx())
    assert back.names == graph.names
    assert arcs_of(back) == arcs_of(graph) or not graph.n_arcs
    L = graph.laplacian().toarray()
    if graph.n_arcs:
        np.testing.assert_allclose(back.laplacian().toarray(), L, rtol=1e-13, atol=1e-13 * np.abs(L).max())


def test_undirected_graphs_and_the_environment_as_a_node() -> None:
    source = nx.Graph([("a", "b"), ("b", ""), ("", "c")])
    graph = MeasurementGraph.from_networkx(source)
    assert graph.names == ("a", "b", "c")
    assert arcs_of(graph) == [("a -> b", [1.0]), ("environment -> b", [1.0]), ("environment -> c", [1.0])]


def test_an_arc_into_the_environment_is_an_external_arc_of_its_start() -> None:
    graph = MeasurementGraph.from_networkx(nx.DiGraph([("a", "")]))
    assert graph.tail.tolist() == [EXTERNAL]
    assert graph.head.tolist() == [0]


def test_order_parallel_edges_anchors_and_weights() -> None:
    source = nx.MultiDiGraph()
    source.add_nodes_from([3, 1])
    source.add_edge(1, 3, weight=2.0)
    source.add_edge(1, 3)
    graph = MeasurementGraph.from_networkx(source, anchors=[1, 1])
    assert graph.names == ("3", "1")
    assert arcs_of(graph) == [
        ("1 -> 3", [1.0]), ("1 -> 3", [2.0]), ("environment -> 1", [1.0]), ("environment -> 1", [1.0])
    ]  # fmt: skip
    lengths = nx.DiGraph()
    lengths.add_edge(0, 1, length=4.0)
    assert MeasurementGraph.from_networkx(lengths, weight="length").arc_weights.tolist() == [4.0]
    assert MeasurementGraph.from_networkx(lengths).weight is None


@pytest.mark.parametrize(
    ("source", "anchors", "words"),
    [
        (nx.Graph(), (), "has no node"),
        (nx.Graph([("", "")]), (), "has no node"),
        (nx.Graph([("a", "b"), ("", "")]), (), "the environment .* has a self-loop"),
        (nx.Graph([("a", "a")]), (), "self-loop on node 'a'"),
        (nx.path_graph(3), (7,), r"anchor 7 is not a node of the graph; the first nodes are \[0, 1, 2\]"),
        (nx.Graph([(1, "1")]), (), "names must differ; '1' stands twice"),
    ],
)
def test_every_refusal_says_what_is_wrong(source, anchors, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        MeasurementGraph.from_networkx(source, anchors)


def test_numbers_and_blocks_do_not_mix() -> None:
    source = nx.DiGraph()
    source.add_edge("a", "b", weight=[[2.0, 0.0], [0.0, 1.0]])
    assert MeasurementGraph.from_networkx(source).dimension == 2
    with pytest.raises(ArgumentError, match="a number on every edge, or a d x d block on every edge"):
        MeasurementGraph.from_networkx(source, anchors=["a"])


def test_weights_that_are_text_are_refused() -> None:
    source = nx.DiGraph()
    source.add_edge("a", "b", weight="heavy")
    with pytest.raises(ArgumentError, match="weight must be an array of real numbers"):
        MeasurementGraph.from_networkx(source)


def test_a_node_with_the_empty_name_cannot_be_written() -> None:
    with pytest.raises(ArgumentError, match="empty name"):
        MeasurementGraph(2, [0], [1], names=["", "b"]).to_networkx()


def test_keys_are_arc_numbers() -> None:
    edges = chain(3).to_networkx().edges(keys=True)
    assert sorted(edges) == [("", "0", 2), ("0", "1", 0), ("1", "2", 1)]
