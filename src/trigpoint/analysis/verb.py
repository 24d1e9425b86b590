"""The verb ``diagnose``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trigpoint.analysis.agreement import diagnose_agreement
from trigpoint.analysis.diagnosis import Diagnosis
from trigpoint.analysis.heterogeneous import diagnose_heterogeneous
from trigpoint.analysis.homogeneous import diagnose_homogeneous
from trigpoint.analysis.relative_sensing import diagnose_relative_sensing
from trigpoint.analysis.shared_plant import diagnose_shared_plant
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.model import (
    AgreementDynamics,
    HyperNetwork,
    LinearAgent,
    Network,
    NetworkedAgents,
    RelativeSensing,
    SharedPlant,
)


def _diagnose_agents(problem: NetworkedAgents) -> Diagnosis:
    if problem.is_homogeneous:
        return diagnose_homogeneous(problem.graph, problem.agent)
    return diagnose_heterogeneous(HyperNetwork.of_networked(problem))


def _diagnose_constants(problem: MeasurementGraph | Network) -> Diagnosis:
    graph = problem if isinstance(problem, MeasurementGraph) else problem.graph
    return diagnose_homogeneous(graph, LinearAgent.static(problem.dimension))


_DIAGNOSES: dict[type, Callable[[Any], Diagnosis]] = {
    AgreementDynamics: diagnose_agreement,
    HyperNetwork: diagnose_heterogeneous,
    MeasurementGraph: _diagnose_constants,
    Network: _diagnose_constants,
    NetworkedAgents: _diagnose_agents,
    RelativeSensing: diagnose_relative_sensing,
    SharedPlant: diagnose_shared_plant,
}


def diagnose(problem: Any) -> Diagnosis:
    """Tell whether every node can know its state, which nodes cannot, why, and what to add.

    Args:
        problem: ``NetworkedAgents`` (equal agents or not), ``HyperNetwork``, ``RelativeSensing``,
            ``AgreementDynamics`` or ``SharedPlant``; or a ``MeasurementGraph`` or ``Network``, which stand for unknown
            constants (``A_1 = 0_d``, ``C_1 = I_d``).

    Raises:
        ArgumentError: something else.

    Source: G16, Theorems 2 and 3; R23, Theorems 6, 9, 13, 18, 21; W17, Corollary 1.
    """
    judge = _DIAGNOSES.get(type(problem))
    if judge is None:
        known = ", ".join(sorted(kind.__name__ for kind in _DIAGNOSES))
        raise ArgumentError(f"diagnose takes one of {known}; got {type(problem).__name__}")
    return judge(problem)
