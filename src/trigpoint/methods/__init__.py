"""Design methods: one frozen dataclass each, and the one verb ``design(problem, method)``."""

from trigpoint.methods.accelerated import Accelerated
from trigpoint.methods.base import Method
from trigpoint.methods.brasch_pearson import BraschPearson
from trigpoint.methods.centralised import Centralised
from trigpoint.methods.coupling_gain import CouplingGain, coupling_margin, link_loss_rates
from trigpoint.methods.gains import Family, Fixed, FromGraph, GainChoice, GainRule, WorstCase
from trigpoint.methods.heterogeneous import Heterogeneous
from trigpoint.methods.integrator import IntegratorObserver
from trigpoint.methods.local_kalman import LocalKalman
from trigpoint.methods.projected_consensus import ProjectedConsensus
from trigpoint.methods.sampled import DiscreteKalman, Sampled
from trigpoint.methods.scc_cascade import SccCascade
from trigpoint.methods.spectrum_assignment import SpectrumAssignment
from trigpoint.methods.verb import METHODS, design
from trigpoint.methods.weighted import Weighted
from trigpoint.methods.weights import OptimalWeights, optimal_weights

__all__ = [
    "METHODS",
    "Accelerated",
    "BraschPearson",
    "Centralised",
    "CouplingGain",
    "DiscreteKalman",
    "Family",
    "Fixed",
    "FromGraph",
    "GainChoice",
    "GainRule",
    "Heterogeneous",
    "IntegratorObserver",
    "LocalKalman",
    "Method",
    "OptimalWeights",
    "ProjectedConsensus",
    "Sampled",
    "SccCascade",
    "SpectrumAssignment",
    "Weighted",
    "WorstCase",
    "coupling_margin",
    "design",
    "link_loss_rates",
    "optimal_weights",
]
