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

    Source: Ruhe 1984, key Ruhe1984; performance as in shift-invert Lanczos with several poles.
    """

    def __init__(self, matrix: sp.csr_array, starts: FloatArray) -> None:
        self._matrix = matrix
        self._factors: dict[float, Factorization] = {}
        self._identity = sp.eye_array(matrix.shape[0])
        first = _orthonormal(starts)
        self._blocks = [first]
        self._images = [np.asarray(matrix @ first)]

    @property
    def size(self) -> int:
        """Number m of basis vectors."""
        return sum(block.shape[1] for block in self._blocks)

    def grow(self, pole: float, steps: int) -> None:
        """Add ``steps`` blocks ``(matrix + pole I)^-1 (last block)``, all with one factorization; pole positive."""
        factor = self._factors.get(pole) or factorize(self._matrix + pole * self._identity)
        if self._matrix.shape[0] <= _KEPT:
            self._factors[pole] = factor
        for _ in range(steps):
            last = self._blocks[-1]
            block = np.column_stack([factor.solve(np.ascontiguousarray(column)) for column in last.T])
            for _ in range(2):  # twice is enough
                for earlier in self._blocks:
                    block -= earlier @ (earlier.T @ block)
            fresh = _orthonormal(block)
            if fresh.shape[1] == 0:
                return  # the space is invariant: everything is exact already
            self._blocks.append(fresh)
            self._images.append(np.asarray(self._matrix @ fresh))

    def pairs(self) -> RitzPairs:
        """Ritz pairs of the whole basis."""
        basis, image = np.hstack(self._blocks), np.hstack(self._images)
        projected = basis.T @ image
        values, inner = la.eigh(0.5 * (projected + projected.T))
        return RitzPairs(values, basis @ inner)


def _orthonormal(block: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns; those that depend on others are dropped."""
    scale = np.linalg.norm(block, axis=0)
    kept = block[:, scale > 0.0] / scale[scale > 0.0]
    if kept.shape[1] == 0:
        return np.zeros((block.shape[0], 0))
    Q, R, _ = la.qr(kept, mode="economic", pivoting=True)
    size = np.abs(np.diagonal(R))
    return np.ascontiguousarray(Q[:, size > _DEPENDENT * max(float(size.max(initial=0.0)), 1e-300)])
