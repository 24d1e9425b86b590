"""Systems with a known answer: planted unobservable pairs and relative-sensing problems."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.model.relative_sensing import RelativeSensing


def jordan(size, eigenvalue) -> np.ndarray:
    return eigenvalue * np.eye(size) + np.eye(size, k=1)


def planted_pair(rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, C, v): the eigenvector v of a Jordan block of size 1, 2 or 3 does not show, in rotated coordinates."""
    size, n = int(rng.integers(1, 4)), int(rng.integers(3, 9))
    eigenvalue = rng.uniform(-2, 2)
    rest = np.diag(_apart(rng, eigenvalue, n - size))
    A = la.block_diag(jordan(size, eigenvalue), rest)
    C = rng.normal(size=(int(rng.integers(1, 3)), n))
    C[:, 0] = 0.0
    Q, _ = la.qr(rng.normal(size=(n, n)))
    return Q @ A @ Q.T, C @ Q.T, Q[:, 0]


def _apart(rng, eigenvalue, count) -> np.ndarray:
    """Other eigenvalues, 0.3 from ``eigenvalue`` and 0.05 from each other, so that v is the only one unseen."""
    found: list[float] = []
    while len(found) < count:
        value = rng.uniform(-3, 3)
        if abs(value - eigenvalue) > 0.3 and all(abs(value - other) > 0.05 for other in found):
            found.append(value)
    return np.array(found)


def islands(rng, sizes, *, anchored=0) -> MeasurementGraph:
    """Random trees with extra arcs on shuffled nodes; the last ``anchored`` of them have an external arc."""
    order = rng.permutation(sum(sizes))
    parts = np.split(order, np.cumsum(sizes)[:-1])
    tail: list[int] = []
    head: list[int] = []
    for nodes in parts:
        for k in range(1, len(nodes)):
            tail.append(int(nodes[rng.integers(k)]))
            head.append(int(nodes[k]))
        if len(nodes) > 2:
            a, b = rng.choice(nodes, 2, replace=False)
            tail.append(int(a))
            head.append(int(b))
    for nodes in parts[len(parts) - anchored :]:
        tail.append(EXTERNAL)
        head.append(int(rng.choice(nodes)))
    return MeasurementGraph(int(sum(sizes)), tail, head)


def floating_indicators(graph) -> np.ndarray:
    groups = [c for c, a in zip(graph.components, graph.component_is_anchored, strict=True) if not a]
    K = np.zeros((graph.n_nodes, len(groups)))
    for k, nodes in enumerate(groups):
        K[nodes, k] = len(nodes) ** -0.5
    return K


def planted_sensing(rng) -> tuple[RelativeSensing, np.ndarray]:
    """A problem whose A has exactly one eigenvector in span K, at the head of a Jordan block of size 1, 2 or 3."""
    count = int(rng.integers(1, 4))
    anchored = int(rng.integers(0, 2))
    graph = islands(rng, rng.integers(2, 6, size=count + anchored).tolist(), anchored=anchored)
    K, n = floating_indicators(graph), graph.n_nodes
    hidden = K @ rng.normal(size=count)
    hidden /= np.linalg.norm(hidden)
    size = min(int(rng.integers(1, 4)), n)
    Q = la.qr(np.column_stack([hidden, rng.normal(size=(n, n - 1))]))[0]
    block = jordan(size, rng.uniform(-2, 2))
    rest = rng.normal(size=(n - size, n - size))
    inner = la.qr(rng.normal(size=(n - 1, n - 1)))[0]
    Q[:, 1:] = Q[:, 1:] @ inner
    return RelativeSensing(Q @ la.block_diag(block, rest) @ Q.T, graph), hidden
