"""Claim: with one exchange every ``period`` seconds the error contracts from exchange to exchange."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.arrays import FloatArray, at_most, exactly
from trigpoint.certificates import equal_programs, programs
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.certificates.smallest_eigenvalue import proved_floor
from trigpoint.certificates.statics import largest_eigenvalue_upper, static_pull
from trigpoint.errors import ArgumentError, ProtocolError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.balls import Ball, contracts, transition_and_integral
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.interval_stability import contraction_on_interval
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.observers.assembled import AssembledObserver, Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.local import LocalObserver
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_ASSUMPTIONS = (
    "all nodes exchange at the same instants, every period seconds, without delay or loss",
    "between two exchanges every node steps as its program says (held, innovation-held, euler or discrete)",
)


@dataclass(frozen=True)
class SampledStability(Claim):
    """``e+ = M e`` from one exchange to the next has ``|e_k| <= c factor^k |e_0|``, for the programs as stored.

    Proved by ``factor^2 P - M' P M > 0``, with exponentials enclosed by Taylor sums and remainders (theory 6-F7): for
    equal programs with equal gains (``innovation-held``; ``euler`` of constants) on the whole interval of eigenvalues,
    piece by piece, any number of nodes; for others as a whole, up to 600 states. Static agents that hold their
    neighbours' values contract at every period (6-F2): each exchange replaces an estimate by an average of its own,
    its neighbours' and the anchors' values; any number of nodes.

    Args:
        period: seconds; the observer's own unless given.

    Source: theory 6-F1, 6-F2, 6-F7; Rump (2006), key Rump2006.
    """

    period: float | None = None
    name: ClassVar[str] = "sampled-stability"
    quantities: ClassVar[tuple[str, ...]] = ("period", "factor", "lambda_floor")
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:
        """Observers that were designed for a period."""
        return isinstance(observer, AssembledObserver) and observer.period is not None

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:  # noqa: ARG002
        """Static agents by their averages, the others by a Lyapunov matrix of the whole step."""
        if self.period is not None and not 0.0 < self.period < np.inf:
            raise ArgumentError(f"period must be a positive number of seconds; got {self.period}")
        period = self.period or (observer.period if isinstance(observer, AssembledObserver) else None)
        if period is None:
            return self._record("inconclusive", 0.0, 0.0, {}, "no period was given")
        if _averages(observer):
            text = f"contracts at a period of {exactly(period)} s, and at every other: each node averages"
            return self._record("certified", period, 1.0, {}, text)
        split = _modes(observer, period)
        if split is not None:
            return self._check_modes(observer, split, period)
        M, why = _step(observer, period)
        if M is None:
            return self._record("inconclusive", period, 0.0, {}, f"nothing could be proved: {why}")
        radius = float(np.abs(np.linalg.eigvals(M.middle)).max()) if np.isfinite(M.radius).all() else np.inf
        for share in (1e-6, 1e-3, 0.05, 0.3):
            factor = radius + share * (1.0 - radius)
            P = _stein(M.middle / (0.5 * (radius + factor) or 1.0)) if radius < 1.0 else None
            if P is not None and is_positive_definite(P) and contracts(P, M, factor):
                text = f"contracts by {at_most(factor)} from exchange to exchange at a period of {exactly(period)} s"
                return self._record("certified", period, factor, {"P": P}, text)
        text = (
            f"no contraction could be proved at a period of {exactly(period)} s (computed spectral radius {radius:.9g})"
        )
        return self._record("inconclusive", period, radius if np.isfinite(radius) else 0.0, {}, text)

    def _check_modes(self, observer: NetworkObserver, split: _Modes, period: float) -> ClaimRecord:
        bound = smallest_eigenvalue(split.graph)
        ends = (bound.lower, largest_eigenvalue_upper(split.graph))
        verdict = contraction_on_interval(split.start, split.pull, *ends)
        for share in (1e-6, 1e-3, 0.05, 0.3) if verdict.stable is True and bound.lower > 0.0 else ():
            factor = verdict.radius + share * (1.0 - verdict.radius)
            proof = equal_programs.prove(split.start, split.pull, ends, factor)
            if proof is not None:
                arrays = {"edges": proof[0], "P": proof[1], "x": bound.witness}
                text = f"contracts by {at_most(factor)} from exchange to exchange at a period of {exactly(period)} s"
                text += ", mode by mode"
                record = self._record("certified", period, factor, arrays, text)
                record = replace(record, numbers={**record.numbers, "lambda_floor": bound.lower})
                if _verify_modes(record, observer, period, factor) == "certified":
                    return record
        text = f"no contraction could be proved at a period of {exactly(period)} s"
        text += f" (largest modal radius {verdict.radius:.9g})"
        return self._record("inconclusive", period, verdict.radius, {}, text)

    def _record(
        self, verdict: Outcome, period: float, factor: float, arrays: dict[str, FloatArray], text: str
    ) -> ClaimRecord:
        return ClaimRecord(self.name, verdict, {"period": period, "factor": factor}, _ASSUMPTIONS, text, arrays)

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Enclose the step again and prove the inequality from P."""
        period, factor = number(record, "period"), number(record, "factor")
        if not (period > 0.0 and 0.0 <= factor <= 1.0):
            return "inconclusive"
        if "edges" not in record.witness and "lambda_floor" in record.numbers:
            return "inconclusive"  # a number that nothing here proves
        if factor == 1.0:
            return "certified" if _averages(observer) else "inconclusive"
        if "edges" in record.witness:
            return _verify_modes(record, observer, period, factor)
        M, _ = _step(observer, period)
        if M is None or "P" not in record.witness:
            return "inconclusive"
        P = witness(record, "P", M.middle.shape)
        return "certified" if is_positive_definite(P) and contracts(P, M, factor) else "inconclusive"


@dataclass(frozen=True, eq=False)
class _Modes:
    """The step of mode lambda, ``start + lambda pull``."""

    start: Ball
    pull: Ball
    graph: MeasurementGraph


def _modes(observer: NetworkObserver, period: float) -> _Modes | None:
    """Equal programs split into modes, whatever their number; None for all others."""
    if not isinstance(observer, AssembledObserver) or observer.period not in (None, period):
        return None
    same = equal_programs.equal_programs(observer)
    moving = same is not None and bool(same.node.A.any())
    if same is None or (moving and same.node.exchange == "euler") or not same.graph.is_externally_connected:
        return None
    if same.node.exchange == "discrete" and observer.period is not None:
        return None  # the truth moves by e^{A h}, which no stored map equals
    transition, phi = _maps(same.node, period)
    return _Modes(
        transition, (phi @ (Ball.exact(same.gain) @ Ball.exact(same.node.arcs[0].output))).times(-1.0), same.graph
    )


def _verify_modes(record: ClaimRecord, observer: NetworkObserver, period: float, factor: float) -> Outcome:
    split = _modes(observer, period)
    if split is None:
        return "inconclusive"
    edges, n = record.witness["edges"], split.start.middle.shape[0]
    count = edges.shape[0] if edges.ndim == 1 else 0
    if not 2 <= count <= 10_000:
        raise ProtocolError(f"the witness 'edges' must hold 2 to 10000 numbers; got the shape {edges.shape}")
    floor = number(record, "lambda_floor")
    if not 0.0 < floor <= proved_floor(record, split.graph):
        return "inconclusive"
    P, ends = witness(record, "P", (count - 1, n, n)), (floor, largest_eigenvalue_upper(split.graph))
    proved = equal_programs.covers(split.start, split.pull, ends, factor, witness(record, "edges", (count,)), P)
    return "certified" if proved else "inconclusive"


def _averages(observer: NetworkObserver) -> bool:
    if not isinstance(observer, DiffusiveObserver) or static_pull(observer) is None or not observer.gain > 0.0:
        return False
    return observer.graph.is_externally_connected


def _step(observer: NetworkObserver, period: float) -> tuple[Ball | None, str]:
    """The map of the stacked error over one period, for the stored programs; or why there is none."""
    if isinstance(observer, DiffusiveObserver):
        if observer.states.total > programs.DENSE_LIMIT:
            return None, f"{observer.states.total} states"
        observer = observer.as_programs()
    if not isinstance(observer, AssembledObserver) or observer.states.total > programs.DENSE_LIMIT:
        return None, "more than 600 states, or an observer without programs"
    if any(node.acceleration is not None for node in observer.nodes):
        return None, "an accelerated exchange is no constant map"
    if observer.is_discrete and not all(node.exchange == "discrete" for node in observer.nodes):
        return None, "some programs are maps and others differential equations"
    moving = any(node.A.any() for node in observer.nodes)
    if any(node.exchange == "euler" for node in observer.nodes) and moving:
        return None, "Euler steps of moving agents do not follow the truth exactly"
    if observer.period not in (None, period) or not programs.error_is_autonomous(observer):
        return None, "the truth may drive the error"
    H = programs.error_magnitude(observer)
    total, states = observer.states.total, observer.states
    own = np.zeros((total, total))
    middle, spread = (np.zeros((total, total)) for _ in range(2))
    phi, phi_spread = (np.zeros((total, total)) for _ in range(2))
    for k, node in enumerate(observer.nodes):
        place = states.slice(k)
        own[place, place] = node.A
        T, F = _maps(node, period)
        middle[place, place], spread[place, place] = T.middle, T.radius
        phi[place, place], phi_spread[place, place] = F.middle, F.radius
    pull = H - Ball.exact(own)
    return Ball(middle, spread) + Ball(phi, phi_spread) @ pull, ""


def _maps(node: LocalObserver, period: float) -> tuple[Ball, Ball]:
    eye = Ball.exact(np.eye(node.n_states))
    if node.exchange == "discrete":
        return Ball.exact(node.A), eye
    if node.exchange == "euler":
        return eye, eye.times(period)
    transition, integral = transition_and_integral(Ball.exact(node.A), period)
    if node.exchange == "innovation-held":
        return transition, integral
    closed = Ball.exact(node.A)
    for arc in node.arcs:
        closed = closed - Ball.exact(arc.gain) @ Ball.exact(arc.output)
    return transition, transition_and_integral(closed, period)[1]


def _stein(M: FloatArray) -> FloatArray | None:
    try:
        with near_singular_allowed():
            P = la.solve_discrete_lyapunov(M.T, np.eye(M.shape[0]), method="bilinear")
    except (np.linalg.LinAlgError, ValueError):
        return None
    P = 0.5 * (P + P.T)
    largest = float(np.abs(P).max(initial=0.0))
    return P / largest if np.isfinite(largest) and largest > 0.0 else None
