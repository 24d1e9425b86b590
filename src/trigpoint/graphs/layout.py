"""Where to draw the nodes of a graph that comes without positions."""

from __future__ import annotations

import networkx as nx
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

from trigpoint.arrays import FloatArray, IntArray, frozen
from trigpoint.graphs import MeasurementGraph

_PIVOTS = 40
_REFINED = 150
_ALIGNED = 0.5


def node_positions(graph: MeasurementGraph) -> FloatArray:
    """Return (N, 2) drawing positions, arcs about one unit long; the same for the same graph.

    Every component is placed by pivot multidimensional scaling of its hop distances (O(N + M) for each of 40 pivots);
    up to 150 nodes Kamada and Kawai's springs refine it. A component whose arcs stand mostly at right angles is turned
    along the axes, so that a grid is a square and no diamond. Components stand side by side, the largest first.

    Source: Brandes, Pich, *Eigensolver methods for progressive multidimensional scaling of large data* (2007),
    key BrandesPich2007.
    """
    adjacency = _adjacency(graph)
    components = sorted(graph.components, key=lambda nodes: (-nodes.shape[0], int(nodes[0])))
    boxes = [_place_component(adjacency[nodes][:, nodes]) for nodes in components]
    places = np.zeros((graph.n_nodes, 2))
    for nodes, box, corner in zip(components, boxes, _shelves(boxes), strict=True):
        places[nodes] = box + corner
    positions: FloatArray = frozen(places)
    return positions


def arc_pairs(graph: MeasurementGraph) -> tuple[IntArray, IntArray]:
    """Return the (P, 2) pairs of nodes with internal arcs between them, and how many arcs each pair has."""
    inner = ~graph.is_external
    ends = np.sort(np.column_stack([graph.tail[inner], graph.head[inner]]), axis=1)
    if not ends.shape[0]:
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=np.int64)
    pairs, counts = np.unique(ends, axis=0, return_counts=True)
    return pairs, counts


def _adjacency(graph: MeasurementGraph) -> sp.csr_array:
    pairs, _ = arc_pairs(graph)
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    return sp.csr_array((np.ones(rows.shape[0]), (rows, columns)), shape=(graph.n_nodes, graph.n_nodes))


def _place_component(adjacency: sp.csr_array) -> FloatArray:
    """Place one connected component: lower left corner at the origin, median arc of length one."""
    n = adjacency.shape[0]
    if n <= 2:
        return np.column_stack([np.arange(n, dtype=np.float64), np.zeros(n)])
    places = _unit_arcs(_pivot_scaling(_pivot_distances(adjacency)), adjacency)
    if n <= _REFINED:
        if np.unique(places.round(6), axis=0).shape[0] < n:  # the refinement divides by distances
            places = places + 0.01 * np.column_stack([np.cos(np.arange(n)), np.sin(np.arange(n))])
        start = {k: tuple(places[k]) for k in range(n)}
        refined = nx.kamada_kawai_layout(nx.from_scipy_sparse_array(adjacency), pos=start)
        places = _unit_arcs(_upright(np.array([refined[k] for k in range(n)])), adjacency)
    places = _straight(places, adjacency)
    return np.asarray(places - places.min(axis=0), dtype=np.float64)


def _unit_arcs(places: FloatArray, adjacency: sp.csr_array) -> FloatArray:
    """Scale the median arc to length one (the longest, where more than half of them have length zero)."""
    rows, columns = adjacency.nonzero()
    lengths = np.linalg.norm(places[rows] - places[columns], axis=1)
    typical = float(np.median(lengths)) or float(lengths.max()) or 1.0
    return np.asarray(places / typical, dtype=np.float64)


def _pivot_distances(adjacency: sp.csr_array) -> FloatArray:
    """Hop distances (N, P) from pivots, each the node farthest from all before it."""
    nearest = np.full(adjacency.shape[0], np.inf)
    columns: list[FloatArray] = []
    pivot = 0
    for _ in range(min(_PIVOTS, adjacency.shape[0])):
        distance = dijkstra(adjacency, directed=False, indices=pivot, unweighted=True)
        columns.append(distance)
        nearest = np.minimum(nearest, distance)
        pivot = int(np.argmax(nearest))
    return np.column_stack(columns)


def _pivot_scaling(distances: FloatArray) -> FloatArray:
    squared = distances**2
    centred = squared - squared.mean(axis=0) - squared.mean(axis=1, keepdims=True) + squared.mean()
    _, vectors = np.linalg.eigh(centred.T @ centred)
    return _upright(centred @ vectors[:, ::-1][:, :2])


def _upright(places: FloatArray) -> FloatArray:
    """Turn the longest extent to the horizontal and node 0 to the upper left."""
    centred = places - places.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    return _mirrored(centred @ vectors[:, ::-1])


def _straight(places: FloatArray, adjacency: sp.csr_array) -> FloatArray:
    """Turn arcs along the axes where most share one angle modulo a right angle: the mean of their fourth powers.

    The longest extent alone does not say how a square is to stand, since it has none.
    """
    rows, columns = adjacency.nonzero()
    ways = (places[columns] - places[rows]) @ np.array([1.0, 1.0j])
    ways = ways[np.abs(ways) > 0.0]
    mean = ((ways / np.abs(ways)) ** 4).mean() if ways.size else 0.0
    if abs(mean) < _ALIGNED:
        return places
    centred = (places - places.mean(axis=0)) @ np.array([1.0, 1.0j])
    turned = centred * np.exp(-0.25j * np.angle(mean))
    if np.ptp(turned.imag) > (1.0 + 1e-6) * np.ptp(turned.real):
        turned = turned * 1.0j
    return _mirrored(np.column_stack([turned.real, turned.imag]))


def _mirrored(turned: FloatArray) -> FloatArray:
    """Node 0 to the upper left, as one reads."""
    signs = np.where(turned[0] * np.array([-1.0, 1.0]) < 0.0, -1.0, 1.0)
    return np.asarray(turned * signs, dtype=np.float64)


def _shelves(boxes: list[FloatArray]) -> list[FloatArray]:
    """Lower left corners of the boxes on shelves, about as wide as high, filled from the top."""
    sizes = [box.max(axis=0) + 1.0 for box in boxes]
    width = max(max(size[0] for size in sizes), 1.3 * float(np.sqrt(sum(size[0] * size[1] for size in sizes))))
    corners: list[FloatArray] = []
    x, y, shelf = 0.0, 0.0, 0.0
    for size in sizes:
        if x > 0.0 and x + size[0] > width:
            x, y, shelf = 0.0, y - shelf, 0.0
        corners.append(np.array([x, y - size[1]]))
        x, shelf = x + size[0], max(shelf, size[1])
    return corners
