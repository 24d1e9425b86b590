"""Factorizations of sparse symmetric positive definite matrices."""

from __future__ import annotations

from typing import Protocol

import scipy.sparse as sp
from scipy.sparse.linalg import splu

from trigpoint.arrays import FloatArray


class Factorization(Protocol):
    """A factored matrix: ``solve`` takes (n,) or (n, k) right-hand sides."""

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return the solution of ``matrix @ x = rhs``."""
        ...


def factorize(matrix: sp.sparray) -> Factorization:
    """Factor a sparse symmetric positive definite matrix.

    SuperLU in symmetric mode with a minimum-degree ordering of ``A + A'`` and diagonal pivots: for M-matrices the
    pivots need no exchange, and the fill is up to 18 times smaller than with the default ordering.
    """
    factor: Factorization = splu(
        sp.csc_array(matrix),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return factor
