"""A run that is going on as a feed: snapshots are taken at a fixed pace, all pages see the same latest one."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from trigpoint.arrays import BoolArray, FloatArray, IntArray
from trigpoint.dashboard.feed import ORDERS, Event, changes
from trigpoint.dashboard.frames import (
    ANCHORED,
    PAUSED,
    RELATIVE,
    SILENT,
    UNCOVERED,
    UNKNOWN,
    Moment,
    Scene,
    encode_moment,
    number_or_null,
    or_null,
    topology_message,
    trace_message,
)
from trigpoint.dashboard.history import History
from trigpoint.dashboard.links import LinkBook
from trigpoint.dashboard.told import facts_of, link_of, norm_of, nothing_said, places_beside, table_of, values_of
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError, TrigpointError
from trigpoint.graphs.layout import arc_pairs

if TYPE_CHECKING:
    from trigpoint.runtime import Controls, NodeStatus, Snapshot

_MOST_EVENTS = 500
_TRAFFIC_SPAN = 2.0
_BETWEEN_STATUSES, _LONGEST_BETWEEN = 2.5, 10.0  # s; as long as only one was heard, and at most


@dataclass(frozen=True, eq=False)
class Following:
    """The view of a page that follows a live feed: always the latest frame."""

    feed: LiveFeed

    @property
    def index(self) -> int:
        """Number of the latest frame."""
        return self.feed.count

    @property
    def wait(self) -> float:
        """Half the feed's period: a frame is shown at most that much late."""
        return 0.5 * self.feed.period

    playing = True
    speed = 1.0

    def advanced(self, seconds: float) -> Following:  # noqa: ARG002  every view has it
        """Return itself: the feed moves, whatever ``seconds`` passed."""
        return self

    def obeying(self, command: Mapping[str, Any]) -> Following:
        """Refuse ``command``: a live run cannot be played, stopped or wound back."""
        raise ProtocolError(f"this page follows a run that is going on; it cannot be told to {command['type']}")


class LiveFeed:
    """Frames of a run that is going on.

    Args:
        source: returns the present ``Snapshot``; called from a thread of its own, never twice at once.
        scene: the network, with nodes named as in the snapshots.
        controls: what the page may do to the nodes; None: look only.
        stale: seconds after which a node that is not heard counts as silent, and its estimate and error as unknown.
        period: seconds between two snapshots.
        memory: bytes that the kept history may take.

    Raises ``ShapeError`` where the names differ, ``ArgumentError`` for times that are not positive.
    """

    def __init__(
        self,
        source: Callable[[], Snapshot],
        scene: Scene,
        controls: Controls | None = None,
        *,
        stale: float = 0.5,
        period: float = 0.1,
        memory: int = 64 * 2**20,
    ) -> None:
        for name, value in (("stale", stale), ("period", period)):
            if not (np.isfinite(value) and value > 0.0):
                raise ArgumentError(f"{name} must be a positive number of seconds; got {value}")
        self.names = scene.graph.names
        self.controls = controls
        self.ended: str | None = None
        self.period = period
        self.count = self.edition = 0
        self._source, self._scene, self._stale, self._memory = source, scene, stale, memory
        pairs = arc_pairs(scene.graph)[0].tolist()
        self._links = LinkBook(pairs, self.names)
        n = len(self.names)
        self._status: list[NodeStatus | None] = [None] * n
        self._said = nothing_said(n)
        self._said_at, self._said_every = np.full(n, -np.inf), np.full(n, _BETWEEN_STATUSES)
        self._met = np.zeros(n, dtype=bool)
        self._paused: set[int] = set()
        self._states: IntArray = np.full(n, UNKNOWN, dtype=np.int64)
        self._events: deque[Event] = deque(maxlen=_MOST_EVENTS)
        self._event_count = 0
        self._lock = threading.Lock()  # events may be noted from other threads
        self._traffic: deque[tuple[float, float]] = deque()
        self._history: History | None = None
        self._snapshot: Snapshot | None = None
        self._moment = self._empty(n, len(pairs))
        self._topology = self._told()
        self._larger: Scene | None = None

    # -- taking in ---------------------------------------------------------------------------------------------------

    async def follow(self) -> None:
        """Take a snapshot every period until the source fails or the feed is ended."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while self.ended is None:
            try:
                snapshot = await asyncio.to_thread(self._source)
                if self.ended is not None:  # the source may have said so
                    return
                self.absorb(snapshot)
            except TrigpointError as error:  # else the pages would show the last moment for ever
                self.end(f"The run cannot be followed any longer: {error}")
                return
            due = max(due + self.period, clock())
            await asyncio.sleep(due - clock())

    def absorb(self, snapshot: Snapshot) -> None:
        """Make ``snapshot`` the latest frame and keep it in the history; other names are a ``ShapeError``."""
        if snapshot.names != self.names:
            self._grow(snapshot.names)
        for node, status in enumerate(snapshot.status):
            before = self._status[node]
            if status is None or status is before:
                continue
            if before is not None and status.acts < before.acts:
                self._add([Event(snapshot.time, f"{self.names[node]}: started again", node)])
            self._links.update(node, status.links)
            self._status[node] = status
            if before is not None:
                self._said_every[node] = min(snapshot.time - self._said_at[node], _LONGEST_BETWEEN)
            self._said_at[node] = snapshot.time
            self._said[node] = (
                True, status.anchored, status.covered, status.paused,
                status.uncertainty, status.missed, status.counters.dropped,
            )  # fmt: skip
        states = self._states_at(np.asarray(snapshot.age, dtype=np.float64), snapshot.time)
        self._add(changes(snapshot.time, self._states, states, self.names))
        self._states, self._snapshot = states, snapshot
        self.count += 1
        self._moment = self._drawn(snapshot, states)
        self._remember(snapshot)

    def extend(self, scene: Scene) -> None:
        """Take the next snapshot with more names for one of this ``scene``: nodes have joined, and come last."""
        self._larger = scene

    def _grow(self, names: tuple[str, ...]) -> None:
        known, scene = len(self.names), self._larger
        if scene is None or names != scene.graph.names or names[:known] != self.names:
            raise ShapeError(f"the snapshot has {len(names)} nodes that are not the {known} watched")
        places = np.column_stack([self._topology["x"], self._topology["y"]])
        more = len(names) - known
        self._scene = replace(scene, positions=places_beside(places, scene.graph))
        self.names, self.edition = names, self.edition + 1
        self._links = LinkBook(arc_pairs(scene.graph)[0].tolist(), names)
        for node, status in enumerate(self._status):
            self._links.update(node, () if status is None else status.links)
        self._traffic.clear()  # the new book counts from the nodes' own counters on
        self._status += [None] * more
        self._said = np.concatenate([self._said, nothing_said(more)])
        self._said_at = np.append(self._said_at, np.full(more, -np.inf))
        self._said_every = np.append(self._said_every, np.full(more, _BETWEEN_STATUSES))
        self._met = np.append(self._met, np.ones(more, dtype=bool))  # the norm does not wait for them
        self._states = np.append(self._states, np.full(more, UNKNOWN))
        self._history = None if self._history is None else self._history.grown(len(names))
        self._topology = self._told()

    def ordered(self, order: str, node: int) -> None:
        """Take note that the page gave ``order`` to ``node``: a paused node is silent until its status tells why."""
        (self._paused.add if order == "pause" else self._paused.discard)(node)
        self.note(f"{self.names[node]}: {order} ordered from the page", node)

    def note(self, text: str, node: int | None = None) -> None:
        """Add an event of the text ``text``, about ``node`` if it is about one, at the time of the latest snapshot."""
        self._add([Event(self._moment.time, text, node)])

    def end(self, text: str) -> None:
        """Tell every page why nothing more will come: ``text``."""
        self.note(text)
        self.ended = text

    # -- giving out --------------------------------------------------------------------------------------------------

    def topology(self) -> dict[str, Any]:
        """Return the message that a page gets first, with the error norm so far."""
        nothing = np.zeros(0)
        times, norm = (nothing if self._history is None else self._history.column(c) for c in ("time", "norm"))
        return {**self._topology, "norm": {"times": times.tolist(), "values": or_null(norm)}}

    def view(self) -> Following:
        """Return the view that is always at the latest frame."""
        return Following(self)

    def frame(self, index: int) -> bytes:  # noqa: ARG002  every feed has it
        """Return the latest binary frame, whatever ``index``: older ones are not kept."""
        return encode_moment(self._moment)

    def traces(self, node: int) -> dict[str, Any]:
        """Return the kept history of ``node``: estimate, truth, error, uncertainty."""
        self._check(node)
        history = self._history
        if history is None:
            nothing = np.zeros(0)
            return trace_message(node, nothing, estimate=np.zeros((0, 0)), error=nothing, uncertainty=nothing)
        tables = {name: history.of_node(name, node) for name in ("estimate", "truth", "error", "uncertainty")}
        return trace_message(node, history.column("time"), **tables)

    def details(self, node: int, index: int) -> dict[str, Any]:  # noqa: ARG002  every feed has it
        """Return what is known of ``node`` now, whatever ``index``."""
        self._check(node)
        snapshot, status = self._snapshot, self._status[node]
        known = snapshot is not None and not self._silent(snapshot)[node]
        joined = [["joined the run while it went on", "yes"]] if node in self._scene.joined else []
        return {
            "type": "node",
            "node": node,
            "time": self._moment.time,
            "estimate": values_of(snapshot.estimate[node]) if snapshot is not None and known else [],
            "truth": [] if snapshot is None else values_of(snapshot.truth[node]),
            "error": number_or_null(float(self._moment.error[node])),
            "uncertainty": number_or_null(float(self._moment.uncertainty[node])),
            "facts": [*joined, *([] if status is None else facts_of(status))],
            "links": [] if status is None else [link_of(link) for link in status.links],
        }

    def events(self, after: int) -> tuple[int, Sequence[Event]]:
        """Return how many events there have been, and those kept among them from number ``after`` on."""
        with self._lock:
            fresh = min(max(0, self._event_count - after), len(self._events))
            return self._event_count, list(self._events)[len(self._events) - fresh :]

    # -- inside ------------------------------------------------------------------------------------------------------

    def _told(self) -> dict[str, Any]:
        return topology_message(
            self._scene,
            self.names,
            mode="live",
            colours=["error", "uncertainty", "state", "age"],
            links=["loss", "age"],
            controls=[] if self.controls is None else list(ORDERS),
            times=[],
            error_range=None,
            stale=self._stale,
        )

    def _check(self, node: int) -> None:
        if not 0 <= node < len(self.names):
            raise ProtocolError(f"node {node} is not in the network; expected 0 <= node < {len(self.names)}")

    def _add(self, events: Sequence[Event]) -> None:
        with self._lock:
            self._events.extend(events)
            self._event_count += len(events)

    def _states_at(self, age: FloatArray, time: float) -> IntArray:
        """(N,) indices into ``STATES`` at ``time`` for nodes last heard ``age`` seconds ago.

        A paused node goes on to tell its status: one that does not is no longer paused, but gone.
        """
        said = self._said
        paused = said["paused"].copy()
        paused[list(self._paused)] = True
        paused &= ~said["known"] | (time - self._said_at <= self._stale + 3.0 * self._said_every)
        rules = (
            (np.isinf(age), UNKNOWN),
            ((age > self._stale) & paused, PAUSED),
            (age > self._stale, SILENT),
            (~said["known"], UNKNOWN),
            (~said["anchored"], RELATIVE),
            (said["covered"], ANCHORED),
        )
        return np.select([rule for rule, _ in rules], [state for _, state in rules], UNCOVERED).astype(np.int64)

    def _silent(self, snapshot: Snapshot) -> BoolArray:
        """(N,) nodes whose last estimate is too old to be taken for a present one."""
        return np.asarray(snapshot.age, dtype=np.float64) > self._stale

    def _drawn(self, snapshot: Snapshot, states: IntArray) -> Moment:
        said = self._said
        known = said["known"].any()
        silent = self._silent(snapshot)
        error = np.where(silent, np.nan, snapshot.error)
        self._met |= ~np.isnan(error)
        return Moment(
            index=self.count,
            time=snapshot.time,
            norm=norm_of(error) if self._met.all() else np.nan,  # else it would jump when the last ones join
            traffic=self._messages_a_second(snapshot.time),
            missed=float(said["missed"].sum()) if known else np.nan,
            rejected=float(said["rejected"].sum()) if known else np.nan,
            error=error,
            uncertainty=np.where(silent, np.nan, said["uncertainty"]),
            age=np.asarray(snapshot.age, dtype=np.float64),
            state=states.astype(np.float64),
            loss=self._links.loss,
            link_age=self._links.age,
        )

    def _messages_a_second(self, time: float) -> float:
        self._traffic.append((time, self._links.total))
        while len(self._traffic) > 2 and time - self._traffic[1][0] >= _TRAFFIC_SPAN:
            self._traffic.popleft()
        start, total = self._traffic[0]
        return (self._links.total - total) / (time - start) if time > start else np.nan

    def _remember(self, snapshot: Snapshot) -> None:
        if self._history is None:
            lengths = [0 if value is None else value.shape[0] for value in (*snapshot.estimate, *snapshot.truth)]
            if not max(lengths, default=0):
                return
            self._history = History(len(self.names), max(lengths), self._memory)
        moment, states = self._moment, self._history.states
        self._history.append(
            time=moment.time,
            norm=moment.norm,
            estimate=np.where(self._silent(snapshot)[:, None], np.nan, table_of(snapshot.estimate, states)),
            truth=table_of(snapshot.truth, states),
            error=moment.error,
            uncertainty=moment.uncertainty,
        )

    @staticmethod
    def _empty(nodes: int, links: int) -> Moment:
        unknown, no_links = np.full(nodes, np.nan), np.full(links, np.nan)
        state = np.full(nodes, float(UNKNOWN))
        age = np.full(nodes, np.inf)
        return Moment(0, 0.0, np.nan, np.nan, np.nan, np.nan, unknown, unknown, age, state, no_links, no_links)
