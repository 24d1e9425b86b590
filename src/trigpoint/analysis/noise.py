"""Noise in a network of equal agents: Theorem 5's guarantee, and the covariance really reached, mode by mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.eigenvalue import smallest_eigenvalue
from trigpoint.analysis.modes import mode_matrices
from trigpoint.arrays import FloatArray, as_matrix, frozen
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.equations import filter_riccati
from trigpoint.linalg.krylov import RationalKrylov
from trigpoint.model import LinearAgent, NetworkedAgents

_ALL_MODES = 2000
_PROBES = 24
_STEPS = 24


def mu_star(gain: float, lambda_min: float) -> float:
    """Largest noise level for which the guarantee ``N J_1`` holds: ``min(1, sqrt((2 g l - 1) / (g^2 l)))``; 0 for none.

    Args: ``gain`` g and ``lambda_min`` l. Source: G16, Theorem 5, equation (19), clipped at 1 (E-000-3).
    """
    strength = gain * lambda_min
    if not strength > 0.5:
        return 0.0
    return min(1.0, float(np.sqrt((2.0 * strength - 1.0) / (gain * strength))))


def gain_interval(mu: float, lambda_min: float) -> tuple[float, float] | None:
    """The gains for which the guarantee holds at noise level ``mu``; None where there are none.

    Source: G16, Theorem 5, equation (21); ``mu <= min(1, sqrt(lambda_min))`` is the best level (E-000-2, E-000-3).
    """
    if not 0.0 < mu <= 1.0:
        raise ArgumentError(f"mu must be a noise level, 0 < mu <= 1; got {mu}")
    rest = lambda_min**2 - lambda_min * mu**2
    if rest < 0.0:
        return None
    root = float(np.sqrt(rest))
    high = (lambda_min + root) / (lambda_min * mu**2)
    return 1.0 / (lambda_min + root), high  # the lower root without cancellation


@dataclass(frozen=True, eq=False)
class NoiseBudget:
    """What noise does to a network.

    Attributes:
        gain: the coupling gain.
        mu: the noise level that the numbers below belong to.
        mu_star: largest level for which ``guarantee`` is proved (Theorem 5).
        interval: gains for which it is proved at level ``mu``; None where there are none.
        guarantee: ``N J_1``, J_1 the trace of the local filter's Q.
        total: trace of the true steady covariance of the whole error, ``E[e' e]``.
        total_error: standard error of ``total``; 0 where it was computed from all modes.
        covariance: (N, n, n) steady covariance of each node's error; None for networks of more than 2000 nodes.
        centralised: the same total for the centralised Kalman filter, which nobody can undercut.
        method: how ``total`` was computed.
    """

    gain: float
    mu: float
    mu_star: float
    interval: tuple[float, float] | None
    guarantee: float
    total: float
    total_error: float
    covariance: FloatArray | None
    centralised: float
    method: str

    @property
    def gap(self) -> float:
        """``total / centralised``: how much of the noise is the price of being decentralised."""
        return self.total / self.centralised


def noise_budget(
    problem: NetworkedAgents | MeasurementGraph,
    gain: float,
    *,
    mu: float | None = None,
    process: FloatArray | None = None,
    measurement: FloatArray | None = None,
) -> NoiseBudget:
    """Noise budget of the network-decentralized observer with the local Riccati gain and coupling ``gain``.

    Mode k of L has the covariance X_k with ``M_k X + X M_k' + mu^2 (S + gain^2 lambda_k K R K') = 0``,
    ``M_k = A - gain lambda_k K C``, ``K = Q C' R^-1``; the covariance of the whole is ``sum u_k u_k' (x) X_k``.

    Args:
        problem: equal agents on an externally connected network; a bare graph stands for constants (A = 0, C = 1).
        gain: the coupling gain, positive.
        mu: noise level; ``mu_star`` unless given (1 where that is 0).
        process: (n, n) process noise S; ``E E'`` unless given, the identity where the agent has no E.
        measurement: (p, p) covariance R of a reading; the identity unless given.

    We assume:
        * scalar weights that are precisions: the reading of arc k has the covariance ``R / w_k``;
        * every mode is stable at this gain (else ArgumentError names it).

    Up to 2000 nodes from all modes; above, the totals by stochastic quadrature (24 probes, shift-invert Lanczos), with
    their standard error. Cost: one n x n Lyapunov and one Riccati equation a mode.
    Source: G16, equations (13)-(21), Theorem 5; E-000-2, E-000-3; theory 000-32.
    """
    if isinstance(problem, MeasurementGraph):
        problem = NetworkedAgents(problem, LinearAgent.static())
    agent, S, R = _checked(problem, gain, process, measurement)
    bound = smallest_eigenvalue(problem.graph)
    if bound.lower <= 0.0:
        raise ArgumentError("noise_budget needs a path from every node to an anchor; diagnose() lists the islands")
    Q = filter_riccati(agent.A, agent.C, S, R)
    star = mu_star(gain, bound.lower)
    level = (star or 1.0) if mu is None else mu
    filters = _Modes(agent, Q, S, R, gain)
    if problem.graph.n_nodes <= _ALL_MODES:
        values, vectors = la.eigh(problem.graph.laplacian().toarray())
        each = level**2 * filters.covariances(values)
        covariance: FloatArray | None = frozen(np.einsum("ik,kab->iab", vectors**2, each))
        total, error = float(np.trace(each, axis1=1, axis2=2).sum()), 0.0
        best, method = level**2 * float(filters.centralised(values).sum()), "all modes"
    else:
        covariance, method = None, f"stochastic quadrature, {_PROBES} probes"
        (total, error), (best, _) = _stochastic(problem, filters, level, bound.value)
    interval = gain_interval(level, bound.lower) if level <= 1.0 else None
    guarantee = problem.graph.n_nodes * float(np.trace(Q))
    return NoiseBudget(gain, level, star, interval, guarantee, total, error, covariance, best, method)


@dataclass(frozen=True, eq=False)
class _Modes:
    """The two covariances of a mode as functions of its eigenvalue."""

    agent: LinearAgent
    Q: FloatArray
    S: FloatArray
    R: FloatArray
    gain: float

    def covariances(self, values: FloatArray) -> FloatArray:
        """(m, n, n) steady covariance of each mode."""
        K = la.solve(self.R, self.agent.C @ self.Q, assume_a="pos").T
        spread = self.gain**2 * K @ self.R @ K.T
        closed = mode_matrices(self.agent.A, K, self.agent.C, self.gain * values)
        worst = np.linalg.eigvals(closed).real.max(axis=1)
        if worst.max() >= 0.0:
            bad = float(values[int(np.argmax(worst))])
            raise ArgumentError(
                f"at gain {self.gain:g} the mode of lambda = {bad:.6g} is not stable: no steady covariance"
            )
        return np.stack(
            [
                la.solve_continuous_lyapunov(M, -(self.S + value * spread))
                for M, value in zip(closed, values.tolist(), strict=True)
            ]
        )

    def centralised(self, values: FloatArray) -> FloatArray:
        """(m,) trace of the Riccati solution of each mode: the centralised filter has the same modes."""
        A, C = self.agent.A, self.agent.C
        return np.array([np.trace(filter_riccati(A, np.sqrt(v) * C, self.S, self.R)) for v in values.tolist()])


def _stochastic(
    problem: NetworkedAgents, filters: _Modes, level: float, lambda_min: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """(mean, standard error) of both totals by random signs and shift-invert quadrature."""
    rng = np.random.default_rng(0)
    n, matrix = problem.graph.n_nodes, problem.graph.laplacian()
    samples = []
    signs = rng.choice([-1.0, 1.0], size=(_PROBES, n))
    for probe in signs:
        space = RationalKrylov(matrix, probe[:, None])
        space.grow(lambda_min, _STEPS)
        pairs = space.pairs()
        weight = (pairs.vectors.T @ probe) ** 2
        values = np.maximum(pairs.values, lambda_min)
        own = np.trace(filters.covariances(values), axis1=1, axis2=2)
        samples.append([weight @ own, weight @ filters.centralised(values)])
    table = level**2 * np.array(samples)
    mean, error = table.mean(axis=0), table.std(axis=0, ddof=1) / np.sqrt(_PROBES)
    return (float(mean[0]), float(error[0])), (float(mean[1]), float(error[1]))


def _checked(
    problem: NetworkedAgents, gain: float, process: FloatArray | None, measurement: FloatArray | None
) -> tuple[LinearAgent, FloatArray, FloatArray]:
    if not isinstance(problem, NetworkedAgents):
        raise ArgumentError(f"problem must be NetworkedAgents; got {type(problem).__name__}")
    if problem.graph.dimension > 1:
        raise ArgumentError("noise_budget is for scalar arc weights")
    if not isinstance(gain, int | float | np.number):
        raise ArgumentError(f"gain must be a number, such as an observer's gain; got {type(gain).__name__}")
    if not (np.isfinite(gain) and gain > 0.0):
        raise ArgumentError(f"gain must be a positive number; got {gain}")
    agent = problem.agent
    entry = np.eye(agent.n_states) if agent.E is None else agent.E
    S = entry @ entry.T if process is None else as_matrix("process", process, agent.n_states, agent.n_states)
    R = np.eye(agent.n_outputs)
    if measurement is not None:
        R = as_matrix("measurement", measurement, agent.n_outputs, agent.n_outputs)
    return agent, S, R


def noise_condition(agent: LinearAgent, Q: FloatArray, values: FloatArray, gain: float, mu: float) -> float:
    """Largest eigenvalue of G16 (18) over the modes ``values``: not positive exactly where the condition holds.

    ``Q (A - g l K C)' + (A - g l K C) Q + mu^2 (g^2 l K K' + E E')`` with ``K = Q C'``, g the ``gain``, l a mode's;
    ``agent`` gives A, C and E (the identity where it has none), ``Q`` is P^-1. Source: G16, equation (18).
    """
    K, E = Q @ agent.C.T, np.eye(agent.n_states) if agent.E is None else agent.E
    closed = mode_matrices(agent.A, K, agent.C, gain * values)
    drift = closed @ Q
    spread = mu**2 * (gain**2 * values[:, None, None] * (K @ K.T) + E @ E.T)
    return float(np.linalg.eigvalsh(drift + np.swapaxes(drift, 1, 2) + spread)[:, -1].max())
