"""How large gain times eigenvalue must be for one mode ``A - g K C``: the sufficient bound and the exact answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray

_REAL = 1e-8
_FLAT = 1e-11
_ZERO, _INFINITE = 1e-13, 1e9


def lmi_threshold(A: FloatArray, Q: FloatArray, information: FloatArray) -> float:
    """Smallest g with ``A Q + Q A' - 2 g Q S Q <= 0`` (S the ``information`` ``C' R^-1 C``); inf if there is none.

    For Q from the Riccati equation it is at most 1/2, so that ``gain > 1 / (2 lambda_min)`` suffices; for any Q that
    satisfies G16 (8) it is at most 1. By bisection to 1e-12. Args: A, Q of shape (n, n).
    Source: G16, Theorem 4 with E-000-12.
    """
    drift, pull = A @ Q + Q @ A.T, Q @ information @ Q
    scale = float(np.abs(drift).max() + np.abs(pull).max()) or 1.0

    def holds(g: float) -> bool:
        size = scale * max(1.0, g)
        return float(la.eigvalsh(drift - 2.0 * g * pull)[-1]) <= _FLAT * size

    if holds(0.0):
        return 0.0
    low, high = 0.0, 1.0
    while not holds(high):
        low, high = high, 2.0 * high
        if high > 1e9:
            return float("inf")
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


@dataclass(frozen=True)
class StableGains:
    """All g > 0 for which ``A - g K C`` is Hurwitz.

    Attributes:
        intervals: open intervals (low, high), ascending; the last high may be inf.
    """

    intervals: tuple[tuple[float, float], ...]

    @property
    def threshold(self) -> float:
        """Every larger g is stable; inf if none is."""
        return self.intervals[-1][0] if self.intervals and np.isinf(self.intervals[-1][1]) else float("inf")

    def covers(self, low: float, high: float) -> bool:
        """True where every g with ``low <= g <= high`` is stable."""
        return any(start < low and high < end for start, end in self.intervals)


def stable_gains(A: FloatArray, K: FloatArray, C: FloatArray) -> StableGains:
    """The exact set of g > 0 for which the mode ``A - g K C`` is Hurwitz.

    An eigenvalue meets the imaginary axis only where the Kronecker sum of ``A - g K C`` with itself is singular: real
    generalized eigenvalues of the pair of Kronecker sums. Between two of them stability does not change. Args:
    A (n, n), K (n, p), C (p, n). Gains beyond 1e9 times ``|A| / |K C|`` are not told from infinite ones. Cost O(n^6):
    n up to about 10. Source: E-000-12.
    """
    n = A.shape[0]
    eye, pull = np.eye(n), K @ C
    whole, part = np.kron(A, eye) + np.kron(eye, A), np.kron(pull, eye) + np.kron(eye, pull)
    values = la.eigvals(whole, part)
    finite = values[np.isfinite(values)]
    real = finite[np.abs(finite.imag) <= _REAL * np.maximum(np.abs(finite), 1.0)].real
    # Below the rounding of A itself a crossing is one at 0; the pencil's infinite eigenvalues come out as huge ones.
    unit = float(np.linalg.norm(A, 2)) / (float(np.linalg.norm(pull, 2)) or 1.0) or 1.0
    crossings = np.unique(real[(real > _ZERO * unit) & (real < _INFINITE * unit)])
    # A conjugate pair crosses twice at once: its two computed values are one.
    apart = np.diff(crossings, prepend=0.0) > 1e-9 * crossings
    cuts = np.concatenate([[0.0], crossings[apart], [np.inf]])
    kept: list[tuple[float, float]] = []
    for low, high in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        inside = 0.5 * (low + high) if np.isfinite(high) else 2.0 * low + unit
        if np.linalg.eigvals(A - inside * pull).real.max() < 0.0:
            touching = kept and kept[-1][1] == low and np.linalg.eigvals(A - low * pull).real.max() < -_REAL
            kept = [*kept[:-1], (kept[-1][0], high)] if touching else [*kept, (low, high)]
    return StableGains(tuple(kept))
