"""Claim: a constant delay of every innovation does not destabilise the observer (theory 6-F3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trigpoint.analysis.eigenvalue import couplings
from trigpoint.arrays import FloatArray, at_least, at_most, exactly
from trigpoint.certificates import moving
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.certificates.statics import largest_eigenvalue_upper, static_pull
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.verified import down, gam, up
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_ASSUMPTIONS = ("continuous exchange; every innovation is late by one constant time, the same for all arcs",)
_STEPS, _DENSE = 200, 600


@dataclass(frozen=True)
class DelayMargin(Claim):
    """``e'(t) = A e(t) - gain K C L e(t - delay)`` is stable, every innovation being late.

    Constants (A = 0, diagonal K and C): exactly for ``delay < pi / (2 gain k c lambda_max)``. Certified with a verified
    upper bound of ``lambda_max`` (the degrees' above 600 nodes); refuted where a vector's Rayleigh quotient proves a
    mode beyond the limit; inconclusive between the two.

    Agents that move: certified for every delay up to the given one, any number of nodes. With one output and up to ten
    states no root of ``det(s I - A + g K C e^(-s delay))`` meets the imaginary axis, for any gain ``g = gain lambda``
    of the spectrum's range: frequency by frequency, sharp for that range. Otherwise by a Lyapunov-Krasovskii functional
    for each piece of it. Refuted, with one output and up to 600 nodes, where a circle to the right of the axis is shown
    to hold a root.

    Args:
        delay: seconds; half the limit that can be proved unless given (for agents that move, 80 % of it).

    Source: Olfati-Saber and Murray 2004, key OlfatiSaberMurray2004; theory 6-F3, 8-G4; Fridman 2014, key Fridman2014.
    """

    delay: float | None = None
    name: ClassVar[str] = "delay-margin"
    quantities: ClassVar[tuple[str, ...]] = ("delay", "lambda_floor")
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:  # noqa: ARG004
        """Stated on request."""
        return False

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Compare the delay with both sides of the limit."""
        if self.delay is not None and not (np.isfinite(self.delay) and self.delay >= 0.0):
            raise ArgumentError(f"delay must be a number of seconds, at least 0; got {self.delay}")
        if not isinstance(observer, DiffusiveObserver) or observer.graph.dimension > 1:
            text = "a limit is known for equal agents with one gain and scalar weights only"
            return ClaimRecord(self.name, "inconclusive", {"delay": self.delay or 0.0}, _ASSUMPTIONS, text, {})
        if static_pull(observer) is None:
            return self._check_moving(observer)
        v = _fastest(observer.graph)
        proved, excluded = _limits(observer, v)
        delay = 0.5 * proved if self.delay is None else self.delay
        record = ClaimRecord(self.name, "inconclusive", {"delay": delay}, _ASSUMPTIONS, "", {"v": v})
        verdict = self.verify(record, problem, observer)
        words = {"certified": "stable", "refuted": "not stable", "inconclusive": "undecided"}[verdict]
        shown = at_most(delay) if verdict == "refuted" else at_least(delay)
        limits = f"stable below {at_least(proved)} s, not stable above {at_most(excluded)} s"
        text = f"{words} with a delay of {shown} s ({limits})"
        return ClaimRecord(self.name, verdict, record.numbers, _ASSUMPTIONS, text, record.witness)

    def _check_moving(self, observer: DiffusiveObserver) -> ClaimRecord:
        with np.errstate(over="ignore", invalid="ignore"):
            found = moving.proof(observer, self.delay)
        if found is not None:
            delay, floor, arrays = found
            text = f"stable with every constant delay up to {at_least(delay)} s"
            numbers = {"delay": delay, "lambda_floor": floor}
            return ClaimRecord(self.name, "certified", numbers, _ASSUMPTIONS, text, arrays)
        delay = self.delay or 0.0
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            grows = moving.growing(observer, delay)
        if grows is not None:
            text = f"not stable with a delay of {exactly(delay)} s"
            return ClaimRecord(self.name, "refuted", {"delay": delay}, _ASSUMPTIONS, text, grows)
        text = f"no stability could be proved with a delay of {exactly(delay)} s"
        return ClaimRecord(self.name, "inconclusive", {"delay": delay}, _ASSUMPTIONS, text, {})

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Both limits again, rounded outwards; or the functionals' decrease on every piece."""
        delay = number(record, "delay")
        if not isinstance(observer, DiffusiveObserver) or not delay >= 0.0 or observer.graph.dimension > 1:
            return "inconclusive"
        if static_pull(observer) is None:
            return moving.verify(record, observer, delay)
        if "lambda_floor" in record.numbers:
            return "inconclusive"  # a number that nothing here proves
        v = witness(record, "v", (observer.graph.n_nodes,))
        proved, excluded = _limits(observer, v)
        if delay > excluded:
            return "refuted"
        return "certified" if delay < proved and observer.graph.is_externally_connected else "inconclusive"


def _limits(observer: DiffusiveObserver, v: FloatArray) -> tuple[float, float]:
    """A delay below which all modes are stable, and one above which some mode is not."""
    pull = static_pull(observer)
    assert pull is not None  # asked before
    high = up(up(observer.gain * pull[1]) * largest_eigenvalue_upper(observer.graph))
    proved = down(down(np.pi / 2.0) / high) if high > 0.0 else 0.0
    low = down(down(observer.gain * pull[0]) * _rayleigh_lower(observer.graph, v))
    return proved, up(up(np.pi / 2.0) / low) if low > 0.0 else np.inf


def _rayleigh_lower(graph: MeasurementGraph, v: FloatArray) -> float:
    """Rigorous lower bound of ``lambda_max``: ``v' L v / v' v``."""
    largest = float(np.abs(v).max(initial=0.0))
    if not 0.0 < largest < np.inf:
        return 0.0
    unit = np.ldexp(v, -int(np.frexp(largest)[1]))
    squares = up(float((unit * unit).sum()) * (1.0 + float(gam(unit.shape[0] + 2.0))))
    return max(0.0, down(couplings(graph).quadratic_form(unit)[0] / squares))


def _fastest(graph: MeasurementGraph) -> FloatArray:
    """Approximate eigenvector of ``lambda_max`` by power iteration; a poor one costs sharpness, not truth."""
    laplacian = graph.laplacian()
    if graph.n_nodes <= _DENSE:
        return np.asarray(np.linalg.eigh(laplacian.toarray())[1][:, -1])
    v = np.random.default_rng(0).standard_normal(graph.n_nodes)
    for _ in range(_STEPS):
        v = laplacian @ v
        v = v / (float(np.linalg.norm(v)) or 1.0)
    return np.asarray(v)
