"""Published plants with many observers, and how far eigenvalues are from a list."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

import trigpoint as tp
from trigpoint.arrays import FloatArray

HAN_A = (
    (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (-1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
    (1.0, -2.0, -1.0, -1.0, 1.0, 1.0),
    (0.0, 0.0, 0.0, -1.0, 0.0, 0.0),
    (-8.0, 1.0, -1.0, -1.0, -2.0, 0.0),
    (4.0, -0.5, 0.5, 0.0, 0.0, -4.0),
)
HAN_OUTPUTS = (
    ((1, 0, 0, 2, 0, 0), (2, 0, 0, 1, 0, 0)),
    ((2, 0, 1, 0, 0, 1),),
    ((0, 0, 0, 2, 0, 0),),
    ((1, 0, 2, 0, 0, 0), (2, 0, 4, 0, 0, 0)),
)
HAN_HEARS = {0: [1, 3], 1: [2], 2: [0, 1], 3: [0]}
HAN_START = (1.0, 3.0, -2.0, -3.0, -1.0, 2.0)

ROOM_EDGES = ((1, 2), (1, 4), (2, 3), (2, 5), (3, 6), (4, 5), (4, 7), (5, 6), (5, 8), (6, 9), (7, 8), (8, 9))
ROOM_RATES = (5.0, 1.0, 5.0, 3.0, 8.0, 3.0, 8.0, 2.0, 7.0, 4.0, 2.0, 3.0)
ROOM_SENSORS = ((5, 6, 9), (2, 6, 9), (2, 5, 9), (2, 5, 6, 9))
ROOM_START = (15.8, 27.5, 7.4, 8.1, 11.2, 23.2, 25.3, 23.2, 18.3)


def han(scale: float = 1.0) -> tp.SharedPlant:
    """Six states, four agents, none of which sees everything (key HanTrentelmanWangShen2019); ``scale`` times A."""
    return tp.SharedPlant(scale * np.array(HAN_A), [np.array(C, dtype=float) for C in HAN_OUTPUTS], HAN_HEARS)


def rooms(exchange: float = 0.05) -> FloatArray:
    """The nine-room thermal network of Yang, Barboni, Rezaee and Parisini (2022); ``exchange`` scales its rates."""
    A = np.zeros((9, 9))
    for (a, b), rate in zip(ROOM_EDGES, ROOM_RATES, strict=True):
        A[a - 1, b - 1] = A[b - 1, a - 1] = exchange * rate
    return A - np.diag(A.sum(axis=1))


def distance(found: ArrayLike, listed: ArrayLike) -> float:
    """Largest distance between eigenvalues and a list, best matched."""
    one, other = np.asarray(found, dtype=complex), np.asarray(listed, dtype=complex)
    gaps = np.abs(one[:, None] - other[None, :])
    rows, columns = linear_sum_assignment(gaps)
    return float(gaps[rows, columns].max())


def left_vector(hears: dict[int, list[int]]) -> FloatArray:
    """r with ``r' L = 0``, the sum of its entries 4 (as printed for four agents)."""
    m = len(hears)
    L = np.zeros((m, m))
    for agent, others in hears.items():
        L[agent, agent] = len(others)
        L[agent, others] = -1.0
    vector = np.linalg.svd(L.T)[2][-1]
    return np.asarray(m * vector / vector.sum())
