"""The best static answer: weighted least squares with standard deviations and suspects."""

from trigpoint.estimation.least_squares import Estimate, estimate

__all__ = ["Estimate", "estimate"]
