"""Problems as JSON documents (kind ``trigpoint/problem``): everything needed to state them again, nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray, as_indices, decode_array, encode_array
from trigpoint.errors import ArgumentError, ProtocolError
from trigpoint.graphs import MeasurementGraph
from trigpoint.model.agents import LinearAgent
from trigpoint.model.hyper_network import HyperNetwork
from trigpoint.model.networked import NetworkedAgents
from trigpoint.model.shared_plant import SharedPlant

KIND = "trigpoint/problem"
VERSION = 1


Problem = NetworkedAgents | HyperNetwork | SharedPlant


def problem_document(problem: Problem) -> dict[str, Any]:
    """The problem as a JSON object; equal agents are written once."""
    head = {"kind": KIND, "version": VERSION}
    if isinstance(problem, SharedPlant):
        return head | _plant_document(problem)
    if isinstance(problem, HyperNetwork):
        return head | _hyper_document(problem)
    return head | _network_document(problem)


def _plant_document(problem: SharedPlant) -> dict[str, Any]:
    return {
        "form": "shared-plant",
        "A": encode_array(problem.A),
        "B": _optional(problem.B),
        "outputs": [encode_array(output) for output in problem.outputs],
        "neighbours": [list(heard) for heard in problem.hears],
    }


def _hyper_document(problem: HyperNetwork) -> dict[str, Any]:
    measurements = [[[node, encode_array(block)] for node, block in blocks.items()] for blocks in problem.measurements]
    return {
        "form": "hyper-network",
        "agents": [_agent_document(agent) for agent in problem.agents],
        "measurements": measurements,
        "names": list(problem.names),
    }


def _network_document(problem: NetworkedAgents) -> dict[str, Any]:
    distinct: list[LinearAgent] = []
    which = []
    for agent in problem.agents:
        position = next((k for k, other in enumerate(distinct) if other is agent), len(distinct))
        if position == len(distinct):
            distinct.append(agent)
        which.append(position)
    return {
        "graph": graph_document(problem.graph),
        "agents": [_agent_document(agent) for agent in distinct],
        "agent_of_node": encode_array(np.array(which)),
    }


def read_problem(document: Mapping[str, Any]) -> Problem:
    """Read ``problem_document``; what does not fit is a ``ProtocolError``."""
    _check_head(document, KIND, VERSION)
    form = document.get("form", "network")
    try:
        if form == "shared-plant":
            return _read_plant(document)
        if form == "hyper-network":
            return _read_hyper(document)
        if form != "network":
            raise ProtocolError(f"unknown form of problem {form!r}; known are network, shared-plant, hyper-network")
        agents = [_read_agent(entry) for entry in document["agents"]]
        which = as_indices("agent_of_node", decode_array(document["agent_of_node"], "agent_of_node"), 0, len(agents))
        return NetworkedAgents(read_graph(document["graph"]), [agents[k] for k in which.tolist()])
    except (KeyError, IndexError, TypeError, ValueError, ArgumentError) as error:
        if isinstance(error, ProtocolError):
            raise
        raise ProtocolError(f"the problem document does not fit: {error}") from error


def _read_plant(document: Mapping[str, Any]) -> SharedPlant:
    outputs = [decode_array(entry, f"outputs[{k}]") for k, entry in enumerate(document["outputs"])]
    B = None if document["B"] is None else decode_array(document["B"], "B")
    neighbours = dict(enumerate(document["neighbours"]))
    return SharedPlant(decode_array(document["A"], "A"), outputs, neighbours, B)


def _read_hyper(document: Mapping[str, Any]) -> HyperNetwork:
    measurements = [
        {node: decode_array(block, f"measurements[{j}]") for node, block in blocks}
        for j, blocks in enumerate(document["measurements"])
    ]
    return HyperNetwork([_read_agent(entry) for entry in document["agents"]], measurements, document["names"])


def graph_document(graph: MeasurementGraph) -> dict[str, Any]:
    """The graph as a JSON object."""
    return {
        "n_nodes": graph.n_nodes,
        "tail": encode_array(graph.tail),
        "head": encode_array(graph.head),
        "weight": None if graph.weight is None else encode_array(graph.weight),
        "names": list(graph.names),
    }


def read_graph(document: Mapping[str, Any]) -> MeasurementGraph:
    """Read ``graph_document``."""
    weight, names, n_nodes = document["weight"], document["names"], document["n_nodes"]
    if not isinstance(names, list) or type(n_nodes) is not int or len(names) != n_nodes:
        raise ProtocolError(f"names must list one text a node, for n_nodes = {str(n_nodes)[:20]} of them")
    return MeasurementGraph(
        n_nodes,
        decode_array(document["tail"], "tail"),
        decode_array(document["head"], "head"),
        None if weight is None else decode_array(weight, "weight"),
        names,
    )


def _agent_document(agent: LinearAgent) -> dict[str, Any]:
    return {key: _optional(getattr(agent, key)) for key in ("A", "C", "B", "E")}


def _read_agent(document: Mapping[str, Any]) -> LinearAgent:
    parts = {key: None if document[key] is None else decode_array(document[key], key) for key in ("A", "C", "B", "E")}
    return LinearAgent(**parts)  # type: ignore[arg-type]


def _optional(matrix: FloatArray | None) -> dict[str, Any] | None:
    return None if matrix is None else encode_array(matrix)


def _check_head(document: Any, kind: str, version: int) -> None:
    if not isinstance(document, Mapping):
        raise ProtocolError(f"a problem document is an object; got {type(document).__name__}")
    if document.get("kind") != kind or document.get("version") != version:
        raise ProtocolError(
            f"expected kind {kind!r}, version {version}; got kind {document.get('kind')!r}, "
            f"version {document.get('version')!r}"
        )
