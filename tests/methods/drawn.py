"""Problems that ``LocalKalman`` accepts, drawn: graphs, agents, and both together."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from trigpoint.analysis.pairs import pair_margin
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.testing.strategies import agents, measurement_graphs

DOUBLE_INTEGRATOR = LinearAgent([[0, 1], [0, 0]], [[1, 0]])
OSCILLATOR = LinearAgent([[0.5, 1], [-1, 0.5]], [[1, 0]])
RISING = LinearAgent(1.0, 1.0)
FALLING = LinearAgent([[-1.0, 2.0], [0.0, -0.5]], [[1.0, 0.0]])


def is_clearly_detectable(agent: LinearAgent) -> bool:
    return bool(pair_margin(agent.A, agent.C, unstable_only=True).margin > 1e-2)


def detectable_agents(**choices) -> st.SearchStrategy[LinearAgent]:
    """Agents without noise entry (S = I), far enough from undetectable for tight tolerances."""
    return agents(**choices).filter(is_clearly_detectable).map(lambda a: LinearAgent(a.A, a.C, a.B))


@st.composite
def problems(draw, max_nodes=6, decades=2, **choices) -> NetworkedAgents:
    """Externally connected networks of equal detectable agents; unit, scalar or block weights."""
    agent = draw(detectable_agents(**choices))
    kind = draw(st.sampled_from(["unit", "scalar", "blocks"]))
    return NetworkedAgents(
        draw(
            measurement_graphs(
                max_nodes=max_nodes,
                max_extra_arcs=5,
                weighted=kind == "scalar",
                blocks=agent.n_outputs if kind == "blocks" else None,
                decades=decades,
                externally_connected=True,
            )
        ),
        agent,
    )


def graph_with_everything(weight=None) -> MeasurementGraph:
    """Parallel arcs in both directions, two anchors on the last node, none on the first."""
    return MeasurementGraph(4, [0, 1, 1, 2, EXTERNAL, EXTERNAL, 0], [1, 0, 2, 3, 3, 3, 2], weight)


def generic_agent(n: int, p: int, rng: np.random.Generator) -> LinearAgent:
    return LinearAgent(rng.normal(size=(n, n)), rng.normal(size=(p, n)), rng.normal(size=(n, 2)))


def assembled(problem: NetworkedAgents, injection: np.ndarray, gain: float) -> np.ndarray:
    """The error matrix arc by arc, from the equations of G16 (dense loop; the oracle)."""
    graph, agent = problem.graph, problem.agent
    n, p, count = agent.n_states, agent.n_outputs, graph.n_nodes
    H = np.kron(np.eye(count), agent.A)
    for k in range(graph.n_arcs):
        weight = graph.arc_weights[k]
        block = weight * np.eye(p) if weight.size == 1 else weight
        pull = gain * injection @ block @ agent.C
        ends = [(int(graph.head[k]), 1.0)] + ([] if graph.is_external[k] else [(int(graph.tail[k]), -1.0)])
        for i, sign in ends:
            for j, other in ends:
                H[i * n : (i + 1) * n, j * n : (j + 1) * n] -= sign * other * pull
    return H
