"""What travels to the page: a JSON topology message, binary frames, and JSON for what is asked for.

Topology message (JSON text, first, and again before the frames of a live network that has grown)::

    {"type": "topology", "version": 2, "mode": "replay" or "live", "title": text, "unit": text or "",
     "names": [N], "joined": [nodes that came while the run went on], "x": [N], "y": [N],
     "arcs": [[i, j], ...] (M pairs), "anchored": [nodes with an external arc],
     "rate": decay rate to draw, 1/s, or null, "rate_name": what it is, "stale": seconds or null,
     "states": [text of each state code],
     "colours": of error, uncertainty, state, age those that the source knows, "links": of loss, age those,
     "controls": [orders that a node takes], "times": [T] (replay; else []),
     "norm": {"times": [], "values": []}, "error_range": [low, high] or null}

Frame, version 2 (binary, little-endian, 40 + 16 N + 8 M bytes)::

    offset  0  uint32 version, uint32 N, uint32 M, uint32 index (sample of the replay, or count of the live frames)
    offset 16  float64 time, s
    offset 24  float32 error norm of the network, float32 messages a second, float32 deadlines missed so far,
               float32 frames rejected so far
    offset 40  float32[N] error norm of each node, in the order of ``names``
               float32[N] uncertainty: the standard deviation that the node states
               float32[N] age: seconds since the node was last heard
               float32[N] state: index into ``states``
               float32[M] loss: share of the messages lost on the pair, the worse direction
               float32[M] age of the last message on the pair, seconds, the worse direction

NaN is "not known", infinity is itself. In JSON, which has neither, both are null. Version 1 was a float32 time and the
errors alone; the page of this version refuses it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.graphs.layout import arc_pairs, node_positions

if TYPE_CHECKING:
    from trigpoint.graphs import MeasurementGraph

VERSION = 2
STATES = ("unknown", "anchored", "uncovered", "relative", "silent", "paused", "away")
"""What a node can be: not heard yet; anchored; anchored with links for which no guarantee was given; without a way to
an anchor; heard of no longer; paused; absent on purpose (recorded runs)."""

UNKNOWN, ANCHORED, UNCOVERED, RELATIVE, SILENT, PAUSED, AWAY = range(len(STATES))

_HEAD = np.dtype(
    [
        ("version", "<u4"), ("nodes", "<u4"), ("links", "<u4"), ("index", "<u4"), ("time", "<f8"),
        ("norm", "<f4"), ("traffic", "<f4"), ("missed", "<f4"), ("rejected", "<f4"),
    ]
)  # fmt: skip
DESIGNED = "designed rate, no delay"
"""What the rate of a live run's design is: it holds for exchange without delay, so here it is no guarantee."""
_FLOAT = np.dtype("<f4")
_TRACE_POINTS = 2000


@dataclass(frozen=True, eq=False)
class Scene:
    """What the page shows besides the moving numbers.

    Attributes:
        graph: the network.
        title: what the page is called: a file or a network.
        positions: (N, 2) or (N, 3) places (plan view); None: placed by the hops between the nodes.
        rate: decay rate, 1/s, drawn beside the error; None for none.
        unit: unit of the state, for the legends; empty where there is none or it is mixed.
        rate_name: what ``rate`` is.
        joined: nodes that came while the run went on; they have no place in ``positions``.
    """

    graph: MeasurementGraph
    title: str = ""
    positions: ArrayLike | None = None
    rate: float | None = None
    unit: str = ""
    rate_name: str = "guaranteed rate"
    joined: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Moment:
    """All that the page draws at one instant; NaN where something is not known.

    Attributes:
        index: sample of the replay, or number of the live frame.
        time: seconds.
        norm: error norm of the whole network, silent nodes not counted; not known before each was known once.
        traffic: messages a second, all links together.
        missed: deadlines missed so far, all nodes together.
        rejected: frames rejected so far, all nodes together.
        error: (N,) error norm of each node.
        uncertainty: (N,) standard deviation that each node states.
        age: (N,) seconds since each node was last heard; infinite: never.
        state: (N,) index into ``STATES``.
        loss: (M,) share of messages lost on each pair, the worse direction.
        link_age: (M,) age of the last message on each pair, seconds, the worse direction.
    """

    index: int
    time: float
    norm: float
    traffic: float
    missed: float
    rejected: float
    error: FloatArray
    uncertainty: FloatArray
    age: FloatArray
    state: FloatArray
    loss: FloatArray
    link_age: FloatArray


_NODE_TABLES = ("error", "uncertainty", "age", "state")
_LINK_TABLES = ("loss", "link_age")
_NUMBERS = tuple(f.name for f in fields(Moment) if f.name not in (*_NODE_TABLES, *_LINK_TABLES))


def encode_moment(moment: Moment) -> bytes:
    """Return the binary frame of ``moment``; what is beyond float32 becomes infinite."""
    head = np.zeros((), dtype=_HEAD)
    head["version"], head["nodes"], head["links"] = VERSION, moment.error.shape[0], moment.loss.shape[0]
    with np.errstate(over="ignore"):  # a diverged error is infinite, which the page draws as the largest
        for name in _NUMBERS:
            head[name] = getattr(moment, name)
        tables = [getattr(moment, name).astype(_FLOAT) for name in (*_NODE_TABLES, *_LINK_TABLES)]
    return b"".join([head.tobytes(), *(table.tobytes() for table in tables)])


def decode_moment(data: bytes) -> Moment:
    """Read the frame ``data``; another version or length is a ``ProtocolError``."""
    if len(data) < _HEAD.itemsize:
        raise ProtocolError(f"a frame begins with a head of {_HEAD.itemsize} bytes; got {len(data)} in all")
    head = np.frombuffer(data, dtype=_HEAD, count=1)[0]
    if int(head["version"]) != VERSION:
        raise ProtocolError(f"frame version {head['version']} is unknown; this reads {VERSION}")
    nodes, links = int(head["nodes"]), int(head["links"])
    lengths = [nodes] * len(_NODE_TABLES) + [links] * len(_LINK_TABLES)
    expected = _HEAD.itemsize + _FLOAT.itemsize * sum(lengths)
    if len(data) != expected:
        raise ProtocolError(f"a frame of {nodes} nodes and {links} pairs has {expected} bytes; got {len(data)}")
    numbers = np.frombuffer(data, dtype=_FLOAT, offset=_HEAD.itemsize).astype(np.float64)
    tables = np.split(numbers, np.cumsum(lengths)[:-1])
    time, norm, traffic, missed, rejected = (float(head[name]) for name in _NUMBERS[1:])
    return Moment(int(head["index"]), time, norm, traffic, missed, rejected, *tables)


def topology_message(scene: Scene, names: tuple[str, ...], **known: Any) -> dict[str, Any]:
    """Return the JSON object that the page gets once.

    Args:
        scene: the network and how to show it.
        names: of the nodes, in the order of the frames.
        known: the entries that depend on the source: ``mode``, ``colours``, ``links``, ``controls``, ``times``,
            ``norm``, ``error_range``, ``stale``.

    Raises ``ShapeError`` where the graph has another number of nodes, ``ArgumentError`` for a rate that is not
    positive.
    """
    graph = scene.graph
    if graph.n_nodes != len(names):
        raise ShapeError(f"graph has {graph.n_nodes} nodes; the run has {len(names)}")
    if scene.rate is not None and not (np.isfinite(scene.rate) and scene.rate > 0.0):
        raise ArgumentError(f"rate must be a positive number or None; got {scene.rate}")
    places = node_positions(graph) if scene.positions is None else _checked_places(graph, scene.positions)
    return {
        "type": "topology",
        "version": VERSION,
        "title": scene.title,
        "unit": scene.unit,
        "names": list(names),
        "joined": list(scene.joined),
        "x": places[:, 0].tolist(),
        "y": places[:, 1].tolist(),
        "arcs": arc_pairs(graph)[0].tolist(),
        "anchored": graph.anchored_nodes.tolist(),
        "rate": scene.rate,
        "rate_name": scene.rate_name,
        "states": list(STATES),
        **known,
    }


def trace_message(node: int, times: FloatArray, **tables: FloatArray) -> dict[str, Any]:
    """Return the JSON object with the history of ``node`` at ``times``, at most 2000 samples of it.

    Args:
        node: whose.
        times: (T,) seconds.
        tables: ``estimate`` and ``truth`` (T, n); ``error`` and ``uncertainty`` (T,). (T, n) becomes n lists.
    """
    stride = max(1, -(-times.shape[0] // _TRACE_POINTS))
    lists = {
        name: or_null(table[::stride]) if table.ndim == 1 else [or_null(column) for column in table[::stride].T]
        for name, table in tables.items()
    }
    return {"type": "trace", "node": node, "times": times[::stride].tolist(), **lists}


def or_null(values: FloatArray) -> list[float | None]:
    """Return the numbers as a list, None for those that JSON does not have."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def number_or_null(value: float) -> float | None:
    """Return the number, None where JSON does not have it."""
    return float(value) if np.isfinite(value) else None


def _checked_places(graph: MeasurementGraph, positions: ArrayLike) -> FloatArray:
    places = as_floats("positions", positions)
    if places.ndim != 2 or places.shape[0] != graph.n_nodes or places.shape[1] not in (2, 3):
        raise ShapeError(f"positions must have shape ({graph.n_nodes}, 2) or ({graph.n_nodes}, 3); got {places.shape}")
    return places
