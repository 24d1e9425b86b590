"""A recorded run as a feed: every page plays it for itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.dashboard.feed import Event, changes
from trigpoint.dashboard.frames import (
    DESIGNED,
    STATES,
    UNKNOWN,
    Moment,
    Scene,
    encode_moment,
    number_or_null,
    or_null,
    topology_message,
    trace_message,
)
from trigpoint.dashboard.playback import Playback
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError
from trigpoint.graphs.layout import arc_pairs

if TYPE_CHECKING:
    from trigpoint.graphs import MeasurementGraph
    from trigpoint.observers.run import Run
    from trigpoint.runtime import Controls

_DECADES = 6.0
_MOST_EVENTS = 500


class ReplayFeed:
    """Frames of a recorded run.

    Args:
        run: at least one sample.
        scene: its network and how to show it. Where it has no rate, the run's ``guaranteed_rate`` is drawn.
        speed: seconds of the run a second when a page opens.
        uncertainty: (T, N) standard deviation that each node states, or None.
        age: (T, N) seconds since each node was last heard, or None.
        events: further events, beside the changes of the nodes' status.
        stale: seconds after which a node counts as silent, for the scale of the ages.

    Raises:
        ShapeError: the graph has another number of nodes than the run, or a table another shape.
        ArgumentError: a run without samples, a speed or a rate that is not positive.
    """

    controls: Controls | None = None
    ended: str | None = None
    edition = 0

    def __init__(
        self,
        run: Run,
        scene: Scene,
        speed: float = 1.0,
        *,
        uncertainty: FloatArray | None = None,
        age: FloatArray | None = None,
        events: Sequence[Event] = (),
        stale: float | None = None,
    ) -> None:
        if not run.times.shape[0]:
            raise ArgumentError("the run has no samples: there is nothing to replay")
        rate = run.attributes.get("guaranteed_rate")
        if scene.rate is None and isinstance(rate, float) and np.isfinite(rate) and rate > 0.0:
            scene = replace(scene, rate=rate, rate_name=DESIGNED if run.path == "live" else scene.rate_name)
        self.names = run.names
        self._run = run
        self._start = Playback.start(run.times, speed)
        self._states = _state_codes(run)
        self._norm = run.error_norm
        self._tables = {name: _table(run, name, value) for name, value in (("uncertainty", uncertainty), ("age", age))}
        self._no_links = np.full(arc_pairs(scene.graph)[0].shape[0], np.nan)
        self._neighbours = neighbours(scene.graph, run.names)
        self._topology = topology_message(
            scene,
            run.names,
            mode="replay",
            colours=[
                "error",
                *(["uncertainty"] if uncertainty is not None else []),
                "state",
                *(["age"] if age is not None else []),
            ],
            links=[],
            controls=[],
            times=run.times.tolist(),
            norm={"times": run.times.tolist(), "values": or_null(self._norm)},
            error_range=_error_range(run),
            stale=stale,
        )
        self._events = sorted([*self._all_events(), *events], key=lambda event: event.time)

    def topology(self) -> dict[str, Any]:
        """Return the message that a page gets first."""
        return self._topology

    def view(self) -> Playback:
        """Return the replay at its first sample, playing."""
        return self._start

    def frame(self, index: int) -> bytes:
        """Return the binary frame of the sample ``index``."""
        return encode_moment(self.moment(index))

    def moment(self, index: int) -> Moment:
        """Return what is drawn at the sample ``index``, 0 <= index < T."""
        run = self._run
        if not 0 <= index < run.times.shape[0]:
            raise ArgumentError(f"sample {index} is not in the run; expected 0 <= index < {run.times.shape[0]}")
        return Moment(
            index=index,
            time=float(run.times[index]),
            norm=float(self._norm[index]),
            traffic=self._traffic(index),
            missed=np.nan,
            rejected=np.nan,
            error=node_errors(run, index),
            uncertainty=self._tables["uncertainty"][index],
            age=self._tables["age"][index],
            state=self._states[index].astype(np.float64),
            loss=self._no_links,
            link_age=self._no_links,
        )

    def traces(self, node: int) -> dict[str, Any]:
        """Return the history of ``node``: estimate, truth, error."""
        run = self._run
        if not 0 <= node < len(run.names):
            raise ProtocolError(f"node {node} is not in the run; expected 0 <= node < {len(run.names)}")
        estimate, truth = run.estimate[:, node], run.truth[:, node]
        error = np.sqrt(((estimate - truth) ** 2).sum(axis=1))
        uncertainty = self._tables["uncertainty"][:, node]
        return trace_message(node, run.times, estimate=estimate, truth=truth, error=error, uncertainty=uncertainty)

    def details(self, node: int, index: int) -> dict[str, Any]:
        """Return what the run knows of ``node`` at the sample ``index``."""
        run = self._run
        facts = [["messages sent", int(run.messages[index, node])]]
        if run.delivered is not None:
            facts.append(["messages taken in", int(run.delivered[index, node])])
        error = float(np.sqrt(((run.estimate[index, node] - run.truth[index, node]) ** 2).sum()))
        return {
            "type": "node",
            "node": node,
            "time": float(run.times[index]),
            "estimate": or_null(run.estimate[index, node]),
            "truth": or_null(run.truth[index, node]),
            "error": number_or_null(error),
            "uncertainty": number_or_null(float(self._tables["uncertainty"][index, node])),
            "facts": facts,
            "links": [{"neighbour": other} for other in self._neighbours.get(node, [])],
        }

    def events(self, after: int) -> tuple[int, Sequence[Event]]:
        """Return how many events the run has, and those from number ``after`` on."""
        return len(self._events), self._events[after:]

    def ordered(self, order: str, node: int) -> None:
        """Do nothing with ``order`` and ``node``: there are no controls."""

    async def follow(self) -> None:
        """Return at once: all is there."""

    def _traffic(self, index: int) -> float:
        if index == 0:
            return np.nan
        sent = float(self._run.messages[index].sum() - self._run.messages[index - 1].sum())
        span = float(self._run.times[index] - self._run.times[index - 1])
        return sent / span if span > 0.0 and sent >= 0.0 else np.nan

    def _all_events(self) -> list[Event]:
        found: list[Event] = []
        for k in np.flatnonzero((np.diff(self._states, axis=0) != 0).any(axis=1)).tolist():
            found += changes(float(self._run.times[k + 1]), self._states[k], self._states[k + 1], self.names)
            if len(found) >= _MOST_EVENTS:
                text = f"only the first {_MOST_EVENTS} changes are listed"
                return [*found[:_MOST_EVENTS], Event(float(self._run.times[k + 1]), text)]
        return found


def _table(run: Run, name: str, values: FloatArray | None) -> FloatArray:
    shape = (run.times.shape[0], len(run.names))
    if values is None:
        return np.broadcast_to(np.nan, shape)
    if values.shape != shape:
        raise ShapeError(f"{name} must be (T, N) = {shape}; got {values.shape}")
    return values


def node_errors(run: Run, k: int) -> FloatArray:
    """(N,) Euclidean norm of each node's error at sample ``k`` of ``run``."""
    norms: FloatArray = np.sqrt(((run.estimate[k] - run.truth[k]) ** 2).sum(axis=1))
    return norms


def _state_codes(run: Run) -> np.ndarray[Any, np.dtype[np.int64]]:
    words, codes = np.unique(run.status, return_inverse=True)
    known = np.array([STATES.index(word) if word in STATES else UNKNOWN for word in words.tolist()], dtype=np.int64)
    return known[codes].reshape(run.status.shape)


def neighbours(graph: MeasurementGraph, names: Sequence[str]) -> dict[int, list[str]]:
    """Return the ``names`` of the nodes at the other ends of each node's arcs in ``graph``."""
    found: dict[int, list[str]] = {}
    for i, j in arc_pairs(graph)[0].tolist():
        found.setdefault(i, []).append(names[j])
        found.setdefault(j, []).append(names[i])
    return found


def _error_range(run: Run) -> list[float] | None:
    """Smallest and largest error of a node that is neither zero nor infinite, at most six decades apart."""
    low, high = np.inf, 0.0
    for k in range(run.times.shape[0]):
        norms = node_errors(run, k)
        norms = norms[np.isfinite(norms) & (norms > 0.0)]
        low, high = min(low, norms.min(initial=np.inf)), max(high, norms.max(initial=0.0))
    return [float(max(low, high / 10.0**_DECADES)), float(high)] if high > 0.0 else None
