"""The engine of the recommendations: what one further arc does to ``tr(L^-1)`` and to ``lambda_min``, for many arcs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from trigpoint.analysis.redundancy import InverseEntries, free_nodes
from trigpoint.arrays import BoolArray, FloatArray, IntArray
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.rank_one import COMPLETE_LIMIT, Tail, smallest_after, spectrum
from trigpoint.linalg.sparse import factorize

_CHUNK_ENTRIES = 4_000_000
_LAZY_BATCH = 32
_SHORTLIST = 256
_GROUND = -1


@dataclass(frozen=True, eq=False)
class Choices:
    """Arcs that may be added, (K,) each: ``tail`` (EXTERNAL for anchors), ``head``, ``weight``, ``cost``, ``left``."""

    tail: IntArray
    head: IntArray
    weight: FloatArray
    cost: FloatArray
    left: BoolArray

    def without(self, chosen: int) -> Choices:
        """The choices left after one is taken."""
        left = self.left.copy()
        left[chosen] = False
        return replace(self, left=left)

    def within(self, budget: float) -> Choices:
        """The choices left that ``budget`` can pay."""
        return replace(self, left=self.left & (self.cost <= budget * (1.0 + 1e-12)))

    def incidence(self, count: int, chosen: IntArray) -> sp.csc_array:
        """Columns ``e_head - e_tail`` (only ``e_head`` for anchors) of the chosen arcs, (count, len(chosen))."""
        inner = np.flatnonzero(self.tail[chosen] != EXTERNAL)
        rows = np.concatenate([self.head[chosen], self.tail[chosen][inner]])
        columns = np.concatenate([np.arange(chosen.shape[0]), inner])
        entries = np.concatenate([np.ones(chosen.shape[0]), -np.ones(inner.shape[0])])
        return sp.csc_array((entries, (rows, columns)), shape=(count, chosen.shape[0]))

    def ends(self, table: NDArray[Any], ground: Any) -> tuple[NDArray[Any], NDArray[Any]]:
        """Entries of a per-node ``table`` at heads and tails, ``ground`` at the tails of anchors."""
        outer = self.tail == EXTERNAL
        return table[self.head], np.where(outer, ground, table[np.where(outer, 0, self.tail)])


def with_arc(graph: MeasurementGraph, choices: Choices, chosen: int) -> MeasurementGraph:
    """The graph with one of the choices added as its last arc."""
    weight = None
    if graph.weight is not None or choices.weight[chosen] != 1.0:
        weight = np.append(graph.arc_weights, choices.weight[chosen])
    return MeasurementGraph(
        graph.n_nodes,
        np.append(graph.tail, choices.tail[chosen]),
        np.append(graph.head, choices.head[chosen]),
        weight,
        graph.names,
    )


def first_best(score: FloatArray, allowed: IntArray) -> int:
    """The allowed index with the greatest score; of equals (to 9 digits) the first: rounding decides nothing."""
    best = float(score.max())
    close = score >= best - 1e-9 * abs(best)
    return int(allowed[np.flatnonzero(close)[0]])


# -- attaching components that no anchor holds ---------------------------------------------------------------------
def touching(graph: MeasurementGraph, choices: Choices, order: IntArray) -> tuple[int, IntArray]:
    """The first component in ``order`` that a choice joins to something outside it, and these choices."""
    here, there = choices.ends(graph.component_labels, _GROUND)
    for label in order.tolist():
        found = np.flatnonzero(choices.left & (here != there) & ((here == label) | (there == label)))
        if found.size:
            return label, found
    return -1, np.zeros(0, dtype=np.int64)


def floating_components(graph: MeasurementGraph) -> IntArray:
    """Labels of the components without anchor, the largest first."""
    size = np.bincount(graph.component_labels)
    labels = np.flatnonzero(~graph.component_is_anchored)
    found: IntArray = labels[np.argsort(-size[labels], kind="stable")]
    return found


def attach(graph: MeasurementGraph, choices: Choices) -> int | None:
    """The choice that attaches the largest attachable floating component with the least total variance; exact.

    Attaching component C by its node i to a node j outside (or the ground) leaves all other variances as they are and
    gives C ``sum_u (R(u, i) + 1/w + Z_jj) = n (L+)_ii + tr L+ + n (1/w + Z_jj)``, with the pseudoinverse of its
    Laplacian. Ends at anchored nodes and at the ground are preferred to those at other floating components.
    """
    label, found = touching(graph, choices, floating_components(graph))
    if not found.size:
        return None
    here, there = choices.ends(graph.component_labels, _GROUND)
    other = np.where(here == label, there, here)[found]
    anchored = (other == _GROUND) | graph.component_is_anchored[np.maximum(other, 0)]
    if anchored.any():
        found = found[anchored]
    level = _relative_variances(graph)
    at_head, at_tail = choices.ends(level, 0.0)
    size = int((graph.component_labels == label).sum())
    total = size * (1.0 / choices.weight + at_head + at_tail)[found]
    total += float(level[graph.component_labels == label].sum())
    return first_best(-total * choices.cost[found], found)


def _relative_variances(graph: MeasurementGraph) -> FloatArray:
    """Diagonal of the inverse on anchored components, of the pseudoinverse on floating ones, (N,)."""
    inverse = InverseEntries.of(graph)
    nodes = np.arange(graph.n_nodes)
    diagonal = inverse.at(nodes, nodes, [(0, 0)])[:, 0]
    if inverse.factor is None:
        return diagonal
    labels, free = graph.component_labels, free_nodes(graph)
    sums = np.zeros(graph.n_nodes)
    size = np.bincount(labels).astype(np.float64)
    sums[free] = inverse.factor.solve(np.ones(free.shape[0]))  # Z 1, component by component
    total = np.bincount(labels, sums)
    floating = ~graph.component_is_anchored[labels]
    centred = diagonal - 2.0 * sums / size[labels] + (total / size**2)[labels]
    return np.where(floating, centred, diagonal)


# -- total variance ------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class VarianceGains:
    """Decrease of ``tr(L^-1)`` for each choice, ``w |Z b|^2 / (1 + w b' Z b)``; bounds from earlier steps are kept.

    For anchors the decrease never grows when others are added (Z >= 0 entrywise shrinks), so that an earlier value is
    an upper bound and most choices need no new solve. For arcs between nodes that is not so: all are computed anew.
    """

    bound: FloatArray

    def best(self, graph: MeasurementGraph, choices: Choices) -> tuple[int, VarianceGains]:
        """The choice with the greatest decrease for its cost, and the bounds for the next step."""
        factor = factorize(graph.laplacian())
        is_lazy = bool((choices.tail == EXTERNAL).all())
        is_first = is_lazy and np.isinf(self.bound).all() and graph.n_nodes > COMPLETE_LIMIT
        bound = _first_bounds(graph, choices) if is_first else self.bound.copy()
        waiting = np.flatnonzero(choices.left)
        waiting = waiting[np.argsort(-(bound / choices.cost)[waiting], kind="stable")]
        batch = _LAZY_BATCH if is_lazy and np.isfinite(bound).any() else max(1, _CHUNK_ENTRIES // graph.n_nodes)
        done: list[IntArray] = []
        best = -np.inf
        while waiting.size:
            now, waiting = waiting[:batch], waiting[batch:]
            b = choices.incidence(graph.n_nodes, now).toarray()
            z = factor.solve(b)
            weight = choices.weight[now]
            bound[now] = weight * np.einsum("ik,ik->k", z, z) / (1.0 + weight * np.einsum("ik,ik->k", b, z))
            done.append(now)
            best = max(best, float((bound / choices.cost)[now].max()))
            if is_lazy and waiting.size and float((bound / choices.cost)[waiting[0]]) < best * (1.0 - 1e-9):
                break
        known = np.sort(np.concatenate(done))
        return first_best((bound / choices.cost)[known], known), VarianceGains(bound)


def _first_bounds(graph: MeasurementGraph, choices: Choices) -> FloatArray:
    """Upper bounds of the decreases for anchors, from ``diag(L^-1)`` and the lowest eigenpairs, without a solve each.

    ``(L^-2)_ii = sum_j v_ij^2 / lambda_j^2 <= (known pairs) + (rest of (L^-1)_ii) / lambda_p``.
    """
    nodes = np.arange(graph.n_nodes)
    lowest = spectrum(graph.laplacian())
    diagonal = InverseEntries.of(graph).at(nodes, nodes, [(0, 0)])[choices.head, 0]
    squares = lowest.vectors[choices.head] ** 2
    rest, _ = lowest.outside(squares, diagonal, diagonal)
    length = squares @ lowest.values**-2.0 + rest / lowest.values[-1]
    return np.asarray(choices.weight * length / (1.0 + choices.weight * diagonal) * (1.0 + 1e-6))


def variance_after(graph: MeasurementGraph, choices: Choices, chosen: int, before: float) -> float:
    """``tr(L^-1)`` after one choice, from its value ``before``: one factorization and one solve (Sherman-Morrison)."""
    if not np.isfinite(before):
        return total_variance(with_arc(graph, choices, chosen))
    b = choices.incidence(graph.n_nodes, np.array([chosen])).toarray()[:, 0]
    z = factorize(graph.laplacian()).solve(b)
    weight = float(choices.weight[chosen])
    return before - weight * float(z @ z) / (1.0 + weight * float(b @ z))


def total_variance(graph: MeasurementGraph) -> float:
    """``tr(L^-1)``; infinity where a node has no path to an anchor. Cost: one factorization, one solve a node."""
    if not graph.is_externally_connected:
        return float("inf")
    nodes = np.arange(graph.n_nodes)
    return float(InverseEntries.of(graph).at(nodes, nodes, [(0, 0)]).sum())


# -- smallest eigenvalue -------------------------------------------------------------------------------------------
def eigenvalues_after(graph: MeasurementGraph, choices: Choices, found: IntArray, label: int) -> FloatArray:
    """Smallest eigenvalue, after each choice in ``found``, of what it makes of component ``label``, (len(found),).

    That is the component itself, or its union with the one at the other end. Exact up to rounding for unions up to
    800 nodes; above an upper estimate from the lowest 24 eigenpairs (Ritz), and for more than 256 choices a rougher
    one for all but the best 256.
    """
    here, there = (ends[found] for ends in choices.ends(graph.component_labels, _GROUND))
    other = np.where(here == label, there, here)
    result = np.zeros(found.shape[0])
    for partner in np.unique(other).tolist():
        chosen = np.flatnonzero(other == partner)
        nodes = np.flatnonzero(np.isin(graph.component_labels, [label, partner]))
        result[chosen] = _after(graph, choices, found[chosen], nodes)
    return result


def _after(graph: MeasurementGraph, choices: Choices, found: IntArray, nodes: IntArray) -> FloatArray:
    # A shift of the size of the result keeps a floating component's matrix positive definite; it is taken off again.
    shift = float(choices.weight[found].min()) / nodes.shape[0]
    rows = Blocks(graph.n_nodes, 1).positions(nodes)
    part = sp.csc_array(graph.laplacian()[rows][:, rows] + shift * sp.eye_array(nodes.shape[0]))
    lowest = spectrum(part)
    b = sp.csc_array(choices.incidence(graph.n_nodes, found).tocsr()[nodes])
    squares = (b.T @ lowest.vectors) ** 2
    weight = choices.weight[found]
    value = smallest_after(lowest, squares, weight)
    if not lowest.is_complete:
        keep = np.argsort(-value, kind="stable")[:_SHORTLIST]
        columns = b[:, keep].toarray()
        z = factorize(part).solve(columns)
        rho, nu = lowest.outside(squares[keep], np.einsum("ik,ik->k", columns, z), np.einsum("ik,ik->k", z, z))
        refined = smallest_after(lowest, squares[keep], weight[keep], Tail.least(lowest, rho, nu))
        value = np.minimum(value, refined.min())
        value[keep] = refined
    return np.asarray(np.maximum(value - shift, 0.0))
