"""Agents that do not move: what the claims about delay, loss and held values rest on."""

from __future__ import annotations

import numpy as np

from trigpoint.analysis.eigenvalue import couplings
from trigpoint.analysis.modes import largest_eigenvalue_bound
from trigpoint.arrays import FloatArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.verified import down, gam, is_positive_definite, up
from trigpoint.observers.network import DiffusiveObserver

_DENSE = 600


def static_pull(observer: DiffusiveObserver) -> tuple[float, float] | None:
    """Bounds of the positive factors k_i c_i when A = 0, K and C are diagonal and weights scalar; None otherwise.

    Then every coordinate obeys ``e' = -gain k_i c_i L e`` by itself.
    """
    A, K, C = observer.agent.A, observer.injection, observer.agent.C
    if observer.graph.dimension > 1 or A.any() or K.shape != C.T.shape or K.shape[0] != K.shape[1]:
        return None
    diagonal = np.eye(K.shape[0], dtype=bool)
    if K[~diagonal].any() or C[~diagonal].any():
        return None
    factors = np.diagonal(K) * np.diagonal(C)
    if not (factors > 2.0**-900).all() or not np.isfinite(factors).all():
        return None
    return down(float(factors.min())), up(float(factors.max()))


def largest_eigenvalue_by_degrees(graph: MeasurementGraph) -> float:
    """Rigorous upper bound of ``lambda_max`` of a ``graph`` with scalar weights, whatever the number of its arcs.

    Source: theory 8-G4.
    """
    # A degree is a sum of at most as many weights as there are arcs, a bound one of two degrees.
    return up(largest_eigenvalue_bound(graph) * (1.0 + float(gam(4.0 * graph.n_arcs + 16.0))))


def eigenvalue_near(graph: MeasurementGraph, v: FloatArray) -> tuple[float, float] | None:
    """An interval that holds an eigenvalue of L, scalar weights: ``|L v - q v| / |v|`` around v's quotient q.

    None where v is zero or not finite. We assume nothing of v; a poor one gives a wide interval.
    """
    largest = float(np.abs(v).max(initial=0.0))
    if not 0.0 < largest < np.inf:
        return None
    unit = np.ldexp(v, -int(np.frexp(largest)[1]))
    with np.errstate(over="ignore", invalid="ignore"):
        image, error = couplings(graph).apply(unit)
        quotient = float(unit @ image) / float(unit @ unit)
        away = np.abs(image - quotient * unit) + error + gam(4.0) * (np.abs(image) + abs(quotient) * np.abs(unit))
        more, n = 1.0 + float(gam(4.0 * unit.shape[0] + 16.0)), unit.shape[0]
        squares = up(float((away * away).sum()) * more) + n * 2.0**-1000
        radius = up(up(float(np.sqrt(squares)) * more) / down(float(np.sqrt(float((unit * unit).sum()) / more))))
    if not np.isfinite(radius):
        return None
    return max(0.0, down(quotient - radius)), up(quotient + radius)


def largest_eigenvalue_upper(graph: MeasurementGraph) -> float:
    """Rigorous upper bound of ``lambda_max`` of ``graph``: ``s I - L > 0`` verified up to 600 nodes, else by degrees.

    Source: Rump (2006), key Rump2006; theory 8-G4.
    """
    by_degrees = largest_eigenvalue_by_degrees(graph)
    if graph.n_nodes > _DENSE:
        return by_degrees
    L = graph.laplacian().toarray()
    radius = gam(2.0 * graph.n_arcs + 8.0) * (np.abs(L) + np.diag(np.diagonal(L)))
    computed = float(np.linalg.eigvalsh(L)[-1])
    for margin in (1e-10, 1e-7, 1e-4):
        s = computed * (1.0 + margin)
        shifted = s * np.eye(graph.n_nodes) - L
        if s < by_degrees and is_positive_definite(0.5 * (shifted + shifted.T), radius + gam(4.0) * s):
            return s
    return by_degrees
