"""Small networks of nodes, and the same exchanges without processes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import trigpoint as tp
from trigpoint.observers.local import LocalObserver
from trigpoint.observers.network import NetworkObserver

STATIC = tp.LinearAgent.static(1)
DOUBLE = tp.LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]])


def grid_observer(rows: int, cols: int, agent: tp.LinearAgent) -> NetworkObserver:
    graph = tp.graphs.grid(rows, cols, anchors=(rows * cols - 1,))
    return tp.design(tp.NetworkedAgents(graph, agent), tp.methods.LocalKalman())


def programs(observer: NetworkObserver) -> list[LocalObserver]:
    return [observer.local(k) for k in range(observer.graph.n_nodes)]


def drawn_readings(observer: NetworkObserver, seed: int) -> Callable[[int], np.ndarray]:
    p = observer.local(0).arcs[0].output.shape[0]

    def readings(number: int) -> np.ndarray:
        return np.random.default_rng(seed + number).normal(size=(observer.graph.n_arcs, p))

    return readings


def in_one_process(
    nodes: list[LocalObserver], starts: np.ndarray, readings: Callable[[int], np.ndarray], period: float, steps: int
) -> np.ndarray:
    """The reference: every program by itself, messages in between, no frame and no pipe."""
    states = {node.name: node.init(start) for node, start in zip(nodes, starts, strict=True)}
    history = [np.stack([states[node.name].estimate for node in nodes])]
    for number in range(steps):
        messages = {node.name: node.emit(states[node.name]) for node in nodes}
        values = readings(number)
        states = {
            node.name: node.step(
                states[node.name],
                {name: messages[name] for name in node.hears},
                {label: values[label] for label in node.reads},
                period,
            )
            for node in nodes
        }
        history.append(np.stack([states[node.name].estimate for node in nodes]))
    return np.stack(history)
