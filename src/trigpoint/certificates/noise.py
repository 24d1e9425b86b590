"""Claim: a bound of the steady error under noise, for the stored gains (Theorem 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.analysis.modes import largest_eigenvalue_bound, mode_matrices
from trigpoint.analysis.noise import mu_star
from trigpoint.arrays import FloatArray, at_least, at_most
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.certificates.convergence import lyapunov_matrix
from trigpoint.certificates.decrease import gain_range, mode_ball
from trigpoint.certificates.smallest_eigenvalue import proved_floor
from trigpoint.certificates.statics import largest_eigenvalue_by_degrees
from trigpoint.errors import ArgumentError
from trigpoint.linalg.balls import Ball, is_positive
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.verified import gam, is_positive_definite, up
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_ASSUMPTIONS = (
    "continuous exchange without delay or loss",
    "independent white noise: intensity mu^2 E E' on every agent (mu^2 I without E), and mu^2 I / w_k on the reading "
    "of arc k",
)
_INFLATIONS = (1e-9, 1e-6, 1e-3, 0.03, 0.3)


@dataclass(frozen=True)
class NoiseBudget(Claim):
    """``E |e|^2 <= N trace(X)`` in the long run: one n x n inequality for the whole network.

    ``M X + X M' + mu^2 (E E' + g gain K K') < 0`` with ``M = A - g K C`` is affine in ``g = gain lambda``: proved at
    both ends of the spectrum, X bounds the covariance of every mode. X starts at Theorem 5's ``P^-1`` (the Riccati
    solution), so that below ``mu*`` the bound is the theorem's ``N J_1`` but for rounding; above, it is what can be
    proved.

    Args:
        mu: noise level; ``mu*`` of the observer's gain unless given.

    Source: G16, Theorem 5; Rump (2006), key Rump2006.
    """

    mu: float | None = None
    name: ClassVar[str] = "noise-budget"
    quantities: ClassVar[tuple[str, ...]] = ("mu", "per_node", "lambda_floor")
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:  # noqa: ARG004
        """Stated on request."""
        return False

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Try the Riccati solution, a little larger, and then the covariance of the slowest mode."""
        if self.mu is not None and not (np.isfinite(self.mu) and self.mu > 0.0):
            raise ArgumentError(f"mu must be a positive noise level; got {self.mu}")
        if not isinstance(observer, DiffusiveObserver) or observer.graph.dimension > 1:
            return ClaimRecord(self.name, "inconclusive", _numbers(0.0, 0.0, 0.0), _ASSUMPTIONS, "not equal agents", {})
        bound = smallest_eigenvalue(observer.graph)
        if bound.unanchored.size:
            text = "no steady covariance: nodes without a path to an anchor"
            return ClaimRecord(self.name, "inconclusive", _numbers(0.0, 0.0, 0.0), _ASSUMPTIONS, text, {})
        mu = (mu_star(observer.gain, bound.lower) or 1.0) if self.mu is None else self.mu
        for X in _candidates(observer, mu, bound.lower):
            per_node = _trace(X)
            whole = at_most(up(observer.graph.n_nodes * per_node))
            text = f"E |e|^2 <= {whole} at noise level {at_least(mu)} ({at_most(per_node)} a node)"
            record = ClaimRecord(
                self.name,
                "certified",
                _numbers(mu, per_node, bound.lower),
                _ASSUMPTIONS,
                text,
                {"X": X, "x": bound.witness},
            )
            if self.verify(record, problem, observer) == "certified":
                return record
        text = f"no bound could be proved at noise level {mu:.6g}"
        return ClaimRecord(self.name, "inconclusive", _numbers(mu, 0.0, bound.lower), _ASSUMPTIONS, text, {})

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Prove the inequality again from X and the positive vector."""
        if not isinstance(observer, DiffusiveObserver) or observer.graph.dimension > 1 or "X" not in record.witness:
            return "inconclusive"
        n, graph = observer.agent.n_states, observer.graph
        mu, per_node, floor = (number(record, name) for name in ("mu", "per_node", "lambda_floor"))
        X = witness(record, "X", (n, n))
        if not (mu > 0.0 and is_positive_definite(X) and _trace(X) <= per_node):
            return "inconclusive"
        if not (graph.is_externally_connected and 0.0 < floor <= proved_floor(record, graph)):
            return "inconclusive"
        ends = gain_range(observer, floor, largest_eigenvalue_by_degrees(graph))
        return "certified" if all(_bounds(observer, X, mu, g) for g in ends) else "inconclusive"


def _numbers(mu: float, per_node: float, floor: float) -> dict[str, float]:
    return {"mu": mu, "per_node": per_node, "lambda_floor": floor}


@np.errstate(over="ignore")
def _trace(X: FloatArray) -> float:
    """An upper bound of the trace."""
    diagonal = np.abs(np.diagonal(X))
    return up(float(diagonal.sum()) * (1.0 + float(gam(2.0 * X.shape[0] + 2.0))))


def _noise(observer: DiffusiveObserver, mu: float, g: float) -> Ball:
    """``mu^2 (E E' + g gain K K')``."""
    agent, K = observer.agent, Ball.exact(observer.injection)
    E = Ball.exact(np.eye(agent.n_states) if agent.E is None else agent.E)
    return (E @ E.T + (K @ K.T).times(g).times(observer.gain)).times(mu).times(mu)


def _bounds(observer: DiffusiveObserver, X: FloatArray, mu: float, g: float) -> bool:
    """Prove ``-(M X + X M' + noise) > 0`` at g."""
    drift = mode_ball(observer, g) @ Ball.exact(X)
    return is_positive(-(drift + drift.T + _noise(observer, mu, g)))


def _candidates(observer: DiffusiveObserver, mu: float, floor: float) -> list[FloatArray]:
    n = observer.agent.n_states
    Q = np.linalg.inv(lyapunov_matrix(observer))
    found = [(1.0 + share) * 0.5 * (Q + Q.T) + share * np.eye(n) for share in _INFLATIONS[:3]]
    g = observer.gain * floor
    M = mode_matrices(observer.agent.A, observer.injection, observer.agent.C, np.array([g]))[0]
    noise = _noise(observer, mu, g).middle
    for share in _INFLATIONS:
        try:
            with near_singular_allowed():
                X = la.solve_continuous_lyapunov(M, -(1.0 + share) * noise - share * np.eye(n))
        except (np.linalg.LinAlgError, ValueError):
            continue
        found.append(0.5 * (X + X.T))
    ceiling = observer.gain * largest_eigenvalue_bound(observer.graph)
    top = _noise(observer, mu, ceiling).middle
    found += [4.0**k * (0.5 * (Q + Q.T) + np.eye(n) * float(np.trace(top)) / n) for k in range(4)]
    return [X for X in found if np.isfinite(X).all()]
