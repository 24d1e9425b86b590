"""The matrix inequality of one mode, with its rounding errors bounded."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from trigpoint.analysis.eigenvalue import absolute_assembly
from trigpoint.arrays import FloatArray
from trigpoint.linalg.balls import Ball, decays
from trigpoint.linalg.verified import down, gam, up
from trigpoint.observers.network import DiffusiveObserver

_SMALLEST = 2.0**-1074


def gain_range(observer: DiffusiveObserver, low: float, high: float) -> tuple[float, float]:
    """An interval that holds ``gain lambda`` for all ``low <= lambda <= high``."""
    ends = (observer.gain * low, observer.gain * high)
    return down(min(ends)), up(max(ends))


def mode_ball(observer: DiffusiveObserver, g: float) -> Ball:
    """``A - g K C`` for the stored A, K, C."""
    pull = Ball.exact(observer.injection) @ Ball.exact(observer.agent.C)
    return Ball.exact(observer.agent.A) - pull.times(g)


def mode_decreases(observer: DiffusiveObserver, P: FloatArray, rate: float, g: float) -> bool:
    """Prove ``-(P (A - g K C) + (A - g K C)' P + 2 rate P) > 0`` for the stored A, K, C."""
    return decays(P, mode_ball(observer, g), rate)


def network_ball(observer: DiffusiveObserver) -> Ball:
    """The error matrix of the whole network, dense: ``I (x) A - gain (I (x) K) (L (x) I) (I (x) C)``."""
    graph, agent = observer.graph, observer.agent
    eye = np.eye(graph.n_nodes)
    drift = Ball(_repeated(eye, agent.A), np.zeros((observer.states.total,) * 2))
    L = laplacian_ball(observer)
    if graph.dimension == 1:
        pull = L.kron(Ball.exact(observer.injection) @ Ball.exact(agent.C))
    else:
        pull = Ball.exact(_repeated(eye, observer.injection)) @ (L @ Ball.exact(_repeated(eye, agent.C)))
    return drift - pull.times(observer.gain)


def _repeated(eye: FloatArray, block: FloatArray) -> FloatArray:
    return np.asarray(np.kron(eye, block), dtype=np.float64)


def laplacian_ball(observer: DiffusiveObserver) -> Ball:
    """``L = G W G'``, dense; the weights of parallel arcs and of a node's arcs are summed with rounding errors."""
    graph = observer.graph
    L = sp.csr_array(graph.laplacian()).toarray()
    size = absolute_assembly(graph) if graph.dimension > 1 else np.abs(L)
    return Ball(L, np.asarray(gam(2.0 * graph.n_arcs + 8.0) * size + graph.n_arcs * _SMALLEST))
