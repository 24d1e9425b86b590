"""Programs that are all the same one: then the sampled step splits into the modes of the generalized Laplacian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.balls import Ball, contracts
from trigpoint.linalg.interval_stability import contraction_on_interval
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver


@dataclass(frozen=True, eq=False)
class EqualPrograms:
    """``e_i+ = T e_i - F G C sum over the arcs of (e_i - e_j)``: the step of mode lambda is ``T - lambda F G C``.

    Attributes:
        node: any one of the programs.
        gain: (n, p) G of every arc.
        graph: the arcs, each counted once (unit weights).
    """

    node: LocalObserver
    gain: FloatArray
    graph: MeasurementGraph


def equal_programs(observer: AssembledObserver) -> EqualPrograms | None:
    """Compare the stored programs bit for bit, arc by arc; None where they differ or are of another form."""
    problem = observer.problem
    if not isinstance(problem, NetworkedAgents) or observer.targets is not None or not observer.nodes[0].arcs:
        return None
    first, graph = observer.nodes[0], problem.graph
    gain, C = first.arcs[0].gain, first.arcs[0].output
    if first.exchange == "held" or not all(_alike(node, first) for node in observer.nodes):
        return None
    if not all(np.array_equal(agent.C, C) and np.array_equal(agent.A, first.A) for agent in problem.agents):
        return None
    if not all(_same_inputs(node.B, agent.B) for node, agent in zip(observer.nodes, problem.agents, strict=True)):
        return None
    wanted: list[dict[int, tuple[str | None, float]]] = [{} for _ in observer.nodes]
    names, ends = graph.names, zip(graph.tail.tolist(), graph.head.tolist(), graph.is_external.tolist(), strict=True)
    for label, (tail, head, external) in enumerate(ends):
        wanted[head][label] = (None if external else names[tail], 1.0)
        if not external:
            wanted[tail][label] = (names[head], -1.0)
    for node, arcs in zip(observer.nodes, wanted, strict=True):
        labels = [arc.label for arc in node.arcs]
        if len(labels) != len(arcs) or set(labels) != set(arcs):
            return None
        if not all(_fits(arc, arcs[arc.label], gain, C) for arc in node.arcs if arc.label is not None):
            return None
    return EqualPrograms(first, gain, graph.with_weight(None) if graph.weight is not None else graph)


def _same_inputs(program: FloatArray | None, truth: FloatArray | None) -> bool:
    return program is truth or (program is not None and truth is not None and np.array_equal(program, truth))


def _alike(node: LocalObserver, first: LocalObserver) -> bool:
    plain = node.readout is None and not node.feedthrough and node.acceleration is None
    return plain and node.exchange == first.exchange and np.array_equal(node.A, first.A)


def _fits(arc: LocalArc, wanted: tuple[str | None, float], gain: FloatArray, C: FloatArray) -> bool:
    other, sign = wanted
    if not (np.array_equal(arc.gain, gain) and np.array_equal(arc.output, C) and arc.sign == sign):
        return False
    heard = list(arc.heard)
    if other is None:
        return not heard
    return len(heard) == 1 and heard[0][0] == other and np.array_equal(heard[0][1], C)


def prove(start: Ball, pull: Ball, ends: tuple[float, float], factor: float) -> tuple[FloatArray, FloatArray] | None:
    """Edges and P of the pieces on which ``start + lambda pull`` contracts by ``factor``; None: not proved."""
    found = contraction_on_interval(start.times(1.0 / factor), pull.times(1.0 / factor), *ends)
    return (found.edges, found.P) if found.stable is True else None


def covers(start: Ball, pull: Ball, ends: tuple[float, float], factor: float, edges: FloatArray, P: FloatArray) -> bool:
    """Prove it again, piece by piece."""
    if not (edges[0] <= ends[0] and ends[1] <= edges[-1] and (np.diff(edges) > 0.0).all()):
        return False
    for left, right, p in zip(edges[:-1].tolist(), edges[1:].tolist(), P, strict=True):
        if not is_positive_definite(p):
            return False
        if not all(contracts(p, start + pull.times(s), factor) for s in (left, right)):
            return False
    return True
