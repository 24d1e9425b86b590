"""Small problems with stable observers, drawn, for runs that both paths can do."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.methods import Fixed, LocalKalman, design
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers import DiffusiveObserver
from trigpoint.testing.strategies import measurement_graphs

AGENTS = [
    LinearAgent.static(2),
    LinearAgent([[0, 1], [0, 0]], [[1, 0]], B=[[0.0], [1.0]], E=[[0.0], [1.0]]),
    LinearAgent([[0.1, 1], [-1, 0.1]], [[1, 0]], B=np.eye(2)),
    LinearAgent(-0.5, 1.0, B=2.0),
    LinearAgent([[0, 1, 0], [-1, 0, 0], [0, 0, -0.2]], [[1, 0, 1], [0, 1, 0]], B=np.ones((3, 1))),
]


def everywhere(weight=None) -> MeasurementGraph:
    """Parallel arcs both ways, two anchors on the last node, none elsewhere."""
    return MeasurementGraph(4, [0, 1, 1, 2, EXTERNAL, EXTERNAL], [1, 0, 2, 3, 3, 3], weight)


@st.composite
def observed(draw, max_nodes=4) -> DiffusiveObserver:
    agent = draw(st.sampled_from(AGENTS))
    kind = draw(st.sampled_from(["unit", "scalar", "blocks"]))
    graph = draw(
        measurement_graphs(
            max_nodes=max_nodes,
            max_extra_arcs=4,
            weighted=kind == "scalar",
            blocks=agent.n_outputs if kind == "blocks" else None,
            decades=0 if kind == "blocks" else 1,
            externally_connected=True,
        )
    )
    each: LinearAgent | list[LinearAgent] = agent
    if agent.B is not None and draw(st.booleans()):
        each = [LinearAgent(agent.A, agent.C, (k + 1.0) * agent.B, agent.E) for k in range(graph.n_nodes)]
    return design(NetworkedAgents(graph, each), LocalKalman(Fixed(draw(st.floats(0.3, 2.0)))))


def start(observer: DiffusiveObserver, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Initial error, initial state, inputs."""
    rng = np.random.default_rng(seed)
    shape = (observer.states.count, observer.states.size)
    width = observer.problem.agents[0].n_inputs
    inputs = rng.normal(size=(shape[0], width)) if width else None
    return rng.normal(size=shape), rng.normal(size=shape), inputs
