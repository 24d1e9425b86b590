"""The smallest eigenvalue of a symmetric matrix after a change of rank one, for many changes at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from trigpoint.arrays import FloatArray
from trigpoint.linalg.sparse import factorize

COMPLETE_LIMIT = 800
"""Up to this size all eigenpairs are computed, and the secular equation has no remainder."""

_BISECTIONS = 64
_LOWEST = 24


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The lowest eigenpairs of a symmetric positive semidefinite matrix.

    Attributes:
        values: (p,) ascending.
        vectors: (n, p) orthonormal columns.
        is_complete: p = n.
    """

    values: FloatArray
    vectors: FloatArray
    is_complete: bool

    def outside(self, squares: FloatArray, first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The parts of ``b' A^-1 b`` (``first``) and ``b' A^-2 b`` (``second``) outside these eigenpairs, >= 0."""
        live = self.values > 1e-13 * max(float(self.values[-1]), 1e-300)
        inverse = 1.0 / self.values[live]
        rho = np.maximum(first - squares[:, live] @ inverse, 0.0)
        nu = np.maximum(second - squares[:, live] @ inverse**2, 0.0)
        return rho, nu


def spectrum(matrix: sp.sparray) -> Spectrum:
    """All eigenpairs of a symmetric positive semidefinite ``matrix`` up to 800 rows, the 24 lowest ones above.

    Cost: O(n^3) up to 800 rows; above one sparse factorization and some sixty solves.
    """
    n = matrix.shape[0]
    if n <= COMPLETE_LIMIT:
        values, vectors = la.eigh(matrix.toarray())
        return Spectrum(np.maximum(values, 0.0), vectors, True)
    shift = -1e-9 * float(matrix.diagonal().max())
    shifted = factorize(sp.csc_array(matrix - shift * sp.eye_array(n)))
    inverse = LinearOperator((n, n), matvec=shifted.solve, dtype=np.float64)
    start = np.random.default_rng(0).normal(size=n)
    values, vectors = eigsh(sp.csc_array(matrix), k=_LOWEST, sigma=shift, OPinv=inverse, v0=start, which="LM")
    order = np.argsort(values)
    return Spectrum(np.maximum(values[order], 0.0), vectors[:, order], False)


@dataclass(frozen=True, eq=False)
class Tail:
    """What is known of the eigenpairs that a ``Spectrum`` leaves out, for K vectors b: ``c / (pole - mu) + constant``.

    With ``rho`` and ``nu`` the parts of ``b' A^-1 b`` and ``b' A^-2 b`` outside the spectrum, ``sum c_j / (lambda_j -
    mu)`` over those eigenpairs is the integral of the convex function ``1 / (1 - mu x)`` of ``x = 1 / lambda`` in
    ``(0, 1 / lambda_p]``, with total mass rho and first moment nu: least for one atom at its mean, greatest for atoms
    at both ends.
    """

    pole: FloatArray
    square: FloatArray
    constant: FloatArray

    @staticmethod
    def none(count: int) -> Tail:
        """Nothing is left out."""
        return Tail(np.full(count, np.inf), np.zeros(count), np.zeros(count))

    @staticmethod
    def least(found: Spectrum, rho: FloatArray, nu: FloatArray) -> Tail:
        """The smallest remainder: eigenvalues come out too large rather than too small (a Ritz value)."""
        last = float(found.values[-1])
        pole = np.maximum(rho / np.maximum(nu, 1e-300), last)
        return Tail(pole, rho * pole, np.zeros_like(rho))

    @staticmethod
    def greatest(found: Spectrum, rho: FloatArray, nu: FloatArray) -> Tail:
        """The largest remainder: eigenvalues come out too small rather than too large."""
        last = float(found.values[-1])
        at_end = np.minimum(nu * last, rho)
        return Tail(np.full_like(rho, last), at_end * last, rho - at_end)


def smallest_after(found: Spectrum, squares: FloatArray, weight: FloatArray, tail: Tail | None = None) -> FloatArray:
    """Smallest eigenvalue of ``A + w_k b_k b_k'`` for each k, (K,), from the secular equation.

    ``1 + w (sum_j c_j / (lambda_j - mu) + t(mu)) = 0`` with ``c_j = (v_j' b)^2``. Bisection on (0, lambda_1) where
    w < 0 and on (lambda_1, lambda_2) where w > 0.

    Args:
        found: the lowest eigenpairs of A.
        squares: (K, p) squared coefficients ``(v_j' b_k)^2``.
        weight: (K,) the weights w_k, of one sign.
        tail: what is known of the other eigenpairs; None where there are none.

    We assume:
        * ``1 + w b' A^-1 b > 0`` where w < 0 (the changed matrix is positive definite); else the result is 0.

    Cost O(K p) a bisection step, 64 of them.
    """
    values = found.values
    rest = Tail.none(weight.shape[0]) if tail is None else tail
    grows = bool((weight > 0).all())
    if grows and values.shape[0] == 1:
        return np.asarray(values[0] + weight * squares[:, 0])
    low = np.full(weight.shape[0], float(values[0]) if grows else 0.0)
    high = np.full(weight.shape[0], float(values[1] if grows else values[0]))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        gaps = values[None, :] - middle[:, None]
        gaps[gaps == 0.0] = 1e-300
        total = np.einsum("kj,kj->k", squares, 1.0 / gaps) + rest.constant
        total += rest.square / np.maximum(rest.pole - middle, 1e-300)
        below = (1.0 + weight * total < 0.0) if grows else (1.0 + weight * total > 0.0)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))
