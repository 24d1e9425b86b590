"""Design methods: one frozen dataclass each, and the one verb ``design(problem, method)``."""

from trigpoint.methods.accelerated import Accelerated
from trigpoint.methods.base import Method
from trigpoint.methods.gains import Family, Fixed, FromGraph, GainChoice, GainRule, WorstCase
from trigpoint.methods.integrator import IntegratorObserver
from trigpoint.methods.local_kalman import LocalKalman
from trigpoint.methods.sampled import DiscreteKalman, Sampled
from trigpoint.methods.verb import METHODS, design
from trigpoint.methods.weighted import Weighted
from trigpoint.methods.weights import OptimalWeights, optimal_weights

__all__ = [
    "METHODS",
    "Accelerated",
    "DiscreteKalman",
    "Family",
    "Fixed",
    "FromGraph",
    "GainChoice",
    "GainRule",
    "IntegratorObserver",
    "LocalKalman",
    "Method",
    "OptimalWeights",
    "Sampled",
    "Weighted",
    "WorstCase",
    "design",
    "optimal_weights",
]
