"""The Chebyshev semi-iteration, step by step: NumPy only, since a deployed node runs it."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray


def chebyshev_factor(sequence: int, rho: float) -> float:
    """Factor omega of exchange number ``sequence`` (0, 1, ...) of the semi-iteration for the contraction ``rho``.

    ``omega_0 = 1``, then ``(2 / rho) T_k(1 / rho) / T_{k+1}(1 / rho)``, T the Chebyshev polynomials.
    Source: Golub and Varga 1961, key GolubVarga1961; theory 7-H4.
    """
    if sequence == 0:
        return 1.0
    theta = np.arccosh(1.0 / rho)
    share = (1.0 + np.exp(-2.0 * sequence * theta)) / (1.0 + np.exp(-2.0 * (sequence + 1) * theta))
    return float(2.0 / rho * np.exp(-theta) * share)


def accelerated(value: FloatArray, before: FloatArray, omega: float) -> FloatArray:
    """``x+ = omega x_new + (1 - omega) x_last`` for ``z = (x, x_last)``: ``value`` after, z ``before`` the exchange."""
    half = value.shape[0] // 2
    return np.concatenate([omega * value[:half] + (1.0 - omega) * before[half:], value[half:]])
