"""Simulation: the stacked path, the modal path, the slow reference path, one verb."""

from trigpoint.simulation.channel import Bursts, Channel, Outage, Trigger
from trigpoint.simulation.clocks import Clocks
from trigpoint.simulation.ensemble import Ensemble, ensemble, ensembles
from trigpoint.simulation.families import FamilyRun, simulate_family
from trigpoint.simulation.motion import Bouncing, Trajectory, proximity, within_reach
from trigpoint.simulation.scenario import Noise, Scenario
from trigpoint.simulation.stationary import Stationary, stationary_covariance
from trigpoint.simulation.topology import Absence, Topology
from trigpoint.simulation.verb import simulate

__all__ = [
    "Absence",
    "Bouncing",
    "Bursts",
    "Channel",
    "Clocks",
    "Ensemble",
    "FamilyRun",
    "Noise",
    "Outage",
    "Scenario",
    "Stationary",
    "Topology",
    "Trajectory",
    "Trigger",
    "ensemble",
    "ensembles",
    "proximity",
    "simulate",
    "simulate_family",
    "stationary_covariance",
    "within_reach",
]
