"""Selected entries of the inverse normal matrix: its diagonal, and one entry an arc and number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.sparse import Factorization

_CHUNK_ENTRIES = 20_000_000


def inverse_entries(
    factor: Factorization | None, free: NDArray[np.bool_], graph: MeasurementGraph, nodes: Blocks
) -> tuple[FloatArray, FloatArray]:
    """Return ``(N^-1)_uu`` for every unknown u (N d,) and ``(N^-1)_(head, tail)`` for every arc and number (M d,).

    Fixed unknowns and the environment have 0. The columns of the inverse are solved for in chunks, so that memory
    stays O(N d + 20 million).
    """
    total, size = nodes.total, nodes.size
    position = np.full(total, -1, dtype=np.int64)
    position[free] = np.arange(int(free.sum()))
    diagonal = np.zeros(total)
    between = np.zeros(graph.n_arcs * size)
    if factor is None:
        return diagonal, between
    head = position[nodes.positions(graph.head)]
    tail_unknowns = graph.at_tail(nodes.split(position), -1).ravel()
    arcs = np.flatnonzero((head >= 0) & (tail_unknowns >= 0))
    arcs = arcs[np.argsort(head[arcs], kind="stable")]
    heads, tails = head[arcs], tail_unknowns[arcs]
    unknowns = np.flatnonzero(free)
    count = unknowns.shape[0]
    width = max(1, _CHUNK_ENTRIES // count)
    for start in range(0, count, width):
        stop = min(start + width, count)
        block = _columns(factor, count, start, stop)
        diagonal[unknowns[start:stop]] = block[np.arange(start, stop), np.arange(stop - start)]
        here: IntArray = np.arange(*np.searchsorted(heads, [start, stop]))
        between[arcs[here]] = block[tails[here], heads[here] - start]
    return diagonal, between


def _columns(factor: Factorization, count: int, start: int, stop: int) -> FloatArray:
    unit = np.zeros((count, stop - start))
    unit[np.arange(start, stop), np.arange(stop - start)] = 1.0
    return factor.solve(unit)
