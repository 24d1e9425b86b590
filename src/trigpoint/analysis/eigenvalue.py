"""The smallest eigenvalue of the generalized Laplacian, with bounds that hold whatever the rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray, IntArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.blocks import Blocks, block_diagonal, expand
from trigpoint.linalg.ground_state import EngineName, ground_state
from trigpoint.linalg.sparse import factorize
from trigpoint.linalg.spectral import DENSE_LIMIT, smallest_eigenpair
from trigpoint.linalg.verified import (
    Couplings,
    collatz_wielandt_lower,
    collatz_wielandt_upper,
    down,
    is_positive_definite,
    rayleigh_upper,
)

_SHIFTS = (1e-9, 1e-8, 1e-6, 1e-4, 1e-2, 0.5)
_BLOCK_DENSE_LIMIT = 1500


@dataclass(frozen=True, eq=False)
class EigenvalueBound:
    """``lower <= lambda_min(L) <= upper`` for the stored weights, with the computed value between them.

    Attributes:
        value: computed smallest eigenvalue.
        lower, upper: rigorous bounds (rounding accounted for).
        residual: ``||L v - value v||`` for the unit vector v.
        vector: (N,) or (N d,) unit eigenvector, zero outside ``nodes``.
        nodes: the internal component where the smallest eigenvalue lives.
        unanchored: nodes of all components without external arc; not empty exactly when the value is 0.
        witness: the positive vector that proves ``lower`` (empty where another argument does).
    """

    value: float
    lower: float
    upper: float
    residual: float
    vector: FloatArray
    nodes: IntArray
    unanchored: IntArray
    witness: FloatArray

    @property
    def relative_width(self) -> float:
        """``(upper - lower) / value``; 0 for the exact value 0."""
        return 0.0 if self.value == 0.0 else (self.upper - self.lower) / self.value


def smallest_eigenvalue(graph: MeasurementGraph, *, engine: EngineName | None = None) -> EigenvalueBound:
    """Smallest eigenvalue of ``L = G W G^T`` with rigorous bounds, component by component.

    Dense up to 500 nodes, component by component; above, inverse iteration or Lanczos on the inverse, all from one
    sparse factorization (from 100 000 nodes on with the extra ``fast``, an approximate one). The lower bound is the
    Collatz-Wielandt quotient ``min_i (L x)_i / x_i`` of a positive x close to the ground state, or to the solution of
    ``(L - s I) x = 1`` with s just below the eigenvalue; the upper bound is the smaller of the quotient's maximum and
    the outward-rounded Rayleigh quotient summed arc by arc.

    Args:
        graph: the network; every component without an external arc gives 0.
        engine: ``superlu`` or ``approx-chol``, instead of the rule of ``linalg.ground_state.choose_engine``.

    We assume:
        * weights as stored in the graph (unit weights where it has none): ``lambda_min`` of a measured network is
          that of its unit-weight graph unless weights are set on purpose.

    A component without external arc gives 0 exactly, with the indicator of that component as vector. Weight blocks
    d x d are bounded through ``lambda_min(W_k)`` arc by arc (L is no M-matrix then), or below 1500 rows by a verified
    Cholesky factorization.

    Cost: one sparse factorization and some ten to hundred solves; O(N + M) for the bounds.
    Source: G16, Proposition 1; bounds after Barta (1937) and Collatz-Wielandt, theory 8-G1 with its caution.
    """
    if not isinstance(graph, MeasurementGraph):
        raise ArgumentError(f"graph must be a MeasurementGraph, such as problem.graph; got {type(graph).__name__}")
    unanchored = np.flatnonzero(~graph.component_is_anchored[graph.component_labels])
    if unanchored.size:
        return _floating(graph, unanchored)
    laplacian = graph.laplacian()
    if graph.n_nodes > DENSE_LIMIT and (graph.weight is None or graph.weight.ndim == 1):
        return _large(graph, laplacian, engine)
    value, vector, nodes = _over_components(graph, laplacian)
    residual = float(np.linalg.norm(laplacian @ vector - value * vector))
    if graph.weight is not None and graph.weight.ndim == 3:
        lower, upper, witness = _block_bounds(graph, laplacian, value, vector)
    else:
        lower, upper, witness = _scalar_bounds(couplings(graph), laplacian, value, vector)
    value = min(max(value, lower), upper)
    return EigenvalueBound(
        value, lower, upper, residual, frozen(vector), frozen(nodes, np.int64), frozen([], np.int64), frozen(witness)
    )


def _large(graph: MeasurementGraph, laplacian: sp.csr_array, engine: EngineName | None) -> EigenvalueBound:
    """Scalar weights and many nodes: everything from one factorization of the whole L."""
    matrix = couplings(graph)
    found = ground_state(matrix, laplacian, engine)
    label = graph.component_labels[int(np.argmax(np.abs(found.vector)))]
    inside = graph.component_labels == label
    vector = np.where(inside, found.vector, 0.0)
    vector /= np.linalg.norm(vector)
    upper = max(min(rayleigh_upper(matrix, vector), collatz_wielandt_upper(matrix, vector)), found.lower)
    value = min(max(found.value, found.lower), upper)
    residual = float(np.linalg.norm(laplacian @ vector - value * vector))
    nodes, none = np.flatnonzero(inside), frozen([], np.int64)
    return EigenvalueBound(
        value, found.lower, upper, residual, frozen(vector), frozen(nodes, np.int64), none, found.positive
    )


def couplings(graph: MeasurementGraph, weight: FloatArray | None = None) -> Couplings:
    """The graph's arcs as the couplings and groundings of a symmetric M-matrix (scalar weights)."""
    values = graph.arc_weights if weight is None else weight
    inner = ~graph.is_external
    return Couplings(
        graph.n_nodes, graph.tail[inner], graph.head[inner], values[inner], graph.head[~inner], values[~inner]
    )


def _floating(graph: MeasurementGraph, unanchored: IntArray) -> EigenvalueBound:
    label = graph.component_labels[unanchored[0]]
    nodes = np.flatnonzero(graph.component_labels == label)
    blocks = Blocks(graph.n_nodes, graph.dimension)
    vector = np.zeros((graph.n_nodes, graph.dimension))
    vector[nodes, 0] = 1.0 / np.sqrt(nodes.shape[0])
    none = frozen([])
    return EigenvalueBound(
        0.0, 0.0, 0.0, 0.0, frozen(blocks.stack(vector)), frozen(nodes, np.int64), frozen(unanchored, np.int64), none
    )  # fmt: skip


def _over_components(graph: MeasurementGraph, laplacian: sp.csr_array) -> tuple[float, FloatArray, IntArray]:
    blocks = Blocks(graph.n_nodes, graph.dimension)
    best = (np.inf, np.zeros(blocks.total), np.zeros(0, dtype=np.int64))
    components = graph.components
    for nodes in components:
        rows = blocks.positions(nodes)
        part = laplacian if len(components) == 1 else laplacian[rows][:, rows]
        value, vector = smallest_eigenpair(part)
        if value < best[0]:
            whole = np.zeros(blocks.total)
            whole[rows] = vector
            best = (value, whole, nodes)
    return best


def _scalar_bounds(
    matrix: Couplings, laplacian: sp.csr_array, value: float, vector: FloatArray
) -> tuple[float, float, FloatArray]:
    upper = min(rayleigh_upper(matrix, vector), collatz_wielandt_upper(matrix, vector))
    lower, witness = 0.0, np.zeros(0)
    start = min(value, upper)
    for shift in _SHIFTS:
        x = _positive_solution(matrix, laplacian, start * (1.0 - shift))
        bound = collatz_wielandt_lower(matrix, x)
        if bound > lower:
            lower, witness = bound, x
        if lower > start * (1.0 - 4.0 * shift):
            break
    return lower, max(upper, lower), witness


def _positive_solution(matrix: Couplings, laplacian: sp.csr_array, shift: float) -> FloatArray:
    """Solve ``(L - s I) x = 1``; positive when s lies below the smallest eigenvalue. Two steps of refinement."""
    ones = np.ones(laplacian.shape[0])
    try:
        factor = factorize(laplacian - shift * sp.eye_array(laplacian.shape[0]))
    except RuntimeError:  # exactly singular: the shift is not below the eigenvalue
        return -ones
    x = factor.solve(ones)
    for _ in range(2):
        product, _ = matrix.apply(x)
        x = x + factor.solve(ones - (product - shift * x))
    return np.asarray(x / (np.abs(x).max() or 1.0))


def _block_bounds(
    graph: MeasurementGraph, laplacian: sp.csr_array, value: float, vector: FloatArray
) -> tuple[float, float, FloatArray]:
    """Bounds for matrix weights: ``W_k >= l_k I`` gives ``L >= L(l) (x) I``; dense problems by verified Cholesky."""
    weight = graph.arc_weights
    least = np.array([_block_floor(block) for block in weight])
    lower, witness = 0.0, np.zeros(0)
    if (least > 0).all():
        floor = graph.with_weight(least)
        scalar_laplacian = floor.laplacian()
        guess, ground, _ = _over_components(floor, scalar_laplacian)
        lower, _, witness = _scalar_bounds(couplings(floor), scalar_laplacian, guess, ground)
    if laplacian.shape[0] <= _BLOCK_DENSE_LIMIT:
        dense = laplacian.toarray()
        dense = 0.5 * (dense + dense.T)
        # Assembly of the diagonal blocks rounds: at most (number of arcs + 1) u of the sum of absolute entries.
        radius = 2.0**-52 * (graph.n_arcs + 2) * absolute_assembly(graph)
        for shift in (1e-9, 1e-6, 1e-3, 0.1):
            trial = down(value * (1.0 - shift))
            shifted = dense - trial * np.eye(dense.shape[0])
            spread = radius + 2.0**-52 * (np.abs(dense) + trial * np.eye(dense.shape[0]))
            if trial > lower and is_positive_definite(shifted, spread):
                lower, witness = trial, np.zeros(0)
                break
    quotient = _block_rayleigh_upper(graph, vector)
    return lower, max(quotient, lower), witness


def absolute_assembly(graph: MeasurementGraph) -> FloatArray:
    """``|G| |W| |G|'`` dense, symmetric: the sizes of what was added up in L, where entries may have cancelled."""
    size = graph.dimension
    incidence = abs(graph.incidence())
    wide = expand(incidence, size)
    whole: FloatArray = (wide @ block_diagonal(np.abs(graph.arc_weights)) @ wide.T).toarray()
    return np.maximum(whole, whole.T)


def _block_floor(block: FloatArray) -> float:
    guess = float(np.linalg.eigvalsh(block)[0])
    identity = np.eye(block.shape[0])
    for shift in (1e-12, 1e-9, 1e-6, 1e-2):
        trial = down(guess * (1.0 - shift))
        spread = 2.0**-52 * (np.abs(block) + trial * identity)
        if trial > 0 and is_positive_definite(0.5 * (block + block.T) - trial * identity, spread):
            return trial
    return 0.0


def _block_rayleigh_upper(graph: MeasurementGraph, vector: FloatArray) -> float:
    x = Blocks(graph.n_nodes, graph.dimension).split(vector)
    difference = x[graph.head] - graph.at_tail(x, 0.0)
    weight = graph.arc_weights
    terms = np.einsum("ki,kij,kj->k", difference, weight, difference)
    size = np.einsum("ki,kij,kj->k", np.abs(difference), np.abs(weight), np.abs(difference))
    slack = 2.0**-53 * (2.0 * graph.n_arcs + 4.0 * graph.dimension**2 + 16.0)
    lost = 2.0**-1000 * weight.size  # what may have underflowed
    high = float(terms.sum()) + slack * float(size.sum()) * (1.0 + slack) + lost
    squares = float(vector @ vector) * (1.0 - 2.0**-53 * (2.0 * vector.shape[0] + 8.0))
    return float(np.nextafter(high * (1.0 + 2.0**-50) / squares, np.inf))
