"""The best static answer: weighted least squares with standard deviations, the global test and suspects."""

from trigpoint.estimation.least_squares import Estimate, estimate
from trigpoint.estimation.reliability import GLOBAL_LEVEL, SUSPECT_PROBABILITY, GlobalTest

__all__ = ["GLOBAL_LEVEL", "SUSPECT_PROBABILITY", "Estimate", "GlobalTest", "estimate"]
