"""What happens when one measurement is lost: every arc and every anchor removed in turn (N - 1 study)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from trigpoint.analysis.critical import Critical, critical
from trigpoint.analysis.diagnosis import listing
from trigpoint.analysis.eigenvalue import EigenvalueBound, smallest_eigenvalue
from trigpoint.analysis.gain import gain_bound
from trigpoint.arrays import BoolArray, FloatArray, IntArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.rank_one import Tail, smallest_after, spectrum
from trigpoint.linalg.sparse import Factorization, factorize

_CHUNK_ENTRIES = 4_000_000


@dataclass(frozen=True, eq=False)
class Contingency:
    """The loss of each arc, the worst first (all arrays have one entry a loss, in that order).

    Attributes:
        arcs: which arc (internal or external) is lost.
        eigenvalue: smallest eigenvalue without it; 0 where nodes float.
        lower: a lower bound of it: rigorous where ``confirmed``, else up to the rounding of the rank-one update.
        gain_bound: gain needed without it, ``1 / lower``; infinity where nodes float.
        deviation_increase: largest growth of a node's standard deviation (unit variance factor); infinity where nodes
            float.
        deviation_node: the node that suffers it (the first floating one where nodes float).
        floating: how many nodes lose every path to an anchor.
        confirmed: true where the eigenvalue was computed anew with rigorous bounds or is exactly 0; false where it
            comes from the rank-one update.
        before: the smallest eigenvalue of the whole network.
        critical: the arcs whose loss leaves nodes floating, and which nodes.
    """

    arcs: IntArray
    eigenvalue: FloatArray
    lower: FloatArray
    gain_bound: FloatArray
    deviation_increase: FloatArray
    deviation_node: IntArray
    floating: IntArray
    confirmed: BoolArray
    before: EigenvalueBound
    critical: Critical

    @property
    def change(self) -> FloatArray:
        """``lambda_min`` after the loss minus before: never positive but for rounding."""
        return np.asarray(self.eigenvalue - self.before.value)

    def verdict(self, position: int) -> str:
        """``observable``, or which nodes float, after the loss ``arcs[position]``."""
        if not self.floating[position]:
            return "observable"
        return f"{listing(self.critical.graph, self.critical.lost_without(int(self.arcs[position])))} float"

    def summary(self, count: int = 10) -> str:
        """The ``count`` worst losses as a table, a line each."""
        graph = self.critical.graph
        lines = [f"whole network: lambda_min {self.before.value:.4g}, gain bound {gain_bound(self.before):.4g}"]
        lines += [
            f"without {graph.arc_label(int(self.arcs[k]))}: lambda_min {self.eigenvalue[k]:.4g}, "
            f"gain bound {self.gain_bound[k]:.4g}, deviation +{self.deviation_increase[k]:.3g}, {self.verdict(k)}"
            for k in range(min(count, self.arcs.shape[0]))
        ]
        return "\n".join(lines)


def without_each(graph: MeasurementGraph, *, confirm: int = 5) -> Contingency:
    """Remove each arc and each anchor of ``graph`` in turn and say what is left, the worst loss first.

    Without arc k the Laplacian is ``L - w b b'``. Its smallest eigenvalue is the smallest root of the secular equation
    ``1 = w sum_j (v_j' b)^2 / (lambda_j - mu)``, with all eigenpairs up to 800 nodes; above, with the 24 lowest ones
    and the rest bounded on both sides through ``b' L^-1 b`` and ``b' L^-2 b``. Standard deviations follow from
    ``(L - w b b')^-1 = L^-1 + w (L^-1 b)(L^-1 b)' / (1 - w b' L^-1 b)``. Arcs whose loss leaves nodes floating
    (bridges) come first, those that cut off most nodes first.

    Args:
        graph: an externally connected network with scalar weights (inverse variances for the deviations).
        confirm: so many of the worst losses without floating nodes are computed anew, with rigorous bounds.

    We assume:
        * one loss at a time; an anchor is lost with its external arc.

    Raises:
        ArgumentError: nodes without any path to an anchor, weight blocks, a negative ``confirm``.

    Cost: three sparse factorizations, one solve a node and one an arc, ``confirm`` eigenvalue bounds.
    Source: G16, Proposition 1 and Theorem 4; BarooahHespanha2007, theory 7-H3.
    """
    _check(graph, confirm)
    before, found = smallest_eigenvalue(graph), critical(graph)
    floating = np.zeros(graph.n_arcs, dtype=np.int64)
    floating[found.arcs] = found.arc_losses
    floating[found.anchors] = found.anchor_losses
    safe = np.flatnonzero(floating == 0)
    losses = _Losses.of(graph, safe)
    eigenvalue, lower = np.zeros(graph.n_arcs), np.zeros(graph.n_arcs)
    eigenvalue[safe], lower[safe] = losses.eigenvalues(graph)
    increase, node = np.full(graph.n_arcs, np.inf), np.zeros(graph.n_arcs, dtype=np.int64)
    increase[safe], node[safe] = losses.growth, losses.where
    for arc in np.flatnonzero(floating).tolist():
        node[arc] = found.lost_without(arc)[0]
    arcs = np.arange(graph.n_arcs)
    gains = _inverse(lower)
    table = Contingency(arcs, eigenvalue, lower, gains, increase, node, floating, floating > 0, before, found)
    return _confirmed(_sorted(table), graph, confirm)


def _check(graph: MeasurementGraph, confirm: int) -> None:
    if isinstance(confirm, bool) or not isinstance(confirm, (int, np.integer)) or confirm < 0:
        raise ArgumentError(f"confirm must be a whole number of at least 0; got {confirm!r}")
    if graph.weight is not None and graph.weight.ndim == 3:
        raise ArgumentError(
            f"without_each takes scalar weights; got {graph.dimension} x {graph.dimension} blocks. "
            "Study the axes one by one, or use graph.with_weight(None)"
        )
    if not graph.is_externally_connected:
        nodes = np.flatnonzero(~graph.component_is_anchored[graph.component_labels])
        raise ArgumentError(
            f"without_each needs a path to an anchor from every node; {listing(graph, nodes)} have none. "
            "Anchor each component first (recommend_anchors says where), or study graph.subgraph of the anchored nodes"
        )


@dataclass(frozen=True, eq=False)
class _Losses:
    """One column ``z = L^-1 b`` an arc, reduced to what is needed of it.

    Attributes:
        arcs: the K arcs, none of them a bridge.
        resistance, length: (K,) ``b' z`` and ``z' z``.
        growth, where: (K,) the largest growth of a standard deviation without the arc, and the node.
    """

    arcs: IntArray
    resistance: FloatArray
    length: FloatArray
    growth: FloatArray
    where: IntArray

    @staticmethod
    def of(graph: MeasurementGraph, arcs: IntArray) -> _Losses:
        factor = factorize(graph.laplacian())
        diagonal = _diagonal_of_inverse(factor, graph.n_nodes)
        incidence = sp.csc_array(graph.incidence())
        resistance, length, growth = (np.zeros(arcs.shape[0]) for _ in range(3))
        where = np.zeros(arcs.shape[0], dtype=np.int64)
        width = max(1, _CHUNK_ENTRIES // graph.n_nodes)
        for start in range(0, arcs.shape[0], width):
            here = slice(start, start + width)
            b = incidence[:, arcs[here]].toarray()
            z = factor.solve(b)
            resistance[here], length[here] = np.einsum("ik,ik->k", b, z), np.einsum("ik,ik->k", z, z)
            weight = graph.arc_weights[arcs[here]]
            added = weight / np.maximum(1.0 - weight * resistance[here], 1e-300)
            change = np.sqrt(diagonal[:, None] + z**2 * added) - np.sqrt(diagonal)[:, None]
            where[here], growth[here] = change.argmax(axis=0), change.max(axis=0)
        return _Losses(arcs, resistance, length, growth, where)

    def eigenvalues(self, graph: MeasurementGraph) -> tuple[FloatArray, FloatArray]:
        """Smallest eigenvalue without each arc, and a lower bound of it (the same where all eigenpairs are known)."""
        lowest = spectrum(graph.laplacian())
        squares = (lowest.vectors[graph.head[self.arcs]] - graph.at_tail(lowest.vectors, 0.0)[self.arcs]) ** 2
        weight = -graph.arc_weights[self.arcs]
        if lowest.is_complete:
            value = smallest_after(lowest, squares, weight)
            return value, value
        rho, nu = lowest.outside(squares, self.resistance, self.length)
        value = smallest_after(lowest, squares, weight, Tail.least(lowest, rho, nu))
        lower = smallest_after(lowest, squares, weight, Tail.greatest(lowest, rho, nu))
        return value, np.minimum(value, lower)


def _diagonal_of_inverse(factor: Factorization, count: int) -> FloatArray:
    diagonal = np.zeros(count)
    width = max(1, _CHUNK_ENTRIES // count)
    for start in range(0, count, width):
        stop = min(start + width, count)
        unit = np.zeros((count, stop - start))
        unit[np.arange(start, stop), np.arange(stop - start)] = 1.0
        diagonal[start:stop] = factor.solve(unit)[np.arange(start, stop), np.arange(stop - start)]
    return np.maximum(diagonal, 0.0)


def _inverse(lower: FloatArray) -> FloatArray:
    return np.divide(1.0, lower, out=np.full_like(lower, np.inf), where=lower > 0.0)


def _sorted(table: Contingency) -> Contingency:
    # Equal losses of a symmetric network differ by rounding: those computed with bounds come first among them.
    level = np.array([float(f"{value:.9g}") for value in table.eigenvalue])
    order = np.lexsort((table.arcs, -table.deviation_increase, ~table.confirmed, level, -table.floating))
    return replace(
        table,
        arcs=frozen(table.arcs[order], np.int64),
        eigenvalue=frozen(table.eigenvalue[order]),
        lower=frozen(table.lower[order]),
        gain_bound=frozen(table.gain_bound[order]),
        deviation_increase=frozen(table.deviation_increase[order]),
        deviation_node=frozen(table.deviation_node[order], np.int64),
        floating=frozen(table.floating[order], np.int64),
        confirmed=frozen(table.confirmed[order], np.bool_),
    )


def _confirmed(table: Contingency, graph: MeasurementGraph, count: int) -> Contingency:
    """Recompute the worst ``count`` losses that leave every node anchored, with rigorous bounds; sort again."""
    eigenvalue, lower, confirmed = table.eigenvalue.copy(), table.lower.copy(), table.confirmed.copy()
    for position in np.flatnonzero(table.floating == 0)[:count].tolist():
        bound = smallest_eigenvalue(graph.without_arcs([int(table.arcs[position])]))
        eigenvalue[position], lower[position], confirmed[position] = bound.value, bound.lower, True
    return _sorted(replace(table, eigenvalue=eigenvalue, lower=lower, gain_bound=_inverse(lower), confirmed=confirmed))
