"""A rate proved block by block, where the stored error matrix is block triangular after a permutation (theory 4.3b)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.certificates import programs
from trigpoint.linalg.verified import is_positive_definite


def blocks_of(H: FloatArray, radius: FloatArray) -> list[IntArray]:
    """The diagonal blocks: strongly connected components of the entries that are not exactly zero.

    Every other entry is zero in exact arithmetic, for each product that makes it up is; ordered by the condensation the
    matrix is block triangular, so that its spectrum is that of the blocks.
    """
    pattern = sp.csr_array((H != 0.0) | (radius != 0.0))
    count, labels = connected_components(pattern, directed=True, connection="strong")
    return [np.flatnonzero(labels == label) for label in range(count)]


def packed(matrices: list[FloatArray]) -> FloatArray:
    """All blocks' Lyapunov matrices as one row of numbers."""
    return np.concatenate([matrix.ravel() for matrix in matrices])


def proves(witness: FloatArray, H: FloatArray, radius: FloatArray, rate: float) -> bool:
    """Prove ``rate`` for every block from its own Lyapunov matrix in ``witness``."""
    blocks = blocks_of(H, radius)
    if witness.shape != (sum(block.shape[0] ** 2 for block in blocks),):
        return False
    start = 0
    for block in blocks:
        size = block.shape[0]
        P = witness[start : start + size * size].reshape(size, size)
        start += size * size
        own = np.ix_(block, block)
        if not (is_positive_definite(P) and programs.decreases(P, H[own], radius[own], rate)):
            return False
    return True


def structured_rate(H: FloatArray, radius: FloatArray, wanted: float | None) -> tuple[float, FloatArray] | None:
    """A rate and its packed witness, or None: also where there is one block only."""
    blocks = blocks_of(H, radius)
    if len(blocks) < 2:
        return None
    proofs = [programs.lyapunov_rate(H[np.ix_(b, b)], radius[np.ix_(b, b)], wanted) for b in blocks]
    if any(proof is None for proof in proofs):
        return None
    rate = min(proof[0] for proof in proofs if proof is not None)
    if any(proof[0] != rate for proof in proofs if proof is not None):  # the same rate for all, proved anew
        proofs = [programs.lyapunov_rate(H[np.ix_(b, b)], radius[np.ix_(b, b)], rate) for b in blocks]
    matrices = [proof[1] for proof in proofs if proof is not None]
    return (rate, packed(matrices)) if len(matrices) == len(blocks) else None
