"""Claim: one quadratic function decreases on every topology whose eigenvalues lie in a range (theory 8-G6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from trigpoint.analysis import smallest_eigenvalue, worst_case_eigenvalue
from trigpoint.analysis.modes import largest_eigenvalue_bound, mode_matrices
from trigpoint.arrays import FloatArray, at_least, at_most
from trigpoint.certificates import pairs
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.certificates.convergence import lyapunov_matrix
from trigpoint.certificates.decrease import gain_range, mode_ball, mode_decreases
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.common_function import common_functions
from trigpoint.linalg.fine import Fine
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_ASSUMPTIONS = (
    "continuous exchange without delay or loss",
    "at every moment all eigenvalues of the generalized Laplacian lie between floor and ceiling (twice the largest "
    "weighted degree is at most the ceiling); the topology may change as often as it likes",
)
_FAMILY = (
    "where max_nodes is not 0, every externally connected network of at most max_nodes nodes without parallel arcs and "
    "with unit weights is among them"
)
_CLOSED_FORM_ERROR = 1e-12


@dataclass(frozen=True)
class SwitchingStability(Claim):
    """``V = e' (I (x) P) e`` decreases at ``rate`` on every topology with ``floor <= lambda <= ceiling``.

    ``P (A - g K C) + (A - g K C)' P + 2 rate P`` is affine in ``g = gain lambda``: negative definite at both ends,
    it is so on the whole range, whatever the order and the speed of the changes. P is the design's, or one computed for
    the range: for agents with one output it is found wherever there is one (bounded real lemma). Refuted (with rate 0)
    where the mode of one end does not decay: one node whose anchor has that weight is such a topology.

    Args:
        floor: smallest eigenvalue to cover; the observer's own network's lower bound unless given.
        ceiling: largest one; ten times the bound of the observer's own network unless given.
        max_nodes: cover every externally connected network with at most so many nodes, instead of a floor.

    Source: G16, Theorem 4 (switching), Theorem 7; theory 8-G6.
    """

    floor: float | None = None
    ceiling: float | None = None
    max_nodes: int | None = None
    name: ClassVar[str] = "switching-stability"
    quantities: ClassVar[tuple[str, ...]] = ("rate", "floor", "ceiling", "max_nodes")
    assumptions: ClassVar[tuple[str, ...]] = (*_ASSUMPTIONS, _FAMILY)

    @staticmethod
    def over(graphs: Sequence[MeasurementGraph]) -> SwitchingStability:
        """The claim for a family: floor and ceiling enclose the spectra of all ``graphs``."""
        if not graphs:
            raise ArgumentError("graphs must hold at least one network")
        floor = min(smallest_eigenvalue(graph).lower for graph in graphs)
        return SwitchingStability(floor, max(largest_eigenvalue_bound(graph) for graph in graphs) * (1.0 + 1e-9))

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:  # noqa: ARG004
        """Stated on request."""
        return False

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """The rate follows from the design's own P, or from one that is computed for the range."""
        if self.max_nodes is not None and self.max_nodes < 1:
            raise ArgumentError(f"max_nodes must be a whole number of at least 1; got {self.max_nodes}")
        if not isinstance(observer, DiffusiveObserver) or observer.graph.dimension > 1:
            return self._record("inconclusive", (0.0, 0.0, 0.0, 0.0), None, "not equal agents with scalar weights")
        if self.max_nodes is not None:
            floor = worst_case_eigenvalue(self.max_nodes) * (1.0 - _CLOSED_FORM_ERROR)
        else:
            floor = smallest_eigenvalue(observer.graph).lower if self.floor is None else self.floor
        ceiling = self.ceiling
        if ceiling is None:
            ceiling = 10.0 * max(largest_eigenvalue_bound(observer.graph), 2.0 * (self.max_nodes or 0) + 2.0)
        if not floor <= ceiling:
            raise ArgumentError(f"floor must not exceed ceiling; got {floor:g} and {ceiling:g}")
        gains = observer.gain * np.array([floor, ceiling])
        P, best = _best_function(observer, gains)
        nodes = float(self.max_nodes or 0)
        for margin in (1e-9, 1e-6, 1e-3, 0.1) if np.isfinite(best) else ():
            rate = best - margin * abs(best)
            # the range is a premise: it is narrowed, not widened
            text = f"decays at least at {at_least(rate)} /s under any switching with "
            text += f"{at_most(floor)} <= lambda <= {at_least(ceiling)}"
            text += f", among them every anchored network of at most {nodes:.0f} nodes" if nodes else ""
            record = self._record("certified", (rate, floor, ceiling, nodes), P, text)
            if self.verify(record, problem, observer) == "certified":
                return record
        for g in gains.tolist():
            growing = _growing(observer, g)
            if growing is not None:
                text = "one node whose anchor has the weight of an end of the range does not decay"
                record = self._record("refuted", (0.0, floor, ceiling, nodes), growing["P"], text)
                record = replace(record, witness=growing)
                if self.verify(record, problem, observer) == "refuted":
                    return record
        best = best if np.isfinite(best) else 0.0
        text = f"no common decay could be proved (best computed rate {best:.3g} /s)"
        return self._record("inconclusive", (best, floor, ceiling, nodes), P, text)

    def _record(
        self, verdict: Outcome, values: tuple[float, float, float, float], P: np.ndarray | None, text: str
    ) -> ClaimRecord:
        numbers = dict(zip(("rate", "floor", "ceiling", "max_nodes"), values, strict=True))
        return ClaimRecord(self.name, verdict, numbers, (*_ASSUMPTIONS, _FAMILY), text, {} if P is None else {"P": P})

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Prove the inequality again at both ends."""
        if not isinstance(observer, DiffusiveObserver) or observer.graph.dimension > 1:
            return "inconclusive"
        n = observer.agent.n_states
        rate, floor, ceiling, nodes = (number(record, name) for name in ("rate", "floor", "ceiling", "max_nodes"))
        P = witness(record, "P", (n, n))
        if "growing" in record.witness:
            return "refuted" if _grows(record, observer, P, (floor, ceiling)) else "inconclusive"
        if not (rate > 0.0 and 0.0 < floor <= ceiling and is_positive_definite(P)):
            return "inconclusive"
        if nodes != 0.0 and not _covers(nodes, floor, ceiling):
            return "inconclusive"
        ends = gain_range(observer, floor, ceiling)
        return "certified" if all(mode_decreases(observer, P, rate, g) for g in ends) else "inconclusive"


def _best_function(observer: DiffusiveObserver, gains: FloatArray) -> tuple[FloatArray, float]:
    """P and the computed rate at which it decreases at both ends: the design's, or one for the whole range."""
    A, K, C = observer.agent.A, observer.injection, observer.agent.C
    with np.errstate(over="ignore", invalid="ignore"):
        ends = mode_matrices(A, K, C, gains)
        middle, half = 0.5 * (ends[0] + ends[1]), 0.5 * (gains[1] - gains[0]) * C
    candidates = [lyapunov_matrix(observer), *common_functions(middle, K, half)]
    rates = [min(_decay(P, M) for M in ends) for P in candidates]
    first = int(np.argmax(rates))
    return candidates[first], rates[first]


def _decay(P: FloatArray, M: FloatArray) -> float:
    """Computed rate at which ``e' P e`` decreases along M; -inf where it cannot be computed."""
    with np.errstate(over="ignore", invalid="ignore"):
        drift = -(P @ M + M.T @ P)
    if not np.isfinite(drift).all():
        return -np.inf
    try:
        return float(la.eigh(drift, P, eigvals_only=True)[0]) / 2.0
    except np.linalg.LinAlgError:  # P is not positive definite in floats
        return -np.inf


def _growing(observer: DiffusiveObserver, g: float) -> dict[str, FloatArray] | None:
    mode = mode_ball(observer, g)
    found = pairs.growing_witness(mode, partial(Fine.of, mode), 0.0)
    return None if found is None or "R" in found else {"P": found["P"], "growing": found["growing"]}


def _grows(record: ClaimRecord, observer: DiffusiveObserver, P: FloatArray, ends: tuple[float, float]) -> bool:
    """Prove that the mode of one end of the range does not decay: a network of one node has that eigenvalue."""
    v = witness(record, "growing", P.shape[:1])
    if not (0.0 < ends[0] <= ends[1] and number(record, "rate") >= 0.0):
        return False
    enclosures = (gain_range(observer, end, end) for end in ends)
    return any(all(pairs.grows(P, v, mode_ball(observer, g), 0.0) for g in pair) for pair in enclosures)


def _covers(nodes: float, floor: float, ceiling: float) -> bool:
    """Every anchored network of ``nodes`` or fewer: Theorem 1's floor, and N + 1 as ceiling of simple graphs."""
    if nodes != int(nodes) or not 1 <= nodes <= 1e9:
        return False
    return floor <= worst_case_eigenvalue(int(nodes)) * (1.0 - _CLOSED_FORM_ERROR) and ceiling >= nodes + 1.0
