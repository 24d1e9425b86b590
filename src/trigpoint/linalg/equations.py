"""Matrix equations of small systems, each returned with its residual."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray

_ON_THE_AXIS = 1e-14  # relative: real parts of computed eigenvalues below it are rounding


def filter_riccati(A: FloatArray, C: FloatArray, process: FloatArray, measurement: FloatArray) -> FloatArray:
    """Stabilizing solution Q (n, n) of ``A Q + Q A' - Q C' R^-1 C Q + S = 0`` (S process, R measurement covariance).

    Raises ``numpy.linalg.LinAlgError`` when there is none (a mode on the imaginary axis that noise does not reach).
    Source: G16, equation (17) with equality, in terms of Q = P^-1.
    """
    Q: FloatArray = la.solve_continuous_are(A.T, C.T, process, measurement)
    information = C.T @ la.solve(measurement, C)
    Q = 0.5 * (Q + Q.T)
    closed = A - Q @ information
    if spectral_abscissa(closed) >= -_ON_THE_AXIS * float(np.abs(closed).max()):
        raise np.linalg.LinAlgError("the solution found does not stabilize: there is a mode that noise does not reach")
    return _newton_step(A, information, process, Q)


def _newton_step(A: FloatArray, information: FloatArray, process: FloatArray, Q: FloatArray) -> FloatArray:
    """One Newton step of the Riccati equation, kept where it lowers the residual."""
    residual = A @ Q + Q @ A.T - Q @ information @ Q + process
    closed = A - Q @ information
    better = Q + la.solve_continuous_lyapunov(closed, -residual)
    better = 0.5 * (better + better.T)
    after = A @ better + better @ A.T - better @ information @ better + process
    return better if np.abs(after).max(initial=0.0) < np.abs(residual).max(initial=0.0) else Q


def filter_riccati_residual(
    A: FloatArray, C: FloatArray, process: FloatArray, measurement: FloatArray, Q: FloatArray
) -> float:
    """Largest entry of ``A Q + Q A' - Q C' R^-1 C Q + S`` relative to the largest of its terms."""
    gain = Q @ C.T
    terms = (A @ Q + Q @ A.T, gain @ la.solve(measurement, gain.T, assume_a="pos"), process)
    size = max(float(np.abs(term).max(initial=0.0)) for term in terms)
    return float(np.abs(terms[0] - terms[1] + terms[2]).max(initial=0.0)) / (size or 1.0)


def spectral_abscissa(A: FloatArray) -> float:
    """Largest real part of the eigenvalues (of one matrix, or the largest over a stack)."""
    return float(np.linalg.eigvals(A).real.max())


@contextmanager
def near_singular_allowed() -> Iterator[None]:
    """Solvers may warn that they had to perturb the coefficients: for a candidate that is verified afterwards, fine."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        yield
