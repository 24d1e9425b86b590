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


Pair = tuple[flint.fmpq_mat, flint.fmpq_mat]


def modes(observer: DiffusiveObserver, ends: tuple[float, float], rate: float = 0.0) -> Pair:
    """``A - gain lambda K C + rate I`` at both ends of a range of eigenvalues."""
    A, pull = matrix(observer.agent.A), matrix(observer.injection) * matrix(observer.agent.C)
    n = observer.agent.n_states
    shift = matrix(np.eye(n)) * exact(rate)
    low, high = (A - pull * (exact(observer.gain) * exact(end)) + shift for end in ends)
    return low, high


def decreases(P: np.ndarray, pair: Pair) -> bool:
    """Is P > 0 and ``P F + F' P < 0`` at both ends?"""
    p = matrix(P)
    drifts = [p * F + F.transpose() * p for F in pair]
    return _is_definite(p.tolist()) and all(_is_definite((-drift).tolist()) for drift in drifts)


def have_a_common_function(pair: Pair) -> bool:
    """Is there a P for both of two 2 x 2 matrices? Both Hurwitz, and neither ``F1 F2`` nor ``F1 F2^-1`` has a negative
    eigenvalue. Source: ShortenNarendra2002.
    """
    first, second = pair
    if any(F[0, 0] + F[1, 1] >= 0 or F.det() <= 0 for F in pair):
        return False
    return not any(_has_a_negative_eigenvalue(M) for M in (first * second, first * second.inv()))


def _has_a_negative_eigenvalue(M: flint.fmpq_mat) -> bool:
    trace, det = M[0, 0] + M[1, 1], M.det()
    return bool(det < 0 or (trace < 0 and trace * trace >= 4 * det))
