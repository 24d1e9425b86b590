"""Slow, readable answers: networkx for structure, dense algebra for the rest."""

from __future__ import annotations

import itertools

import networkx as nx
import numpy as np

from trigpoint.graphs import EXTERNAL, MeasurementGraph


def without(graph: MeasurementGraph, arc: int) -> MeasurementGraph:
    keep = [k for k in range(graph.n_arcs) if k != arc]
    weight = None if graph.weight is None else graph.weight[keep]
    return MeasurementGraph(graph.n_nodes, graph.tail[keep], graph.head[keep], weight, graph.names)


def extended(graph: MeasurementGraph) -> nx.MultiGraph:
    """The graph with the environment as the node ``'ground'``; arcs keep their index as key."""
    whole = nx.MultiGraph()
    whole.add_nodes_from([*range(graph.n_nodes), "ground"])
    for k in range(graph.n_arcs):
        start = "ground" if graph.tail[k] == EXTERNAL else int(graph.tail[k])
        whole.add_edge(start, int(graph.head[k]), key=k)
    return whole


def bridges(graph: MeasurementGraph) -> list[int]:
    whole = extended(graph)
    count = nx.number_connected_components(whole)
    found = []
    for k in range(graph.n_arcs):
        rest = extended(without(graph, k))
        found += [k] if nx.number_connected_components(rest) > count else []
    return found


def bridges_by_networkx(graph: MeasurementGraph) -> list[int]:
    """For larger networks: networkx's bridges of the simple graph, minus the doubled ones."""
    whole = extended(graph)
    pairs = {frozenset(pair) for pair in nx.bridges(nx.Graph(whole))}
    return sorted(
        key
        for one, other, key in whole.edges(keys=True)
        if frozenset((one, other)) in pairs and whole.number_of_edges(one, other) == 1
    )


def unanchored(graph: MeasurementGraph) -> set[int]:
    reached = nx.node_connected_component(extended(graph), "ground")
    return set(range(graph.n_nodes)) - reached


def redundancy(graph: MeasurementGraph) -> np.ndarray:
    d = graph.dimension
    incidence = np.kron(graph.incidence().toarray(), np.eye(d))
    projected = incidence.T @ np.linalg.pinv(graph.laplacian().toarray(), hermitian=True) @ incidence
    blocks = graph.arc_weights.reshape(-1, d, d)
    traces = [np.trace(blocks[k] @ projected[k * d : k * d + d, k * d : k * d + d]) for k in range(graph.n_arcs)]
    return np.array([1.0 - trace / d for trace in traces])


def eigenvalue(graph: MeasurementGraph) -> float:
    return float(np.linalg.eigvalsh(graph.laplacian().toarray())[0])


def variance(graph: MeasurementGraph) -> float:
    return float("inf") if unanchored(graph) else float(np.trace(np.linalg.inv(graph.laplacian().toarray())))


def added(graph: MeasurementGraph, arcs: list[tuple[int, int]], weights: list[float]) -> MeasurementGraph:
    tail = [*graph.tail.tolist(), *(tail for tail, _ in arcs)]
    head = [*graph.head.tolist(), *(head for _, head in arcs)]
    return MeasurementGraph(graph.n_nodes, tail, head, [*graph.arc_weights.tolist(), *weights])


def best_value(graph: MeasurementGraph, arcs: list[tuple[int, int]], count: int, objective: str) -> float:
    values = []
    for chosen in itertools.combinations(arcs, count):
        whole = added(graph, list(chosen), [1.0] * count)
        values.append(eigenvalue(whole) if objective == "lambda_min" else -variance(whole))
    return abs(max(values))
