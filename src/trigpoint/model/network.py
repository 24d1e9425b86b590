"""A measured network: a graph with the numbers on its arcs, as read from a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from trigpoint.arrays import BoolArray, FloatArray, IntArray, as_floats, as_indices, frozen, require_finite
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.linalg.blocks import Blocks

Covariance: TypeAlias = Any
"""(M,) variances, (M, d, d) blocks, or a ``scipy.sparse.csr_array`` (M d, M d); SciPy's types are not checked."""


@dataclass(frozen=True, eq=False)
class Network:
    """Measurements on the arcs of a graph: ``values[k] = x[head] - x[tail]``, or ``x[head]`` for an external arc.

    Args:
        graph: who measures whom.
        values: (M,) or (M, d) measured values, in the data's own unit.
        covariance: None (unknown: unit weights), (M,) variances, (M, d, d) blocks, or a sparse (M d, M d) matrix of
            jointly correlated arcs (arc-major).
        exact: (M,) true for external arcs without error (an exactly known value); their covariance is not used.
        known: nodes that are known marks (a fixed point of a survey): each has exactly one external arc, an exact one.
            A known mark announces its value and estimates nothing.
        positions: (N, 2) places for a picture, NaN where unknown; None for none.
        unit: unit of the values, for reports.
        title: what the network is and where it was published.
        columns: further columns of the file, one text an arc; kept and written back.

    Raises:
        ShapeError: shapes that do not fit the graph.
        ArgumentError: a value that is not finite, a variance that is not positive, an exact internal arc, two exact
            readings of one node that disagree.
    """

    graph: MeasurementGraph
    values: FloatArray
    covariance: Covariance | None = None
    exact: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    known: tuple[int, ...] = ()
    positions: FloatArray | None = None
    unit: str = ""
    title: str = ""
    columns: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __init__(
        self,
        graph: MeasurementGraph,
        values: ArrayLike,
        covariance: ArrayLike | sp.sparray | None = None,
        *,
        exact: ArrayLike | None = None,
        known: Sequence[int] = (),
        positions: ArrayLike | None = None,
        unit: str = "",
        title: str = "",
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        numbers = as_floats("values", values)
        if numbers.ndim not in (1, 2) or numbers.shape[0] != graph.n_arcs:
            raise ShapeError(f"values must have shape ({graph.n_arcs},) or ({graph.n_arcs}, d); got {numbers.shape}")
        if graph.weight is not None and graph.weight.ndim == 3 and graph.dimension != _width(numbers):
            raise ShapeError(
                f"the graph's weight blocks are {graph.dimension} x {graph.dimension}, but a measurement has "
                f"{_width(numbers)} numbers"
            )
        mask = np.zeros(graph.n_arcs, dtype=np.bool_) if exact is None else np.asarray(exact, dtype=np.bool_)
        _check_exact(graph, numbers, mask)
        object.__setattr__(self, "graph", graph)
        object.__setattr__(self, "values", numbers)
        object.__setattr__(self, "exact", frozen(mask, np.bool_))
        object.__setattr__(self, "covariance", _checked_covariance(covariance, numbers, mask))
        object.__setattr__(self, "known", tuple(int(k) for k in as_indices("known", known, 0, graph.n_nodes)))
        object.__setattr__(self, "positions", _checked_positions(positions, graph.n_nodes))
        object.__setattr__(self, "unit", unit)
        object.__setattr__(self, "title", title)
        object.__setattr__(self, "columns", {name: tuple(texts) for name, texts in (columns or {}).items()})
        self._check_known()
        for name, texts in self.columns.items():
            if len(texts) != graph.n_arcs:
                raise ShapeError(f"column {name!r} must hold one text an arc ({graph.n_arcs}); got {len(texts)}")

    @property
    def dimension(self) -> int:
        """Number d of values in one measurement."""
        return _width(self.values)

    def __repr__(self) -> str:
        exact = int(self.exact.sum())
        return f"Network({self.graph!r}, {self.dimension} numbers an arc, {exact} exact, {len(self.known)} known marks)"

    def known_values(self) -> dict[int, FloatArray]:
        """Value (d,) of each known mark, by node."""
        table = self.values.reshape(self.graph.n_arcs, -1)
        readings = np.flatnonzero(self.exact)
        value = {int(self.graph.head[k]): table[k] for k in readings}
        return {mark: value[mark] for mark in self.known}

    def with_exact_readings_as_marks(self) -> Network:
        """The same network in which every node with an exact reading is a known mark (one exact arc is kept).

        Noisy readings of such a node say nothing more and are left out; where their errors are correlated with others
        that would lose information, and is an ``ArgumentError``.
        """
        readings = np.flatnonzero(self.exact)
        marks, first = np.unique(self.graph.head[readings], return_index=True)
        drop = np.setdiff1d(np.flatnonzero(self.graph.is_external & np.isin(self.graph.head, marks)), readings[first])
        keep = np.setdiff1d(np.arange(self.graph.n_arcs), drop)
        if self.covariance is not None and sp.issparse(self.covariance):
            rows = Blocks(self.graph.n_arcs, self.dimension)
            if self.covariance[rows.positions(drop)][:, rows.positions(keep)].nnz:
                raise ArgumentError(
                    "a noisy reading of an exactly known node is correlated with other arcs: it tells about their "
                    "errors and cannot be left out; use estimate(), or drop the correlation"
                )
        return self._select(keep, known=tuple(int(k) for k in marks))

    def _select(self, arcs: IntArray, known: tuple[int, ...]) -> Network:
        graph = self.graph
        weight = None if graph.weight is None else graph.weight[arcs]
        chosen = MeasurementGraph(graph.n_nodes, graph.tail[arcs], graph.head[arcs], weight, graph.names)
        return Network(
            chosen,
            self.values[arcs],
            _select_covariance(self.covariance, arcs, np.ones(arcs.shape[0]), self.dimension),
            exact=self.exact[arcs],
            known=known,
            positions=self.positions,
            unit=self.unit,
            title=self.title,
            columns={name: [texts[k] for k in arcs.tolist()] for name, texts in self.columns.items()},
        )

    def without_known_marks(self) -> Reduction:
        """The network of the estimating nodes: arcs to known marks become external arcs of their other end.

        An arc from mark m to node k reads ``x_k = z + x_m``, from node k to mark m ``x_k = x_m - z``; arcs between
        marks and readings of marks say nothing about the rest and are left out. (The noise of an arc between marks is
        known, though: arcs whose joint covariance couples them to one are conditioned on it.)

        Raises:
            ArgumentError: every node is a known mark.
        """
        graph, marks = self.graph, np.array(self.known, dtype=np.int64)
        nodes = np.setdiff1d(np.arange(graph.n_nodes), marks)
        if not nodes.size:
            raise ArgumentError("every node is a known mark: there is nothing to estimate")
        is_mark = np.zeros(graph.n_nodes, dtype=np.bool_)
        is_mark[marks] = True
        height = np.zeros((graph.n_nodes, self.dimension))
        for mark, value in self.known_values().items():
            height[mark] = value
        tail_known, head_known = graph.at_tail(is_mark, False), is_mark[graph.head]
        arcs = np.flatnonzero(~head_known & ~tail_known | (tail_known ^ head_known) & ~graph.is_external)
        sign = np.where(head_known[arcs], -1.0, 1.0)
        position = np.full(graph.n_nodes, EXTERNAL, dtype=np.int64)
        position[nodes] = np.arange(nodes.shape[0])
        tail, head = graph.at_tail(position, EXTERNAL)[arcs], position[graph.head[arcs]]
        flipped = head == EXTERNAL
        tail, head = np.where(flipped, EXTERNAL, tail), np.where(flipped, tail, head)
        weight = None if graph.weight is None else graph.weight[arcs]
        offset = (graph.at_tail(height, 0.0) + height[graph.head])[arcs]
        table, covariance = self.values.reshape(graph.n_arcs, -1), self.covariance
        between = np.flatnonzero(head_known & tail_known & ~graph.is_external)
        if isinstance(covariance, sp.csr_array) and between.size:
            noise = table[between] - (height[graph.head[between]] - height[graph.tail[between]])
            table, covariance = _conditioned(table, covariance, arcs, between, noise)
        values = sign[:, None] * table[arcs] + offset
        reduced = MeasurementGraph(nodes.shape[0], tail, head, weight, [graph.names[k] for k in nodes.tolist()])
        network = Network(
            reduced,
            values if self.values.ndim == 2 else values[:, 0],
            _select_covariance(covariance, arcs, sign, self.dimension),
            exact=self.exact[arcs],
            positions=None if self.positions is None else self.positions[nodes],
            unit=self.unit,
            title=self.title,
        )
        return Reduction(network, frozen(nodes, np.int64), frozen(arcs, np.int64))

    def precision_weights(self) -> FloatArray | None:
        """Arc weights ``R^-1`` scaled to mean 1 (their trace over d, for blocks); None without a covariance.

        The scale changes the unit of time of an observer, not its fixed point.

        Raises:
            ArgumentError: jointly correlated arcs, or an exact reading (its weight would be infinite: make it a
                known mark first).
        """
        if self.covariance is None:
            return None
        if isinstance(self.covariance, sp.csr_array):
            raise ArgumentError(
                "jointly correlated arcs have no weight of their own; estimate() uses the whole covariance, an "
                "observer needs one variance (or block) an arc"
            )
        if self.exact.any():
            node = self.graph.names[self.graph.head[np.flatnonzero(self.exact)[0]]]
            raise ArgumentError(
                f"node {node!r} has an exact reading, whose weight 1/sigma^2 would be infinite; "
                "use with_exact_readings_as_marks() and without_known_marks() first"
            )
        if self.covariance.ndim == 1:
            weights = 1.0 / self.covariance
            return frozen(weights / weights.mean())
        blocks = np.linalg.inv(self.covariance)
        blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
        return frozen(blocks / (np.trace(blocks, axis1=1, axis2=2).mean() / self.dimension))

    def _check_known(self) -> None:
        external = self.graph.is_external
        for mark in self.known:
            at_mark = np.flatnonzero(external & (self.graph.head == mark))
            if at_mark.shape[0] != 1 or not self.exact[at_mark[0]]:
                raise ArgumentError(
                    f"known mark {self.graph.names[mark]!r} must have exactly one external arc, an exact one; "
                    f"got {at_mark.shape[0]}"
                )


@dataclass(frozen=True, eq=False)
class Reduction:
    """What is left to estimate: ``network``, with its nodes' and arcs' indices in the network it came from."""

    network: Network
    nodes: IntArray
    arcs: IntArray


def _width(values: FloatArray) -> int:
    return 1 if values.ndim == 1 else int(values.shape[1])


def _check_exact(graph: MeasurementGraph, values: FloatArray, exact: BoolArray) -> None:
    if exact.shape != (graph.n_arcs,):
        raise ShapeError(f"exact must have shape ({graph.n_arcs},); got {exact.shape}")
    inner = np.flatnonzero(exact & ~graph.is_external)
    if inner.size:
        raise ArgumentError(f"arc {graph.arc_label(int(inner[0]))} is internal and cannot be exact; give it a sigma")
    first: dict[int, int] = {}
    for k in np.flatnonzero(exact).tolist():
        other = first.setdefault(int(graph.head[k]), k)
        if not np.array_equal(values[k], values[other]):
            raise ArgumentError(
                f"two exact readings of node {graph.names[graph.head[k]]!r} disagree: {values[other]} and {values[k]}; "
                "give one of them a sigma"
            )


def _checked_covariance(
    covariance: ArrayLike | sp.sparray | None, values: FloatArray, exact: BoolArray
) -> Covariance | None:
    if covariance is None:
        return None
    count = values.shape[0]
    size = 1 if values.ndim == 1 else int(values.shape[1])
    if sp.issparse(covariance):
        joint = sp.csr_array(covariance)
        if joint.shape != (count * size, count * size):
            raise ShapeError(f"covariance must have shape {(count * size, count * size)}; got {joint.shape}")
        _check_joint(joint, np.repeat(exact, size))
        return joint
    array = as_floats("covariance", covariance)
    if array.shape == (count,) and size == 1:
        bad = np.flatnonzero((array <= 0) & ~exact)
        if bad.size:
            raise ArgumentError(f"covariance[{bad[0]}] = {array[bad[0]]} must be a positive variance")
        return array
    if array.shape == (count, size, size):
        blocks = array[~exact]
        if blocks.size:
            bad = np.flatnonzero(np.linalg.eigvalsh(blocks)[:, 0] <= 0)
            skew = np.abs(blocks - blocks.transpose(0, 2, 1)).max(axis=(1, 2)) > 1e-9 * np.abs(blocks).max(axis=(1, 2))
            bad = np.union1d(bad, np.flatnonzero(skew))
            if bad.size:
                k = int(np.flatnonzero(~exact)[bad[0]])
                raise ArgumentError(f"covariance[{k}] must be symmetric positive definite; got {array[k].tolist()}")
        return array
    raise ShapeError(
        f"covariance must have shape ({count},), ({count}, {size}, {size}) or be sparse "
        f"({count * size}, {count * size}); got {array.shape}"
    )


def _check_joint(joint: sp.csr_array, exact: BoolArray) -> None:
    require_finite("covariance", joint.data)
    bad = np.flatnonzero((joint.diagonal() <= 0) & ~exact)
    if bad.size:
        raise ArgumentError(f"covariance[{bad[0]}, {bad[0]}] = {joint.diagonal()[bad[0]]} must be a positive variance")
    if abs(joint - joint.T).max() > 1e-9 * abs(joint).max():
        raise ArgumentError("covariance must be symmetric")


def _checked_positions(positions: ArrayLike | None, n_nodes: int) -> FloatArray | None:
    if positions is None:
        return None
    try:
        array: FloatArray = frozen(positions)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"positions must be numbers, NaN where unknown; got {error}") from error
    if array.shape != (n_nodes, 2):
        raise ShapeError(f"positions must have shape ({n_nodes}, 2); got {array.shape}")
    if np.isinf(array).any():
        raise ArgumentError("positions must be finite, or NaN where unknown; got infinity")
    return array


def _conditioned(
    table: FloatArray, covariance: sp.csr_array, kept: IntArray, seen: IntArray, noise: FloatArray
) -> tuple[FloatArray, sp.csr_array]:
    """Correct values and covariance of the arcs ``kept`` for the known ``noise`` of the correlated arcs ``seen``.

    ``y - R_ks R_ss^-1 e_s`` and ``R_kk - R_ks R_ss^-1 R_sk``: the conditional law of normal noise.
    """
    blocks = Blocks(*table.shape)
    rows, columns = blocks.positions(kept), blocks.positions(seen)
    cross = covariance[rows][:, columns]
    touched = np.flatnonzero(np.diff(cross.indptr))
    if not touched.size:
        return table, covariance
    rows, cross = rows[touched], cross[touched].toarray()
    gain = np.linalg.solve(covariance[columns][:, columns].toarray(), cross.T).T
    corrected = blocks.stack(table).copy()
    corrected[rows] -= gain @ noise.ravel()
    loss = sp.coo_array(gain @ cross.T)
    place = (rows[loss.row], rows[loss.col])
    loss = sp.coo_array((loss.data, place), shape=covariance.shape)
    return blocks.split(corrected), sp.csr_array(covariance - 0.5 * (loss + loss.T))


def _select_covariance(covariance: Covariance | None, arcs: IntArray, sign: FloatArray, size: int) -> Covariance | None:
    if covariance is None:
        return None
    if not isinstance(covariance, sp.csr_array):
        return covariance[arcs]
    rows = Blocks(covariance.shape[0] // size, size).positions(arcs)
    flip = sp.diags_array(np.repeat(sign, size))
    return sp.csr_array(flip @ covariance[rows][:, rows] @ flip)
