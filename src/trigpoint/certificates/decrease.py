"""The matrix inequality of one mode, with its rounding errors bounded."""

from __future__ import annotations

import numpy as np

from trigpoint.analysis.modes import mode_matrices
from trigpoint.arrays import FloatArray
from trigpoint.linalg.verified import gam, is_positive_definite
from trigpoint.observers.network import DiffusiveObserver


def mode_decreases(observer: DiffusiveObserver, P: FloatArray, rate: float, g: float) -> bool:
    """Prove ``-(P (A - g K C) + (A - g K C)' P + 2 rate P) > 0`` for the stored A, K, C."""
    A, C, K = observer.agent.A, observer.agent.C, observer.injection
    closed = mode_matrices(A, K, C, np.array([g]))[0]
    size = np.abs(A) + g * (np.abs(K) @ np.abs(C))
    return decreases(P, closed, size, rate)


def decreases(P: FloatArray, F: FloatArray, size: FloatArray, rate: float) -> bool:
    """Prove ``P F + F' P + 2 rate P < 0``, ``size`` bounding the terms that F was summed from."""
    product = P @ F
    decrease = -(product + product.T) - 2.0 * rate * P
    # Every entry is a sum of at most 4 n + 8 rounded terms of this size, whatever the order of evaluation.
    magnitude = np.abs(P) @ size
    magnitude = magnitude + magnitude.T + 2.0 * rate * np.abs(P)
    radius = gam(8.0 * P.shape[0] + 64.0) * magnitude
    return is_positive_definite(0.5 * (decrease + decrease.T), radius)
