"""The decay rate that is left when every neighbour's value is a little old, but moved on by its own model."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_DENSE = 600
_ROUNDS, _CLOSE = 60, 1e-10


def delayed_decay_rate(observer: NetworkObserver, delay: float) -> float | None:
    """Predicted rate s of ``|e(t)| ~ e^{-s t}`` when every message is ``delay`` seconds old and moved to now.

    What a node knows of itself is fresh; what it knows of a neighbour is the neighbour's value of ``delay`` seconds
    ago, moved by its model. For a mode ``e_i = v_i x e^{r t}`` of equal agents, v an eigenvector of L = D - Adj,

        r x = (A - g K C (v' D v - v' Adj v e^{(A - r) delay})) x,

    taken for every eigenvector (only the slowest above 600 nodes), the largest real part being ``-s``. For constants
    with one state this is ``s (1 + g delay v' Adj v) = g lambda_min`` to first order. Other observers: the same for the
    whole error matrix, ``r e = (H_own + H_other diag(e^{(A_j - r) delay})) e``, up to 600 states.

    We assume:
        * the delay is short, ``delay |A - g K C D| << 1``, so that a mode keeps its shape: no bound, a prediction.

    Args:
        observer: continuous programs with continuous exchange.
        delay: seconds, at least 0.

    Returns None where the problem is too large for it, or no eigenvalue settles.
    """
    if not (np.isfinite(delay) and delay >= 0.0):
        raise ArgumentError(f"delay must be a number of seconds, at least 0; got {delay}")
    if isinstance(observer, DiffusiveObserver) and observer.graph.dimension == 1:
        return _of_modes(observer, delay)
    programs = observer if isinstance(observer, AssembledObserver) else None
    if programs is None and isinstance(observer, DiffusiveObserver):
        programs = observer.as_programs()
    if programs is None or programs.states.total > _DENSE or programs.is_discrete:
        return None
    return _of_programs(programs, delay)


def _of_modes(observer: DiffusiveObserver, delay: float) -> float | None:
    graph, A = observer.graph, observer.agent.A
    pull = observer.gain * observer.injection @ observer.agent.C
    laplacian = graph.laplacian()
    degrees = laplacian.diagonal()
    if graph.n_nodes <= _DENSE:
        vectors = la.eigh(laplacian.toarray())[1]
    else:
        vectors = smallest_eigenvalue(graph).vector.reshape(-1, 1)
    own = (vectors**2 * degrees[:, None]).sum(axis=0)
    other = own - (vectors * (laplacian @ vectors)).sum(axis=0)
    found = [_abscissa(A - d * pull, a * pull, A, delay) for d, a in zip(own, other, strict=True)]
    return None if any(one is None for one in found) else -max(one for one in found if one is not None)


def _of_programs(observer: AssembledObserver, delay: float) -> float | None:
    own = np.zeros((observer.states.total, observer.states.total))
    motion = np.zeros_like(own)
    for k, node in enumerate(observer.nodes):
        place = observer.states.slice(k)
        pull = sum((arc.gain @ arc.output for arc in node.arcs), np.zeros_like(node.A))
        own[place, place], motion[place, place] = node.A - pull, node.A
    found = _abscissa(own, observer.error_matrix().toarray() - own, motion, delay)
    return None if found is None else -found


def _abscissa(own: FloatArray, other: FloatArray, A: FloatArray, delay: float) -> float | None:
    """Largest real part of r in ``det(r - own - other e^{(A - r) delay}) = 0``, followed from its value at delay 0."""
    moved = la.expm(A * delay)
    starts = la.eigvals(own + other)
    if own.shape[0] > 8:  # the rightmost few: one that was far to the left does not overtake them in a short delay
        starts = starts[np.argsort(-starts.real)][:4]
    found = [_followed(r, own, other @ moved, delay) for r in starts]
    settled = [r.real for r in found if r is not None]
    return max(settled) if len(settled) == len(found) else None


def _followed(r: complex, own: FloatArray, moved: FloatArray, delay: float) -> complex | None:
    for _ in range(_ROUNDS):
        values = la.eigvals(own + moved * np.exp(-r * delay))
        following = complex(values[np.argmin(np.abs(values - r))])
        if abs(following - r) <= _CLOSE * max(1.0, abs(r)):
            return following
        r = 0.5 * (r + following)
    return None


def is_homogeneous_network(observer: NetworkObserver) -> bool:
    """Whether the observer is of equal agents on a network."""
    return isinstance(getattr(observer, "problem", None), NetworkedAgents)
