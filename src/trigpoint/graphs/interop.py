"""networkx in and out. The environment is the node with the empty name, as in an edge list's empty ``from``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import networkx as nx
import numpy as np

from trigpoint.errors import ArgumentError
from trigpoint.graphs.measurement_graph import EXTERNAL, MeasurementGraph

ENVIRONMENT = ""


def from_networkx(graph: nx.Graph, anchors: Sequence[Any] = (), weight: str = "weight") -> MeasurementGraph:
    """Read any networkx graph: edge (u, v) becomes the arc u -> v, the order of ``graph.nodes`` is kept.

    Args:
        graph: directed or not, parallel edges allowed. A node named ``""`` is the environment: its edges become
            external arcs of their other end (an undirected or reversed edge too).
        anchors: nodes that get one more external arc each, of weight 1.
        weight: edge attribute with the arc's weight (1 where it is missing).

    Raises:
        ArgumentError: a self-loop, an unknown anchor, a graph without nodes, two nodes with the same text.

    Cost O(N + M).
    """
    nodes = [node for node in graph.nodes if node != ENVIRONMENT]
    position = {node: k for k, node in enumerate(nodes)}
    if not nodes:
        raise ArgumentError("the networkx graph has no node")
    arcs: list[tuple[int, int, float]] = []
    for u, v, data in graph.edges(data=True):
        value = data.get(weight, 1.0)
        if u != ENVIRONMENT and v != ENVIRONMENT:
            arcs.append((position[u], position[v], value))
        else:
            other = v if u == ENVIRONMENT else u
            if other == ENVIRONMENT:
                raise ArgumentError("the environment (node '') has a self-loop: it measures nothing")
            arcs.append((EXTERNAL, position[other], value))
    for anchor in anchors:
        if anchor not in position:
            raise ArgumentError(f"anchor {anchor!r} is not a node of the graph; the first nodes are {nodes[:5]}")
        arcs.append((EXTERNAL, position[anchor], 1.0))
    try:
        weights = np.array([w for _, _, w in arcs])
    except ValueError as error:
        raise ArgumentError(
            f"the edge attribute {weight!r} must be a number on every edge, or a d x d block on every edge; got both, "
            "or blocks of different size (an edge without it, and every one of anchors, has the number 1)"
        ) from error
    unit = weights.ndim == 1 and bool((weights == 1.0).all())
    return MeasurementGraph(
        len(nodes),
        [t for t, _, _ in arcs],
        [h for _, h, _ in arcs],
        None if unit else weights,
        [str(n) for n in nodes],
    )


def to_networkx(graph: MeasurementGraph) -> nx.MultiDiGraph:
    """Return nodes by name and one edge an arc (key = arc number); the environment is the node ``""`` if it is used.

    ``from_networkx(to_networkx(g))`` has the same nodes, arcs and weights (arcs perhaps in another order).

    Raises:
        ArgumentError: a node with the empty name.
    """
    if ENVIRONMENT in graph.names:
        raise ArgumentError("a node has the empty name, which is the environment's in networkx; rename the node")
    result = nx.MultiDiGraph()
    result.add_nodes_from(graph.names)
    external = graph.is_external
    for k in range(graph.n_arcs):
        start = ENVIRONMENT if external[k] else graph.names[graph.tail[k]]
        data = {} if graph.weight is None else {"weight": _plain(graph.weight[k])}
        result.add_edge(start, graph.names[graph.head[k]], key=k, **data)
    return result


def _plain(value: Any) -> Any:
    return float(value) if np.ndim(value) == 0 else np.asarray(value).tolist()
