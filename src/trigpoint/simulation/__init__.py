"""Simulation: the stacked path, the slow reference path, one verb."""

from trigpoint.simulation.scenario import Channel, Noise, Scenario
from trigpoint.simulation.verb import simulate

__all__ = ["Channel", "Noise", "Scenario", "simulate"]
