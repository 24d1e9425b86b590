"""The one file that talks to the semidefinite engine (extra ``lmi``)."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray
from trigpoint.errors import MissingExtraError

_ROOT = np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class Solution:
    """What the engine returned: ``x``, one dual matrix a cone, and whether it says that it solved the problem."""

    x: FloatArray
    duals: tuple[FloatArray, ...]
    solved: bool


def engine(purpose: str) -> Any:
    """The engine's module; ``MissingExtraError`` says what it was wanted for (``purpose``) and how to install it."""
    try:
        return importlib.import_module("clarabel")
    except ImportError as error:
        raise MissingExtraError("clarabel", "lmi", purpose) from error


def symmetric_basis(n: int) -> FloatArray:
    """(n (n + 1) / 2, n, n): the symmetric matrices with one entry, or one and its mirror image, equal to 1."""
    rows, columns = np.tril_indices(n)
    basis = np.zeros((rows.shape[0], n, n))
    number = np.arange(rows.shape[0])
    basis[number, rows, columns] = 1.0
    basis[number, columns, rows] = 1.0
    return basis


def minimise(
    module: Any, cost: FloatArray, cones: Sequence[tuple[FloatArray, FloatArray]], row: FloatArray | None = None
) -> Solution:
    """Minimise ``cost' x`` over x with ``F_0 + sum_k x_k F_k >= 0`` for each cone, and ``row' x = 1`` where given.

    Args:
        module: what ``engine`` returned.
        cost: (v,).
        cones: pairs of ``F_0`` (n, n) and the ``F_k`` (v, n, n), symmetric.
        row: (v,) or None.
    """
    blocks = [] if row is None else [sp.csc_array(row[None, :])]
    limits = [] if row is None else [np.ones(1)]
    kinds = [] if row is None else [module.ZeroConeT(1)]
    for constant, slopes in cones:
        blocks.append(sp.csc_array(-_packed(slopes).T))
        limits.append(_packed(constant[None])[0])
        kinds.append(module.PSDTriangleConeT(constant.shape[0]))
    settings = module.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    v = cost.shape[0]
    nothing = sp.csc_matrix((v, v))
    stacked = sp.csc_matrix(sp.vstack(blocks))
    found = module.DefaultSolver(nothing, cost, stacked, np.concatenate(limits), kinds, settings).solve()
    z, start, duals = np.asarray(found.z), 0 if row is None else 1, []
    for constant, _ in cones:
        n = constant.shape[0]
        stop = start + n * (n + 1) // 2
        duals.append(_unpacked(z[start:stop], n))
        start = stop
    solved = str(found.status) in ("Solved", "AlmostSolved")
    return Solution(np.asarray(found.x), tuple(duals), solved and bool(np.isfinite(found.x).all()))


def _packed(matrices: FloatArray) -> FloatArray:
    """Upper triangles column by column, off-diagonal entries times sqrt(2): the engine's order."""
    rows, columns = np.tril_indices(matrices.shape[-1])
    return np.asarray(matrices[:, rows, columns] * np.where(rows == columns, 1.0, _ROOT))


def _unpacked(vector: FloatArray, n: int) -> FloatArray:
    rows, columns = np.tril_indices(n)
    matrix = np.zeros((n, n))
    matrix[rows, columns] = matrix[columns, rows] = vector / np.where(rows == columns, 1.0, _ROOT)
    return matrix
