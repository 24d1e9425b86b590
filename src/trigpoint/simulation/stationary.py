"""The covariance that noise leaves behind under continuous exchange, as a matrix function of L."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike

from trigpoint.analysis.modes import largest_eigenvalue_bound, mode_matrices
from trigpoint.arrays import FloatArray, IntArray, as_indices
from trigpoint.errors import ArgumentError
from trigpoint.linalg.krylov import RationalKrylov
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation.modal import ALL_MODES
from trigpoint.simulation.scenario import Noise

_ROUNDS = 30
_GOAL = 1e-9
_ROUNDING = 1e-13
_PICKED = 16


@dataclass(frozen=True, eq=False)
class Stationary:
    """What the error settles at.

    Attributes:
        nodes: (k,) the nodes that were asked for.
        covariance: (k, n, n) steady covariance of each one's error.
        error: estimated error, relative to the largest entry.
    """

    nodes: IntArray
    covariance: FloatArray
    error: float


def stationary_covariance(
    observer: DiffusiveObserver, noise: Noise, nodes: ArrayLike | None = None
) -> Stationary:  # fmt: skip
    """Steady covariance of the nodes' errors under white noise: ``sum_k u_k(i)^2 X(lambda_k)``.

    X solves ``M X + X M' + process^2 E E' + measurement^2 gain^2 lambda K K' = 0``, ``M = A - gain lambda K C``: the
    noise that ``simulate`` draws under continuous exchange.

    Args:
        observer: equal agents, one gain, unit weights.
        noise: intensities of both kinds.
        nodes: which nodes; all up to 1200 nodes unless given. Larger networks take up to 16 at a time.

    Up to 1200 nodes by all eigenpairs; above by a rational Krylov space for each node, whose last change is the error
    estimate. Cost: N^3, or a few factorizations and some 40 solves a node.

    Raises:
        ArgumentError: weights, no or too many nodes of a large network, a mode that is not stable.
    """
    graph = observer.graph
    if graph.dimension > 1 or not (graph.arc_weights == 1.0).all():
        raise ArgumentError("the stationary covariance is for unit weights, as noise under continuous exchange is")
    if nodes is None and graph.n_nodes > ALL_MODES:
        raise ArgumentError(f"name the nodes of a network of more than {ALL_MODES} nodes, up to {_PICKED} of them")
    picked = np.arange(graph.n_nodes) if nodes is None else as_indices("nodes", nodes, 0, graph.n_nodes)
    function = partial(_covariances, observer, noise)
    if graph.n_nodes <= ALL_MODES:
        values, vectors = la.eigh(graph.laplacian().toarray())
        each = function(values)
        return Stationary(picked, np.einsum("ik,kab->iab", vectors[picked] ** 2, each), 1e-12)
    if picked.shape[0] > _PICKED:
        raise ArgumentError(f"at most {_PICKED} nodes of a large network at a time; got {picked.shape[0]}")
    found = [_of_one(observer, function, node) for node in picked.tolist()]
    return Stationary(picked, np.stack([one[0] for one in found]), max(one[1] for one in found))


def _covariances(observer: DiffusiveObserver, noise: Noise, values: FloatArray) -> FloatArray:
    """(m, n, n) X of each eigenvalue."""
    agent, K = observer.agent, observer.injection
    entry = noise.process * (np.eye(agent.n_states) if agent.E is None else agent.E)
    modes = mode_matrices(agent.A, K, agent.C, observer.gain * values)
    if np.linalg.eigvals(modes).real.max() >= -_ROUNDING * np.abs(modes).max():
        raise ArgumentError("a mode is not stable (an island without an anchor, or too small a gain): no steady state")
    pull = (noise.measurement * observer.gain) ** 2 * K @ K.T
    spread = entry @ entry.T + values[:, None, None] * pull
    return np.stack([la.solve_continuous_lyapunov(M, -Q) for M, Q in zip(modes, spread, strict=True)])


def _of_one(observer: DiffusiveObserver, function: partial[FloatArray], node: int) -> tuple[FloatArray, float]:
    """One node's covariance: the quadratic form of its unit vector, by a space that starts with it."""
    graph = observer.graph
    start = np.zeros((graph.n_nodes, 1))
    start[node] = 1.0
    space = RationalKrylov(graph.laplacian(), start)
    ceiling = largest_eigenvalue_bound(graph)
    n = observer.agent.n_states
    last, change, pole = np.zeros((n, n)), np.inf, 0.1 * ceiling
    for number in range(_ROUNDS):
        space.grow(pole, 2)
        values, inner = space.ritz()
        weights = inner[0] ** 2
        kept = weights > 1e-300
        value = np.einsum("k,kab->ab", weights[kept], function(np.maximum(values[kept], 0.0)))
        change = float(np.abs(value - last).max() / max(np.abs(value).max(), 1e-300))
        if number > 1 and change < _GOAL:
            break
        last, pole = value, pole / 10.0 if pole > 1e-6 * ceiling else 0.1 * ceiling
    return value, change
