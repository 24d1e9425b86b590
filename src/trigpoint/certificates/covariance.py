"""Claim: a bound of every single node's steady error under noise, for the stored programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray, at_most
from trigpoint.certificates import programs
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.errors import ArgumentError
from trigpoint.linalg.balls import Ball, is_positive
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.verified import is_positive_definite, up
from trigpoint.model import NetworkedAgents, SharedPlant
from trigpoint.observers.assembled import AssembledObserver, Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_ASSUMPTIONS = (
    "continuous exchange without delay or loss",
    "independent white noise: intensity process^2 E E' on every agent or on the shared plant (process^2 I without E), "
    "and measurement^2 I on every reading (divided by the weight of its arc)",
)
_INFLATIONS = (1e-9, 1e-6, 1e-3, 0.03)


@dataclass(frozen=True)
class CovarianceBound(Claim):
    """``E |e_i|^2 <= v_i`` in the long run, node by node.

    X with ``H X + X H' + N < 0``, proved, exceeds the steady covariance of ``e' = H e + noise`` of intensity N; v_i is
    the trace of node i's block. Up to 600 states of the whole network; the total of larger ones is what
    ``NoiseBudget`` bounds.

    Args:
        process: factor on the agents' process noise.
        measurement: factor on the noise of the readings.

    Source: G16, equations (13)-(16); Rump (2006), key Rump2006.
    """

    process: float = 1.0
    measurement: float = 1.0
    name: ClassVar[str] = "covariance-bound"
    quantities: ClassVar[tuple[str, ...]] = ("process", "measurement", "worst", "total")
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:  # noqa: ARG004
        """Stated on request."""
        return False

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Solve for the covariance of a slightly larger noise and prove that it bounds."""
        for name, value in (("process", self.process), ("measurement", self.measurement)):
            if not (np.isfinite(value) and value >= 0.0):
                raise ArgumentError(f"{name} must be a noise level of at least 0; got {value}")
        error, why = _error(observer)
        if error is None:
            return self._record("inconclusive", (0.0, 0.0), {}, f"nothing could be proved: {why}")
        for X in _candidates(error, self.process, self.measurement):
            v = _traces(error.programs, X)
            worst, total = float(v.max()), up(float(v.sum()) * (1.0 + 1e-12))
            text = f"E |e_i|^2 <= {at_most(worst)} at every node, E |e|^2 <= {at_most(total)} in all"
            record = self._record("certified", (worst, total), {"X": X, "v": v}, text)
            if self.verify(record, problem, observer) == "certified":
                return record
        return self._record("inconclusive", (0.0, 0.0), {}, "no bound could be proved: a mode may not decay")

    def _record(
        self, verdict: Outcome, bounds: tuple[float, float], arrays: dict[str, FloatArray], text: str
    ) -> ClaimRecord:
        levels = {"process": float(self.process), "measurement": float(self.measurement)}
        numbers = {**levels, "worst": bounds[0], "total": bounds[1]}
        return ClaimRecord(self.name, verdict, numbers, _ASSUMPTIONS, text, arrays)

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Prove the inequality again from X, and compare its blocks' traces with v."""
        process, measurement, worst, total = (
            number(record, name) for name in ("process", "measurement", "worst", "total")
        )
        error, _ = _error(observer)
        if error is None or "X" not in record.witness or not (process >= 0.0 and measurement >= 0.0):
            return "inconclusive"
        X = witness(record, "X", error.H.middle.shape)
        v = witness(record, "v", (len(error.programs.nodes),))
        stated = bool((_traces(error.programs, X) <= v).all()) and v.max() <= worst
        stated = stated and float(v.sum()) * (1.0 + 1e-13) <= total
        proved = stated and is_positive_definite(X) and _bounds(error, X, process, measurement)
        return "certified" if proved else "inconclusive"


@dataclass(frozen=True, eq=False)
class _Error:
    """``e' = H e + noise``: H, entries of the noise of the agents and of the readings, variances of the readings."""

    programs: AssembledObserver
    H: Ball
    agents: Ball
    readings: Ball
    variance: FloatArray


def _error(observer: NetworkObserver) -> tuple[_Error | None, str]:
    weights = None
    if isinstance(observer, DiffusiveObserver):
        if observer.states.total > programs.DENSE_LIMIT:
            return None, f"{observer.states.total} states are more than {programs.DENSE_LIMIT}; NoiseBudget takes them"
        observer = observer.as_programs()
    if not isinstance(observer, AssembledObserver) or observer.states.total > programs.DENSE_LIMIT:
        return None, "more than 600 states, or an observer without programs"
    if isinstance(observer.problem, NetworkedAgents):
        if observer.problem.graph.dimension > 1:
            return None, "weights are matrices"
        weights = observer.problem.graph.arc_weights
    if observer.period is not None or observer.is_discrete or not programs.error_is_autonomous(observer):
        return None, "a sampled exchange, or the truth may drive the error"
    # Targets have entries 0 and 1, at most one in a row (proved above): the product selects.
    entry = observer.target_matrix().toarray() @ _entry(observer.problem)
    sizes = [observer.channels.readings.size(k) for k in range(observer.channels.readings.count)]
    variance = np.ones(sum(sizes)) if weights is None else np.repeat(1.0 / weights, sizes)
    H, K = programs.error_magnitude(observer), programs.reading_gain(observer)
    return _Error(observer, H, Ball.exact(entry), K, variance), ""


def _entry(problem: Problem) -> FloatArray:
    if isinstance(problem, SharedPlant):
        return np.eye(problem.n_states)
    blocks = [np.eye(agent.n_states) if agent.E is None else agent.E for agent in problem.agents]
    return np.asarray(diagonal_of(blocks).toarray())


@np.errstate(over="ignore", invalid="ignore")
def _noise(error: _Error, process: float, measurement: float) -> Ball:
    """Its intensity ``process^2 E E' + measurement^2 K R K'``."""
    E, K = error.agents, error.readings
    middle, r = K.middle * error.variance, error.variance
    weighed = Ball(middle, 1.01 * K.radius * r + 1e-15 * np.abs(middle) + 2.0**-1000)  # r itself is a rounded quotient
    readings = (weighed @ K.T).times(measurement).times(measurement)
    return (E @ E.T).times(process).times(process) + readings


def _bounds(error: _Error, X: FloatArray, process: float, measurement: float) -> bool:
    """Prove ``-(H X + X H' + N) > 0`` for every H and N of their balls."""
    drift = error.H @ Ball.exact(X)
    return is_positive(-(drift + drift.T + _noise(error, process, measurement)))


@np.errstate(over="ignore")
def _traces(observer: AssembledObserver, X: FloatArray) -> FloatArray:
    """An upper bound of the trace of every node's block."""
    ranges, diagonal = observer.states, np.abs(np.diagonal(X))
    return np.array([up(float(diagonal[ranges.slice(k)].sum()) * (1.0 + 1e-13)) for k in range(ranges.count)])


def _candidates(error: _Error, process: float, measurement: float) -> list[FloatArray]:
    noise = _noise(error, process, measurement).middle
    scale = float(np.trace(noise)) / noise.shape[0] or 1.0
    found = []
    for share in _INFLATIONS:
        larger = (1.0 + share) * noise + share * scale * np.eye(noise.shape[0])
        try:
            with near_singular_allowed():
                X = la.solve_continuous_lyapunov(error.H.middle, -larger)
        except (np.linalg.LinAlgError, ValueError):
            continue
        if np.isfinite(X).all():
            found.append(0.5 * (X + X.T))
    return found
