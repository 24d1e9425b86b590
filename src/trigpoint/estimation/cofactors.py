"""Selected entries of the inverse normal matrix: its diagonal, and one entry an arc and number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trigpoint.arrays import FloatArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.selected_inverse import entries_of_inverse
from trigpoint.linalg.sparse import Factorization


def inverse_entries(
    factor: Factorization | None, free: NDArray[np.bool_], graph: MeasurementGraph, nodes: Blocks
) -> tuple[FloatArray, FloatArray]:
    """Return ``(N^-1)_uu`` for every unknown u (N d,) and ``(N^-1)_(head, tail)`` for every arc and number (M d,).

    Fixed unknowns and the environment have 0.
    """
    total, size = nodes.total, nodes.size
    count = int(free.sum())
    position = np.full(total, -1, dtype=np.int64)
    position[free] = np.arange(count)
    diagonal, between = np.zeros(total), np.zeros(graph.n_arcs * size)
    if factor is None:
        return diagonal, between
    head = position[nodes.positions(graph.head)]
    tail = graph.at_tail(nodes.split(position), -1).ravel()
    inner = np.flatnonzero((head >= 0) & (tail >= 0))
    own = np.arange(count)
    found = entries_of_inverse(
        factor, count, np.concatenate([own, tail[inner]]), np.concatenate([own, head[inner]])
    )  # fmt: skip
    diagonal[free], between[inner] = found[:count], found[count:]
    return diagonal, between
