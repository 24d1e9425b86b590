"""The claim that every node uses its own arcs and neighbours only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings

import trigpoint as tp
from tests.certificates.oracle import record_of
from trigpoint.certificates import Locality, certify
from trigpoint.graphs import MeasurementGraph
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.testing.strategies import measurement_graphs

CLAIM = Locality()
ONE = np.ones((1, 1))


@dataclass(frozen=True, eq=False)
class Eavesdropping(DiffusiveObserver):
    """An observer whose last node uses one arc more than it has."""

    extra: LocalArc | None = None

    def local(self, node: int) -> LocalObserver:
        honest = super().local(node)
        if node != self.graph.n_nodes - 1 or self.extra is None:
            return honest
        return replace(honest, arcs=(*honest.arcs, self.extra))


def eavesdropping(extra: LocalArc | None) -> Eavesdropping:
    problem = tp.NetworkedAgents(tp.graphs.chain(4), tp.LinearAgent.static())
    return Eavesdropping("given", problem, ONE, 1.0, 0.1, None, {}, extra)


@given(measurement_graphs(max_nodes=7))
@settings(max_examples=100)
def test_every_diffusive_observer_is_local(graph: MeasurementGraph) -> None:
    observer = DiffusiveObserver("given", tp.NetworkedAgents(graph, tp.LinearAgent.static()), ONE, 1.0, 0.0, None)
    assert record_of(CLAIM, observer).verdict == "certified"


@pytest.mark.parametrize(
    ("label", "neighbour"),
    [
        (0, None),  # the anchor's reading belongs to node 0
        (1, "0"),  # somebody else's arc, seen from somebody else's end
        (3, "0"),  # its own arc, but another neighbour
        (3, None),  # its own arc as if it led to the environment
        (3, "3"),  # its own arc, heard from itself
        (99, "2"),  # an arc that nobody has
    ],
)
def test_a_stranger_is_refuted_and_named(label: int, neighbour: str | None) -> None:
    observer = eavesdropping(LocalArc(label, neighbour, 1.0, ONE, ONE, ONE))
    record = record_of(CLAIM, observer)
    assert record.verdict == "refuted"
    assert f"node 3 uses arc {label} with {neighbour or 'the environment'}" in record.text
    assert CLAIM.verify(replace(record, verdict="certified"), observer.problem, observer) == "refuted"


def test_the_honest_twin_of_the_eavesdropper_is_local() -> None:
    assert record_of(CLAIM, eavesdropping(None)).verdict == "certified"


def test_one_refuted_claim_refutes_the_certificate() -> None:
    observer = eavesdropping(LocalArc(0, None, 1.0, ONE, ONE, None))
    certificate = certify(observer.problem, observer)
    assert [record.verdict for record in certificate.records].count("refuted") == 1
    assert certificate.verdict == "refuted"
    assert tp.verify(certificate, observer.problem, observer).outcome == "refuted"
