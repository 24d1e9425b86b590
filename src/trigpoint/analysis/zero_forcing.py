"""Zero forcing: a combinatorial proof that measured nodes determine every other one."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from trigpoint.arrays import as_indices
from trigpoint.graphs import MeasurementGraph


def is_zero_forcing(graph: MeasurementGraph, nodes: ArrayLike) -> bool:
    """Tell whether ``nodes`` force every node of ``graph``: a sufficient test for the agreement dynamics.

    The given nodes are black. A black node with exactly one neighbour that is not black makes it black; the set forces
    when this ends with every node black. An eigenvector of ``L`` that vanishes on the black nodes vanishes on each
    forced one as well (the row of the forcing node has one unknown left), so ``(-L, E')`` is observable.

    Args:
        graph: internal arcs only are looked at; parallel arcs count as one neighbour.
        nodes: indices of the nodes that are black at the start.

    We assume:
        * positive weights, of any value: the answer holds for all of them together.

    Raises:
        ArgumentError: an index outside 0..N-1.

    Cost O(N + M). Source: R23, Lemma 17 (an eigenvector that vanishes on the measured nodes is what must not exist).
    """
    chosen = as_indices("nodes", nodes, 0, graph.n_nodes)
    adjacency = simple_adjacency(graph)
    is_black = np.zeros(graph.n_nodes, dtype=np.bool_)
    is_black[chosen] = True
    white = (adjacency @ (~is_black).astype(np.float64)).astype(np.int64).tolist()
    return _all_forced(adjacency.indptr.tolist(), adjacency.indices.tolist(), is_black.tolist(), white)


def simple_adjacency(graph: MeasurementGraph) -> sp.csr_array:
    """Adjacency by internal arcs: sparse (N, N), 1 between the ends of at least one arc of ``graph``.

    Cost O(N + M). Source: R23, Section VI.
    """
    inner = ~graph.is_external
    tail, head = graph.tail[inner], graph.head[inner]
    ends = (np.concatenate([tail, head]), np.concatenate([head, tail]))
    adjacency = sp.csr_array((np.ones(ends[0].shape[0]), ends), shape=(graph.n_nodes, graph.n_nodes))
    adjacency.sum_duplicates()
    adjacency.data[:] = 1.0
    return adjacency


def _all_forced(indptr: list[int], indices: list[int], is_black: list[bool], white: list[int]) -> bool:
    """Apply the rule until nothing changes; ``white`` counts each node's neighbours that are not black."""
    stack = [node for node, black in enumerate(is_black) if black and white[node] == 1]
    while stack:
        node = stack.pop()
        forced = next((k for k in indices[indptr[node] : indptr[node + 1]] if not is_black[k]), None)
        if forced is None:  # another black neighbour forced it meanwhile
            continue
        is_black[forced] = True
        around = indices[indptr[forced] : indptr[forced + 1]]
        for other in around:
            white[other] -= 1
        stack += [other for other in (*around, forced) if is_black[other] and white[other] == 1]
    return all(is_black)
