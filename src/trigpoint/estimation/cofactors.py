"""Selected entries of the inverse normal matrix: its diagonal, and one entry an arc and number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.selected_inverse import selected_inverse
from trigpoint.linalg.sparse import Factorization

_CHUNK_ENTRIES = 20_000_000
_BY_SOLVES = 1500
"""Up to this many unknowns, solving for all columns is faster than selected inversion."""


def inverse_entries(
    factor: Factorization | None, free: NDArray[np.bool_], graph: MeasurementGraph, nodes: Blocks
) -> tuple[FloatArray, FloatArray]:
    """Return ``(N^-1)_uu`` for every unknown u (N d,) and ``(N^-1)_(head, tail)`` for every arc and number (M d,).

    Fixed unknowns and the environment have 0. Large problems use selected inversion; small ones, and those whose
    factor does not allow it, solve for the columns of the inverse in chunks of 20 million numbers.
    """
    total, size = nodes.total, nodes.size
    position = np.full(total, -1, dtype=np.int64)
    position[free] = np.arange(int(free.sum()))
    diagonal, between = np.zeros(total), np.zeros(graph.n_arcs * size)
    if factor is None:
        return diagonal, between
    head = position[nodes.positions(graph.head)]
    tail = graph.at_tail(nodes.split(position), -1).ravel()
    inner = np.flatnonzero((head >= 0) & (tail >= 0))
    found = _selected(factor, head[inner], tail[inner], int(free.sum()))
    if found is None:
        found = _by_solves(factor, head[inner], tail[inner], int(free.sum()))
    diagonal[free], between[inner] = found
    return diagonal, between


def _selected(
    factor: Factorization, heads: IntArray, tails: IntArray, count: int
) -> tuple[FloatArray, FloatArray] | None:
    if count <= _BY_SOLVES or not isinstance(factor, SuperLU):
        return None
    inverse = selected_inverse(factor)
    entries = None if inverse is None else inverse.entries(heads, tails)
    return None if inverse is None or entries is None else (inverse.diagonal(), entries)


def _by_solves(factor: Factorization, heads: IntArray, tails: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    diagonal, between = np.zeros(count), np.zeros(heads.shape[0])
    order = np.argsort(heads, kind="stable")
    width = max(1, _CHUNK_ENTRIES // count)
    for start in range(0, count, width):
        stop = min(start + width, count)
        unit = np.zeros((count, stop - start))
        unit[np.arange(start, stop), np.arange(stop - start)] = 1.0
        block = factor.solve(unit)
        diagonal[start:stop] = block[np.arange(start, stop), np.arange(stop - start)]
        here = order[slice(*np.searchsorted(heads[order], [start, stop]))]
        between[here] = block[tails[here], heads[here] - start]
    return diagonal, between
