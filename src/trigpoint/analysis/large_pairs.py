"""The PBH margin of one large sparse pair (A, C), at given candidate modes, without a dense decomposition."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from trigpoint.analysis.pairs import PairMargin

_UNOBSERVABLE, _OBSERVABLE = 1e-12, 1e-9  # as in pairs.py
_ON_THE_AXIS = 1e-9
_SUSPICIOUS = 1e-3
_DENSE = 60
_MOST_CANDIDATES = 200
_NEWTON_STEPS = 10
_ITERATIONS = 30


def large_pair_margin(
    A: sp.sparray, C: sp.sparray, candidates: NDArray[Any], *, unstable_only: bool = False
) -> PairMargin:
    """Minimum over s near the ``candidates`` of ``sigma_min([s I - A; C]) / ||(A, C)||``, by inverse iteration.

    With ``P = [s I - A; C]`` a step of inverse iteration on ``P'P`` is a solve with the quasi-definite matrix
    ``[[a I, P], [P', -d I]]``, whose condition is not squared; sigma is then ``|P v|`` for the vector found, so that a
    small value is always a true one. From a candidate with a small value s moves by Newton steps while sigma falls.

    Args:
        A: (n, n) sparse.
        C: (p, n) sparse.
        candidates: eigenvalues of A (approximately); all of them, since nothing is looked for elsewhere. Of conjugate
            pairs one is enough. Candidates that agree to 1e-8 (relative) are tried once.
        unstable_only: leave out modes left of the imaginary axis.

    We assume:
        * vectors found from two seeded starts show the smallest singular value (the verdict True rests on it).

    Verdict: True above 1e-9 relative, False below 1e-12, None between, and None instead of True above 200 different
    candidates, of which only 200 are tried. Cost: a few sparse factorizations a candidate.
    Source: R23, Theorem 6; theory 001-05, E-001-1.
    """
    pair = sp.csc_array(sp.vstack([A, C]))
    size = float(np.sqrt(abs(pair).sum(axis=0).max() * abs(pair).sum(axis=1).max())) or 1.0
    starts = _distinct(candidates, size)
    best = PairMargin(np.inf, 0j, np.zeros(A.shape[0], dtype=complex), True)
    for start in starts[:_MOST_CANDIDATES].tolist():
        s, value, vector = _newton(A, C, complex(start), size)
        if unstable_only and s.real < -_ON_THE_AXIS * size:
            continue
        if value / size < best.margin:
            best = PairMargin(value / size, s, vector.astype(complex), None)
    if best.margin <= _UNOBSERVABLE:
        verdict: bool | None = False
    else:
        verdict = True if best.margin >= _OBSERVABLE and starts.shape[0] <= _MOST_CANDIDATES else None
    return PairMargin(best.margin, best.mode, best.direction, verdict)


def _distinct(candidates: NDArray[Any], size: float) -> NDArray[Any]:
    """One of each conjugate pair, and one of those that agree to 1e-8, the rightmost first."""
    step = 1e-8 * size
    grid = np.column_stack([np.round(candidates.real / step), np.round(np.abs(candidates.imag) / step)])
    chosen = np.unique(grid, axis=0, return_index=True)[1]
    upper = candidates.real[chosen] + 1j * np.abs(candidates.imag[chosen])
    return np.asarray(upper[np.argsort(-upper.real, kind="stable")])


def _newton(A: sp.sparray, C: sp.sparray, s: complex, size: float) -> tuple[complex, float, NDArray[Any]]:
    """Towards a zero of sigma_min: with singular vectors u, v it changes by ``Re(u_1' v ds)``."""
    n = A.shape[0]
    P = _pencil(A, C, s)
    value, vector = _smallest(P, size)
    for _ in range(_NEWTON_STEPS if value < _SUSPICIOUS * size else 0):
        left = (P @ vector)[:n]
        slope = left.conj() @ vector / value if value > 0.0 else 0.0
        if abs(slope) < 1e-15:
            break
        trial = s - value / slope
        if s.imag == 0.0 or abs(trial.imag) < 1e-15 * size:
            trial = complex(trial.real, 0.0)
        moved = _pencil(A, C, trial)
        lower, other = _smallest(moved, size)
        if not lower < 0.5 * value:
            break
        s, P, value, vector = trial, moved, lower, other
    return s, value, vector


def _pencil(A: sp.sparray, C: sp.sparray, s: complex) -> sp.csc_array:
    at = s if s.imag else s.real
    return sp.csc_array(sp.vstack([at * sp.eye_array(A.shape[0]) - A, C]))


def _smallest(P: sp.csc_array, size: float) -> tuple[float, NDArray[Any]]:
    """Smallest singular value of P (or what inverse iteration finds, never less) and its right vector."""
    rows, n = P.shape
    if n <= _DENSE:
        _, values, right = la.svd(P.toarray(), full_matrices=False)
        return float(values[-1]), right[-1].conj()
    a, d = 1e-6 * size, 1e-16 * size
    corner = sp.block_array([[a * sp.eye_array(rows), P], [P.conj().T, -d * sp.eye_array(n)]], format="csc")
    factor = splu(corner, permc_spec="MMD_AT_PLUS_A")
    rng = np.random.default_rng(n)
    space = la.qr(rng.normal(size=(n, 2)).astype(P.dtype), mode="economic")[0]
    value, vector = np.inf, space[:, 0]
    for _ in range(_ITERATIONS):
        solved = factor.solve(np.vstack([np.zeros((rows, 2), dtype=P.dtype), space]))[rows:]
        space = la.qr(solved / np.abs(solved).max(), mode="economic")[0]
        _, values, right = la.svd(P @ space, full_matrices=False)
        before, value, vector = value, float(values[-1]), space @ right[-1].conj()
        if value > 0.999 * before or value < 1e-15 * size:
            break
    return value, vector
