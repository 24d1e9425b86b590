"""The verb ``diagnose``."""

from __future__ import annotations

from typing import Any

from trigpoint.analysis.diagnosis import Diagnosis
from trigpoint.analysis.homogeneous import diagnose_homogeneous
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.model import LinearAgent, Network, NetworkedAgents


def diagnose(problem: Any) -> Diagnosis:
    """Tell whether every node can know its state, which nodes cannot, why, and what to add.

    Args:
        problem: ``NetworkedAgents`` with equal agents; or a ``MeasurementGraph`` or ``Network``, which stand for
            unknown constants (``A_1 = 0_d``, ``C_1 = I_d``).

    Raises:
        ArgumentError: something else, or agents that differ.

    Source: G16, Theorem 3, Corollary 2, Remark 4; R23, Theorem 6.
    """
    if isinstance(problem, MeasurementGraph | Network):
        graph = problem if isinstance(problem, MeasurementGraph) else problem.graph
        return diagnose_homogeneous(graph, LinearAgent.static(problem.dimension))
    if isinstance(problem, NetworkedAgents):
        return diagnose_homogeneous(problem.graph, problem.agent)
    raise ArgumentError(
        f"diagnose takes a NetworkedAgents, a MeasurementGraph or a Network; got {type(problem).__name__}"
    )
