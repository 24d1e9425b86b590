"""Networks to try things on. ``anchors`` lists the nodes with an external arc (a node may stand several times)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from trigpoint.arrays import IntArray, as_floats, as_indices
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs.algebra import EXTERNAL
from trigpoint.graphs.measurement_graph import MeasurementGraph


def chain(n: int, anchors: Sequence[int] = (0,)) -> MeasurementGraph:
    """Path 0 -> 1 -> ... -> n-1 with ``anchors``, node 0 unless given.

    Anchored at its end it is the worst graph with n nodes (G16, Theorem 1).

    >>> from trigpoint.graphs import chain
    >>> chain(3).laplacian().toarray()
    array([[ 2., -1.,  0.],
           [-1.,  2., -1.],
           [ 0., -1.,  1.]])
    """
    n = _count("n", n, 1)
    nodes = np.arange(n)
    return _with_anchors(n, nodes[:-1], nodes[1:], anchors)


def cycle(n: int, anchors: Sequence[int] = ()) -> MeasurementGraph:
    """Ring 0 -> 1 -> ... -> n-1 -> 0 with ``anchors``, as in R23's cycle sensing (n = 2: two parallel arcs)."""
    n = _count("n", n, 2)
    nodes = np.arange(n)
    return _with_anchors(n, nodes, np.roll(nodes, -1), anchors)


def complete(n: int, anchors: Sequence[int] = ()) -> MeasurementGraph:
    """Every pair of the n nodes joined by one arc, lower index to higher; external arcs on ``anchors``."""
    n = _count("n", n, 1)
    tail, head = np.triu_indices(n, k=1)
    return _with_anchors(n, tail, head, anchors)


def star(n: int, anchors: Sequence[int] = (0,)) -> MeasurementGraph:
    """Node 0 joined to each of the n - 1 others; external arcs on ``anchors``."""
    n = _count("n", n, 1)
    return _with_anchors(n, np.zeros(n - 1, dtype=np.int64), np.arange(1, n), anchors)


def grid(rows: int, cols: int, anchors: Sequence[int] = (0,)) -> MeasurementGraph:
    """Grid of ``rows`` x ``cols`` nodes, row-major, arcs to the right and downwards; external arcs on ``anchors``."""
    rows, cols = _count("rows", rows, 1), _count("cols", cols, 1)
    index = np.arange(rows * cols).reshape(rows, cols)
    tail = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    head = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    return _with_anchors(rows * cols, tail, head, anchors)


def random_connected(n: int, connectivity: float, rng: np.random.Generator) -> MeasurementGraph:
    """Random externally connected network of G16, Section 5.1.

    An anchored chain of n arcs, and further arcs up to ``round(connectivity n (n - 1) / 2)`` in all: each joins two
    nodes drawn uniformly with repetition, and is external where the two are the same node.

    Args:
        n: number of nodes.
        connectivity: fraction of all pairs, 0 < connectivity <= 1 (the paper's p = 30 % is 0.3).
        rng: source of randomness.
    """
    n = _count("n", n, 1)
    if not 0.0 < connectivity <= 1.0:
        raise ArgumentError(
            f"connectivity must be a fraction, 0 < connectivity <= 1 (the paper's p = 30 % is 0.3); got {connectivity}"
        )
    extra = max(0, round(n * (n - 1) * connectivity / 2) - n)
    first = rng.integers(n, size=extra)
    second = rng.integers(n, size=extra)
    nodes = np.arange(n)
    tail = np.concatenate([[EXTERNAL], nodes[:-1], np.where(first == second, EXTERNAL, first)])
    head = np.concatenate([[0], nodes[1:], second])
    return MeasurementGraph(n, tail, head)


def within_radius(
    positions: ArrayLike, radius: float, anchors: ArrayLike = (), anchor_positions: ArrayLike | None = None
) -> MeasurementGraph:
    """Proximity network: one arc a pair of nodes at distance of at most ``radius`` (lower index to higher).

    Args:
        positions: (N, d) places of the nodes.
        radius: reach, positive.
        anchors: nodes that always have an external arc.
        anchor_positions: (A, d) places of known marks; a node gets one external arc for each mark within reach.
    """
    places = as_floats("positions", positions)
    if places.ndim != 2 or not places.shape[0]:
        raise ShapeError(f"positions must have shape (N, d) with N >= 1; got {places.shape}")
    if not radius > 0:
        raise ArgumentError(f"radius must be positive; got {radius}")
    tree = cKDTree(places)
    pairs = tree.query_pairs(radius, output_type="ndarray").reshape(-1, 2).astype(np.int64)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    extra = as_indices("anchors", anchors, 0, places.shape[0])
    if anchor_positions is not None:
        marks = as_floats("anchor_positions", anchor_positions)
        if marks.ndim != 2 or marks.shape[1] != places.shape[1]:
            raise ShapeError(
                f"anchor_positions must have shape (A, {places.shape[1]}) like positions; got {marks.shape}"
            )
        reached = [sorted(nodes) for nodes in tree.query_ball_point(marks, radius)]
        extra = np.concatenate([extra, *(np.array(nodes, dtype=np.int64) for nodes in reached)])
    return _with_anchors(places.shape[0], pairs[:, 0], pairs[:, 1], extra)


def _with_anchors(n: int, tail: IntArray, head: IntArray, anchors: ArrayLike) -> MeasurementGraph:
    marks = as_indices("anchors", anchors, 0, n)
    tail = np.concatenate([tail, np.full(marks.shape[0], EXTERNAL)]).astype(np.int64)
    return MeasurementGraph(n, tail, np.concatenate([head, marks]).astype(np.int64))


def _count(name: str, value: int, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ArgumentError(f"{name} must be a whole number of at least {least}; got {value!r}")
    return int(value)
