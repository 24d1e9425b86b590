"""Oracle: spectra of the stored observers to fifty digits, and observers drawn for it to judge."""

from __future__ import annotations

import mpmath
import numpy as np

import trigpoint as tp
from trigpoint.certificates.base import Claim
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.observers.certificate import ClaimRecord
from trigpoint.observers.network import DiffusiveObserver

DIGITS = 50
SLACK = mpmath.mpf(10) ** -30
"""Error that the oracle itself may have, relative to the size of the matrix."""

AGENTS = {
    "static": tp.LinearAgent.static(1),
    "decaying": tp.LinearAgent([[-0.5]], [[1.0]]),
    "unstable": tp.LinearAgent([[0.3]], [[2.0]]),
    "double integrator": tp.LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]]),
    "oscillator": tp.LinearAgent([[0.0, 1.0], [-2.0, 0.0]], [[1.0, 0.0]]),
    "driven oscillator": tp.LinearAgent([[0.1, 1.0], [-1.0, 0.1]], [[0.0, 1.0]]),
    "two outputs": tp.LinearAgent([[0.0, 1.0], [0.0, -0.1]], [[1.0, 0.0], [0.5, 1.0]]),
}


def matrix(values: np.ndarray) -> mpmath.matrix:
    return mpmath.matrix(np.asarray(values, dtype=float).tolist())


def laplacian(graph: MeasurementGraph) -> mpmath.matrix:
    """``G W G'`` from the stored weights, without cancellation."""
    d = graph.dimension
    L = mpmath.zeros(graph.n_nodes * d)
    for tail, head, weight in zip(graph.tail.tolist(), graph.head.tolist(), graph.arc_weights, strict=True):
        block = matrix(np.atleast_2d(weight))
        ends = [(head, 1)] if tail == EXTERNAL else [(head, 1), (tail, -1)]
        for i, a in ends:
            for j, b in ends:
                for r in range(d):
                    for c in range(d):
                        L[i * d + r, j * d + c] += a * b * block[r, c]
    return L


def eigenvalues(graph: MeasurementGraph) -> list[mpmath.mpf]:
    with mpmath.workdps(DIGITS):
        return sorted(mpmath.eigsy(laplacian(graph), eigvals_only=True))


def _abscissa(error_matrix: mpmath.matrix) -> mpmath.mpf:
    if error_matrix.rows == 1:
        return error_matrix[0, 0]
    if error_matrix.rows == 2:
        half = (error_matrix[0, 0] + error_matrix[1, 1]) / 2
        square = half**2 - mpmath.det(error_matrix)
        return half + (mpmath.sqrt(square) if square > 0 else 0)
    return max(mpmath.re(value) for value in mpmath.eig(error_matrix, left=False, right=False))


def decay(observer: DiffusiveObserver) -> mpmath.mpf:
    """The rate at which the slowest part of the error really decays, from the stored numbers."""
    with mpmath.workdps(DIGITS):
        A, C = matrix(observer.agent.A), matrix(observer.agent.C)
        pull = mpmath.mpf(observer.gain) * matrix(observer.injection)
        if observer.graph.dimension == 1:
            return -max(_abscissa(A - value * (pull * C)) for value in eigenvalues(observer.graph))
        count, n, p = observer.graph.n_nodes, A.rows, C.rows
        L = laplacian(observer.graph)
        H = mpmath.zeros(count * n)
        for i in range(count):
            for j in range(count):
                block = -(pull * L[i * p : (i + 1) * p, j * p : (j + 1) * p] * C)
                block = block + A if i == j else block
                for r in range(n):
                    for c in range(n):
                        H[i * n + r, j * n + c] = block[r, c]
        return -_abscissa(H)


def holds(record: ClaimRecord, observer: DiffusiveObserver) -> bool:
    """Is what the record claims true?"""
    with mpmath.workdps(DIGITS):
        if record.claim == "smallest-eigenvalue":
            values = eigenvalues(observer.graph)
            slack = SLACK * values[-1]
            return record.numbers["lower"] <= values[0] + slack and values[0] - slack <= record.numbers["upper"]
        if record.claim == "convergence":
            true = decay(observer)
            return record.numbers["rate"] <= true + SLACK * (1 + abs(true))
        return record.claim == "locality"


def record_of(claim: Claim, observer: DiffusiveObserver) -> ClaimRecord:
    return claim.check(observer.problem, observer)


def drawn_graph(rng: np.random.Generator, nodes: int, decades: float = 0.0) -> MeasurementGraph:
    """A connected graph with parallel arcs and anchors, the last node's included, weights over ``decades``."""
    arcs = [(int(rng.integers(-1, k)) if k else EXTERNAL, k) for k in range(nodes)]
    for _ in range(int(rng.integers(0, nodes + 2))):
        tail, head = int(rng.integers(-1, nodes)), int(rng.integers(0, nodes))
        if tail != head:
            arcs.append((tail, head))
    order = rng.permutation(nodes)
    tails = [EXTERNAL if t == EXTERNAL else int(order[t]) for t, _ in arcs]
    weight = None if decades == 0.0 else 10.0 ** rng.uniform(-decades, decades, len(arcs))
    return MeasurementGraph(nodes, tails, [int(order[h]) for _, h in arcs], weight)


def drawn_observer(rng: np.random.Generator, agent: tp.LinearAgent, decades: float = 0.0) -> DiffusiveObserver:
    graph = drawn_graph(rng, int(rng.integers(1, 6)), decades)
    bound = tp.smallest_eigenvalue(graph)
    rules = [tp.FromGraph(1.05), tp.FromGraph(3.0), tp.Fixed(0.3 / bound.lower), tp.Fixed(0.7 / bound.lower)]
    return tp.design(
        tp.NetworkedAgents(graph, agent), tp.methods.LocalKalman(gain=rules[int(rng.integers(0, len(rules)))])
    )
