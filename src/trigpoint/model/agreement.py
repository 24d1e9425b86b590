"""Agreement dynamics (consensus) of which some nodes are measured (R23, Section VI)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from trigpoint.arrays import IntArray, as_indices, frozen
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph


@dataclass(frozen=True, eq=False)
class AgreementDynamics:
    """Agreement dynamics ``x' = -L x`` with the absolute states of some nodes measured: ``y = E' x``.

    ``L`` (N, N) is the ordinary Laplacian of the *internal* arcs of ``graph``, with their weights; external arcs are
    ignored. ``E'`` (k, N) has one row ``e_i'`` for each measured node i. ``x`` is (N,), in 1/s where weights are.

    Args:
        graph: who follows whom; the direction of an arc plays no part.
        measured: indices of the measured nodes, at least one; kept ascending, each once.

    We assume:
        * scalar arc weights (one state a node).

    Raises:
        ArgumentError: no measured node, or an index outside 0..N-1.
        ShapeError: weight blocks larger than 1 x 1.

    Source: R23, Section VI, system (3).
    """

    graph: MeasurementGraph
    measured: IntArray

    def __init__(self, graph: MeasurementGraph, measured: ArrayLike) -> None:
        if graph.dimension != 1:
            raise ShapeError(
                f"agreement dynamics has one state a node and needs scalar arc weights; "
                f"the graph's weight blocks are {graph.dimension} x {graph.dimension}"
            )
        nodes = np.unique(as_indices("measured", np.atleast_1d(np.asarray(measured)), 0, graph.n_nodes))
        if not nodes.size:
            raise ArgumentError("measured must list at least one node; got none: nothing would be observed")
        object.__setattr__(self, "graph", graph)
        object.__setattr__(self, "measured", frozen(nodes, np.int64))

    @property
    def n_states(self) -> int:
        """Number N of states, one a node."""
        return self.graph.n_nodes

    def laplacian(self) -> sp.csr_array:
        """``L`` of the internal arcs: sparse (N, N), rows sum to zero. Cost O(N + M). Source: R23, Section VI."""
        inner = ~self.graph.is_external
        weight = None if self.graph.weight is None else self.graph.weight[inner]
        internal = MeasurementGraph(self.graph.n_nodes, self.graph.tail[inner], self.graph.head[inner], weight)
        return internal.laplacian()

    def dynamics(self) -> sp.csr_array:
        """``-L``: sparse (N, N), rows sum to zero. Cost O(N + M). Source: R23, Section VI, system (3)."""
        return sp.csr_array(-self.laplacian())

    def output(self) -> sp.csr_array:
        """``E'``: sparse (k, N), row r is the unit row of measured node r. Source: R23, Section VI, system (3)."""
        count = self.measured.shape[0]
        return sp.csr_array((np.ones(count), (np.arange(count), self.measured)), shape=(count, self.n_states))

    def __repr__(self) -> str:
        return f"AgreementDynamics({self.n_states} nodes, {self.measured.shape[0]} measured)"
