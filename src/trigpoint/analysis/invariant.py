"""Many small matrices split by clusters of eigenvalues: orthonormal bases of their invariant subspaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from trigpoint.arrays import FloatArray, IntArray

NEAR = 1e-4
"""Relative to its matrix: eigenvalues nearer than this belong together (Jordan blocks up to size 4 spread so far)."""

_EQUAL = 1e-8
_AXIS = 1e-9


@dataclass(frozen=True, eq=False)
class Piece:
    """One matrix's invariant subspace for one cluster of eigenvalues: ``A_i Q = Q T``.

    Attributes:
        node: index i of the matrix.
        cluster: number of the cluster; pieces of several matrices share it.
        Q: (n_i, m) orthonormal columns.
        T: (m, m) the matrix there.
        values: (m,) its eigenvalues as computed.
    """

    node: int
    cluster: int
    Q: FloatArray
    T: FloatArray
    values: NDArray[Any]

    @property
    def size(self) -> float:
        """Frobenius norm of T."""
        return float(np.linalg.norm(self.T))

    @property
    def is_unstable(self) -> bool:
        """Is there an eigenvalue that is not clearly left of the imaginary axis (-1e-9, relative)?"""
        return float(self.values.real.max()) >= -_AXIS * self.size

    @property
    def is_marginal(self) -> bool:
        """Stable, or on the imaginary axis and semisimple: there ``T = 0`` or ``T^2 + b^2 I = 0``."""
        size = self.size
        if not self.is_unstable or size == 0.0:
            return True
        frequency = float(np.abs(self.values.imag).mean())
        if frequency <= _EQUAL * size:
            return False
        rest = self.T @ self.T / size + np.eye(self.T.shape[0]) * (frequency**2 / size)
        return bool(np.linalg.norm(rest) <= _EQUAL * size)


def invariant_pieces(matrices: Sequence[FloatArray]) -> list[Piece]:
    """Split every matrix of ``matrices`` by cluster of eigenvalues; equal matrices are split once.

    We assume:
        * eigenvalues (conjugates count as one) within 2e-4 of the larger matrix's norm belong together, transitively;
          none further apart than 1.2e-3 of it are linked directly.

    Cost O(n_i^3) for each different matrix. Source: 000-21.
    """
    keys = [(A.shape, A.tobytes()) for A in matrices]
    distinct = dict(zip(keys, matrices, strict=True))
    values = [la.eigvals(A) for A in distinct.values()]
    labels = _clusters(values, [float(np.linalg.norm(A)) for A in distinct.values()])
    split = {key: _split(A, v, c) for (key, A), v, c in zip(distinct.items(), values, labels, strict=True)}
    return [Piece(node, *part) for node, key in enumerate(keys) for part in split[key]]


def candidate_modes(pieces: Sequence[Piece]) -> NDArray[Any]:
    """The computed eigenvalues of ``pieces`` and each piece's mean: a Jordan block's are off, their mean is not."""
    real = np.array([piece.values.real.mean() for piece in pieces])
    imaginary = np.array([np.abs(piece.values.imag).mean() for piece in pieces])
    return np.concatenate([*(piece.values for piece in pieces), real + 1j * imaginary, real + 0j])


def shared_unstable(pieces: Sequence[Piece]) -> list[Piece]:
    """Those of ``pieces`` with an unstable eigenvalue that another node has too, to 1e-8 of the largest matrix."""
    unstable = [piece for piece in pieces if piece.is_unstable]
    if not unstable:
        return []
    values = [_own_modes(piece) for piece in unstable]
    owner = np.repeat([piece.node for piece in unstable], [v.shape[0] for v in values])
    place = np.repeat(np.arange(len(unstable)), [v.shape[0] for v in values])
    cell = 2.0 * _EQUAL * max(piece.size for piece in pieces) or 1.0
    found: set[int] = set()
    for cells in _cells(_points(np.concatenate(values)), cell):
        first = np.full(int(cells.max()) + 1, -1)
        first[cells] = owner
        several = np.zeros(first.shape[0], dtype=bool)
        several[cells[owner != first[cells]]] = True
        found.update(np.unique(place[several[cells]]).tolist())
    return [unstable[k] for k in sorted(found)]


def _own_modes(piece: Piece) -> NDArray[Any]:
    """Computed eigenvalues and their mean, on the real axis where they are as near to it as a Jordan block's are."""
    mean = complex(piece.values.real.mean(), np.abs(piece.values.imag).mean())
    return np.append(piece.values, [mean, mean.real if mean.imag <= NEAR * piece.size else mean])


def _clusters(values: list[NDArray[Any]], sizes: list[float]) -> list[IntArray]:
    """Labels of the eigenvalues: those in one cell of a grid for their magnitude are linked."""
    counts = [v.shape[0] for v in values]
    points = _points(np.concatenate(values))
    floor = 1e-12 * (max(sizes) or 1.0)
    level = np.repeat([int(np.ceil(np.log2(max(size, floor)))) for size in sizes], counts)
    rows, columns, total = [], [], points.shape[0]
    for own in np.unique(level).tolist():
        members = np.flatnonzero(level <= own)
        for cells in _cells(points[members], 4.0 * NEAR * 2.0**own):
            used = np.isin(cells, cells[level[members] == own])
            rows.append(members[used])
            columns.append(cells[used] + total)
            total += int(cells.max()) + 1
    places = (np.concatenate(rows), np.concatenate(columns))
    links = sp.coo_array((np.ones(places[0].shape[0]), places), shape=(total, total))
    labels = connected_components(links, directed=False)[1][: points.shape[0]]
    return np.split(labels, np.cumsum(counts)[:-1])


def _cells(points: FloatArray, width: float) -> list[IntArray]:
    """Cell numbers in four shifted grids: points nearer than half a cell share one of them at least once."""
    numbered = []
    for shift in product((0.0, 0.5), repeat=2):
        grid = np.floor(points / width + np.array(shift))
        numbered.append(np.unique(grid, axis=0, return_inverse=True)[1].ravel())
    return numbered


def _points(values: NDArray[Any]) -> FloatArray:
    return np.column_stack([values.real, np.abs(values.imag)])


def _split(
    A: FloatArray, values: NDArray[Any], labels: IntArray
) -> list[tuple[int, FloatArray, FloatArray, NDArray[Any]]]:
    """(label, Q, T, eigenvalues of T) for each cluster in the spectrum of A, by ordered real Schur forms."""
    found = np.unique(labels).tolist()
    if len(found) == 1:
        return [(found[0], np.eye(A.shape[0]), A, values)]
    split = []
    for label in found:

        def chosen(real: complex, imaginary: float = 0.0, label: int = label) -> bool:
            s = complex(real) + 1j * imaginary
            nearest = np.argmin(np.abs(values - complex(s.real, abs(s.imag))))
            return bool(labels[nearest] == label)

        T, Q, count = la.schur(A, output="real", sort=chosen)
        split.append((label, Q[:, :count], T[:count, :count], la.eigvals(T[:count, :count])))
    return split
