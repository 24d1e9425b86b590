"""Bridges of a measurement graph with the environment as a node: the arcs that nothing replaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order
from scipy.sparse.linalg import spsolve_triangular

from trigpoint.arrays import BoolArray, IntArray, frozen
from trigpoint.graphs.measurement_graph import MeasurementGraph


@dataclass(frozen=True, eq=False)
class BridgeTable:
    """The bridges, and for each the nodes on its far side (away from the environment, or from the component's root).

    Attributes:
        arcs: (B,) indices of the bridges, ascending.
        first: (B,) where the nodes behind the bridge begin in ``order``.
        count: (B,) how many nodes lie behind it.
        order: (N,) the nodes in preorder of one spanning forest: what lies behind a bridge is contiguous.
    """

    arcs: IntArray
    first: IntArray
    count: IntArray
    order: IntArray

    def behind(self, position: int) -> IntArray:
        """Nodes behind the bridge ``arcs[position]``, ascending. Cost: their number."""
        start = int(self.first[position])
        nodes: IntArray = np.sort(self.order[start : start + int(self.count[position])])
        return nodes


def bridges(graph: MeasurementGraph) -> IntArray:
    """Indices of the arcs of ``graph`` on no cycle, ascending; the environment counts as one node (G16, Remark 1).

    Removing a bridge parts two nodes that were joined: in an anchored component it cuts nodes off from every anchor.
    Parallel arcs are never bridges; external arcs meet in the environment, so that two of them in one component close
    a cycle. Deterministic and exact: no random labels.

    We assume:
        * fewer than 2^53 nodes (tree sizes are summed in float64).

    Cost O(N log N + M), a few NumPy and SciPy passes: about two seconds for a million nodes.
    Source: the low-point criterion for bridges, on the extended graph of G16, Remark 1.
    """
    return bridge_table(graph).arcs


def bridge_table(graph: MeasurementGraph) -> BridgeTable:
    """The bridges of ``graph`` with what lies behind each of them.

    A spanning tree is rooted at the environment (a component without external arc hangs on it by its first node) and
    numbered in preorder, so that the nodes below a tree arc are an interval. The tree arc is a bridge exactly when no
    other arc leaves that interval: the smallest and the largest neighbour over the interval decide.

    We assume:
        * fewer than 2^53 nodes.

    Cost O(N log N + M). Source: the low-point criterion for bridges, on the extended graph of G16, Remark 1.
    """
    tail = np.where(graph.is_external, 0, graph.tail + 1)
    head = graph.head + 1
    order, parent = _spanning_tree(graph, tail, head)
    place, size = _preorder(order, parent)
    child, is_tree = _tree_arcs(tail, head, parent)
    copies = np.bincount(child[is_tree], minlength=order.shape[0])
    inside = _closed_intervals(place, size, place[tail[~is_tree]], place[head[~is_tree]])
    single = is_tree & (copies[child] == 1)
    found = np.flatnonzero(single & inside[place[child]])
    far = child[found]
    by_place = np.empty_like(place)
    by_place[place] = np.arange(place.shape[0])
    return BridgeTable(
        frozen(found, np.int64),
        frozen(place[far] - 1, np.int64),
        frozen(size[far], np.int64),
        frozen(by_place[1:] - 1, np.int64),
    )


def _spanning_tree(graph: MeasurementGraph, tail: IntArray, head: IntArray) -> tuple[IntArray, IntArray]:
    """Nodes in breadth-first order from the environment (0), and the parent of each (the root's is 0)."""
    count = graph.n_nodes + 1
    labels = graph.component_labels
    first = np.full(graph.component_is_anchored.shape[0], graph.n_nodes, dtype=np.int64)
    np.minimum.at(first, labels, np.arange(graph.n_nodes))
    floating = first[~graph.component_is_anchored] + 1
    rows = np.concatenate([tail, np.zeros_like(floating)])
    columns = np.concatenate([head, floating])
    joined = sp.coo_array((np.ones(rows.shape[0]), (rows, columns)), shape=(count, count))
    order, parent = breadth_first_order(sp.csr_array(joined), 0, directed=False)
    parent[0] = 0
    return order.astype(np.int64), parent.astype(np.int64)


def _preorder(order: IntArray, parent: IntArray) -> tuple[IntArray, IntArray]:
    """Preorder number and subtree size of every node, from two unit triangular solves in exact whole numbers.

    Both systems are written in breadth-first positions, where parents come before children.
    """
    count = order.shape[0]
    position = np.empty(count, dtype=np.int64)
    position[order] = np.arange(count)
    up = position[parent[order[1:]]]  # ascending: breadth-first search finishes one parent before the next
    children = np.arange(1, count)
    tree = sp.coo_array((-np.ones(count - 1), (up, children)), shape=(count, count))
    system = sp.csr_array(tree + sp.eye_array(count))
    size = spsolve_triangular(system, np.ones(count), lower=False, unit_diagonal=True)
    # A child comes after its parent and after the subtrees of its elder siblings, which stand next to each other.
    before = np.concatenate([[0.0], np.cumsum(size[1:])])
    is_eldest = np.concatenate([[True], up[1:] != up[:-1]])
    eldest = np.maximum.accumulate(np.where(is_eldest, np.arange(count - 1), 0))
    step = np.concatenate([[0.0], 1.0 + before[:-1] - before[eldest]])
    number = spsolve_triangular(sp.csr_array(system.T), step, lower=True, unit_diagonal=True)
    place, sizes = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    place[order], sizes[order] = number.astype(np.int64), size.astype(np.int64)
    return place, sizes


def _tree_arcs(tail: IntArray, head: IntArray, parent: IntArray) -> tuple[IntArray, BoolArray]:
    """The lower end of each arc that runs along the tree (parallel arcs all do), and which arcs these are."""
    down, up = parent[head] == tail, parent[tail] == head
    down &= head != 0
    up &= tail != 0
    return np.where(down, head, tail), down | up


def _closed_intervals(place: IntArray, size: IntArray, one: IntArray, other: IntArray) -> BoolArray:
    """For each preorder number: does every arc (``one``, ``other``) at the subtree's nodes stay inside it?

    Smallest and largest neighbours over intervals, from tables of intervals of length 2^k, one k at a time.
    """
    count = place.shape[0]
    least, most = np.arange(count), np.arange(count)
    for here, there in ((one, other), (other, one)):
        np.minimum.at(least, here, there)
        np.maximum.at(most, here, there)
    length = np.empty(count, dtype=np.int64)
    length[place] = size
    power = np.frexp(length.astype(np.float64))[1] - 1
    closed = np.zeros(count, dtype=np.bool_)
    for k in range(int(power.max()) + 1):
        start = np.flatnonzero(power == k)
        last = start + length[start] - (1 << k)
        low = np.minimum(least[start], least[last])
        high = np.maximum(most[start], most[last])
        closed[start] = (low >= start) & (high < start + length[start])
        width = 1 << k
        least = np.minimum(least[:-width], least[width:])
        most = np.maximum(most[:-width], most[width:])
    return closed
