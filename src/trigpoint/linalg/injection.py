"""Gains K that move the eigenvalues of ``A - K C``: to the left of a line, or to given places."""

from __future__ import annotations

import warnings

import numpy as np
import scipy.linalg as la
from scipy.optimize import linear_sum_assignment

from trigpoint.arrays import FloatArray
from trigpoint.linalg.equations import filter_riccati, spectral_abscissa

_STEPS = 8
_SWEEPS = (1, 2, 30)  # of the placement: more make it robust, and lose digits where it was so already
_CORRECTIONS = 2
_PROCESS = 1e-2  # little process noise: eigenvalues are hardly moved further than the shift asks


def rate_injection(A: FloatArray, C: FloatArray, rate: float) -> FloatArray:
    """K (n, p) with every eigenvalue of ``A - K C`` left of ``-rate``, the rightmost close to it if it can be.

    ``K = Q C'`` with Q from the filter equation of the shifted pair ``(A + s I, C)``, C in the units of A; the shift s
    is the least of a bisection between 0 and ``rate`` that suffices, since ``s = rate`` always does and asks for larger
    gains. Well conditioned where placing poles is not.

    Args:
        A: (n, n).
        C: (p, n).
        rate: 1/s, positive.

    We assume:
        * what C does not see lies left of ``-rate``.

    Raises ``numpy.linalg.LinAlgError`` where no shift gives a gain that reaches the rate.
    Cost: some ten Riccati equations, O(n^3). Source: theory 4b-B1 (the local gains); G16, equation (17).
    """
    n, size = A.shape[0], float(np.linalg.norm(C, 2)) if C.size else 0.0
    if n == 0 or C.shape[0] == 0:
        return np.zeros((n, C.shape[0]))
    scale = max(float(np.linalg.norm(A, 2)), rate) / (size or 1.0)
    found = None
    for share in np.linspace(1.0, 0.0, _STEPS, endpoint=False).tolist():  # the first, but for rounding
        found = _sufficient(A, C * scale, share * rate, rate)
        if found is not None:
            break
    if found is None:
        raise np.linalg.LinAlgError(f"no gain found that moves all modes left of -{rate:g}: C sees one weakly or not")
    low, high = 0.0, share * rate
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        trial = _sufficient(A, C * scale, middle, rate)
        found, low, high = (found, middle, high) if trial is None else (trial, low, middle)
    return np.asarray(found * scale)


def _sufficient(A: FloatArray, C: FloatArray, shift: float, rate: float) -> FloatArray | None:
    """The gain that belongs to a shift, where it suffices."""
    try:
        K = _shifted(A, C, shift)
    except (np.linalg.LinAlgError, ValueError):  # a mode on the axis that C does not see, or lost digits
        return None
    return K if spectral_abscissa(A - K @ C) < -rate else None


def _shifted(A: FloatArray, C: FloatArray, shift: float) -> FloatArray:
    n = A.shape[0]
    Q = filter_riccati(A + shift * np.eye(n), C, _PROCESS * np.eye(n), np.eye(C.shape[0]))
    return np.asarray(Q @ C.T)


def assigned_injection(A: FloatArray, C: FloatArray, eigenvalues: np.ndarray) -> FloatArray:
    """K (n, p) with the ``eigenvalues`` of ``A - K C`` as given, by robust placement on the dual pair.

    Args:
        A: (n, n).
        C: (p, n); dependent rows are allowed.
        eigenvalues: n of them, closed under conjugation, none more often than the rank of C.

    We assume:
        * (A, C) is observable; measure what came out by ``spectrum_error``.

    Raises ``ValueError`` where the list cannot be placed. Cost O(n^3) an iteration. Source: W17, section III.
    """
    left, values, right = la.svd(C, full_matrices=False)
    rank = int(np.sum(values > 1e-10 * values[0])) if values.size else 0
    trials = [_placed(A, right[:rank], eigenvalues, sweeps) / values[:rank] @ left[:, :rank].T for sweeps in _SWEEPS]
    best = min(trials, key=lambda K: spectrum_error(A - K @ C, eigenvalues))
    for _ in range(_CORRECTIONS):
        better = best + _correction(A - best @ C, C, np.asarray(eigenvalues))
        if not spectrum_error(A - better @ C, eigenvalues) < spectrum_error(A - best @ C, eigenvalues):
            break
        best = better
    return np.asarray(best)


def _correction(closed: FloatArray, C: FloatArray, eigenvalues: np.ndarray) -> FloatArray:
    """Smallest change of K that takes the eigenvalues the rest of the way (first order, ``d lambda = -y' dK C x``)."""
    values, right = la.eig(closed)
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return np.zeros((closed.shape[0], C.shape[0]))
    rows, columns = linear_sum_assignment(np.abs(values[:, None] - eigenvalues[None, :]))
    missing = np.empty(values.shape[0], dtype=np.complex128)
    missing[rows] = eigenvalues[columns] - values[rows]
    slope = -np.einsum("ka,kb->kab", left, (C @ right).T).reshape(values.shape[0], -1)
    step = np.linalg.lstsq(np.vstack([slope.real, slope.imag]), np.append(missing.real, missing.imag), rcond=None)[0]
    return np.asarray(step.reshape(closed.shape[0], C.shape[0]))


def _placed(A: FloatArray, C: FloatArray, eigenvalues: np.ndarray, sweeps: int) -> FloatArray:
    from scipy.signal import place_poles  # here: it brings scipy.stats, which takes longer to load than all else

    with warnings.catch_warnings():
        # The placement's own stopping rule is about robustness, not about the eigenvalues.
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(place_poles(A.T, C.T, eigenvalues, maxiter=sweeps).gain_matrix.T)


def spectrum_error(A: FloatArray, eigenvalues: np.ndarray) -> float:
    """Largest distance between the spectrum of A and the wanted ``eigenvalues``, best matched."""
    distance = np.abs(la.eigvals(A)[:, None] - np.asarray(eigenvalues)[None, :])
    rows, columns = linear_sum_assignment(distance)
    return float(distance[rows, columns].max(initial=0.0))
