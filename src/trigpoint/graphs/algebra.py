"""Incidence matrices and Laplacians of arc lists (G16, Section 2). ``tail`` is an index only where not external."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import BoolArray, FloatArray, IntArray
from trigpoint.linalg.blocks import Blocks

EXTERNAL = -1
"""Tail of an external arc: the environment (node 0 of G16). Never an index: test with ``graph.is_external``."""


def incidence(n_nodes: int, tail: IntArray, head: IntArray, external: BoolArray) -> sp.csc_array:
    """Generalized incidence ``G`` (N, M): -1 at the tail of an internal arc, +1 at every head."""
    arcs = np.arange(tail.shape[0])
    inner = ~external
    rows = np.concatenate([tail[inner], head])
    columns = np.concatenate([arcs[inner], arcs])
    entries = np.concatenate([-np.ones(int(inner.sum())), np.ones(head.shape[0])])
    return sp.csc_array((entries, (rows, columns)), shape=(n_nodes, tail.shape[0]))


def extended_incidence(n_nodes: int, tail: IntArray, head: IntArray, external: BoolArray) -> sp.csc_array:
    """Incidence with the environment as row 0 (N + 1, M): an ordinary incidence matrix (G16, Remark 1)."""
    whole = incidence(n_nodes, tail, head, external)
    environment = sp.csc_array(-external.astype(np.float64)[None, :])
    return sp.csc_array(sp.vstack([environment, whole]))


def laplacian(
    n_nodes: int, tail: IntArray, head: IntArray, external: BoolArray, weight: FloatArray | None
) -> sp.csr_array:
    """Generalized Laplacian ``L = G W G^T`` assembled arc by arc; parallel arcs add up.

    Diagonal: weight of all arcs at the node; off the diagonal: minus the weight between the two nodes.
    """
    size = 1 if weight is None or weight.ndim == 1 else weight.shape[1]
    values = (np.ones(tail.shape[0]) if weight is None else weight).reshape(tail.shape[0], size, size)
    inner = ~external
    t, h, w = tail[inner], head[inner], values[inner]
    low, high = np.minimum(t, h), np.maximum(t, h)
    # Each pair of nodes is summed once and mirrored, so that L is symmetric to the last bit.
    diagonal = _assembled(np.concatenate([head, t]), np.concatenate([head, t]), np.concatenate([values, w]), n_nodes)
    above = _assembled(low, high, -w, n_nodes)
    return sp.csr_array(diagonal + above + above.T)


def _assembled(rows: IntArray, columns: IntArray, entries: FloatArray, n_nodes: int) -> sp.csr_array:
    size = entries.shape[1]
    if size > 1:
        rows, columns, entries = _expand(rows, columns, entries, size)
    shape = (n_nodes * size, n_nodes * size)
    return sp.csr_array(sp.coo_array((entries.ravel(), (rows, columns)), shape=shape))


def _expand(rows: IntArray, columns: IntArray, entries: FloatArray, size: int) -> tuple[IntArray, IntArray, FloatArray]:
    count = int(max(rows.max(initial=-1), columns.max(initial=-1))) + 1
    blocks = Blocks(count, size)
    wide = np.repeat(blocks.positions(rows).reshape(-1, size, 1), size, axis=2)
    tall = np.repeat(blocks.positions(columns).reshape(-1, 1, size), size, axis=1)
    return wide.ravel(), tall.ravel(), entries
