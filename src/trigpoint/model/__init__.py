"""What is estimated: agents, networks of agents, and measured networks."""

from trigpoint.model.agents import LinearAgent
from trigpoint.model.network import Network, Reduction
from trigpoint.model.networked import NetworkedAgents

__all__ = ["LinearAgent", "Network", "NetworkedAgents", "Reduction"]
