"""Facts about a graph or a problem, before there is any observer."""

from trigpoint.analysis.diagnosis import Diagnosis, Finding
from trigpoint.analysis.eigenvalue import EigenvalueBound, smallest_eigenvalue
from trigpoint.analysis.gain import gain_bound, worst_case_eigenvalue, worst_case_gain
from trigpoint.analysis.verb import diagnose

__all__ = [
    "Diagnosis",
    "EigenvalueBound",
    "Finding",
    "diagnose",
    "gain_bound",
    "smallest_eigenvalue",
    "worst_case_eigenvalue",
    "worst_case_gain",
]
