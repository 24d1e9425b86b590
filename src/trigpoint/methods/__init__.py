"""Design methods: one frozen dataclass each, and the one verb ``design(problem, method)``."""

from trigpoint.methods.base import Method
from trigpoint.methods.gains import Family, Fixed, FromGraph, GainChoice, GainRule, WorstCase
from trigpoint.methods.local_kalman import LocalKalman
from trigpoint.methods.verb import METHODS, design

__all__ = [
    "METHODS",
    "Family",
    "Fixed",
    "FromGraph",
    "GainChoice",
    "GainRule",
    "LocalKalman",
    "Method",
    "WorstCase",
    "design",
]
