"""Connectivity of arc lists in O(N + M)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from trigpoint.arrays import IntArray


def component_labels(n_nodes: int, tail: IntArray, head: IntArray) -> IntArray:
    """Number the connected components of an undirected arc list by their first node."""
    adjacency = sp.coo_array((np.ones(tail.shape[0]), (tail, head)), shape=(n_nodes, n_nodes))
    count, raw = connected_components(sp.csr_array(adjacency), directed=False)
    first = np.full(count, n_nodes, dtype=np.int64)
    np.minimum.at(first, raw, np.arange(n_nodes))
    rank = np.empty(count, dtype=np.int64)
    rank[np.argsort(first)] = np.arange(count)
    labels: IntArray = rank[raw]
    return labels


def groups(labels: IntArray) -> list[IntArray]:
    """Index arrays of equal labels, each ascending, ordered by label."""
    order = np.argsort(labels, kind="stable")
    ends = np.cumsum(np.bincount(labels))
    return np.split(order, ends[:-1])


def is_path(n_nodes: int, tail: IntArray, head: IntArray, external_heads: IntArray) -> bool:
    """Tell whether a generalized tree is a path with the environment at one of its ends (G16's chain)."""
    degree = np.bincount(np.concatenate([tail, head, external_heads]), minlength=n_nodes)
    return external_heads.shape[0] == 1 and bool((degree <= 2).all())
