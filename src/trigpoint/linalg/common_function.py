"""One quadratic function for all ``F + s B C`` with ``|s| <= 1``: computed, for somebody else to verify."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray

_SHARES = (0.5, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 0.9)
_BISECTIONS = 50
_AXIS = 1e-9


def common_functions(F: FloatArray, B: FloatArray, C: FloatArray) -> list[FloatArray]:
    """P > 0 of some rates r at which ``e' P e`` decreases along every ``F + s B C``; the largest r is approached.

    ``P (F + r I) + (F + r I)' P + C' C + P B B' P = 0`` has a solution P > 0 where ``C (i w I - F - r I)^-1 B`` is
    below 1 in norm at every w (bounded real lemma). For one column B and one row C no P exists where it is not.

    Args: ``F`` (n, n), ``B`` (n, p), ``C`` (p, n), sizes of B and C in the ratio that suits P. Returns (n, n) matrices,
    largest entry 1; none where even a small rate has none. Cost: some 60 eigenvalue problems of size 2n.
    Source: Boyd1994, Section 2.7.2.
    """
    if not all(np.isfinite(matrix).all() for matrix in (F, B, C)):
        return []
    if not (B.any() and C.any()):  # one matrix: any Lyapunov equation serves
        B, C = np.zeros_like(F), np.eye(F.shape[0])
    else:
        size = float(np.sqrt(np.linalg.norm(C) / np.linalg.norm(B)))
        B, C = B * size, C / size
    high = -float(np.linalg.eigvals(F).real.max())
    if not high > 0.0 or _meets_the_axis(_hamiltonian(F, B, C, 0.0)):
        return []
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _meets_the_axis(_hamiltonian(F, B, C, middle)) else (middle, high)
    found = (_solution(_hamiltonian(F, B, C, (1.0 - share) * low)) for share in _SHARES)
    return [P for P in found if P is not None]


def _hamiltonian(F: FloatArray, B: FloatArray, C: FloatArray, rate: float) -> FloatArray:
    shifted = F + rate * np.eye(F.shape[0])
    return np.block([[shifted, B @ B.T], [-C.T @ C, -shifted.T]])


def _meets_the_axis(H: FloatArray) -> bool:
    values = np.linalg.eigvals(H)
    return bool((np.abs(values.real) <= _AXIS * np.abs(values).max()).any())


def _solution(H: FloatArray) -> FloatArray | None:
    n = H.shape[0] // 2
    _, vectors, stable = la.schur(H, sort="lhp")
    if stable != n:
        return None
    upper, lower = vectors[:n, :n], vectors[n:, :n]
    try:
        P = np.linalg.solve(upper.T, lower.T)
    except np.linalg.LinAlgError:
        return None
    P = 0.5 * (P + P.T)
    largest = float(np.abs(P).max())
    return np.asarray(P / largest) if np.isfinite(largest) and largest > 0.0 else None
