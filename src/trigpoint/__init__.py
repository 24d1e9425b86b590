"""Distributed state estimation from relative measurements.

The table of contents: every public name, loaded when it is first used (``import trigpoint`` alone loads nothing else).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "AgreementDynamics": "model",
    "ArgumentError": "errors",
    "Certificate": "certificates",
    "Channel": "simulation",
    "Convergence": "certificates",
    "Diagnosis": "analysis",
    "EXTERNAL": "graphs",
    "EigenvalueBound": "analysis",
    "Estimate": "estimation",
    "Family": "methods",
    "FileFormatError": "errors",
    "Finding": "analysis",
    "Fixed": "methods",
    "FromGraph": "methods",
    "HyperNetwork": "model",
    "LinearAgent": "model",
    "LocalObserver": "observers",
    "Locality": "certificates",
    "MeasurementGraph": "graphs",
    "MethodError": "errors",
    "Network": "model",
    "NetworkObserver": "observers",
    "NetworkedAgents": "model",
    "Noise": "simulation",
    "RelativeSensing": "model",
    "Run": "observers",
    "Scenario": "simulation",
    "ScenarioFile": "io",
    "SharedPlant": "model",
    "SmallestEigenvalue": "certificates",
    "TrigpointError": "errors",
    "Verdict": "certificates",
    "WorstCase": "methods",
    "agent_knowledge": "analysis",
    "certify": "certificates",
    "critical": "analysis",
    "design": "methods",
    "diagnose": "analysis",
    "estimate": "estimation",
    "fixed_modes": "analysis",
    "gain_bound": "analysis",
    "load": "io",
    "measurement_nodes": "analysis",
    "recommend_anchors": "analysis",
    "noise_budget": "analysis",
    "recommend_arcs": "analysis",
    "redundancy": "analysis",
    "reproduce": "papers",
    "save": "io",
    "simulate": "simulation",
    "smallest_eigenvalue": "analysis",
    "verify": "certificates",
    "without_each": "analysis",
    "worst_case_eigenvalue": "analysis",
    "worst_case_gain": "analysis",
}

_MODULES = ("graphs", "methods", "testing")

__all__ = sorted([*_HOME, *_MODULES, "__version__"])

if TYPE_CHECKING:
    from trigpoint import graphs as graphs
    from trigpoint import methods as methods
    from trigpoint import testing as testing
    from trigpoint.analysis import Diagnosis as Diagnosis
    from trigpoint.analysis import EigenvalueBound as EigenvalueBound
    from trigpoint.analysis import Finding as Finding
    from trigpoint.analysis import agent_knowledge as agent_knowledge
    from trigpoint.analysis import critical as critical
    from trigpoint.analysis import diagnose as diagnose
    from trigpoint.analysis import fixed_modes as fixed_modes
    from trigpoint.analysis import gain_bound as gain_bound
    from trigpoint.analysis import measurement_nodes as measurement_nodes
    from trigpoint.analysis import noise_budget as noise_budget
    from trigpoint.analysis import recommend_anchors as recommend_anchors
    from trigpoint.analysis import recommend_arcs as recommend_arcs
    from trigpoint.analysis import redundancy as redundancy
    from trigpoint.analysis import smallest_eigenvalue as smallest_eigenvalue
    from trigpoint.analysis import without_each as without_each
    from trigpoint.analysis import worst_case_eigenvalue as worst_case_eigenvalue
    from trigpoint.analysis import worst_case_gain as worst_case_gain
    from trigpoint.certificates import Certificate as Certificate
    from trigpoint.certificates import Convergence as Convergence
    from trigpoint.certificates import Locality as Locality
    from trigpoint.certificates import SmallestEigenvalue as SmallestEigenvalue
    from trigpoint.certificates import Verdict as Verdict
    from trigpoint.certificates import certify as certify
    from trigpoint.certificates import verify as verify
    from trigpoint.errors import ArgumentError as ArgumentError
    from trigpoint.errors import FileFormatError as FileFormatError
    from trigpoint.errors import MethodError as MethodError
    from trigpoint.errors import TrigpointError as TrigpointError
    from trigpoint.estimation import Estimate as Estimate
    from trigpoint.estimation import estimate as estimate
    from trigpoint.graphs import EXTERNAL as EXTERNAL
    from trigpoint.graphs import MeasurementGraph as MeasurementGraph
    from trigpoint.io import ScenarioFile as ScenarioFile
    from trigpoint.io import load as load
    from trigpoint.io import save as save
    from trigpoint.methods import Family as Family
    from trigpoint.methods import Fixed as Fixed
    from trigpoint.methods import FromGraph as FromGraph
    from trigpoint.methods import WorstCase as WorstCase
    from trigpoint.methods import design as design
    from trigpoint.model import AgreementDynamics as AgreementDynamics
    from trigpoint.model import HyperNetwork as HyperNetwork
    from trigpoint.model import LinearAgent as LinearAgent
    from trigpoint.model import Network as Network
    from trigpoint.model import NetworkedAgents as NetworkedAgents
    from trigpoint.model import RelativeSensing as RelativeSensing
    from trigpoint.model import SharedPlant as SharedPlant
    from trigpoint.observers import LocalObserver as LocalObserver
    from trigpoint.observers import NetworkObserver as NetworkObserver
    from trigpoint.observers import Run as Run
    from trigpoint.papers import reproduce as reproduce
    from trigpoint.simulation import Channel as Channel
    from trigpoint.simulation import Noise as Noise
    from trigpoint.simulation import Scenario as Scenario
    from trigpoint.simulation import simulate as simulate


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"trigpoint.{name}")
    if name in _HOME:
        return getattr(importlib.import_module(f"trigpoint.{_HOME[name]}"), name)
    raise AttributeError(f"module 'trigpoint' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
