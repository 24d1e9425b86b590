"""What a live node said, as the page's tables and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.dashboard.frames import number_or_null, or_null

if TYPE_CHECKING:
    from trigpoint.graphs import MeasurementGraph
    from trigpoint.runtime import LinkStatus, NodeStatus

SAID = np.dtype(
    [
        ("known", "?"), ("anchored", "?"), ("covered", "?"), ("paused", "?"),
        ("uncertainty", "f8"), ("missed", "f8"), ("rejected", "f8"),
    ]
)  # fmt: skip
"""What the drawing needs of each node's last status."""


def nothing_said(nodes: int) -> np.ndarray[Any, Any]:
    """The table of as many ``nodes`` that have said nothing yet."""
    table = np.zeros(nodes, dtype=SAID)
    table["uncertainty"] = np.nan
    return table


def places_beside(places: FloatArray, graph: MeasurementGraph) -> FloatArray:
    """(N, d) the ``places`` of a network's first nodes, and each further one of ``graph`` beside its neighbours.

    A little further out than their mean, so that it lies on none of them.
    """
    found = list(np.asarray(places, dtype=np.float64))
    tail, head = graph.tail, graph.head
    centre, reach = places.mean(axis=0), max(float(np.ptp(places, axis=0).max(initial=0.0)), 1.0)
    for node in range(len(found), graph.n_nodes):
        others = [int(k) for k in (*head[tail == node], *tail[head == node]) if 0 <= k < len(found)]
        mean = np.mean([found[k] for k in others], axis=0) if others else centre
        out = mean - centre
        size = float(np.linalg.norm(out))
        way = out / size if size > 1e-9 * reach else np.resize([np.cos(node), np.sin(node)], centre.shape)
        found.append(mean + 0.12 * reach * way)
    return np.array(found)


def norm_of(error: FloatArray) -> float:
    """Norm over the nodes whose error is known; NaN where none is."""
    known = error[~np.isnan(error)]
    return float(np.sqrt((known**2).sum())) if known.size else np.nan


def table_of(values: Sequence[FloatArray | None], states: int) -> FloatArray:
    """(N, states) the ``values`` of all nodes, cut or filled up with NaN to as many ``states``."""
    table = np.full((len(values), states), np.nan)
    for row, value in zip(table, values, strict=True):
        if value is not None:
            row[: min(states, value.shape[0])] = value[:states]
    return table


def values_of(value: FloatArray | None) -> list[float | None]:
    """The ``value`` as JSON; nothing where there is none."""
    return [] if value is None else or_null(np.asarray(value, dtype=np.float64))


def facts_of(status: NodeStatus) -> list[list[Any]]:
    """Name and value of what the card of a node shows of its ``status``."""
    facts: list[list[Any]] = [
        ["hops to an anchor", status.hops],
        ["guarantee covers its links", "yes" if status.covered else "no"],
        ["norm of innovations", number_or_null(status.innovation)],
        ["acts", status.acts],
        ["deadlines missed", status.missed],
        ["an act takes, µs", number_or_null(status.step_us)],
        ["frames rejected", status.counters.dropped],
    ]
    return facts if status.warning is None else [*facts, ["warning", status.warning]]


def link_of(link: LinkStatus) -> dict[str, Any]:
    """The ``link`` to one neighbour as JSON."""
    return {
        "neighbour": link.neighbour,
        "state": link.state.name.lower(),
        "age": link.age,
        "received": link.received,
        "lost": link.lost,
        "round_trip": link.round_trip,
        "offset": link.offset,
    }
