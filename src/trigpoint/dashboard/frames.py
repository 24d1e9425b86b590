"""What travels to the page: one JSON topology message, then binary frames; and what the page asks for.

Topology message (JSON text, once)::

    {"type": "topology", "version": 1, "path": ..., "names": [N], "x": [N], "y": [N], "arcs": [[i, j], ...],
     "anchored": [nodes with an external arc], "times": [T], "norm": [T], "error_range": [low, high] or null}

Frame (binary, 4 + 4 N bytes, little-endian)::

    offset 0     float32    time, s
    offset 4     float32[N] Euclidean norm of each node's error, in the order of ``names``; NaN: no estimate

``norm`` is the whole network's error norm; what is not finite is null in JSON, which has no NaN.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.graphs import MeasurementGraph
from trigpoint.graphs.layout import node_positions

if TYPE_CHECKING:
    from trigpoint.observers.run import Run

VERSION = 1
_FLOAT = np.dtype("<f4")
_DECADES = 6.0
_TRACE_POINTS = 2000


def topology_message(run: Run, graph: MeasurementGraph, positions: ArrayLike | None = None) -> dict[str, Any]:
    """Return the JSON object that the page gets once: the network, the times and the range of the errors.

    Args:
        run: the recorded run, at least one sample.
        graph: its network, with as many nodes as the run.
        positions: (N, 2) or (N, 3) places (plan view); None: placed by the hops between them.

    Raises ``ShapeError`` where the numbers of nodes differ, ``ArgumentError`` for a run without samples.
    """
    check_run(run, graph)
    places = node_positions(graph) if positions is None else _checked_places(graph, positions)
    inner = ~graph.is_external
    ends = np.sort(np.column_stack([graph.tail[inner], graph.head[inner]]), axis=1)
    return {
        "type": "topology",
        "version": VERSION,
        "path": run.path,
        "names": list(run.names),
        "x": places[:, 0].tolist(),
        "y": places[:, 1].tolist(),
        "arcs": np.unique(ends, axis=0).tolist(),
        "anchored": graph.anchored_nodes.tolist(),
        "times": run.times.tolist(),
        "norm": _or_null(run.error_norm),
        "error_range": _error_range(run),
    }


def frame(run: Run, k: int) -> bytes:
    """Return the binary frame of sample ``k`` of ``run``, 0 <= k < T: the time and each node's error norm."""
    if not 0 <= k < run.times.shape[0]:
        raise ArgumentError(f"sample {k} is not in the run; expected 0 <= k < {run.times.shape[0]}")
    numbers = np.concatenate([run.times[k : k + 1], node_errors(run, k)])
    with np.errstate(over="ignore"):  # beyond float32 a diverged error is infinite, which the page draws as the largest
        return numbers.astype(_FLOAT).tobytes()


def decode_frame(data: bytes) -> tuple[float, FloatArray]:
    """Read the frame ``data``: its time and the (N,) error norms; what is not float32 numbers is a ``ProtocolError``"""
    if len(data) < _FLOAT.itemsize or len(data) % _FLOAT.itemsize:
        raise ProtocolError(f"a frame is a time and one number a node, 4 bytes each; got {len(data)} bytes")
    numbers = np.frombuffer(data, dtype=_FLOAT).astype(np.float64)
    return float(numbers[0]), numbers[1:]


def trace_message(run: Run, node: int) -> dict[str, Any]:
    """Return the JSON object with one node's error norm over the whole run, at most 2000 samples of it."""
    if not 0 <= node < len(run.names):
        raise ProtocolError(f"node {node} is not in the run; expected 0 <= node < {len(run.names)}")
    stride = -(-run.times.shape[0] // _TRACE_POINTS)
    error = run.estimate[::stride, node] - run.truth[::stride, node]
    norms = np.sqrt((error**2).sum(axis=1))
    return {"type": "trace", "node": node, "times": run.times[::stride].tolist(), "errors": _or_null(norms)}


def node_errors(run: Run, k: int) -> FloatArray:
    """(N,) Euclidean norm of each node's error at sample ``k``."""
    norms: FloatArray = np.sqrt(((run.estimate[k] - run.truth[k]) ** 2).sum(axis=1))
    return norms


def check_run(run: Run, graph: MeasurementGraph) -> None:
    """Refuse a run without samples and a graph of another size."""
    if not run.times.shape[0]:
        raise ArgumentError("the run has no samples: there is nothing to replay")
    if graph.n_nodes != len(run.names):
        raise ShapeError(f"graph has {graph.n_nodes} nodes; the run has {len(run.names)}")


def _checked_places(graph: MeasurementGraph, positions: ArrayLike) -> FloatArray:
    places = as_floats("positions", positions)
    if places.ndim != 2 or places.shape[0] != graph.n_nodes or places.shape[1] not in (2, 3):
        raise ShapeError(f"positions must have shape ({graph.n_nodes}, 2) or ({graph.n_nodes}, 3); got {places.shape}")
    return places


def _error_range(run: Run) -> list[float] | None:
    """Smallest and largest error of a node that is neither zero nor infinite, at most six decades apart."""
    low, high = np.inf, 0.0
    for k in range(run.times.shape[0]):
        norms = node_errors(run, k)
        norms = norms[np.isfinite(norms) & (norms > 0.0)]
        low, high = min(low, norms.min(initial=np.inf)), max(high, norms.max(initial=0.0))
    return [float(max(low, high / 10.0**_DECADES)), float(high)] if high > 0.0 else None


def _or_null(values: FloatArray) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]
