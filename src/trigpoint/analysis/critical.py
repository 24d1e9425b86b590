"""What a network cannot afford to lose: arcs and anchors without which nodes float."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.analysis.diagnosis import listing
from trigpoint.arrays import BoolArray, IntArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.graphs.bridges import BridgeTable, bridge_table

_IN_SUMMARY = 10


@dataclass(frozen=True, eq=False)
class Critical:
    """Single points of failure of a measurement graph.

    Attributes:
        arcs: internal arcs whose loss cuts nodes off from every anchor, most nodes first.
        arc_losses: how many nodes each of them would set afloat.
        anchors: external arcs whose loss leaves a component without any anchor, most nodes first.
        anchor_losses: how many nodes each of them would set afloat.
        single_anchor: numbers of the components (``graph.components``) held by one external arc only.
        floating: nodes that have no path to an anchor already.
        redundant: arcs that lie on a cycle (with the environment as a node): losing one of them cuts nobody off.
        bridges: all arcs on no cycle, those of the floating components included, and what lies behind each.
        graph: the graph that was examined.
    """

    arcs: IntArray
    arc_losses: IntArray
    anchors: IntArray
    anchor_losses: IntArray
    single_anchor: IntArray
    floating: IntArray
    redundant: IntArray
    bridges: BridgeTable
    graph: MeasurementGraph

    @property
    def is_robust(self) -> bool:
        """True when every node is anchored and stays so whichever single arc is lost."""
        return not (self.arcs.size or self.anchors.size or self.floating.size)

    def lost_without(self, arc: int) -> IntArray:
        """Nodes that lose their last path to an anchor when ``arc`` is lost, ascending; none for a redundant arc.

        Raises:
            ArgumentError: ``arc`` is no arc of the graph.

        Cost: the number of these nodes.
        """
        if not 0 <= arc < self.graph.n_arcs:
            raise ArgumentError(f"arc {arc} does not exist; expected 0 <= arc < {self.graph.n_arcs}")
        position = int(np.searchsorted(self.bridges.arcs, arc))
        is_bridge = position < self.bridges.arcs.shape[0] and self.bridges.arcs[position] == arc
        if not is_bridge or not self._is_anchored(arc):
            return frozen([], np.int64)
        return frozen(self.bridges.behind(position), np.int64)

    def _is_anchored(self, arc: int) -> bool:
        return bool(self.graph.component_is_anchored[self.graph.component_labels[self.graph.head[arc]]])

    def summary(self) -> str:
        """The findings as text, the worst ten of each kind."""
        if self.is_robust:
            return "no single arc or anchor is critical: any one of them may be lost"
        lines = []
        if self.floating.size:
            lines.append(f"{listing(self.graph, self.floating)} float already: no path to an anchor")
        for word, arcs, losses in (
            ("anchor", self.anchors, self.anchor_losses),
            ("arc", self.arcs, self.arc_losses),
        ):
            for arc, loss in zip(arcs[:_IN_SUMMARY].tolist(), losses[:_IN_SUMMARY].tolist(), strict=True):
                nodes = listing(self.graph, self.lost_without(arc))
                lines.append(f"{word} {self.graph.arc_label(arc)} is critical: without it {loss} float ({nodes})")
            if arcs.shape[0] > _IN_SUMMARY:
                lines.append(f"and {arcs.shape[0] - _IN_SUMMARY} critical {word}s more")
        return "\n".join(lines)


def critical(graph: MeasurementGraph) -> Critical:
    """Find the arcs and anchors of ``graph`` whose loss would leave nodes without a path to any anchor.

    An arc is critical exactly when it is a bridge of the graph with the environment as a node and its component is
    anchored; the nodes that float are those on its far side. An external arc is critical exactly when it is its
    component's only one.

    We assume:
        * an anchor is lost with its external arc: two external arcs at a node back each other up.

    Cost O(N log N + M): about two seconds for a million nodes. Source: G16, Definition 2, Propositions 1 and 5.
    """
    table = bridge_table(graph)
    labels, anchored = graph.component_labels, graph.component_is_anchored
    holds = anchored[labels[graph.head[table.arcs]]]
    external = graph.is_external[table.arcs]
    arcs, arc_losses = _worst_first(table, holds & ~external)
    anchors, anchor_losses = _worst_first(table, holds & external)
    redundant = np.ones(graph.n_arcs, dtype=np.bool_)
    redundant[table.arcs] = False
    return Critical(
        arcs,
        arc_losses,
        anchors,
        anchor_losses,
        frozen(np.sort(labels[graph.head[anchors]]), np.int64),
        frozen(np.flatnonzero(~anchored[labels]), np.int64),
        frozen(np.flatnonzero(redundant), np.int64),
        table,
        graph,
    )


def _worst_first(table: BridgeTable, chosen: BoolArray) -> tuple[IntArray, IntArray]:
    arcs, losses = table.arcs[chosen], table.count[chosen]
    order = np.argsort(-losses, kind="stable")
    return frozen(arcs[order], np.int64), frozen(losses[order], np.int64)
