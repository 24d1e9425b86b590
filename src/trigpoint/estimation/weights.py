"""The weight matrix ``R^-1`` of a measured network, sparse; correlated groups are inverted group by group."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from trigpoint.errors import ArgumentError
from trigpoint.linalg.blocks import block_diagonal
from trigpoint.model import Network


def weight_matrix(network: Network) -> sp.csr_array:
    """``R^-1`` (M d, M d), zero on the rows of exact readings."""
    return invert_blocks(covariance_matrix(network))


def covariance_matrix(network: Network) -> sp.csr_array:
    """R (M d, M d), the identity where none is known, empty on the rows of exact readings."""
    count, size = network.graph.n_arcs, network.dimension
    keep = sp.diags_array(np.repeat((~network.exact).astype(np.float64), size))
    covariance = network.covariance
    if covariance is None:
        whole = sp.eye_array(count * size)
    elif sp.issparse(covariance):
        whole = covariance
    elif covariance.ndim == 1:
        whole = sp.diags_array(np.where(network.exact, 1.0, covariance))
    else:
        whole = block_diagonal(np.where(network.exact[:, None, None], np.eye(size), covariance))
    result = sp.csr_array(keep @ whole @ keep)
    result.eliminate_zeros()
    return result


def invert_blocks(matrix: sp.csr_array) -> sp.csr_array:
    """Inverse of a symmetric positive definite matrix that is block diagonal after a permutation.

    The blocks are the connected components of the pattern; empty rows stay empty. Cost: the sum of the cubes of the
    block sizes.
    """
    occupied = matrix.diagonal() != 0.0
    if matrix.nnz == int(occupied.sum()):  # diagonal: nearly always
        return sp.csr_array(
            sp.diags_array(np.divide(1.0, matrix.diagonal(), out=np.zeros(len(occupied)), where=occupied))
        )
    _, labels = connected_components(matrix, directed=False)
    order = np.argsort(labels, kind="stable")
    parts, places = [], []
    for group in np.split(order, np.cumsum(np.bincount(labels))[:-1]):
        if occupied[group].any():
            block = matrix[group][:, group].toarray()
            try:
                parts.append(la.cho_solve(la.cho_factor(block), np.eye(len(group))))
            except np.linalg.LinAlgError as error:
                raise ArgumentError(
                    f"the joint covariance of the measured numbers {group[:6].tolist()} is not positive definite"
                ) from error
            places.append(group)
    rows = np.concatenate([np.repeat(group, len(group)) for group in places])
    columns = np.concatenate([np.tile(group, len(group)) for group in places])
    entries = np.concatenate([part.ravel() for part in parts])
    return sp.csr_array(sp.coo_array((entries, (rows, columns)), shape=matrix.shape))
