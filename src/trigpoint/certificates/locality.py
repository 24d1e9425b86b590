"""Claim: every node's program uses its own arcs and its neighbours' messages, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from trigpoint.certificates.base import Claim
from trigpoint.model import NetworkedAgents
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import NetworkObserver

_ASSUMPTIONS = ("an arc may be read, and its other end heard, by the nodes at its ends",)


@dataclass(frozen=True)
class Locality(Claim):
    """The sparsity pattern of the observer lies in the neighbour pattern of the problem's graph.

    Decided exactly, in whole numbers: no witness is needed. Source: G16, Definition 4.
    """

    name: ClassVar[str] = "locality"

    def check(self, problem: NetworkedAgents, observer: NetworkObserver) -> ClaimRecord:
        """Compare what every program reads with the graph."""
        stranger = _first_stranger(problem, observer)
        text = "every node uses only its own arcs and neighbours" if stranger is None else stranger
        return ClaimRecord(self.name, "certified" if stranger is None else "refuted", {}, _ASSUMPTIONS, text, {})

    @staticmethod
    def verify(record: ClaimRecord, problem: NetworkedAgents, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Decide again from problem and observer."""
        return "certified" if _first_stranger(problem, observer) is None else "refuted"


def _first_stranger(problem: NetworkedAgents, observer: NetworkObserver) -> str | None:
    graph = problem.graph
    allowed: list[set[tuple[int, str | None]]] = [set() for _ in range(graph.n_nodes)]
    external = graph.is_external
    for k, (tail, head) in enumerate(zip(graph.tail.tolist(), graph.head.tolist(), strict=True)):
        if external[k]:
            allowed[head].add((k, None))
        else:
            allowed[head].add((k, graph.names[tail]))
            allowed[tail].add((k, graph.names[head]))
    for node, permitted in enumerate(allowed):
        for arc in observer.local(node).arcs:
            if (arc.label, arc.neighbour) not in permitted:
                return f"node {graph.names[node]} uses arc {arc.label} with {arc.neighbour or 'the environment'}"
    return None
