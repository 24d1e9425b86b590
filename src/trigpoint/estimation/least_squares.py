"""Weighted least squares on a measured network (the yardstick for every observer)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from trigpoint.arrays import FloatArray, IntArray, frozen
from trigpoint.errors import ArgumentError
from trigpoint.estimation.cofactors import inverse_entries
from trigpoint.estimation.reliability import GLOBAL_LEVEL, GlobalTest, checked_level, suspects_of
from trigpoint.estimation.weights import invert_blocks, weight_matrix
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.blocks import Blocks, expand
from trigpoint.linalg.sparse import Factorization, factorize
from trigpoint.model import Network

_LEAST_REDUNDANCY = 1e-6
_REFINEMENTS = 3


@dataclass(frozen=True, eq=False)
class Estimate:
    """The least-squares answer.

    Attributes:
        names: N node names.
        x: (N,) or (N, d), like the values; relative to ``reference`` where the status is ``relative``.
        sigma: standard deviations, shaped like x; 0 for exact nodes and references; NaN where not computed.
        residuals: values minus ``x[head] - x[tail]``, shaped like the values.
        standardized: residuals divided by their standard deviations; 0 where nothing checks the measurement.
        redundancy: share of each measurement that others check, 0 (nothing does) to 1; shaped like the values. Over
            uncorrelated measurements it adds up to the degrees of freedom.
        suspects: arcs whose residual is improbable (two-sided 0.1 %), the worst first.
        suspects_kind: ``a-priori``: residuals over their stated standard deviations, by the normal distribution (data
            snooping); where ``a_priori`` was asked for, and where the global test fails because the residuals are too
            large, since a blunder inflates the m0 that would hide it. Else ``a-posteriori``: scaled by m0, by
            Student's distribution, m0 being estimated from the others (external studentization).
        status: (N,) ``anchored`` or ``relative``.
        reference: (N,) node that a relative node's value refers to; -1 where anchored.
        variance_factor: a-posteriori variance factor m0^2 = v' R^-1 v / degrees_of_freedom; None without any.
        degrees_of_freedom: measured numbers minus unknown numbers.
        sigma_kind: ``a-posteriori`` (sigma includes m0) or ``a-priori``.
        gradient: largest entry of ``A' R^-1 v`` relative to ``|A'| R^-1 |values|``: zero at the minimum.
        global_test: whether m0 fits the stated sigmas; None where none are stated or nothing is redundant.
    """

    names: tuple[str, ...]
    x: FloatArray
    sigma: FloatArray
    residuals: FloatArray
    standardized: FloatArray
    redundancy: FloatArray
    suspects: tuple[int, ...]
    status: NDArray[np.str_]
    reference: IntArray
    variance_factor: float | None
    degrees_of_freedom: int
    sigma_kind: Literal["a-posteriori", "a-priori"]
    gradient: float
    global_test: GlobalTest | None
    suspects_kind: Literal["a-posteriori", "a-priori"]

    @property
    def suspect_scores(self) -> FloatArray:
        """Largest standardized residual of each of ``suspects``, by the standard deviations that ranked it."""
        worst = np.abs(self.standardized.reshape(self.standardized.shape[0], -1)).max(axis=1, initial=0.0)
        scaled = self.variance_factor if self.suspects_kind != self.sigma_kind else None
        return frozen(worst[list(self.suspects)] * (1.0 if scaled is None else np.sqrt(scaled)))

    def summary(self) -> str:
        """Values and standard deviations, a line a node (the first 50), and what the residuals say."""
        count = len(self.names)
        x, sigma = self.x.reshape(count, -1), self.sigma.reshape(count, -1)
        lines = [
            f"{name}: {' '.join(f'{v:.6g}' for v in value)} +- {' '.join(f'{s:.2g}' for s in spread)} ({status})"
            for name, value, spread, status in list(zip(self.names, x, sigma, self.status, strict=True))[:50]
        ]
        if count > 50:
            lines.append(f"and {count - 50} more")
        factor = "none" if self.variance_factor is None else f"{self.variance_factor:.6g}"
        lines.append(f"degrees of freedom {self.degrees_of_freedom}, variance factor {factor}, sigma {self.sigma_kind}")
        if self.global_test is not None:
            lines.append(self.global_test.text)
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"Estimate({len(self.names)} nodes, {self.degrees_of_freedom} degrees of freedom, {self.sigma_kind})"


def estimate(
    network: Network | MeasurementGraph,
    values: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
    *,
    a_priori: bool = False,
    uncertainty: bool = True,
    level: float = GLOBAL_LEVEL,
) -> Estimate:
    """Best linear unbiased estimate of every node from all measurements, component by component.

    Minimizes ``v' R^-1 v`` with ``v = values - (G^T x)`` over the nodes that are not exactly known; R is the
    covariance (the identity where none is given). A component without any absolute reading is solved relative to its
    first node.

    Args:
        network: a measured network, or a graph with ``values`` (and ``covariance``) given beside it.
        values: (M,) or (M, d) measured values, in the unit of the answer.
        covariance: (M,) variances, (M, d, d) blocks or a sparse (M d, M d) matrix, in that unit squared.
        a_priori: take R as it is; otherwise standard deviations are scaled by the a-posteriori m0.
        uncertainty: compute standard deviations and suspects (one solve a node: minutes beyond 1e5 nodes).
        level: chance of failing the global test although the stated sigmas are right.

    We assume:
        * errors have mean zero and covariance R up to one unknown factor;
        * for the global test and the suspects, errors are normal.

    Raises:
        ArgumentError, ShapeError: the arguments do not fit together; ``level`` is not between 0 and 1.

    Cost: one sparse factorization; with ``uncertainty`` one solve a node.
    Source: Barooah and Hespanha (2007), key BarooahHespanha2007; theory 7-H3; tests: Baarda (1968), key Baarda1968.
    """
    checked_level(level)
    data = _as_network(network, values, covariance)
    system = _System.of(data)
    unknown, factor = system.solve()
    x = system.whole(unknown)
    residuals = system.values - system.differences @ x
    freedom = int(system.rows.sum()) - int(system.free.sum())
    weighted = system.weight @ residuals
    square_sum = float(residuals @ weighted)
    variance_factor = square_sum / freedom if freedom > 0 else None
    prior = a_priori or variance_factor is None
    scale = 1.0 if prior else float(np.sqrt(variance_factor or 0.0))
    stated = data.covariance is not None and freedom > 0
    test = GlobalTest.of(square_sum, freedom, level) if stated else None
    snooped = prior or (test is not None and test.too_large)
    cofactors = _Cofactors.of(system, factor, uncertainty)
    standardized = cofactors.standardized(residuals, scale)
    ranked = cofactors.standardized(residuals, 1.0) if snooped else standardized
    shape = data.values.shape
    node_shape = (data.graph.n_nodes, *shape[1:])
    return Estimate(
        names=data.graph.names,
        x=frozen(x.reshape(node_shape)),
        sigma=frozen((scale * cofactors.node_sigma).reshape(node_shape)),
        residuals=frozen(residuals.reshape(shape)),
        standardized=frozen(standardized.reshape(shape)),
        redundancy=frozen(cofactors.redundancy.reshape(shape)),
        suspects=suspects_of(ranked.reshape(shape[0], data.dimension), None if snooped else freedom),
        status=np.where(system.reference < 0, "anchored", "relative"),
        reference=frozen(system.reference, np.int64),
        variance_factor=variance_factor,
        degrees_of_freedom=freedom,
        sigma_kind="a-priori" if prior else "a-posteriori",
        gradient=system.gradient(weighted),
        global_test=test,
        suspects_kind="a-priori" if snooped else "a-posteriori",
    )


def _as_network(network: Network | MeasurementGraph, values: ArrayLike | None, covariance: Any) -> Network:
    if isinstance(network, Network):
        if values is not None or covariance is not None:
            raise ArgumentError("a Network has its values and covariance already: give the graph to use others")
        return network
    if not isinstance(network, MeasurementGraph):
        raise ArgumentError(f"estimate takes a Network, or a MeasurementGraph and values; got {type(network).__name__}")
    if values is None:
        raise ArgumentError("values are missing: one measured value an arc of the graph")
    return Network(network, values, covariance)


@dataclass(frozen=True, eq=False)
class _System:
    """The linear model ``values = D x + error``, split into free and fixed unknowns (all node-major)."""

    nodes: Blocks
    values: FloatArray
    differences: sp.csr_array
    weight: sp.csr_array
    rows: NDArray[np.bool_]
    free: NDArray[np.bool_]
    fixed_values: FloatArray
    reference: IntArray
    graph: MeasurementGraph

    @staticmethod
    def of(data: Network) -> _System:
        graph, size = data.graph, data.dimension
        nodes = Blocks(graph.n_nodes, size)
        fixed = np.zeros((graph.n_nodes, size))
        readings = np.flatnonzero(data.exact)
        fixed[graph.head[readings]] = data.values.reshape(graph.n_arcs, size)[readings]
        is_free = np.ones(graph.n_nodes, dtype=np.bool_)
        is_free[graph.head[readings]] = False
        reference = np.full(graph.n_nodes, -1, dtype=np.int64)
        first = np.full(graph.component_is_anchored.shape[0], graph.n_nodes, dtype=np.int64)
        np.minimum.at(first, graph.component_labels, np.arange(graph.n_nodes))
        floating = ~graph.component_is_anchored[graph.component_labels]
        reference[floating] = first[graph.component_labels[floating]]
        is_free[first[~graph.component_is_anchored]] = False
        return _System(
            nodes,
            data.values.ravel(),
            expand(sp.csr_array(graph.incidence().T), size),
            weight_matrix(data),
            np.repeat(~data.exact, size),
            np.repeat(is_free, size),
            fixed.ravel(),
            reference,
            graph,
        )

    def solve(self) -> tuple[FloatArray, Factorization | None]:
        """Free unknowns by sparse normal equations, refined until the gradient vanishes to rounding."""
        design = self.differences[:, np.flatnonzero(self.free)]
        unknown = np.zeros(design.shape[1])
        if not unknown.size:
            return unknown, None
        factor = factorize(design.T @ self.weight @ design)
        for _ in range(_REFINEMENTS):
            residuals = self.values - self.differences @ self.whole(unknown)
            unknown = unknown + factor.solve(design.T @ (self.weight @ residuals))
        return unknown, factor

    def whole(self, unknown: FloatArray) -> FloatArray:
        """All N d unknowns from the free ones."""
        x = self.fixed_values.copy()
        x[self.free] = unknown
        return x

    def gradient(self, weighted: FloatArray) -> float:
        """Size of the normal equations' residual relative to its terms."""
        design = self.differences[:, np.flatnonzero(self.free)]
        size = np.abs(design).T @ (np.abs(self.weight) @ np.abs(self.values))
        return float(np.abs(design.T @ weighted).max(initial=0.0)) / (float(size.max(initial=0.0)) or 1.0)


@dataclass(frozen=True, eq=False)
class _Cofactors:
    """What the inverse of the normal matrix says about nodes and arcs, for variance factor 1."""

    node_sigma: FloatArray
    residual_sigma: FloatArray
    redundancy: FloatArray

    @staticmethod
    def of(system: _System, factor: Factorization | None, wanted: bool) -> _Cofactors:
        if not wanted:
            unknown = np.full(system.values.shape[0], np.nan)
            return _Cofactors(np.full(system.nodes.total, np.nan), unknown, unknown)
        node, between = inverse_entries(factor, system.free, system.graph, system.nodes)
        size = system.nodes.size
        diagonal = system.nodes.split(node)
        spread = diagonal[system.graph.head] + system.graph.at_tail(diagonal, 0.0) - 2.0 * between.reshape(-1, size)
        prior = _prior_variances(system.weight)
        rest = np.maximum(prior - spread.ravel(), 0.0)
        redundancy = np.divide(rest, prior, out=np.zeros_like(rest), where=prior > 0)
        return _Cofactors(np.sqrt(np.maximum(node, 0.0)), np.sqrt(rest), redundancy)

    def standardized(self, residuals: FloatArray, scale: float) -> FloatArray:
        """Residuals over their standard deviations; 0 where the measurement is checked by nothing."""
        checked = (self.redundancy > _LEAST_REDUNDANCY) & (scale > 0)
        result = np.where(np.isnan(self.redundancy), np.nan, 0.0)
        return np.divide(residuals, scale * self.residual_sigma, out=result, where=checked)


def _prior_variances(weight: sp.csr_array) -> FloatArray:
    """Diagonal of R from the block-sparse R^-1: exact readings (weight 0) get 0."""
    return np.asarray(invert_blocks(weight).diagonal())
