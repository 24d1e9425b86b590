"""Oracle: claims about small networks decided in fractions, by python-flint; no rounding anywhere."""

from __future__ import annotations

import flint
import numpy as np

from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.observers.network import DiffusiveObserver

PI_BELOW = flint.fmpq(31415926535897932384626433832795028841971693993751, 10**49)
PI_ABOVE = flint.fmpq(31415926535897932384626433832795028841971693993752, 10**49)


def exact(value: float) -> flint.fmpq:
    return flint.fmpq(*float(value).as_integer_ratio())


def matrix(values: np.ndarray) -> flint.fmpq_mat:
    return flint.fmpq_mat([[exact(v) for v in row] for row in np.asarray(values, dtype=float).tolist()])


def laplacian(graph: MeasurementGraph) -> list[list[flint.fmpq]]:
    L = [[flint.fmpq(0)] * graph.n_nodes for _ in range(graph.n_nodes)]
    ends = zip(graph.tail.tolist(), graph.head.tolist(), graph.arc_weights.tolist(), strict=True)
    for tail, head, weight in ends:
        w = exact(weight)
        L[head][head] += w
        if tail != EXTERNAL:
            L[tail][tail] += w
            L[head][tail] -= w
            L[tail][head] -= w
    return L


def _is_definite(rows: list[list[flint.fmpq]]) -> bool:
    rows = [list(row) for row in rows]
    for k in range(len(rows)):
        if rows[k][k] <= 0:
            return False
        for i in range(k + 1, len(rows)):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return True


def smallest_is_above(graph: MeasurementGraph, value: flint.fmpq) -> bool:
    """Is ``lambda_min > value``?"""
    return _is_definite([[v - value * (i == j) for j, v in enumerate(row)] for i, row in enumerate(laplacian(graph))])


def largest_is_below(graph: MeasurementGraph, value: flint.fmpq) -> bool:
    """Is ``lambda_max < value``?"""
    return _is_definite([[value * (i == j) - v for j, v in enumerate(row)] for i, row in enumerate(laplacian(graph))])


def decays_faster(observer: DiffusiveObserver, rate: flint.fmpq) -> bool:
    """Are all eigenvalues of the exact error matrix to the left of ``-rate``? By Routh's table."""
    A, n = matrix(observer.agent.A), observer.agent.n_states
    pull = matrix(observer.injection) * matrix(observer.agent.C) * exact(observer.gain)
    L = laplacian(observer.graph)
    size = n * len(L)
    H = flint.fmpq_mat(size, size)
    for i, row in enumerate(L):
        for j, value in enumerate(row):
            for r in range(n):
                for c in range(n):
                    entry = -value * pull[r, c] + (A[r, c] if i == j else 0)
                    H[i * n + r, j * n + c] = entry + (rate if i == j and r == c else 0)
    return _is_hurwitz(H.charpoly().coeffs()[::-1])


def _is_hurwitz(coefficients: list[flint.fmpq]) -> bool:
    """Routh's table of a monic polynomial, highest power first: every first entry positive."""
    upper, lower = list(coefficients[0::2]), list(coefficients[1::2])
    while lower:
        if lower[0] <= 0:
            return False
        factor = upper[0] / lower[0]
        following = [a - factor * b for a, b in zip(upper[1:], [*lower[1:], *[0] * len(upper)], strict=False)]
        upper, lower = lower, following
    return True
