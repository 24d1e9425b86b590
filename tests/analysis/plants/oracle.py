"""Oracles: observability in exact rational arithmetic, and published plants."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import scipy.linalg as la

Rational = list[list[Fraction]]

HAN_A = np.array(
    [
        [-1, 0, 0, 0, 0, 0],
        [-1, 1, 1, 0, 0, 0],
        [1, -2, -1, -1, 1, 1],
        [0, 0, 0, -1, 0, 0],
        [-8, 1, -1, -1, -2, 0],
        [4, -0.5, 0.5, 0, 0, -4],
    ]
)
HAN_C = [
    [[1, 0, 0, 2, 0, 0], [2, 0, 0, 1, 0, 0]],
    [[2, 0, 1, 0, 0, 1]],
    [[0, 0, 0, 2, 0, 0]],
    [[1, 0, 2, 0, 0, 0], [2, 0, 4, 0, 0, 0]],
]
HAN_HEARS = {0: [1, 3], 1: [2], 2: [0, 1], 3: [0]}

ROOMS = [(1, 2), (1, 4), (2, 3), (2, 5), (3, 6), (4, 5), (4, 7), (5, 6), (5, 8), (6, 9), (7, 8), (8, 9)]
CONDUCTANCES = [5, 1, 5, 3, 8, 3, 8, 2, 7, 4, 2, 3]
SENSED_ROOMS = [(5, 6, 9), (2, 6, 9), (2, 5, 9), (2, 5, 6, 9)]


def thermal_network() -> tuple[np.ndarray, list[np.ndarray]]:
    X = np.zeros((9, 9))
    for (a, b), value in zip(ROOMS, CONDUCTANCES, strict=True):
        X[a - 1, b - 1] = X[b - 1, a - 1] = 0.05 * value
    return X - np.diag(X.sum(axis=1)), [np.eye(9)[np.array(rooms) - 1] for rooms in SENSED_ROOMS]


def exact(matrix) -> Rational:
    return [[Fraction(float(value)) for value in row] for row in np.atleast_2d(matrix)]


def observability_rows(A, C) -> Rational:
    """``[C; C A; ...; C A^(n-1)]`` exactly."""
    n = np.asarray(A).shape[0]
    block, a, rows = exact(C) if np.asarray(C).size else [], exact(A), []
    for _ in range(n):
        rows += block
        block = [[sum((r[k] * a[k][j] for k in range(n)), Fraction(0)) for j in range(n)] for r in block]
    return rows


def null_space(rows: Rational, n: int) -> np.ndarray:
    """(n, k) basis of the null space, by exact elimination (then as floats)."""
    work, pivots = [list(row) for row in rows], []
    for column in range(n):
        place = len(pivots)
        found = next((k for k in range(place, len(work)) if work[k][column] != 0), None)
        if found is None:
            continue
        work[place], work[found] = work[found], work[place]
        work[place] = [value / work[place][column] for value in work[place]]
        for k in range(len(work)):
            if k != place and work[k][column] != 0:
                factor = work[k][column]
                work[k] = [a - factor * b for a, b in zip(work[k], work[place], strict=True)]
        pivots.append(column)
    free = [column for column in range(n) if column not in pivots]
    basis = np.zeros((n, len(free)))
    for k, column in enumerate(free):
        basis[column, k] = 1.0
        for place, pivot in enumerate(pivots):
            basis[pivot, k] = -float(work[place][column])
    return basis


def exact_unobservable(A, C) -> np.ndarray:
    """(n, k) orthonormal basis of what C never sees, the dimension exact."""
    basis = null_space(observability_rows(A, C), np.asarray(A).shape[0])
    return la.qr(basis, mode="economic")[0] if basis.shape[1] else basis


def exact_rank(A, C) -> int:
    return np.asarray(A).shape[0] - exact_unobservable(A, C).shape[1]


def same_subspace(one: np.ndarray, other: np.ndarray) -> float:
    """Largest sine of the angles between two subspaces with orthonormal bases of equal dimension."""
    assert one.shape == other.shape
    return float(np.linalg.norm(one - other @ (other.T @ one), 2)) if one.size else 0.0


def reaching(hears: dict[int, list[int]], agent: int) -> set[int]:
    """Agents from which ``agent`` learns, found by walking."""
    found, todo = set(), [agent]
    while todo:
        now = todo.pop()
        if now not in found:
            found.add(now)
            todo += hears.get(now, [])
    return found
