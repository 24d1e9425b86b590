"""One quadratic function for all ``F + s B C`` with ``|s| <= 1``: computed, for somebody else to verify."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray

_SHARES = (0.5, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 0.9)
_RISES = (0.3, 0.05, 1e-3)
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
    B, C = _balanced(F, B, C)
    high = -float(np.linalg.eigvals(F).real.max())
    if not high > 0.0 or _meets_the_axis(_hamiltonian(F, B, C, 0.0)):
        return []
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _meets_the_axis(_hamiltonian(F, B, C, middle)) else (middle, high)
    found = (_solution(_hamiltonian(F, B, C, (1.0 - share) * low)) for share in _SHARES)
    return [P for P in found if P is not None]


def functions_at(F: FloatArray, B: FloatArray, C: FloatArray, rate: float) -> list[FloatArray]:
    """The same of a given ``rate``: P of a few rates between it and the decay of F, the largest first.

    Args: ``F`` (n, n), ``B`` (n, p), ``C`` (p, n). Cost: some five eigenvalue problems of size 2n.
    """
    if not all(np.isfinite(matrix).all() for matrix in (F, B, C)):
        return []
    B, C = _balanced(F, B, C)
    gap = -float(np.linalg.eigvals(F).real.max()) - rate
    matrices = [_hamiltonian(F, B, C, rate + share * gap) for share in _RISES if gap > 0.0]
    found = [_solution(H) for H in matrices if not _meets_the_axis(H)]
    return [P for P in found if P is not None]


def _balanced(F: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray]:
    if not (B.any() and C.any()):  # one matrix: any Lyapunov equation serves
        return np.zeros_like(F), np.eye(F.shape[0])
    size = float(np.sqrt(np.abs(C).max()) / np.sqrt(np.abs(B).max()))
    return B * size, C / size


def _hamiltonian(F: FloatArray, B: FloatArray, C: FloatArray, rate: float) -> FloatArray:
    shifted = F + rate * np.eye(F.shape[0])
    with np.errstate(over="ignore", invalid="ignore"):
        return np.block([[shifted, B @ B.T], [-C.T @ C, -shifted.T]])


def _meets_the_axis(H: FloatArray) -> bool:
    if not np.isfinite(H).all():  # nothing is known of it
        return True
    values = np.linalg.eigvals(H)
    return bool((np.abs(values.real) <= _AXIS * np.abs(values).max()).any())


def _solution(H: FloatArray) -> FloatArray | None:
    n = H.shape[0] // 2
    try:
        _, vectors, stable = la.schur(H, sort="lhp")
        P = np.linalg.solve(vectors[:n, :n].T, vectors[n:, :n].T)
    except np.linalg.LinAlgError:  # too close to the axis to be told from it
        return None
    if stable != n:
        return None
    P = 0.5 * (P + P.T)
    largest = float(np.abs(P).max())
    return np.asarray(P / largest) if np.isfinite(largest) and largest > 0.0 else None
