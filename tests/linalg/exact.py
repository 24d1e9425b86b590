"""Exact oracles in rational arithmetic: every float is a fraction, so these know the truth about stored numbers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from trigpoint.linalg.verified import Couplings


def exact_apply(matrix: Couplings, x: np.ndarray) -> list[Fraction]:
    """``L x`` for the stored couplings, without rounding."""
    values = [Fraction(float(v)) for v in x]
    result = [Fraction(0)] * matrix.size
    for i, j, w in zip(matrix.first, matrix.second, matrix.weight, strict=True):
        flow = Fraction(float(w)) * (values[i] - values[j])
        result[i] += flow
        result[j] -= flow
    for i, w in zip(matrix.ground, matrix.ground_weight, strict=True):
        result[i] += Fraction(float(w)) * values[i]
    return result


def exact_quotient(matrix: Couplings, x: np.ndarray) -> Fraction:
    """Rayleigh quotient ``x' L x / x' x``, without rounding."""
    values = [Fraction(float(v)) for v in x]
    product = exact_apply(matrix, x)
    return sum((a * b for a, b in zip(values, product, strict=True)), Fraction(0)) / sum(v * v for v in values)


def is_exactly_positive_definite(matrix: np.ndarray) -> bool:
    """Sylvester's criterion by Gaussian elimination on fractions."""
    rows = [[Fraction(float(v)) for v in row] for row in matrix]
    n = len(rows)
    for k in range(n):
        if rows[k][k] <= 0:
            return False
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return True
