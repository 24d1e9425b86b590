"""What is estimated: agents, networks of agents, shared plants, and measured networks."""

from trigpoint.model.agents import LinearAgent
from trigpoint.model.agreement import AgreementDynamics
from trigpoint.model.control_systems import plant_from_control, plant_to_control
from trigpoint.model.hyper_network import HyperNetwork
from trigpoint.model.network import Network, Reduction
from trigpoint.model.networked import NetworkedAgents
from trigpoint.model.relative_sensing import RelativeSensing
from trigpoint.model.shared_plant import SharedPlant

__all__ = [
    "AgreementDynamics",
    "HyperNetwork",
    "LinearAgent",
    "Network",
    "NetworkedAgents",
    "Reduction",
    "RelativeSensing",
    "SharedPlant",
    "plant_from_control",
    "plant_to_control",
]
