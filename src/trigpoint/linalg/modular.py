"""Exact answers about matrices of floats: ranks modulo a prime, invariance in fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from trigpoint.arrays import FloatArray, IntArray

_PRIMES = (2**31 - 1, 2**31 - 19)
_LARGEST_EXACT = 60
_LARGEST_WHOLE = 2.0**53  # larger ones might make fractions of any length


def residues(matrix: FloatArray, prime: int) -> IntArray:
    """A matrix of floats modulo an odd ``prime``: mantissa times a power of two, which has an inverse."""
    mantissa, exponent = np.frexp(matrix)
    whole = np.ldexp(mantissa, 53).astype(np.int64) % prime
    powers = {int(e): pow(2, int(e) - 53, prime) for e in np.unique(exponent)}
    scale = np.vectorize(powers.__getitem__, otypes=[np.int64])(exponent)
    return np.asarray(_product(whole, scale, prime), dtype=np.int64)


def _product(a: IntArray, b: IntArray | int, prime: int) -> IntArray:
    return np.asarray(np.asarray(a) % prime * (np.asarray(b) % prime) % prime)  # below 2^62


def is_observable_pair(A: FloatArray, C: FloatArray) -> bool:
    """Prove that ``(C, C A, ..., C A^(n-1))`` has rank n, for the stored numbers; False means *not proved*.

    The rank modulo a prime is at most the true one. Args: ``A`` (n, n), ``C`` (p, n). Cost O(n^3).
    """
    return any(_rank_grows_to_full(residues(A, prime), residues(C, prime), prime) for prime in _PRIMES)


def _rank_grows_to_full(A: IntArray, C: IntArray, prime: int) -> bool:
    n = A.shape[0]
    basis = np.zeros((0, n), dtype=np.int64)  # reduced: each row has its pivot 1, and zeros in the other pivots
    pivots: list[int] = []
    waiting = list(C)
    while waiting and len(pivots) < n:
        row = waiting.pop(0) % prime
        for pivot, own in zip(pivots, basis, strict=True):
            if row[pivot]:
                row = (row - _product(own, int(row[pivot]), prime)) % prime
        places = np.flatnonzero(row)
        if not places.size:
            continue
        pivot = int(places[0])
        row = _product(row, pow(int(row[pivot]), -1, prime), prime)
        basis = np.vstack([basis, row[None, :]])
        pivots.append(pivot)
        image = np.zeros(n, dtype=np.int64)
        for k in np.flatnonzero(row):
            image = (image + _product(A[k], int(row[k]), prime)) % prime
        waiting.append(image)
    return bool(len(pivots) == n)


def stays_and_is_unseen(A: FloatArray, C: FloatArray, V: FloatArray) -> bool:
    """Prove in exact fractions that V has full rank, ``C V = 0`` and ``A V = V M`` for some M. Up to 60 rows.

    V must be whole numbers (n, r) of at most 2^53, and hold a multiple of the identity in r of its rows.
    """
    n, r = V.shape
    if not 0 < r <= n <= _LARGEST_EXACT or not np.isfinite(V).all() or np.mod(V, 1.0).any():
        return False
    lead = float(np.abs(V).max())
    rows: list[int] = []
    for column in range(r):
        hits = [k for k in range(n) if V[k, column] != 0.0 and not np.delete(V[k], column).any()]
        if not hits:
            return False
        rows.append(hits[0])
    if not 0.0 < lead <= _LARGEST_WHOLE:
        return False
    exact = [[Fraction(float(v)) for v in row] for row in V]
    moved = _times(A, exact)
    if any(value for row in _times(C, exact) for value in row):
        return False
    M = [[moved[rows[i]][j] / exact[rows[i]][i] for j in range(r)] for i in range(r)]
    stays = (
        moved[k][j] == sum((exact[k][i] * M[i][j] for i in range(r)), Fraction(0)) for k in range(n) for j in range(r)
    )
    return bool(all(stays))


def _times(matrix: FloatArray, columns: list[list[Fraction]]) -> list[list[Fraction]]:
    width = len(columns[0])
    return [
        [
            sum((Fraction(float(row[k])) * columns[k][j] for k in np.flatnonzero(row).tolist()), Fraction(0))
            for j in range(width)
        ]
        for row in matrix
    ]
