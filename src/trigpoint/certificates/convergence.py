"""Claim: the error decays at least at a rate, by one small matrix inequality for the whole network (theory 8-G6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.eigenvalue import EigenvalueBound, smallest_eigenvalue
from trigpoint.arrays import FloatArray, at_least, at_most
from trigpoint.certificates import growth, pairs, piecewise, programs, structure
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.certificates.decrease import gain_range, mode_decreases, network_ball
from trigpoint.certificates.smallest_eigenvalue import proved_floor
from trigpoint.certificates.statics import largest_eigenvalue_by_degrees
from trigpoint.errors import ArgumentError
from trigpoint.linalg.balls import Ball, decays
from trigpoint.linalg.fine import Fine
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.observers.assembled import AssembledObserver, Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_SMALL, _WHOLE = 60, 300
_MARK = np.ones(1)
_ASSUMPTIONS = (
    "continuous exchange without delay or loss",
    "every agent follows the model A of the problem's document",
)


@dataclass(frozen=True)
class Convergence(Claim):
    """``|e(t)| <= sqrt(cond P) e^{-rate t} |e(0)|`` for a homogeneous network.

    With ``V = e' (I (x) P) e`` mode k contributes ``F(g) = P (A - g K C) + (A - g K C)' P + 2 rate P`` at
    ``g = gain lambda_k``. F is affine in g, so that ``F < 0`` at both ends of ``[gain l, gain u]`` proves it for every
    eigenvalue in ``[l, u]``: l is proved by a positive vector, u by the degrees. Networks with weight blocks are
    proved as a whole up to 600 states, and so are observers given by programs: ``P H + H' P + 2 rate P < 0`` for
    the assembled error matrix H, after a proof that the truth does not drive the error; block by block where the
    stored H is block triangular after a permutation; by the factors of P where its condition exceeds what a matrix of
    floats can hold (deep cascades). A rate that is asked for and that no common P proves is proved mode by mode, with a
    P for each piece of the spectrum, above 60 states and for any number of nodes; or decided on the whole of H up to
    300 states, and refuted where an indefinite P shows an eigenvalue to the right of it.

    Args:
        rate: the rate to prove, 1/s; the design's guaranteed rate, less a hair for rounding, unless given.

    Source: G16, proof of Theorem 4; Rump (2006), key Rump2006.
    """

    rate: float | None = None
    name: ClassVar[str] = "convergence"
    quantities: ClassVar[tuple[str, ...]] = ("rate", "lambda_floor")
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Choose P = Q^-1 from the design's facts and prove the rate, or fall short of it by up to one part in 1e3."""
        if self.rate is not None and not np.isfinite(self.rate):
            raise ArgumentError(f"rate must be a number of 1/s; got {self.rate}")
        if isinstance(observer, AssembledObserver):
            return self._check_programs(observer)
        if not isinstance(observer, DiffusiveObserver):
            return self._record("inconclusive", 0.0, 0.0, {}, "not an observer of equal agents")
        bound = smallest_eigenvalue(observer.graph)
        P = lyapunov_matrix(observer)
        arrays = {"P": P} if bound.witness.size == 0 else {"P": P, "x": bound.witness}
        wanted = observer.decay_rate if self.rate is None else self.rate
        margins = (1e-9, 1e-7, 1e-5, 1e-3) if self.rate is None else (0.0,)
        rates = [wanted - margin * abs(wanted) for margin in margins]
        for rate in rates if wanted > 0.0 else ():
            record = self._record(
                "certified", rate, bound.lower, arrays, f"the error decays at least at {at_least(rate)} /s"
            )
            if self.verify(record, problem, observer) == "certified":
                return record
        slower = growth.witness(observer, max(wanted, 0.0), bound)
        if slower is not None:
            record = self._record("refuted", max(wanted, 0.0), bound.lower, slower, _slower(wanted))
            if self.verify(record, problem, observer) == "refuted":
                return record
        pieces = self._by_pieces(observer, bound) if observer.states.total > _SMALL else None
        if pieces is not None:
            return pieces
        if self.rate is not None and 0.0 < self.rate < np.inf and observer.states.total <= _WHOLE:
            H = network_ball(observer)
            return self._decided(H, partial(Fine.of, H), self.rate)
        text = f"no decay at {wanted:.9g} /s could be proved" if wanted > 0.0 else "no decay could be proved"
        return self._record("inconclusive", wanted, bound.lower, arrays, text)

    def _by_pieces(self, observer: DiffusiveObserver, bound: EigenvalueBound) -> ClaimRecord | None:
        """A rate that is asked for, proved mode by mode."""
        if self.rate is None or not 0.0 < self.rate < np.inf or observer.graph.dimension > 1 or not bound.lower > 0.0:
            return None
        arrays = piecewise.prove(observer, self.rate, piecewise.spectrum(observer, bound.lower))
        if arrays is None:
            return None
        text = f"the error decays at least at {at_least(self.rate)} /s, mode by mode"
        return self._record("certified", self.rate, bound.lower, {**arrays, "x": bound.witness}, text)

    def _decided(self, H: Ball, fine: Callable[[], Fine], rate: float) -> ClaimRecord:
        """A ``rate`` proved or refuted on the whole error matrix."""
        pair = pairs.lyapunov_pair(H, fine, rate)
        if pair is not None:
            text = f"the error decays at least at {at_least(rate)} /s"
            record = self._record("certified", rate, 0.0, {**pair.arrays, "whole": _MARK}, text)
            if pair.rate == rate or pairs.proves(record, H, fine, rate):
                return record
        growing = pairs.growing_witness(H, fine, rate)
        if growing is not None:
            return self._record("refuted", rate, 0.0, {**growing, "whole": _MARK}, _slower(rate))
        return self._record("inconclusive", rate, 0.0, {}, f"no decay at {rate:.9g} /s could be proved")

    def _check_programs(self, observer: AssembledObserver) -> ClaimRecord:
        """A Lyapunov pair of the assembled error matrix (theory 8-G5)."""
        if observer.states.total > programs.DENSE_LIMIT or not _is_continuous(observer):
            reason = "a sampled observer" if not _is_continuous(observer) else f"{observer.states.total} states"
            return self._record("inconclusive", 0.0, 0.0, {}, f"no decay could be proved: {reason}")
        if not programs.error_is_autonomous(observer):
            return self._record("inconclusive", 0.0, 0.0, {}, "no decay could be proved: the truth may drive the error")
        H, fine = programs.error_magnitude(observer), partial(programs.error_to_more_digits, observer)
        by_blocks = structure.structured_rate(H, self.rate)
        if by_blocks is not None and by_blocks[0] > 0.0:
            rate, P = by_blocks
            text = f"the error decays at least at {at_least(rate)} /s, through the exact zeros of the stored matrix"
            return self._record("certified", rate, 0.0, {"blocks": P}, text)
        if self.rate is not None and 0.0 < self.rate < np.inf:
            return self._decided(H, fine, self.rate)
        pair = pairs.lyapunov_pair(H, fine, None) if self.rate is None else None
        if pair is None or not pair.rate > 0.0:
            return self._record("inconclusive", self.rate or 0.0, 0.0, {}, "no decay could be proved")
        return self._record(
            "certified", pair.rate, 0.0, pair.arrays, f"the error decays at least at {at_least(pair.rate)} /s"
        )

    def _record(
        self, verdict: Outcome, rate: float, floor: float, arrays: dict[str, FloatArray], text: str
    ) -> ClaimRecord:
        return ClaimRecord(self.name, verdict, {"rate": rate, "lambda_floor": floor}, _ASSUMPTIONS, text, arrays)

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Prove the inequality again from P and x alone."""
        if isinstance(observer, AssembledObserver):
            return _verify_programs(record, observer)
        if not isinstance(observer, DiffusiveObserver):
            return "inconclusive"
        n, graph = observer.agent.n_states, observer.graph
        rate, floor = number(record, "rate"), number(record, "lambda_floor")
        if "whole" in record.witness:
            fits = observer.states.total <= programs.DENSE_LIMIT and rate > 0.0 and floor == 0.0
            H = network_ball(observer) if fits else None
            return _judged(record, H, partial(Fine.of, H), rate) if H is not None else "inconclusive"
        if not record.witness:
            return "inconclusive"
        if "edges" in record.witness:
            return "certified" if piecewise.proves(record, observer, rate) else "inconclusive"
        P = witness(record, "P", (n, n))
        if "growing" in record.witness:
            return "refuted" if growth.proves(record, observer, rate, floor) else "inconclusive"
        proved = graph.is_externally_connected and rate > 0.0 and is_positive_definite(P)
        if not proved:
            return "inconclusive"
        if graph.dimension > 1:
            whole = (
                np.asarray(np.kron(np.eye(graph.n_nodes), P)) if observer.states.total <= programs.DENSE_LIMIT else None
            )
            proved = whole is not None and decays(whole, network_ball(observer), rate) and floor >= 0.0
            return "certified" if proved and floor <= proved_floor(record, graph) else "inconclusive"
        if not 0.0 < floor <= proved_floor(record, graph):
            return "inconclusive"
        ends = gain_range(observer, floor, largest_eigenvalue_by_degrees(graph))
        certified = all(mode_decreases(observer, P, rate, g) for g in ends)
        return "certified" if certified else "inconclusive"


def _is_continuous(observer: AssembledObserver) -> bool:
    return observer.period is None and not observer.is_discrete


def _verify_programs(record: ClaimRecord, observer: AssembledObserver) -> Outcome:
    total, rate = observer.states.total, number(record, "rate")
    if total > programs.DENSE_LIMIT or not _is_continuous(observer) or not rate > 0.0:
        return "inconclusive"
    if record.numbers.get("lambda_floor", 0.0) != 0.0:
        return "inconclusive"  # a number that nothing here proves
    if not programs.error_is_autonomous(observer):
        return "inconclusive"
    H = programs.error_magnitude(observer)
    if "blocks" in record.witness:
        return "certified" if structure.proves(record, H, rate) else "inconclusive"
    return _judged(record, H, partial(programs.error_to_more_digits, observer), rate)


def _judged(record: ClaimRecord, H: Ball, fine: Callable[[], Fine], rate: float) -> Outcome:
    """The outcome for the whole of H, from P (or its factors R and T) or from P and a growing direction."""
    if "growing" in record.witness:
        return "refuted" if pairs.refutes(record, H, fine, rate) else "inconclusive"
    return "certified" if pairs.proves(record, H, fine, rate) else "inconclusive"


def _slower(rate: float) -> str:
    slower = f"an error that shrinks slower than {at_most(rate)} /s" if rate > 0.0 else "an error that never shrinks"
    return f"there is {slower}"


def lyapunov_matrix(observer: DiffusiveObserver) -> FloatArray:
    """``P = Q^-1`` of the Riccati solution in the design's facts; the identity where there is none."""
    n = observer.agent.n_states
    Q = observer.facts.get("Q")
    if not isinstance(Q, np.ndarray) or Q.shape != (n, n):
        return np.eye(n)
    try:
        P = np.asarray(la.cho_solve(la.cho_factor(Q), np.eye(n)), dtype=np.float64)
    except (np.linalg.LinAlgError, ValueError):  # a fact that is no covariance: any other P may do
        return np.eye(n)
    return np.asarray(0.5 * (P + P.T))
