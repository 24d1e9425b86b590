"""Arc weights that make the smallest eigenvalue of the generalized Laplacian as large as their sum allows (an SDP)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.arrays import FloatArray, IntArray, frozen
from trigpoint.errors import ArgumentError, MissingExtraError, TrigpointError
from trigpoint.graphs import MeasurementGraph

_LARGEST = 150
_LEAST = 1e-9


@dataclass(frozen=True, eq=False)
class OptimalWeights:
    """Weights, what they reach, and a bound that no weights exceed.

    Attributes:
        weights: (M,) nonnegative arc weights, their sum the given total.
        value: ``lambda_min`` with these weights, a rigorous lower bound.
        ceiling: no weights of that sum reach more (a dual solution's value).
        gap: ``ceiling / value - 1``.
    """

    weights: FloatArray
    value: float
    ceiling: float
    gap: float


def optimal_weights(
    graph: MeasurementGraph, total: float | None = None, fixed: IntArray | None = None
) -> OptimalWeights:
    """Solve ``max t`` subject to ``G diag(w) G' >= t I``, ``sum w = total``, ``w >= 0``.

    Args:
        graph: the network; its own weights (1 where it has none) are the start of the comparison.
        total: sum of the free weights; that of the graph's own unless given.
        fixed: arcs whose weight stays as it is in the graph (anchor gains that are given); none unless given.

    We assume:
        * scalar weights and at most 150 nodes (the SDP is dense).

    The result is checked, not believed: ``value`` is bounded by ``smallest_eigenvalue``, ``ceiling`` follows from the
    dual matrix Z by weak duality: if Z >= 0 and tr Z = 1, ``t <= sum_fixed w_k g_k' Z g_k + total max_free g_k' Z g_k``

    Raises:
        MissingExtraError: the solver ``clarabel`` is not installed (extra ``lmi``).
        ArgumentError: a network that is too large, or a total that is not positive.

    Source: theory 7-H2; Xiao and Boyd 2004.
    """
    if graph.arc_weights.ndim > 1 or graph.n_nodes > _LARGEST:
        raise ArgumentError(f"optimal weights are for scalar weights and up to {_LARGEST} nodes; got {graph!r}")
    held = np.zeros(graph.n_arcs, dtype=bool)
    held[np.zeros(0, dtype=np.int64) if fixed is None else fixed] = True
    budget = float(graph.arc_weights[~held].sum()) if total is None else float(total)
    if not (np.isfinite(budget) and budget > 0.0):
        raise ArgumentError(f"total must be a positive number; got {budget}")
    free, Z = _solve(graph, held, budget)
    weights = np.array(graph.arc_weights)
    weights[~held] = free
    # A weight of exactly zero would take the arc out of the graph; this share of the budget keeps it and its reading.
    weights[~held] = np.maximum(weights[~held], _LEAST * budget / max(int((~held).sum()), 1))
    weights[~held] *= budget / float(weights[~held].sum())
    value = smallest_eigenvalue(graph.with_weight(weights)).lower
    ceiling = _ceiling(graph, held, budget, Z)
    return OptimalWeights(frozen(weights), value, ceiling, ceiling / value - 1.0 if value > 0.0 else np.inf)


def _ceiling(graph: MeasurementGraph, held: np.ndarray, budget: float, Z: FloatArray) -> float:
    values, vectors = np.linalg.eigh(0.5 * (Z + Z.T))
    values = np.maximum(values, 0.0)
    G = graph.incidence().toarray()
    energy = ((vectors.T @ G) ** 2 * (values / values.sum())[:, None]).sum(axis=0)
    return float((graph.arc_weights[held] * energy[held]).sum() + budget * energy[~held].max(initial=0.0))


def _solve(graph: MeasurementGraph, held: np.ndarray, budget: float) -> tuple[FloatArray, FloatArray]:
    """Weights of the free arcs and the dual matrix Z, by an interior-point method."""
    try:
        import clarabel
    except ImportError as error:
        raise MissingExtraError("clarabel", "lmi", "optimal_weights") from error
    n, G = graph.n_nodes, graph.incidence().toarray()
    free, rows = np.flatnonzero(~held), np.triu_indices(n)
    scale = np.where(rows[0] == rows[1], 1.0, np.sqrt(2.0))
    order = np.lexsort((rows[0], rows[1]))  # the solver's triangle goes column by column

    def triangle(matrix: FloatArray) -> FloatArray:
        return np.asarray((matrix[rows] * scale)[order])

    known = (G[:, held] * graph.arc_weights[held]) @ G[:, held].T
    columns = [triangle(np.outer(G[:, k], G[:, k])) for k in free]
    semidefinite = np.column_stack([-np.column_stack(columns), triangle(np.eye(n))])
    equality = np.append(np.ones(free.size), 0.0)[None, :]
    positive = np.column_stack([-np.eye(free.size), np.zeros(free.size)])
    A = sp.csc_matrix(np.vstack([equality, positive, semidefinite]))
    b = np.concatenate([[budget], np.zeros(free.size), triangle(known)])
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(free.size), clarabel.PSDTriangleConeT(n)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    objective = np.append(np.zeros(free.size), -1.0)
    nothing = sp.csc_matrix((free.size + 1, free.size + 1))
    answer = clarabel.DefaultSolver(nothing, objective, A, b, cones, settings).solve()
    if "Solved" not in str(answer.status):
        raise TrigpointError(f"the solver found no optimal weights: {answer.status}")
    Z = np.zeros((n, n))
    dual = np.asarray(answer.z)[1 + free.size :]
    Z[rows[0][order], rows[1][order]] = dual / scale[order]
    return np.asarray(answer.x)[:-1], Z + np.triu(Z, 1).T
