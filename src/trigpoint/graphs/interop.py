"""networkx in and out, as arc lists. The environment is the node with the empty name, as in an edge list."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import networkx as nx
import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.graphs.algebra import EXTERNAL

ENVIRONMENT = ""
"""Name of the networkx node that stands for the environment."""


@dataclass(frozen=True)
class ArcList:
    """Names of the nodes, and (tail, head, weight) of each arc."""

    names: list[str]
    arcs: list[tuple[int, int, Any]]

    def weight(self, attribute: str) -> FloatArray | None:
        """The arcs' weights, numbers or blocks; None where all are 1. ``attribute`` is named in the error."""
        try:
            weights = np.array([weight for _, _, weight in self.arcs])
        except ValueError as error:
            raise ArgumentError(
                f"the edge attribute {attribute!r} must be a number on every edge, or a d x d block on every edge; got "
                "both, or blocks of different size (an edge without it, and every one of anchors, has the number 1)"
            ) from error
        return None if weights.ndim == 1 and bool((weights == 1.0).all()) else weights


def read_networkx(graph: nx.Graph, anchors: Sequence[Any], weight: str) -> ArcList:
    """Arcs of any networkx graph: edge (u, v) becomes u -> v, an edge of the environment an external arc."""
    nodes = [node for node in graph.nodes if node != ENVIRONMENT]
    position = {node: k for k, node in enumerate(nodes)}
    if not nodes:
        raise ArgumentError("the networkx graph has no node")
    arcs = []
    for u, v, data in graph.edges(data=True):
        value = data.get(weight, 1.0)
        if u != ENVIRONMENT and v != ENVIRONMENT:
            arcs.append((position[u], position[v], value))
            continue
        other = v if u == ENVIRONMENT else u
        if other == ENVIRONMENT:
            raise ArgumentError("the environment (node '') has a self-loop: it measures nothing")
        arcs.append((EXTERNAL, position[other], value))
    for anchor in anchors:
        if anchor not in position:
            raise ArgumentError(f"anchor {anchor!r} is not a node of the graph; the first nodes are {nodes[:5]}")
        arcs.append((EXTERNAL, position[anchor], 1.0))
    return ArcList([str(node) for node in nodes], arcs)


def write_networkx(names: Sequence[str], arcs: Iterable[tuple[int, int, Any]]) -> nx.MultiDiGraph:
    """Nodes by name and one edge an arc, with its number as key and its weight (unless None) as attribute."""
    if ENVIRONMENT in names:
        raise ArgumentError("a node has the empty name, which is the environment's in networkx; rename the node")
    result = nx.MultiDiGraph()
    result.add_nodes_from(names)
    for k, (tail, head, weight) in enumerate(arcs):
        start = ENVIRONMENT if tail == EXTERNAL else names[tail]
        data = {} if weight is None else {"weight": np.asarray(weight).tolist()}
        result.add_edge(start, names[head], key=k, **data)
    return result
