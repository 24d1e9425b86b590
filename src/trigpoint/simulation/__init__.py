"""Simulation: the stacked path, the modal path, the slow reference path, one verb."""

from trigpoint.simulation.channel import Bursts, Channel, Outage, Trigger
from trigpoint.simulation.clocks import Clocks
from trigpoint.simulation.ensemble import Ensemble, ensemble
from trigpoint.simulation.motion import Bouncing, Trajectory, proximity
from trigpoint.simulation.scenario import Noise, Scenario
from trigpoint.simulation.topology import Absence, Topology
from trigpoint.simulation.verb import simulate

__all__ = [
    "Absence",
    "Bouncing",
    "Bursts",
    "Channel",
    "Clocks",
    "Ensemble",
    "Noise",
    "Outage",
    "Scenario",
    "Topology",
    "Trajectory",
    "Trigger",
    "ensemble",
    "proximity",
    "simulate",
]
