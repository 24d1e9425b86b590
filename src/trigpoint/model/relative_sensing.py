"""Any linear system, one state a node, seen through the arcs of a measurement graph (R23, Section III)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_matrix
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph


@dataclass(frozen=True, eq=False)
class RelativeSensing:
    """A linear system ``x' = A x + B u`` with one state a node, measured by the arcs: ``y = G^T x``.

    An internal arc from i to j measures ``x_j - x_i`` (a relative observation), an external arc of j measures ``x_j``
    (an anchor). ``x`` is (n,), ``y`` is (M,) with one row an arc, in the order of the arcs.

    Args:
        A: (n, n) dynamics, 1/s; dense, or any SciPy sparse matrix, which stays sparse.
        graph: who is measured against whom; ``n = graph.n_nodes``.
        B: (n, m) known input; None for none.

    We assume:
        * the arcs measure without gain: arc weights, where the graph has any, play no part here.

    Raises:
        ShapeError: A is not (n, n), or B has not n rows; the message names both shapes.
        ArgumentError: NaN or infinity.

    Source: R23, Section III and Lemma 14; E-001-4.
    """

    A: FloatArray | sp.csr_array
    graph: MeasurementGraph
    B: FloatArray | None

    def __init__(self, A: ArrayLike | sp.sparray, graph: MeasurementGraph, B: ArrayLike | None = None) -> None:
        n = graph.n_nodes
        dynamics = _sparse_dynamics(A) if sp.issparse(A) else as_matrix("A", A)
        if dynamics.shape != (n, n):
            raise ShapeError(
                f"A must be square with one row a node of the graph, shape {(n, n)}; got shape {dynamics.shape}"
            )
        inputs = None if B is None else as_matrix("B", B)
        if inputs is not None and inputs.shape[0] != n:
            raise ShapeError(f"B must have one row a state of A {(n, n)}; got shape {inputs.shape}")
        object.__setattr__(self, "A", dynamics)
        object.__setattr__(self, "graph", graph)
        object.__setattr__(self, "B", inputs)

    @property
    def n_states(self) -> int:
        """Number n of states, one a node."""
        return self.graph.n_nodes

    @property
    def is_sparse(self) -> bool:
        """True when A is kept as a sparse matrix."""
        return bool(sp.issparse(self.A))

    def output(self) -> sp.csr_array:
        """``C = G^T``: sparse (M, n), a row -1, +1 for each internal arc and a row +1 for each external one.

        Cost O(n + M). Source: R23, Section III.
        """
        return sp.csr_array(self.graph.incidence().T)

    def __repr__(self) -> str:
        kind = "sparse" if self.is_sparse else "dense"
        return f"RelativeSensing({self.n_states} states, {kind} A, {self.graph.n_arcs} measurements)"


def _sparse_dynamics(value: Any) -> sp.csr_array:
    """A frozen copy in CSR form; NaN, infinity and complex entries are refused."""
    if value.dtype.kind not in "biuf":
        raise ArgumentError(f"A must be an array of real numbers; got a sparse matrix of dtype {value.dtype}")
    matrix = sp.csr_array(value, dtype=np.float64, copy=True)
    matrix.sum_duplicates()
    bad = np.flatnonzero(~np.isfinite(matrix.data))
    if bad.size:
        entries = matrix.tocoo()
        position = (int(entries.row[bad[0]]), int(entries.col[bad[0]]))
        raise ArgumentError(f"A must be finite; got {matrix.data[bad[0]]} at position {position}")
    for part in (matrix.data, matrix.indices, matrix.indptr):
        part.setflags(write=False)
    return matrix
