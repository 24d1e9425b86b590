"""``IntegratorObserver``: consensus on what relative and absolute readings say, for single integrators (R23)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.analysis.eigenvalue import EigenvalueBound
from trigpoint.analysis.modes import largest_eigenvalue_bound
from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.graphs import MeasurementGraph
from trigpoint.methods.base import Method
from trigpoint.methods.weights import optimal_weights
from trigpoint.model import NetworkedAgents
from trigpoint.observers.network import DiffusiveObserver

_NAME = "IntegratorObserver"


@dataclass(frozen=True, eq=False)
class IntegratorObserver(Method):
    """Observer of single integrators ``x_i' = B_i u_i`` from differences and anchor readings.

    ``z_i' = B_i u_i + sum over arcs of w_ij (y - (z_i - z_j)) + K (y_i - z_i)``, hence ``e' = -(Lambda (x) I) e`` with
    ``Lambda = D W D^T + K Delta``, the weighted generalized Laplacian; the rate is its smallest eigenvalue.

    Args:
        weights: w of the internal arcs: a scalar, one number an internal arc, or ``"optimal"`` (the largest rate for
            the same sum of weights; extra ``lmi``); the graph's own unless given.
        anchor_gain: K of the external arcs: a scalar or one number an external arc; the graph's own unless given.

    We assume:
        * A = 0 and C = I: constants, or integrators with known inputs (R23, Section VII);
        * every node has a path to an anchor; weights and gains are positive.

    Raises:
        MethodError: one of these does not hold.

    Guarantee: the error decays at least at ``decay_rate``, a rigorous lower bound of ``lambda_min(Lambda)``, which
    never exceeds (sum of anchor gains) / N, whatever the arcs (E-001-10). Cost: one smallest eigenvalue.
    Source: R23, equations (7)-(9), Lemma 23, Proposition 24; ``optimal``: theory 7-H2.
    """

    label: ClassVar[str] = "integrator"

    weights: FloatArray | Literal["optimal"] | None = None
    anchor_gain: FloatArray | None = None

    def __init__(
        self, weights: ArrayLike | Literal["optimal"] | None = None, anchor_gain: ArrayLike | None = None
    ) -> None:
        if isinstance(weights, str) and weights != "optimal":
            raise ArgumentError(f"weights must be numbers or 'optimal'; got {weights!r}")
        object.__setattr__(self, "weights", _positive("weights", weights))
        object.__setattr__(self, "anchor_gain", _positive("anchor_gain", anchor_gain))

    def build(self, problem: Any) -> DiffusiveObserver:
        """Return the observer, or raise ``MethodError``."""
        network = _accepted(problem)
        graph = self._weighted(network.graph)
        bound = smallest_eigenvalue(graph)
        if bound.unanchored.size:
            names = ", ".join(graph.names[k] for k in bound.unanchored[:8].tolist())
            raise MethodError(
                _NAME,
                "a path from every node to an anchor (R23, Lemma 23)",
                f"no such path from {names}",
                "Add an absolute reading there; diagnose() lists the islands.",
            )
        return DiffusiveObserver(
            method=self.label,
            problem=NetworkedAgents(graph, network.agents),
            injection=np.eye(network.n_outputs),
            gain=1.0,
            decay_rate=bound.lower,
            spectral_abscissa=-bound.value,
            facts=_facts(graph, bound),
        )

    def _weighted(self, graph: MeasurementGraph) -> MeasurementGraph:
        own = graph.arc_weights
        if own.ndim > 1:
            raise MethodError(_NAME, "scalar arc weights", "weight blocks", "Use Weighted() for covariances.")
        inner = ~graph.is_external
        weight = np.array(own)
        weight[~inner] = _filled("anchor_gain", self.anchor_gain, own[~inner])
        if isinstance(self.weights, str):
            return graph.with_weight(optimal_weights(graph.with_weight(weight), fixed=np.flatnonzero(~inner)).weights)
        weight[inner] = _filled("weights", self.weights, own[inner])
        return graph.with_weight(weight)


def _positive(name: str, value: Any) -> Any:
    if value is None or isinstance(value, str):
        return value
    numbers = as_floats(name, value)
    if numbers.ndim > 1 or (numbers <= 0).any():
        raise ArgumentError(f"{name} must be a positive number, or one an arc; got {value!r}")
    return numbers


def _filled(name: str, given: Any, own: FloatArray) -> FloatArray:
    if given is None:
        return own
    if given.ndim == 1 and given.shape != own.shape:
        raise MethodError(
            _NAME, f"{name} with {own.size} numbers, one an arc of that kind", f"{given.size}", "Give a scalar for all."
        )
    return np.broadcast_to(given, own.shape)


def _accepted(problem: Any) -> NetworkedAgents:
    if not isinstance(problem, NetworkedAgents):
        raise MethodError(
            _NAME, "a NetworkedAgents problem", type(problem).__name__, "Write NetworkedAgents(graph, agent)."
        )
    agent = problem.agents[0]
    if not problem.is_homogeneous or not agent.is_static or not np.array_equal(agent.C, np.eye(agent.n_states)):
        raise MethodError(
            _NAME,
            "single integrators: A = 0 and C = I on every node (R23, Section VII)",
            "other agents",
            "Use LocalKalman() for agents that move by themselves.",
        )
    return problem


def _facts(graph: MeasurementGraph, bound: EigenvalueBound) -> dict[str, Any]:
    external = graph.arc_weights[graph.is_external]
    return {
        "lambda_min": bound.value,
        "lambda_min_lower": bound.lower,
        "lambda_min_upper": bound.upper,
        "lambda_max_bound": largest_eigenvalue_bound(graph),
        "rate_ceiling": float(external.sum()) / graph.n_nodes,
        "gain_rule": "edge weights and anchor gains (R23 (7))",
        "driftless": True,
    }
