"""A rate proved block by block, where the stored error matrix is block triangular after a permutation (theory 4.3b)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.certificates import pairs
from trigpoint.certificates.base import witness
from trigpoint.linalg.balls import Ball, decays
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.observers.certificate import ClaimRecord


def blocks_of(H: Ball) -> list[IntArray]:
    """The diagonal blocks: strongly connected components of the entries that are not exactly zero.

    Every other entry is zero in exact arithmetic, for each product that makes it up is; ordered by the condensation the
    matrix is block triangular, so that its spectrum is that of the blocks.
    """
    pattern = sp.csr_array((H.middle != 0.0) | (H.radius != 0.0))
    count, labels = connected_components(pattern, directed=True, connection="strong")
    return [np.flatnonzero(labels == label) for label in range(count)]


def packed(matrices: list[FloatArray]) -> FloatArray:
    """All blocks' Lyapunov matrices as one row of numbers."""
    return np.concatenate([matrix.ravel() for matrix in matrices])


def _part(H: Ball, block: IntArray) -> Ball:
    own = np.ix_(block, block)
    return Ball(H.middle[own], H.radius[own])


def proves(record: ClaimRecord, H: Ball, rate: float) -> bool:
    """Prove ``rate`` for every block from its own Lyapunov matrix in the ``record``'s witness ``blocks``."""
    blocks = blocks_of(H)
    packed_matrices = witness(record, "blocks", (sum(block.shape[0] ** 2 for block in blocks),))
    start = 0
    for block in blocks:
        size = block.shape[0]
        P = packed_matrices[start : start + size * size].reshape(size, size)
        start += size * size
        if not (is_positive_definite(P) and decays(P, _part(H, block), rate)):
            return False
    return True


def structured_rate(H: Ball, wanted: float | None) -> tuple[float, FloatArray] | None:
    """A rate and its packed witness, or None: also where there is one block only."""
    blocks = blocks_of(H)
    if len(blocks) < 2:
        return None
    parts = [_part(H, block) for block in blocks]
    proofs = [pairs.lyapunov_pair(part, None, wanted) for part in parts]
    rate = min((proof.rate if proof is not None else -np.inf for proof in proofs), default=-np.inf)
    if rate == -np.inf:
        return None
    if any(proof is not None and proof.rate != rate for proof in proofs):  # the same rate for all, proved anew
        proofs = [pairs.lyapunov_pair(part, None, rate) for part in parts]
    matrices = [proof.arrays["P"] for proof in proofs if proof is not None]
    return (rate, packed(matrices)) if len(matrices) == len(blocks) else None
