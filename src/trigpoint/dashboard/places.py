"""Where the page draws the nodes of a graph that comes without positions."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

from trigpoint.arrays import FloatArray
from trigpoint.graphs import MeasurementGraph

_PIVOTS = 40


def drawing_places(graph: MeasurementGraph) -> FloatArray:
    """Return (N, 2) places by pivot multidimensional scaling of the hop distances; deterministic, O(N + M) a pivot.

    Components that no arc joins are set apart by a distance longer than any within them.
    Source: Brandes, Pich, *Eigensolver methods for progressive multidimensional scaling of large data* (2007).
    """
    inner, n = ~graph.is_external, graph.n_nodes
    links = sp.csr_array((np.ones(int(inner.sum())), (graph.tail[inner], graph.head[inner])), shape=(n, n))
    nearest = np.full(n, np.inf)
    columns: list[FloatArray] = []
    for _ in range(min(_PIVOTS, n)):
        hops = dijkstra(links, directed=False, indices=int(np.argmax(nearest)), unweighted=True)
        columns.append(hops)
        nearest = np.minimum(nearest, hops)
    distances = np.column_stack(columns)
    reachable = np.isfinite(distances)
    distances[~reachable] = 2.0 + float(distances[reachable].max())
    squared = distances**2
    centred = squared - squared.mean(axis=0) - squared.mean(axis=1, keepdims=True) + squared.mean()
    _, vectors = np.linalg.eigh(centred.T @ centred)
    places = np.zeros((n, 2))
    chosen = vectors[:, ::-1][:, :2]
    chosen = chosen * np.where(chosen.sum(axis=0) < 0.0, -1.0, 1.0)
    places[:, : chosen.shape[1]] = centred @ chosen
    return places
