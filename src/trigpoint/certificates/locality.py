"""Claim: every node's program uses its own arcs and its neighbours' messages, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from trigpoint.certificates.base import Claim
from trigpoint.model import HyperNetwork, SharedPlant
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import NetworkObserver

_ASSUMPTIONS = (
    "a measurement may be read, and its other ends heard, by the nodes that it joins; an agent of a shared plant reads "
    "its own output and hears its neighbours",
)


@dataclass(frozen=True)
class Locality(Claim):
    """The sparsity pattern of the observer lies in the neighbour pattern of the problem.

    Decided exactly, in whole numbers: no witness is needed. Source: G16, Definition 4.
    """

    name: ClassVar[str] = "locality"
    quantities: ClassVar[tuple[str, ...]] = ()
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Compare what every program reads with the graph."""
        stranger = _first_stranger(problem, observer)
        text = "every node uses only its own arcs and neighbours" if stranger is None else stranger
        return ClaimRecord(self.name, "certified" if stranger is None else "refuted", {}, _ASSUMPTIONS, text, {})

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Decide again from problem and observer."""
        return "certified" if _first_stranger(problem, observer) is None else "refuted"


def _first_stranger(problem: Problem, observer: NetworkObserver) -> str | None:
    readers, links = _permitted(problem)
    for node, name in enumerate(observer.names):
        program = observer.local(node)
        for arc in program.arcs:
            heard = [other for other, _ in arc.heard]
            own = arc.label is None or name in readers.get(arc.label, set())
            if not own or not set(heard) <= links[name] | {name}:
                return f"node {name} uses {_named(arc.label)} with {', '.join(heard) or 'the environment'}"
        for label, _ in program.feedthrough:
            if name not in readers.get(label, set()):
                return f"node {name} uses {_named(label)}"
    return None


def _named(label: int | None) -> str:
    return "a link" if label is None else f"arc {label}"


def _permitted(problem: Problem) -> tuple[dict[int, set[str]], dict[str, set[str]]]:
    """Whose states each reading compares, and whom each node may hear."""
    if isinstance(problem, SharedPlant):
        readers = {agent: {str(agent)} for agent in range(problem.n_agents)}
        return readers, {str(agent): set(map(str, heard)) for agent, heard in enumerate(problem.hears)}
    network = problem if isinstance(problem, HyperNetwork) else HyperNetwork.of_networked(problem)
    readers = {label: {network.names[k] for k in blocks} for label, blocks in enumerate(network.measurements)}
    links: dict[str, set[str]] = {name: set() for name in network.names}
    for members in readers.values():
        for name in members:
            links[name] |= members - {name}
    return readers, links
