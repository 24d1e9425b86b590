"""Facts about a graph or a problem, before there is any observer."""

from trigpoint.analysis.agreement import MeasurementNode, measurement_nodes
from trigpoint.analysis.contingency import Contingency, without_each
from trigpoint.analysis.critical import Critical, critical
from trigpoint.analysis.diagnosis import Diagnosis, Finding
from trigpoint.analysis.eigenvalue import EigenvalueBound, smallest_eigenvalue
from trigpoint.analysis.fixed_modes import Complementary, FixedMode, check_complementary, fixed_modes
from trigpoint.analysis.gain import gain_bound, worst_case_eigenvalue, worst_case_gain
from trigpoint.analysis.noise import NoiseBudget, noise_budget
from trigpoint.analysis.proposition1 import Proposition1, check_prop1
from trigpoint.analysis.recommend import Recommendation, recommend_anchors, recommend_arcs
from trigpoint.analysis.redundancy import redundancy
from trigpoint.analysis.shared_plant import Knowledge, agent_knowledge
from trigpoint.analysis.verb import diagnose

__all__ = [
    "Complementary",
    "Contingency",
    "Critical",
    "Diagnosis",
    "EigenvalueBound",
    "Finding",
    "FixedMode",
    "Knowledge",
    "MeasurementNode",
    "NoiseBudget",
    "Proposition1",
    "Recommendation",
    "agent_knowledge",
    "check_complementary",
    "check_prop1",
    "critical",
    "diagnose",
    "fixed_modes",
    "gain_bound",
    "measurement_nodes",
    "noise_budget",
    "recommend_anchors",
    "recommend_arcs",
    "redundancy",
    "smallest_eigenvalue",
    "without_each",
    "worst_case_eigenvalue",
    "worst_case_gain",
]
