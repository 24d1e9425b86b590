"""Observers with drawn gains on drawn networks: the axioms hold for stable and unstable ones alike."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers import DiffusiveObserver
from trigpoint.testing.strategies import agents, measurement_graphs


@st.composite
def observers(draw, max_nodes=5, inputs=True, static=False, connected=None) -> DiffusiveObserver:
    agent = draw(agents(inputs=inputs))
    if static:
        agent = LinearAgent(np.zeros_like(agent.A), np.eye(agent.n_states))
    kind = draw(st.sampled_from(["unit", "scalar", "blocks"]))
    graph = draw(
        measurement_graphs(
            max_nodes=max_nodes,
            max_extra_arcs=6,
            weighted=kind == "scalar",
            blocks=agent.n_outputs if kind == "blocks" else None,
            decades=1,
            externally_connected=connected,
        )
    )
    rng = np.random.default_rng(draw(st.integers(0, 2**20)))
    K = np.eye(agent.n_states) if static else rng.normal(size=(agent.n_states, agent.n_outputs))
    each: LinearAgent | list[LinearAgent] = agent
    if inputs and not static and draw(st.booleans()):
        each = [LinearAgent(agent.A, agent.C, rng.normal(size=agent.B.shape), agent.E) for _ in range(graph.n_nodes)]
    return DiffusiveObserver("drawn", NetworkedAgents(graph, each), K, draw(st.floats(0.1, 3.0)), 0.0, None)


def everything(p: int = 2, weight=None) -> DiffusiveObserver:
    """Parallel arcs both ways, an anchored last node with two external arcs, names, inputs, two outputs."""
    graph = MeasurementGraph(
        4, [0, 1, 1, 2, EXTERNAL, EXTERNAL, 0], [1, 0, 2, 3, 3, 3, 2], weight, ["a", "b", "c d", "\u00fc"]
    )
    rng = np.random.default_rng(5)
    agent = LinearAgent([[0, 1, 0], [-1, 0, 0.5], [0, 0, -0.3]], rng.normal(size=(p, 3)), rng.normal(size=(3, 2)))
    return DiffusiveObserver("test", NetworkedAgents(graph, agent), rng.normal(size=(3, p)), 0.7, 0.0, None)


def exchange(observer, rng) -> tuple[dict, dict, dict]:
    """States, messages and readings of all nodes, drawn."""
    nodes = {name: observer.local(k) for k, name in enumerate(observer.graph.names)}
    states = {name: node.init(rng.normal(size=node.n_states)) for name, node in nodes.items()}
    messages = {name: node.emit(states[name]) for name, node in nodes.items()}
    readings = {k: rng.normal(size=observer.problem.n_outputs) for k in range(observer.graph.n_arcs)}
    return states, messages, readings
