"""The one owner of index ranges: node-major stacked vectors and block matrices (``I (x) A``).

Nowhere else in the package is an offset ``i * n`` computed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from trigpoint.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Blocks:
    """A stacked vector of ``count`` equal blocks of ``size`` entries, block after block (node-major)."""

    count: int
    size: int

    @property
    def total(self) -> int:
        """Length of the stacked vector."""
        return self.count * self.size

    def slice(self, block: int) -> slice:
        """Positions of one block in the stacked vector."""
        return slice(block * self.size, (block + 1) * self.size)

    def positions(self, blocks: IntArray) -> IntArray:
        """Positions of several blocks, shape (len(blocks) * size,), in the given order."""
        offsets = np.arange(self.size, dtype=np.int64)
        positions: IntArray = (np.asarray(blocks, dtype=np.int64)[:, None] * self.size + offsets).ravel()
        return positions

    def split(self, vector: NDArray[Any]) -> NDArray[Any]:
        """Return a stacked vector (..., count * size) as (..., count, size), without copying."""
        return vector.reshape(*vector.shape[:-1], self.count, self.size)

    def stack(self, table: NDArray[Any]) -> NDArray[Any]:
        """Return (..., count, size) as the stacked (..., count * size), without copying where possible."""
        return table.reshape(*table.shape[:-2], self.total)


def repeat_diagonal(count: int, block: FloatArray) -> sp.csr_array:
    """``I_count (x) block``: sparse, shape (count * rows, count * columns)."""
    return sp.csr_array(sp.kron(sp.eye_array(count), sp.csr_array(block)))


def block_diagonal(blocks: FloatArray) -> sp.csr_array:
    """Block diagonal sparse matrix of the (count, rows, columns) array ``blocks``."""
    count, rows, columns = blocks.shape
    indptr = np.arange(count + 1)
    matrix = sp.bsr_array((blocks, np.arange(count), indptr), shape=(count * rows, count * columns))
    return sp.csr_array(matrix)


def diagonal_of(blocks: Iterable[Any]) -> sp.csr_array:
    """Block diagonal sparse matrix of dense or sparse blocks of any sizes."""
    given = list(blocks)
    if not given or any(sp.issparse(block) for block in given):
        return sp.csr_array(sp.block_diag([sp.csr_array(block) for block in given]))
    tables = [np.atleast_2d(block) for block in given]
    rows, columns = (Ranges.of(table.shape[axis] for table in tables) for axis in (0, 1))
    places = [np.nonzero(table) for table in tables]
    entries = np.concatenate([table[place] for table, place in zip(tables, places, strict=True)])
    i = np.concatenate([place[0] + start for place, start in zip(places, rows.starts, strict=False)])
    j = np.concatenate([place[1] + start for place, start in zip(places, columns.starts, strict=False)])
    return sp.csr_array((entries, (i, j)), shape=(rows.total, columns.total))


def expand(matrix: sp.sparray, size: int) -> sp.csr_array:
    """``matrix (x) I_size``: every entry becomes a multiple of the identity (node-major)."""
    return sp.csr_array(matrix) if size == 1 else sp.csr_array(sp.kron(matrix, sp.eye_array(size)))


@dataclass(frozen=True)
class Ranges:
    """A stacked vector of blocks of any sizes, block after block; ``starts`` has one entry more than there are."""

    starts: tuple[int, ...]

    @staticmethod
    def of(sizes: Iterable[int]) -> Ranges:
        """Ranges of blocks of these ``sizes``."""
        starts = [0]
        for size in sizes:
            starts.append(starts[-1] + int(size))
        return Ranges(tuple(starts))

    @property
    def count(self) -> int:
        """Number of blocks."""
        return len(self.starts) - 1

    @property
    def total(self) -> int:
        """Length of the stacked vector."""
        return self.starts[-1]

    def start(self, block: int) -> int:
        """Position of the first entry of one block."""
        return self.starts[block]

    def size(self, block: int) -> int:
        """Number of entries of one block."""
        return self.starts[block + 1] - self.starts[block]

    def slice(self, block: int) -> slice:
        """Positions of one block in the stacked vector."""
        return slice(self.starts[block], self.starts[block + 1])
