"""Oracle: the smallest eigenvalue of the exactly stored Laplacian, to fifty digits."""

from __future__ import annotations

import mpmath
import numpy as np

from trigpoint.graphs import EXTERNAL, MeasurementGraph

DIGITS = 50


def exact_laplacian(graph: MeasurementGraph) -> mpmath.matrix:
    """``G W G'`` summed in extended precision from the stored weights (their symmetric part, for blocks)."""
    d = graph.dimension
    L = mpmath.zeros(graph.n_nodes * d)
    for k in range(graph.n_arcs):
        block = np.atleast_2d(graph.arc_weights[k]).tolist()
        tail, head = int(graph.tail[k]), int(graph.head[k])
        for a in range(d):
            for b in range(d):
                w = (mpmath.mpf(block[a][b]) + mpmath.mpf(block[b][a])) / 2
                L[head * d + a, head * d + b] += w
                if tail != EXTERNAL:
                    L[tail * d + a, tail * d + b] += w
                    L[head * d + a, tail * d + b] -= w
                    L[tail * d + a, head * d + b] -= w
    return L


def exact_smallest_eigenvalue(graph: MeasurementGraph) -> mpmath.mpf:
    with mpmath.workdps(DIGITS):
        return min(mpmath.eigsy(exact_laplacian(graph), eigvals_only=True))


def resolution(graph: MeasurementGraph) -> mpmath.mpf:
    """Absolute error that the oracle itself may have."""
    with mpmath.workdps(DIGITS):
        return mpmath.mpf(10) ** (8 - DIGITS) * (1 + mpmath.mpf(float(np.abs(graph.arc_weights).sum())))
