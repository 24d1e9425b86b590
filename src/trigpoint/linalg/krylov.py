"""Rational Krylov spaces of a sparse symmetric positive semidefinite matrix: few vectors that carry ``f(matrix) b``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from trigpoint.arrays import FloatArray
from trigpoint.linalg.sparse import Factorization, factorize

_DEPENDENT = 1e-13
_KEPT = 200_000  # above this size a factorization is made again rather than kept
_INVARIANT = 1e-12
_ROOM = 128  # rows are taken from the system when they are written to


@dataclass(frozen=True, eq=False)
class RitzPairs:
    """Approximate eigenpairs that carry the starting vectors.

    Attributes:
        values: (m,) Ritz values.
        vectors: (N, m) orthonormal.
    """

    values: FloatArray
    vectors: FloatArray


class RationalKrylov:
    """An orthonormal basis V of ``span{starts, (matrix + s I)^-1 starts, ...}``, grown pole by pole.

    With ``V' matrix V = S diag(theta) S'`` the action of any smooth f is ``f(matrix) b = V S f(theta) S' V' b`` as
    nearly as the poles let it; growing the basis and watching the change tells how nearly.

    Args:
        matrix: (N, N) sparse, symmetric, positive semidefinite.
        starts: (N, b) the vectors that f will be applied to.

    Memory: N numbers a basis vector, and one factorization (up to 200 000 rows: one a pole).
    Source: Ruhe 1984, key Ruhe1984; performance as in shift-invert Lanczos with several poles.
    """

    def __init__(self, matrix: sp.csr_array, starts: FloatArray) -> None:
        self._matrix = matrix
        self._factors: dict[float, Factorization] = {}
        self._identity = sp.eye_array(matrix.shape[0])
        first = _orthonormal(starts)
        self._basis = np.empty((_ROOM + first.shape[1], matrix.shape[0]))  # a row a vector
        self._projected = np.zeros((self._basis.shape[0], self._basis.shape[0]))
        self._size = 0
        self._last = first
        self._append(first)

    @property
    def size(self) -> int:
        """Number m of basis vectors."""
        return self._size

    @property
    def basis(self) -> FloatArray:
        """(N, m) orthonormal; a view."""
        return self._basis[: self._size].T

    def grow(self, pole: float, steps: int) -> None:
        """Add ``steps`` blocks ``(matrix + pole I)^-1 (last block)``, all with one factorization; pole positive."""
        factor = self._factors.get(pole)
        if factor is None:
            factor = factorize(self._matrix + pole * self._identity)
        if self._matrix.shape[0] <= _KEPT:
            self._factors[pole] = factor
        for _ in range(steps):
            block = np.column_stack([factor.solve(np.ascontiguousarray(column)) for column in self._last.T])
            known, scale = self._basis[: self._size], np.linalg.norm(block, axis=0)
            for _ in range(2):  # twice is enough
                block -= known.T @ (known @ block)
            fresh = _orthonormal(block[:, np.linalg.norm(block, axis=0) > _INVARIANT * scale])
            if fresh.shape[1] == 0:
                return  # the space is invariant: everything is exact already
            self._append(fresh)

    def ritz(self) -> tuple[FloatArray, FloatArray]:
        """Ritz values theta (m,) and S (m, m): the Ritz vectors are ``basis @ S``."""
        projected = self._projected[: self._size, : self._size]
        values, inner = la.eigh(0.5 * (projected + projected.T))
        return values, inner

    def pairs(self) -> RitzPairs:
        """Ritz pairs of the whole basis."""
        values, inner = self.ritz()
        return RitzPairs(values, self.basis @ inner)

    def _append(self, block: FloatArray) -> None:
        size = self._size + block.shape[1]
        if size > self._basis.shape[0]:
            room = max(size, self._basis.shape[0] + _ROOM)
            basis, projected = np.empty((room, self._basis.shape[1])), np.zeros((room, room))
            basis[: self._size] = self._basis[: self._size]
            projected[: self._size, : self._size] = self._projected[: self._size, : self._size]
            self._basis, self._projected = basis, projected
        self._basis[self._size : size] = block.T
        across = self._basis[:size] @ np.asarray(self._matrix @ block)
        self._projected[:size, self._size : size] = across
        self._projected[self._size : size, :size] = across.T
        self._size, self._last = size, block


def _orthonormal(block: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns; those that depend on others are dropped."""
    scale = np.linalg.norm(block, axis=0)
    kept = block[:, scale > 0.0] / scale[scale > 0.0]
    if kept.shape[1] == 0:
        return np.zeros((block.shape[0], 0))
    if kept.shape[1] == 1:
        return np.ascontiguousarray(kept)
    Q, R, _ = la.qr(kept, mode="economic", pivoting=True)
    size = np.abs(np.diagonal(R))
    return np.ascontiguousarray(Q[:, size > _DEPENDENT * max(float(size.max(initial=0.0)), 1e-300)])
