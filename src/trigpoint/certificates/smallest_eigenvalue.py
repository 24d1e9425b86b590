"""Claim: ``lower <= lambda_min(L) <= upper`` for the weights that the observer uses (theory 8-G1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trigpoint.analysis.eigenvalue import couplings, smallest_eigenvalue
from trigpoint.arrays import at_least, at_most
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.verified import collatz_wielandt_lower, collatz_wielandt_upper, rayleigh_upper
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_ASSUMPTIONS = ("the arcs and weights are those of the observer's document",)


@dataclass(frozen=True)
class SmallestEigenvalue(Claim):
    """Bounds of the smallest eigenvalue of the generalized Laplacian; refuted (0) where nodes have no anchor.

    Witness: a positive vector x with ``min (L x)_i / x_i >= lower`` and a vector v with ``v' L v / v' v <= upper``.
    Bounds are refuted by the same vectors: v shows that ``lower`` is too high, x that ``upper`` is too low.
    Source: G16, Proposition 1; Barta (1937), key Barta1937.
    """

    name: ClassVar[str] = "smallest-eigenvalue"
    quantities: ClassVar[tuple[str, ...]] = ("lower", "upper")
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:
        """Observers with one gain for all arcs: only they rest on the eigenvalue."""
        return isinstance(observer, DiffusiveObserver)

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Compute the bounds and keep their witnesses."""
        if not isinstance(observer, DiffusiveObserver):
            numbers = {"lower": 0.0, "upper": 0.0}
            return ClaimRecord(self.name, "inconclusive", numbers, _ASSUMPTIONS, "not an observer of equal agents", {})
        graph = observer.graph
        bound = smallest_eigenvalue(graph)
        if bound.unanchored.size:
            names = ", ".join(graph.names[k] for k in bound.nodes[:8].tolist())
            text = f"lambda_min = 0: no path to an anchor from {names}"
            return ClaimRecord(
                self.name, "refuted", {"lower": 0.0, "upper": 0.0}, _ASSUMPTIONS, text, {"v": bound.vector}
            )
        text = f"{at_least(bound.lower)} <= lambda_min <= {at_most(bound.upper)}"
        arrays = {"v": bound.vector}
        if bound.witness.size:
            arrays["x"] = bound.witness
        record = ClaimRecord(
            self.name, "certified", {"lower": bound.lower, "upper": bound.upper}, _ASSUMPTIONS, text, arrays
        )
        verdict = self.verify(record, problem, observer)
        return ClaimRecord(self.name, verdict, record.numbers, _ASSUMPTIONS, text, arrays)

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Evaluate both quotients again, rounding outwards."""
        if not isinstance(observer, DiffusiveObserver):
            return "inconclusive"
        graph = observer.graph
        lower, upper = number(record, "lower"), number(record, "upper")
        if not graph.is_externally_connected:
            return "refuted"
        if not lower > 0.0:
            return "inconclusive"
        if graph.dimension > 1:
            bound = smallest_eigenvalue(graph)
            floor, ceiling = bound.lower, bound.upper
        else:
            matrix, v = couplings(graph), witness(record, "v", (graph.n_nodes,))
            floor, ceiling = (
                proved_floor(record, graph),
                min(rayleigh_upper(matrix, v), collatz_wielandt_upper(matrix, v)),
            )
        if ceiling < lower or upper < floor:
            return "refuted"
        return "certified" if lower <= floor and ceiling <= upper else "inconclusive"


def proved_floor(record: ClaimRecord, graph: MeasurementGraph) -> float:
    """Lower bound of ``lambda_min`` that the record's positive vector proves; 0 where it proves nothing."""
    if graph.dimension > 1:
        return smallest_eigenvalue(graph).lower
    x = witness(record, "x", (graph.n_nodes,))
    return max(0.0, float(np.nan_to_num(collatz_wielandt_lower(couplings(graph), x), neginf=0.0)))
