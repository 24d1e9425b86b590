"""From what an engine computed to a ``Run``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver, Problem
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver
from trigpoint.observers.run import Run
from trigpoint.simulation.documents import scenario_document
from trigpoint.simulation.exchanges import Recorded
from trigpoint.simulation.modal import Engines
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.topology import is_away, with_absences

_DENSE = 400


def recorded(
    problem: Problem,
    observer: NetworkObserver,
    scenario: Scenario,
    path: str,
    done: Recorded,
    engines: Engines | None = None,
) -> Run:
    """Name everything, and say for each time who is anchored and how well the topology is connected.

    Args:
        problem, observer, scenario: what ran.
        path: which engine.
        done: what it computed; fewer times than asked for where it was interrupted.
        engines: of a modal run: who computed it, with an error estimate; None for others.
    """
    count = done.estimate.shape[0]
    times = scenario.times[:count]
    status, lambda_min = _connections(problem, observer, scenario, times)
    attributes = _facts(observer, scenario)
    if engines is not None:
        attributes |= {"engines": engines.names, "error_estimate": engines.error}
    if count < scenario.times.shape[0]:
        attributes["interrupted"] = True
    names = observer.names if isinstance(observer, AssembledObserver) else _graph_names(problem)
    traffic = done.traffic
    return Run(
        times,
        done.truth,
        done.estimate,
        traffic.sent,
        status,
        names,
        path,
        attributes,
        traffic.delivered,
        traffic.bytes,
        lambda_min,
    )


def _graph_names(problem: Problem) -> tuple[str, ...]:
    assert isinstance(problem, NetworkedAgents)  # diffusive observers have no other problem
    return problem.graph.names


def _connections(
    problem: Problem, observer: NetworkObserver, scenario: Scenario, times: FloatArray
) -> tuple[NDArray[np.str_], FloatArray | None]:
    nodes = len(observer.names) if isinstance(observer, AssembledObserver) else len(_graph_names(problem))
    shape = (times.shape[0], nodes)
    away = np.zeros(shape, dtype=bool)
    for node in {one.node for one in scenario.absences}:
        away[:, node] = [is_away(scenario.absences, node, time) for time in times.tolist()]
    if not isinstance(problem, NetworkedAgents):
        return np.where(away, "away", np.broadcast_to("anchored", shape)), None
    graph = problem.graph
    topology = with_absences(graph, scenario.topology, scenario.absences)
    if topology is None:
        anchored = graph.component_is_anchored[graph.component_labels]
        return np.broadcast_to(np.where(anchored, "anchored", "relative"), shape), None
    known: dict[bytes, tuple[NDArray[np.bool_], float]] = {}
    rows: list[NDArray[np.bool_]] = []
    values: list[float] = []
    for time in times.tolist():
        key = topology.at(time).tobytes()
        if key not in known:
            part = topology.graph_at(graph, time)
            present = np.flatnonzero(~away[len(rows)])
            known[key] = (part.component_is_anchored[part.component_labels], _smallest(part, present))
        rows.append(known[key][0])
        values.append(known[key][1])
    anchored = np.array(rows).reshape(shape)
    return np.where(away, "away", np.where(anchored, "anchored", "relative")), np.array(values)


def _smallest(graph: MeasurementGraph, present: IntArray) -> float:
    """Smallest eigenvalue of the part of L that belongs to the nodes that are present."""
    if not graph.component_is_anchored[graph.component_labels[present]].all() or not present.size:
        return 0.0
    p = graph.dimension
    L = graph.laplacian().tocsr()
    if p == 1:
        L = L[present][:, present]
    if L.shape[0] <= _DENSE or p > 1:
        return max(0.0, float(np.linalg.eigvalsh(L.toarray())[0]))
    return float(eigsh(L.tocsc(), k=1, sigma=0.0, which="LM", return_eigenvectors=False, v0=np.ones(L.shape[0]))[0])


def _facts(observer: NetworkObserver, scenario: Scenario) -> dict[str, Any]:
    noise, channel = scenario.noise, scenario.channel
    period = scenario.period
    if period is None and isinstance(observer, AssembledObserver):
        period = observer.period
    plain = scenario.topology is None and not scenario.absences and noise is None
    known: dict[str, Any] = {"gain": observer.gain} if isinstance(observer, DiffusiveObserver) else {}
    return {
        **known,
        "period": period,
        "method": observer.method,
        # The guarantee speaks of continuous exchange on the whole network: other runs carry none.
        "guaranteed_rate": observer.decay_rate if scenario.period is None and plain else None,
        "seed": scenario.seed,
        "noise_measurement": 0.0 if noise is None else noise.measurement,
        "noise_process": 0.0 if noise is None else noise.process,
        "loss": 0.0 if channel is None else channel.loss,
        "scenario": scenario_document(scenario),
    }
