"""Readable oracle for measured networks: dense weighted least squares with equality constraints."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from trigpoint.model import Network


def dense_covariance(network: Network) -> np.ndarray:
    d, m = network.dimension, network.graph.n_arcs
    covariance = network.covariance
    if covariance is None:
        return np.eye(m * d)
    if sp.issparse(covariance):
        return covariance.toarray()
    if covariance.ndim == 1:
        return np.diag(np.repeat(covariance, d))
    return la.block_diag(*covariance)


def constrained_least_squares(network: Network) -> np.ndarray:
    """Minimize ``r' R^-1 r`` subject to the exact readings (KKT system): estimates (N, d).

    The rows of exact readings are constraints; their covariance is not used.
    """
    graph, d = network.graph, network.dimension
    G = np.kron(graph.incidence().toarray(), np.eye(d))
    values = network.values.reshape(-1)
    exact = np.repeat(network.exact, d)
    noisy = ~exact
    weight = la.inv(dense_covariance(network)[np.ix_(noisy, noisy)])
    normal = G[:, noisy] @ weight @ G[:, noisy].T
    constraints = G[:, exact].T
    k = constraints.shape[0]
    system = np.block([[normal, constraints.T], [constraints, np.zeros((k, k))]])
    rhs = np.concatenate([G[:, noisy] @ weight @ values[noisy], values[exact]])
    solution, *_ = la.lstsq(system, rhs)
    return solution[: graph.n_nodes * d].reshape(graph.n_nodes, d)
