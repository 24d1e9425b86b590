"""Measured networks, drawn, and the slow readable oracle: dense weighted least squares by the pseudo-inverse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import strategies as st

from trigpoint.model import Network
from trigpoint.testing.strategies import measurement_graphs


@st.composite
def measured(draw, kinds=("none", "variances", "blocks", "joint"), connected=None, exact=True) -> Network:
    """Any connectivity, d = 1 (flat or not), 2, 3; exact readings on some anchors."""
    graph = draw(measurement_graphs(max_nodes=6, max_extra_arcs=9, externally_connected=connected))
    rng = np.random.default_rng(draw(st.integers(0, 2**20)))
    size = draw(st.sampled_from([1, 2, 3]))
    kind = draw(st.sampled_from([k for k in kinds if size == 1 or k != "variances"]))
    count = graph.n_arcs
    values = rng.normal(size=(count, size))
    fixed = np.zeros(count, dtype=bool)
    if exact:
        certain = graph.is_external & (rng.random(count) < 0.4)
        for k in np.flatnonzero(certain):
            values[k] = values[np.flatnonzero(certain & (graph.head == graph.head[k]))[0]]
        fixed = certain
    covariance = None
    root = rng.normal(size=(count, size, size))
    if kind == "variances":
        covariance = rng.uniform(0.1, 4.0, size=count)
    elif kind == "blocks":
        covariance = np.eye(size) + root @ root.transpose(0, 2, 1)
    elif kind == "joint" and count:
        mix = np.eye(count * size) + 0.4 * rng.normal(size=(count * size,) * 2) * (
            rng.random((count * size,) * 2) < 0.3
        )
        covariance = sp.csr_array(mix @ mix.T + 0.1 * np.eye(count * size))
    flat = size == 1 and kind != "blocks" and draw(st.booleans())
    return Network(graph, values[:, 0] if flat else values, covariance, exact=fixed)


@dataclass(frozen=True)
class Oracle:
    """Dense answer: x and its covariance (N d), residuals, and their covariance, all for variance factor 1."""

    x: np.ndarray
    covariance: np.ndarray
    residuals: np.ndarray
    residual_covariance: np.ndarray
    square_sum: float
    freedom: int


def dense_covariance(network: Network) -> np.ndarray:
    count, size = network.graph.n_arcs, network.dimension
    given = network.covariance
    if given is None:
        return np.eye(count * size)
    if sp.issparse(given):
        return given.toarray()
    return np.zeros((0, 0)) if not count else la.block_diag(*given.reshape(count, size, size))


def oracle(network: Network) -> Oracle:
    """Minimum of v' R^-1 v by the pseudo-inverse; unanchored components are shifted to their first node."""
    graph, size = network.graph, network.dimension
    D = np.kron(graph.incidence().toarray().T, np.eye(size))
    total = graph.n_nodes * size
    noisy = np.repeat(~network.exact, size)
    fixed, known = np.zeros(total), np.zeros(total, dtype=bool)
    table = network.values.reshape(graph.n_arcs, size)
    for k in np.flatnonzero(network.exact):
        own = slice(int(graph.head[k]) * size, (int(graph.head[k]) + 1) * size)
        fixed[own], known[own] = table[k], True
    R = dense_covariance(network)[np.ix_(noisy, noisy)]
    half = la.inv(la.cholesky(R, lower=True)) if R.size else R
    A = half @ D[noisy][:, ~known]
    b = half @ (network.values.ravel() - D @ fixed)[noisy]
    shift = shift_to_first(network)
    inverse = np.linalg.pinv(A, rcond=1e-10)
    x = fixed.copy()
    x[~known] = inverse @ b
    cofactor = np.zeros((total, total))
    cofactor[np.ix_(~known, ~known)] = inverse @ inverse.T
    residuals = network.values.ravel() - D @ x
    spread = np.zeros((len(noisy), len(noisy)))
    spread[np.ix_(noisy, noisy)] = R - (D @ cofactor @ D.T)[np.ix_(noisy, noisy)]
    rank = np.linalg.matrix_rank(A) if A.size else 0
    return Oracle(
        shift @ x,
        shift @ cofactor @ shift.T,
        residuals,
        spread,
        float(np.sum((half @ residuals[noisy]) ** 2)),
        int(noisy.sum()) - int(rank),
    )


def shift_to_first(network: Network) -> np.ndarray:
    """Matrix that takes the first node's value from every node of an unanchored component."""
    graph, size = network.graph, network.dimension
    T = np.eye(graph.n_nodes)
    for label, nodes in enumerate(graph.components):
        if not graph.component_is_anchored[label]:
            T[nodes, nodes[0]] -= 1.0
    return np.kron(T, np.eye(size))
