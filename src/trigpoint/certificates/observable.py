"""Claim: every state can be known from the readings; decided exactly, without a tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.certificates.base import Claim
from trigpoint.linalg.modular import is_observable_pair, stays_and_is_unseen
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import Problem, channels_of
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import NetworkObserver

_ASSUMPTIONS = (
    "the problem's numbers are taken as they are stored; how close it is to losing observability is not said",
)
_LIMIT = 400


@dataclass(frozen=True)
class Observable(Claim):
    """The readings of the whole network determine the state of the whole network.

    Certified when ``(C, C A, C A^2, ...)`` has full rank modulo a prime: a rank never grows by reducing modulo a prime,
    and every stored number is a fraction whose denominator is a power of two. Refuted by a subspace V of whole numbers
    with ``C V = 0`` and ``A V`` in V, checked in exact fractions. For equal agents on a network: every node has a
    path to an anchor, and one agent alone is observable. Up to 400 states, or agents of up to 400.

    Source: R23 and G16, Theorem 2 (observability through the graph); theory 001-05.
    """

    name: ClassVar[str] = "observable"
    quantities: ClassVar[tuple[str, ...]] = ()
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:  # noqa: ARG004
        """Stated on request: an observer that converges is its own proof of detectability."""
        return False

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Prove, or look for a direction that nobody sees."""
        outcome, arrays = self._decide(problem)
        words = {
            "certified": "every state can be known from the readings",
            "refuted": "a direction stays in itself and is seen by nobody",
            "inconclusive": "undecided: no direction of small whole numbers was found",
        }
        record = ClaimRecord(self.name, outcome, {}, _ASSUMPTIONS, words[outcome], arrays)
        return record if self.verify(record, problem, observer) == outcome else _undecided(record)

    def _decide(self, problem: Problem) -> tuple[Outcome, dict[str, FloatArray]]:
        A, C, _ = _pair(problem)
        if A is None or C is None:
            return ("refuted" if _floats(problem) else "inconclusive"), {}
        if _floats(problem):
            return "refuted", {}
        if is_observable_pair(A, C):
            return "certified", {}
        V = _unseen(A, C)
        return ("inconclusive", {}) if V is None else ("refuted", {"V": V})

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Decide again: the graph and the rank need no witness, a direction is checked in exact fractions."""
        if _floats(problem):
            return "refuted"
        A, C, _ = _pair(problem)
        if A is None or C is None:
            return "inconclusive"
        V = record.witness.get("V")
        if V is not None and V.ndim == 2 and V.shape[0] == A.shape[0] and stays_and_is_unseen(A, C, V):
            return "refuted"
        return "certified" if V is None and is_observable_pair(A, C) else "inconclusive"


def _undecided(record: ClaimRecord) -> ClaimRecord:
    return ClaimRecord(record.claim, "inconclusive", {}, record.assumptions, "undecided", {})


def _floats(problem: Problem) -> bool:
    """Equal agents with a component that has no absolute reading: moving it as a whole changes no reading."""
    return isinstance(problem, NetworkedAgents) and problem.is_homogeneous and not problem.graph.is_externally_connected


def _pair(problem: Problem) -> tuple[FloatArray | None, FloatArray | None, str]:
    if isinstance(problem, NetworkedAgents) and problem.is_homogeneous:
        agent = problem.agent
        return (agent.A, agent.C, "one agent") if agent.n_states <= _LIMIT else (None, None, "")
    channels = channels_of(problem)
    if channels.A.shape[0] > _LIMIT:
        return None, None, ""
    return channels.A.toarray(), channels.C.toarray(), "the whole"


def _unseen(A: FloatArray, C: FloatArray) -> FloatArray | None:
    """A basis of the unobservable subspace as small whole numbers (reduced echelon form), if there is one."""
    n = A.shape[0]
    scale = max(1.0, float(np.abs(A).sum(axis=1).max()))
    rows, block = [C], C
    for _ in range(n - 1):
        block = block @ A / scale
        rows.append(block)
    kernel = la.null_space(np.vstack(rows), rcond=1e-10)
    if kernel.shape[1] == 0:
        return None
    _, pivots = la.qr(kernel.T, mode="r", pivoting=True)
    chosen = np.sort(pivots[: kernel.shape[1]])
    echelon = kernel @ np.linalg.inv(kernel[chosen])
    for denominator in (1, 2, 3, 4, 5, 6, 8, 10, 12, 60, 120):
        V = np.round(echelon * denominator)
        if np.abs(V / denominator - echelon).max() < 1e-7 and stays_and_is_unseen(A, C, V):
            return np.asarray(V)
    return None
