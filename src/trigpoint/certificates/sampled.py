"""Claim: with one exchange every ``period`` seconds the error contracts from exchange to exchange."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.certificates import programs
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.certificates.statics import static_pull
from trigpoint.linalg.balls import Ball, contracts, transition_and_integral
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.verified import gam, is_positive_definite
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

    Proved by ``factor^2 P - M' P M > 0``, with exponentials enclosed by Taylor sums and remainders (theory 6-F7), up
    to 600 states. Static agents that hold their neighbours' values contract at every period (6-F2): each exchange
    replaces an estimate by an average of its own, its neighbours' and the anchors' values; any number of nodes.

    Args:
        period: seconds; the observer's own unless given.

    Source: theory 6-F1, 6-F2, 6-F7; Rump (2006), key Rump2006.
    """

    period: float | None = None
    name: ClassVar[str] = "sampled-stability"

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:
        """Observers that were designed for a period."""
        return isinstance(observer, AssembledObserver) and observer.period is not None

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:  # noqa: ARG002
        """Static agents by their averages, the others by a Lyapunov matrix of the whole step."""
        period = self.period or (observer.period if isinstance(observer, AssembledObserver) else None)
        if period is None:
            return self._record("inconclusive", 0.0, 0.0, {}, "no period was given")
        if _averages(observer):
            text = f"contracts at a period of {period:g} s, and at every other: each node averages"
            return self._record("certified", period, 1.0, {}, text)
        M, why = _step(observer, period)
        if M is None:
            return self._record("inconclusive", period, 0.0, {}, f"nothing could be proved: {why}")
        radius = float(np.abs(np.linalg.eigvals(M.middle)).max())
        for share in (1e-6, 1e-3, 0.05, 0.3):
            factor = radius + share * (1.0 - radius)
            P = _stein(M.middle / (0.5 * (radius + factor) or 1.0)) if radius < 1.0 else None
            if P is not None and is_positive_definite(P) and contracts(P, M, factor):
                text = f"contracts by {factor:.9g} from exchange to exchange at a period of {period:g} s"
                return self._record("certified", period, factor, {"P": P}, text)
        text = f"no contraction could be proved at a period of {period:g} s (computed spectral radius {radius:.9g})"
        return self._record("inconclusive", period, radius, {}, text)

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
        if factor == 1.0:
            return "certified" if _averages(observer) else "inconclusive"
        M, _ = _step(observer, period)
        if M is None or "P" not in record.witness:
            return "inconclusive"
        P = witness(record, "P", M.middle.shape)
        return "certified" if is_positive_definite(P) and contracts(P, M, factor) else "inconclusive"


def _averages(observer: NetworkObserver) -> bool:
    if not isinstance(observer, DiffusiveObserver) or static_pull(observer) is None:
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
    moving = any(node.A.any() for node in observer.nodes)
    if any(node.exchange == "euler" for node in observer.nodes) and moving:
        return None, "Euler steps of moving agents do not follow the truth exactly"
    if observer.period not in (None, period) or not programs.error_is_autonomous(observer):
        return None, "the truth may drive the error"
    H, radius = programs.error_magnitude(observer)
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
    pull = Ball(H, radius) + Ball.exact(-own)
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
    closed, size, terms = node.A.copy(), np.abs(node.A), 2.0
    for arc in node.arcs:
        closed = closed - arc.gain @ arc.output
        size = size + np.abs(arc.gain) @ np.abs(arc.output)
        terms += arc.gain.shape[1] + 2.0
    return transition, transition_and_integral(Ball(closed, gam(4.0 * terms) * size), period)[1]


def _stein(M: FloatArray) -> FloatArray | None:
    try:
        with near_singular_allowed():
            P = la.solve_discrete_lyapunov(M.T, np.eye(M.shape[0]), method="bilinear")
    except (np.linalg.LinAlgError, ValueError):
        return None
    P = 0.5 * (P + P.T)
    largest = float(np.abs(P).max(initial=0.0))
    return P / largest if np.isfinite(largest) and largest > 0.0 else None
