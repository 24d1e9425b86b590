"""The graph type: connectivity, parts, the environment that is never an index, and every refusal."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle, star
from trigpoint.testing.strategies import measurement_graphs


def arcs_of(graph: MeasurementGraph) -> list[tuple[str, str, float]]:
    return sorted((*graph.arc_label(k).split(" -> "), float(graph.arc_weights[k])) for k in range(graph.n_arcs))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0, [], []), "n_nodes must be a whole number of at least 1; got 0"),
        ((2.0, [], []), "n_nodes must be a whole number"),
        ((True, [], []), "n_nodes must be a whole number"),
        ((2, [-2], [0]), r"tail\[0\] = -2 is no index"),
        ((2, [0], [2]), r"head\[0\] = 2 is no index"),
        ((2, [0], [EXTERNAL]), r"head\[0\] = -1 is no index"),
        ((2, [0, 1], [1]), "tail and head must have equal length; got 2 and 1"),
        ((2, [0, 1], [1, 1]), "arc 1 is a self-loop on node '1'.*external arc"),
        ((2, [0], [1], None, ["a"]), r"one name a node \(2\); got 1"),
        ((2, [0], [1], None, ["a", "a"]), "names must differ; 'a' stands twice"),
        ((2, [0], [1], [0.0]), r"weight\[0\] = 0.0 must be positive"),
        ((2, [0], [1], [-1.0]), "must be positive"),
        ((2, [0], [1], [np.nan]), "weight must be finite"),
        ((2, [0], [1], [1.0, 2.0]), r"weight must have shape \(1,\) or \(1, d, d\); got \(2,\)"),
        ((2, [0], [1], np.ones((1, 2, 3))), "weight must have shape"),
        ((2, [0], [1], np.ones((1, 0, 0))), "weight must have shape"),
        ((2, [0], [1], [[[1.0, 0.0], [0.0, -1.0]]]), "symmetric positive definite block"),
        ((2, [0], [1], [[[1.0, 0.5], [0.0, 1.0]]]), "symmetric positive definite block"),
    ],
)
def test_every_refusal_says_what_is_wrong(arguments, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        MeasurementGraph(*arguments)


def test_shapes_that_do_not_fit_are_shape_errors() -> None:
    with pytest.raises(ShapeError):
        MeasurementGraph(2, [0, 1], [1])


def test_inputs_are_copied_and_fields_are_read_only() -> None:
    tail = np.array([EXTERNAL, 0])
    graph = MeasurementGraph(2, tail, [0, 1])
    tail[0] = 1
    assert graph.tail.tolist() == [EXTERNAL, 0]
    for array in (graph.tail, graph.head, graph.is_external, graph.anchored_nodes, graph.component_labels):
        assert not array.flags.writeable


def test_names_and_labels() -> None:
    graph = MeasurementGraph(2, [EXTERNAL, 0], [1, 1], names=["left", "right"])
    assert [graph.arc_label(k) for k in range(2)] == ["environment -> right", "left -> right"]
    assert graph.index("right") == 1
    with pytest.raises(ArgumentError, match=r"no node is called 'up'; the first names are \['left', 'right'\]"):
        graph.index("up")
    assert repr(graph) == "MeasurementGraph(2 nodes, 1 internal and 1 external arcs)"


# -- the anchor on the last node: EXTERNAL = -1 must never act as an index ---------------------------------------------
def test_an_anchor_on_the_last_node_stays_there() -> None:
    graph = MeasurementGraph(3, [0, EXTERNAL], [1, 2])
    assert graph.anchored_nodes.tolist() == [2]
    assert [c.tolist() for c in graph.components] == [[0, 1], [2]]
    assert graph.component_is_anchored.tolist() == [False, True]
    assert np.array_equal(graph.laplacian().toarray(), [[1, -1, 0], [-1, 1, 0], [0, 0, 1]])


def test_an_anchor_does_not_tie_its_node_to_the_last_node() -> None:
    graph = MeasurementGraph(3, [EXTERNAL], [0])
    assert len(graph.components) == 3
    assert graph.neighbours(2).tolist() == []
    assert graph.neighbours(0).tolist() == []
    assert graph.laplacian().toarray()[2].tolist() == [0, 0, 0]


def test_subgraphs_keep_external_arcs_of_the_last_node_and_no_others() -> None:
    graph = MeasurementGraph(4, [0, 1, EXTERNAL, 2, EXTERNAL], [1, 2, 3, 3, 0], [1.0, 2.0, 3.0, 4.0, 5.0])
    last = graph.subgraph([3])
    assert arcs_of(last) == [("environment", "3", 3.0)]
    assert arcs_of(graph.subgraph([3, 0])) == [("environment", "0", 5.0), ("environment", "3", 3.0)]
    assert arcs_of(graph.subgraph([2, 1])) == [("1", "2", 2.0)]
    assert graph.subgraph([2, 1]).names == ("2", "1")


def test_at_tail_gives_the_environment_its_own_value() -> None:
    graph = MeasurementGraph(3, [EXTERNAL, 0, 2], [2, 1, 0])
    assert graph.at_tail(np.array([10.0, 20.0, 30.0]), -5.0).tolist() == [-5.0, 10.0, 30.0]
    assert graph.at_tail(np.arange(6.0).reshape(3, 2), 0.0).tolist() == [[0, 0], [0, 1], [4, 5]]


# -- structure ---------------------------------------------------------------------------------------------------------
@settings(max_examples=60)
@given(measurement_graphs(weighted=True))
def test_components_agree_with_networkx(graph) -> None:
    undirected = nx.Graph()
    undirected.add_nodes_from(range(graph.n_nodes))
    inner = ~graph.is_external
    undirected.add_edges_from(zip(graph.tail[inner].tolist(), graph.head[inner].tolist(), strict=True))
    expected = sorted(sorted(nodes) for nodes in nx.connected_components(undirected))
    assert [nodes.tolist() for nodes in graph.components] == expected
    assert graph.is_internally_connected == (len(expected) == 1)
    anchors = set(graph.anchored_nodes.tolist())
    assert graph.component_is_anchored.tolist() == [bool(anchors & set(nodes)) for nodes in expected]
    assert graph.is_externally_connected == all(anchors & set(nodes) for nodes in expected)
    for node in range(graph.n_nodes):
        assert graph.neighbours(node).tolist() == sorted(undirected.neighbors(node))


@settings(max_examples=60)
@given(measurement_graphs(weighted=True))
def test_split_partitions_nodes_and_arcs(graph) -> None:
    parts = graph.split()
    assert sorted(name for part in parts for name in part.names) == sorted(graph.names)
    assert sorted(arc for part in parts for arc in arcs_of(part)) == arcs_of(graph)
    assert all(part.is_internally_connected for part in parts)


@settings(max_examples=60)
@given(measurement_graphs())
def test_generalized_trees_are_trees_with_the_environment_as_a_node(graph) -> None:
    whole = nx.MultiGraph()
    whole.add_nodes_from(range(EXTERNAL, graph.n_nodes))
    whole.add_edges_from(zip(graph.tail.tolist(), graph.head.tolist(), strict=True))
    assert graph.is_generalized_tree == nx.is_tree(whole)
    degrees = dict(whole.degree())
    assert graph.is_chain == (nx.is_tree(whole) and max(degrees.values()) <= 2 and degrees[EXTERNAL] == 1)


@given(st.permutations(range(6)))
@settings(max_examples=20)
def test_a_chain_is_a_chain_in_any_order_of_nodes_and_arcs(order) -> None:
    graph = MeasurementGraph(6, [*order[1:], EXTERNAL], [*order[:-1], order[0]])
    assert graph.is_chain


def test_what_is_no_chain() -> None:
    assert not chain(4, anchors=(1,)).is_chain
    assert chain(4, anchors=(3,)).is_chain
    assert not chain(4, anchors=()).is_chain
    assert not chain(4, anchors=(0, 3)).is_generalized_tree
    assert not star(4).is_chain
    assert star(4).is_generalized_tree
    assert not cycle(4, anchors=(0,)).is_generalized_tree
    assert chain(1).is_chain
    two = MeasurementGraph(2, [EXTERNAL, EXTERNAL], [0, 1])
    assert two.is_generalized_tree
    assert not two.is_chain
    doubled = MeasurementGraph(2, [EXTERNAL, EXTERNAL], [0, 0])
    assert not doubled.is_generalized_tree


def test_weights_written_out_and_replaced() -> None:
    graph = chain(3)
    assert graph.arc_weights.tolist() == [1, 1, 1]
    assert graph.dimension == 1
    blocks = graph.with_weight(np.broadcast_to(np.eye(2), (3, 2, 2)))
    assert blocks.dimension == 2
    assert blocks.with_weight(None).weight is None
    assert graph.with_weight([1, 2, 3]).arc_weights.tolist() == [1, 2, 3]


def test_subgraph_refuses_unknown_repeated_and_no_nodes() -> None:
    with pytest.raises(ArgumentError, match=r"nodes\[0\] = -1 is no index"):
        chain(3).subgraph([-1])
    with pytest.raises(ArgumentError, match="stands twice"):
        chain(3).subgraph([1, 1])
    with pytest.raises(ArgumentError, match="at least 1"):
        chain(3).subgraph([])
