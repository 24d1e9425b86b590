"""How far the other measurements check each one: local redundancy numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray, IntArray, frozen
from trigpoint.graphs import MeasurementGraph
from trigpoint.graphs.bridges import bridges
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.selected_inverse import entries_of_inverse
from trigpoint.linalg.sparse import Factorization, factorize


def redundancy(graph: MeasurementGraph) -> FloatArray:
    """Local redundancy number of every arc: the share of its error that the other measurements uncover, (M,).

    ``r_k = 1 - w_k R_k`` with the effective resistance ``R_k = b_k' L^-1 b_k`` across the arc (``b_k`` is its column
    of the generalized incidence matrix); for d x d weight blocks ``r_k = 1 - tr(W_k B_k' L^-1 B_k) / d``. 0: nothing
    checks the arc (exactly 0 for bridges); near 1: it adds nothing new. The sum is ``M - N`` on an anchored graph and
    one more for each component of ``graph`` without anchor, whose first node is then the reference (the numbers do
    not depend on that choice).

    We assume:
        * the graph's weights are inverse variances of uncorrelated measurements (unit weights where it has none).

    Cost: one sparse factorization; up to 1500 unknowns a solve each, above the selected inverse, which takes one
    Python step an entry of the factor. Source: BarooahHespanha2007, theory 7-H3; G16, Section 2.
    """
    numbers = 1.0 - np.sum(leverages(graph), axis=1) / graph.dimension
    numbers[bridges(graph)] = 0.0
    return frozen(np.clip(numbers, 0.0, 1.0))


def leverages(graph: MeasurementGraph) -> FloatArray:
    """Diagonal of ``W_k B_k' L^-1 B_k`` for every arc k: (M, d), the share of an arc in its own adjusted value.

    Each component of ``graph`` without anchor is solved relative to its first node. Cost as for ``redundancy``.
    """
    d = graph.dimension
    inverse = InverseEntries.of(graph)
    pairs = [(a, b) for a in range(d) for b in range(d)]
    tail = graph.at_tail(np.arange(graph.n_nodes), -1)
    head = graph.head
    first = np.concatenate([head, tail, head, tail])
    second = np.concatenate([head, tail, tail, head])
    found = inverse.at(first, second, pairs).reshape(4, graph.n_arcs, d, d)
    resistance = found[0] + found[1] - found[2] - found[3]
    weight = graph.arc_weights.reshape(graph.n_arcs, d, d)
    return np.asarray(np.einsum("kab,kba->ka", weight, resistance))


@dataclass(frozen=True, eq=False)
class InverseEntries:
    """Entries of the inverse Laplacian of the free nodes; 0 for the environment and for reference nodes."""

    blocks: Blocks
    position: IntArray
    factor: Factorization | None

    @staticmethod
    def of(graph: MeasurementGraph) -> InverseEntries:
        """Factor the Laplacian of ``graph`` on its free nodes."""
        blocks = Blocks(graph.n_nodes, graph.dimension)
        free = free_nodes(graph)
        position = np.full(graph.n_nodes + 1, -1, dtype=np.int64)
        position[free] = np.arange(free.shape[0])
        if not free.size:
            return InverseEntries(blocks, position, None)
        rows = blocks.positions(free)
        return InverseEntries(blocks, position, factorize(graph.laplacian()[rows][:, rows]))

    def at(self, first: IntArray, second: IntArray, pairs: list[tuple[int, int]]) -> FloatArray:
        """Blocks of the inverse at node pairs (node -1: the environment), (len(first), len(pairs))."""
        a, b = self.position[first], self.position[second]
        inner = (a >= 0) & (b >= 0)
        result = np.zeros((first.shape[0], len(pairs)))
        if self.factor is None or not inner.any():
            return result
        row_blocks = self.blocks.positions(a[inner]).reshape(-1, self.blocks.size)
        column_blocks = self.blocks.positions(b[inner]).reshape(-1, self.blocks.size)
        rows = np.concatenate([row_blocks[:, p] for p, _ in pairs])
        columns = np.concatenate([column_blocks[:, q] for _, q in pairs])
        found = entries_of_inverse(self.factor, int(self.position.max() + 1) * self.blocks.size, rows, columns)
        result[inner] = found.reshape(len(pairs), -1).T
        return result


def free_nodes(graph: MeasurementGraph) -> IntArray:
    """All nodes of ``graph`` but the first one of each component without anchor, ascending."""
    first = np.full(graph.component_is_anchored.shape[0], graph.n_nodes, dtype=np.int64)
    np.minimum.at(first, graph.component_labels, np.arange(graph.n_nodes))
    free = np.ones(graph.n_nodes, dtype=np.bool_)
    free[first[~graph.component_is_anchored]] = False
    found: IntArray = np.flatnonzero(free)
    return found
