"""A network of agents in which each node estimates its own state (G16, R23)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.blocks import Blocks, diagonal_of, expand, repeat_diagonal
from trigpoint.model.agents import LinearAgent


@dataclass(frozen=True, eq=False)
class NetworkedAgents:
    """Agents on the nodes of a measurement graph; node i's state is agent i's, and node i estimates it.

    ``x = (x_1, ..., x_N)`` node-major, ``x_i' = A_i x_i + B_i u_i``; arc k from i to j measures
    ``y_k = C_j x_j - C_i x_i`` (external: ``C_j x_j``). With equal agents ``A = I (x) A_1``, ``C = G^T (x) C_1``.

    Args:
        graph: who measures whom.
        agents: one agent for all nodes, or one a node.

    Raises:
        ShapeError: not one agent a node; outputs of different length; weight blocks of another size than p.

    Source: G16, Section 3, equations (3), (7) and Assumption 1.
    """

    graph: MeasurementGraph
    agents: tuple[LinearAgent, ...]

    def __init__(self, graph: MeasurementGraph, agents: LinearAgent | Sequence[LinearAgent]) -> None:
        if not isinstance(graph, MeasurementGraph):
            raise ArgumentError(
                f"graph must be a MeasurementGraph; got {type(graph).__name__} (of networkx: "
                "MeasurementGraph.from_networkx(graph, anchors=[...]))"
            )
        each = (agents,) * graph.n_nodes if isinstance(agents, LinearAgent) else tuple(agents)
        if len(each) != graph.n_nodes:
            raise ShapeError(f"agents must be one agent or one a node ({graph.n_nodes}); got {len(each)}")
        outputs = sorted({agent.n_outputs for agent in each})
        if len(outputs) > 1:
            raise ShapeError(f"all agents must have equally many outputs, since arcs subtract them; got {outputs}")
        if graph.dimension not in (1, outputs[0]):
            raise ShapeError(
                f"the graph's weight blocks are {graph.dimension} x {graph.dimension}, "
                f"but an arc's measurement has {outputs[0]} numbers (rows of C)"
            )
        object.__setattr__(self, "graph", graph)
        object.__setattr__(self, "agents", each)

    @cached_property
    def is_homogeneous(self) -> bool:
        """True when all agents have the same A, C and E (G16, Assumption 1); known inputs B may differ."""
        return all(_is_same(agent, self.agents[0]) for agent in self.agents)

    @property
    def agent(self) -> LinearAgent:
        """The one agent of a homogeneous network; an error names the first node that differs."""
        for node, other in enumerate(() if self.is_homogeneous else self.agents):
            if not _is_same(other, self.agents[0]):
                raise ArgumentError(
                    f"the agents differ: node {self.graph.names[node]!r} has another A, C or E than "
                    f"node {self.graph.names[0]!r}; ask for problem.agents"
                )
        return self.agents[0]

    @property
    def n_outputs(self) -> int:
        """Number p of values in one arc's measurement."""
        return self.agents[0].n_outputs

    @property
    def states(self) -> Blocks:
        """Index ranges of the stacked state of a homogeneous network, node-major."""
        return Blocks(self.graph.n_nodes, self.agent.n_states)

    def __repr__(self) -> str:
        kind = f"{self.agents[0]!r}" if self.is_homogeneous else "agents that differ"
        return f"NetworkedAgents({self.graph!r}, {kind})"

    def stacked_dynamics(self) -> sp.csr_array:
        """``A = I (x) A_1``, or the block diagonal of the agents' A: sparse (sum n_i, sum n_i)."""
        if self.is_homogeneous:
            return repeat_diagonal(self.graph.n_nodes, self.agents[0].A)
        return diagonal_of(agent.A for agent in self.agents)

    def stacked_output(self) -> sp.csr_array:
        """``C = G^T (x) C_1`` (in general ``(G^T (x) I_p) blockdiag(C_i)``): sparse (M p, sum n_i)."""
        differences = expand(sp.csr_array(self.graph.incidence().T), self.n_outputs)
        if self.is_homogeneous:
            return sp.csr_array(differences @ repeat_diagonal(self.graph.n_nodes, self.agents[0].C))
        return sp.csr_array(differences @ diagonal_of(agent.C for agent in self.agents))


def _is_same(one: LinearAgent, other: LinearAgent) -> bool:
    if one is other:
        return True
    if (one.E is None) != (other.E is None):
        return False
    same_noise = one.E is None or other.E is None or np.array_equal(one.E, other.E)
    return same_noise and np.array_equal(one.A, other.A) and np.array_equal(one.C, other.C)
