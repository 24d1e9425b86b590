"""A homogeneous network as its modes: with ``L = sum lambda_k u_k u_k'`` the error splits into n x n systems.

Mode k moves by ``A_1 - gain lambda_k K_1 C_1`` with ``K_1 = Q_1 C_1' R_1^{-1}`` (G16, proof of Theorem 4).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.equations import spectral_abscissa

_ALL_EIGENVALUES = 2000
_SAMPLES = 400


def mode_matrices(A: FloatArray, injection: FloatArray, C: FloatArray, gains: FloatArray) -> FloatArray:
    """``A - g K C`` for each g in ``gains`` (gain times eigenvalue): (len(gains), n, n)."""
    return np.asarray(A - gains[:, None, None] * (injection @ C))


def computed_abscissa(
    graph: MeasurementGraph, A: FloatArray, injection: FloatArray, C: FloatArray, gain: float, lambda_min: float
) -> float | None:
    """Largest real part of the error spectrum.

    Over all modes up to 2000 nodes; above, the largest over 400 points between ``lambda_min`` and an upper bound of
    ``lambda_max``. None for d x d weight blocks on a large network, whose modes do not split.
    """
    if graph.dimension > 1:
        if graph.n_nodes * A.shape[0] > _ALL_EIGENVALUES:
            return None
        n_nodes = graph.n_nodes
        pull = np.kron(np.eye(n_nodes), gain * injection) @ graph.laplacian().toarray() @ np.kron(np.eye(n_nodes), C)
        return spectral_abscissa(np.kron(np.eye(n_nodes), A) - pull)
    if graph.n_nodes <= _ALL_EIGENVALUES:
        eigenvalues = np.maximum(la.eigvalsh(graph.laplacian().toarray()), lambda_min)
    else:
        eigenvalues = np.geomspace(max(lambda_min, 1e-300), largest_eigenvalue_bound(graph), _SAMPLES)
    return spectral_abscissa(mode_matrices(A, injection, C, gain * eigenvalues))


def largest_eigenvalue_bound(graph: MeasurementGraph) -> float:
    """``lambda_max <= max over arcs (d_i + d_j)`` with weighted degrees (external arcs count). Source: theory 8-G4.

    Weight blocks count with their largest eigenvalue.
    """
    weight = graph.arc_weights
    sizes = weight if weight.ndim == 1 else np.linalg.eigvalsh(weight)[:, -1]
    inner = ~graph.is_external
    degree = np.bincount(graph.head, sizes, graph.n_nodes) + np.bincount(graph.tail[inner], sizes[inner], graph.n_nodes)
    pairs = degree[graph.head[inner]] + degree[graph.tail[inner]]
    return float(max(pairs.max(initial=0.0), degree.max(initial=0.0)))


def guaranteed_rate(A: FloatArray, Q: FloatArray, information: FloatArray, level: float) -> float:
    """Largest a with ``A Q + Q A' - 2 level Q S Q + 2 a Q <= 0``, S = C' R^{-1} C: every mode decays at least so fast.

    With ``level = gain * l`` this holds for every mode with ``lambda >= l`` (the matrix inequality is monotone in
    lambda), hence for the whole network and for every network with ``lambda_min >= l``: ``V = e' (I (x) Q^{-1}) e``
    obeys ``V' <= -2 a V``. Source: G16, proof of Theorem 4; theory 8-G6. Cost O(n^3).
    """
    decrease = -(A @ Q + Q @ A.T) + 2.0 * level * Q @ information @ Q
    values = la.eigh(0.5 * (decrease + decrease.T), Q, eigvals_only=True)
    return 0.5 * float(values[0])
