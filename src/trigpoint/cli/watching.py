"""``trigpoint watch``: a run on the page, recorded or going on; and the page of ``trigpoint run --watch``."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from trigpoint.arrays import FloatArray
from trigpoint.cli.compose import estimating, kind_of, read
from trigpoint.cli.live import LiveRun
from trigpoint.cli.shell import HOLDS, Json, emit, guarded, notice
from trigpoint.dashboard import DESIGNED, Event, LiveFeed, ReplayFeed, Scene, live_app, page_url, serve, serving
from trigpoint.dashboard.told import places_beside
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io import load
from trigpoint.observers.local import LocalObserver
from trigpoint.observers.run import Run
from trigpoint.runtime import Log, Monitor, NodeSettings, Snapshot, SystemClock, read_log, run_of
from trigpoint.runtime.arrivals import Arrivals, opener
from trigpoint.runtime.log_format import JOINED
from trigpoint.runtime.viewer import VIEWER_FILE, nodes_in, read_viewer, running, view_transport

_OVER = "The run is over."
_LOOK = 1.0  # seconds between two looks whether the run goes on
_FAREWELL = 0.5  # seconds for the pages to hear that the run is over


@guarded
def watch(
    file: Annotated[Path, typer.Argument(help="A run: .npz of simulate, run.mcap, or the folder of run --out.")],
    network: Annotated[
        Path | None, typer.Argument(help="Its network: any file that simulate takes. A run.mcap names its own links.")
    ] = None,
    port: Annotated[int, typer.Option("--port", help="Port on 127.0.0.1.")] = 8765,
    as_json: Json = False,
) -> int:
    """Show a run in the browser, from this machine only. Ends with Ctrl-C.

    The folder of a run that goes on (run --out DIR), or of nodes that were started by hand (run --prepare DIR), is
    followed live, by a guest that only hears; orders are for run --watch. Everything else is replayed.
    """
    goes_on = file.is_dir() and network is None and (running(file) or _by_hand(file))
    with attached(file) if goes_on else nullcontext(feed_of(file, network)) as feed:
        app = live_app(feed)
        if as_json:
            emit({"address": page_url(app, port), "live": goes_on})
        serve(app, port)
    return HOLDS


def feed_of(file: Path, network: Path | None) -> ReplayFeed:
    """What a page replays of the run in ``file`` on its ``network``."""
    if file.is_dir():
        file = file / "run.mcap"
    if file.suffix.lower() == ".mcap":
        return _of_log(read_log(file), network)
    run = load(file)
    if not isinstance(run, Run):
        raise FileFormatError(
            file, f"holds {kind_of(run)}; expected a recorded run (.npz written by simulate, .mcap written by run)"
        )
    if network is None:
        raise ArgumentError(f"{file} holds no links: name its network, too (trigpoint watch {file} NETWORK)")
    return ReplayFeed(run, _scene(network, run.names, file.name))


def _of_log(log: Log, network: Path | None) -> ReplayFeed:
    title = f"{log.network} ({Path(log.path).name})"
    joined = tuple(name for name in log.names if name in log.attributes.get(JOINED, ()))
    if network is not None:
        scene = _scene(network, log.names[: len(log.names) - len(joined)], title)
    elif "hears" in log.attributes:
        scene = Scene(_links_in(log), title)
    else:
        raise ArgumentError(f"{log.path} does not tell its links: name its network, too")
    if joined:
        scene = _with_newcomers(scene, log, joined)
    run = run_of(log)
    start = float(run.attributes.get("start", 0.0))
    uncertainty, age = _told(log, run.times + start)
    index = {name: k for k, name in enumerate(log.names)}
    events = [Event(event.time - start, event.text, index.get(event.node or "")) for event in log.events]
    stale = log.attributes.get("stale")
    return ReplayFeed(
        run,
        scene,
        uncertainty=uncertainty,
        age=age,
        events=events,
        stale=2.0 * stale if isinstance(stale, float) and stale > 0.0 else None,
    )


def _links_in(log: Log) -> MeasurementGraph:
    return links_of(log.names, log.attributes.get("hears", {}), log.attributes.get("anchors", ()))


def _with_newcomers(scene: Scene, log: Log, joined: tuple[str, ...]) -> Scene:
    """The ``scene`` of the run's own nodes, and what the log says of those that came later."""
    known, graph = len(log.names) - len(joined), _links_in(log)
    if scene.graph.n_nodes == known:
        new = (graph.tail >= known) | (graph.head >= known)
        arcs = np.append(scene.graph.tail, graph.tail[new]), np.append(scene.graph.head, graph.head[new])
        graph = MeasurementGraph(len(log.names), *arcs, names=log.names)
    places = None if scene.positions is None else places_beside(np.asarray(scene.positions, dtype=np.float64), graph)
    return replace(scene, graph=graph, positions=places, joined=tuple(range(known, len(log.names))))


def _told(log: Log, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(T, N) uncertainty and age of each node's last estimate at ``times``, in the log's own seconds."""
    shape = (times.shape[0], len(log.names))
    uncertainty, age = np.full(shape, np.nan), np.full(shape, np.inf)
    for k, name in enumerate(log.names):
        if name not in log.estimates:
            continue
        series = log.estimates[name]
        order = np.argsort(series.times, kind="stable")
        last = np.searchsorted(series.times[order], times, side="right") - 1
        known = last >= 0
        uncertainty[known, k] = series.facts["uncertainty"][order][last[known]]
        age[known, k] = times[known] - series.times[order][last[known]]
    return uncertainty, age


def _scene(network: Path, names: tuple[str, ...], title: str) -> Scene:
    given = read(network)
    part = estimating(given, "unit")
    for graph, measured in ((given.graph, given.network), (part.graph, part.network)):
        if graph is not None and graph.names == names:
            places = None if measured is None else measured.positions
            states_are_values = measured is not None and not given.agent.A.any()
            return Scene(
                graph,
                title,
                places if places is not None and np.isfinite(places).all() else None,
                unit=measured.unit if measured is not None and states_are_values else "",
            )
    raise FileFormatError(network, "is not the network of this run: the node names differ")


def links_of(names: Sequence[str], hears: Mapping[str, Sequence[str]], anchors: Sequence[str]) -> MeasurementGraph:
    """Return the network of ``names``: an arc where one ``hears`` another, an external one at each of ``anchors``."""
    index = {name: k for k, name in enumerate(names)}
    pairs = {
        (min(index[name], index[other]), max(index[name], index[other]))
        for name, others in hears.items()
        for other in others
        if name in index and other in index
    }
    ends = [*sorted(pairs), *((EXTERNAL, index[name]) for name in anchors if name in index)]
    return MeasurementGraph(len(names), [i for i, _ in ends], [j for _, j in ends], names=names)


def anchored_by(programs: Sequence[LocalObserver]) -> list[str]:
    """Return the names of those among the ``programs`` that have a reading of their own state alone."""
    return [program.name for program in programs if any(not arc.heard for arc in program.arcs)]


def _by_hand(folder: Path) -> bool:
    """Whether it is the ``folder`` of ``run --prepare``, where nobody looks after the nodes: they may run or not."""
    over = any((folder / name).exists() for name in ("status.json", "run.mcap"))
    return (folder / VIEWER_FILE).is_file() and not over


@contextmanager
def attached(folder: Path) -> Iterator[LiveFeed]:
    """The feed of the run that goes on in ``folder``, heard by a monitor of its own that only listens."""
    viewer, nodes = read_viewer(folder / VIEWER_FILE), nodes_in(folder)
    transport = view_transport(viewer, nodes)
    programs = [node.program for node in nodes]
    monitor = Monitor(transport, viewer.network, programs, SystemClock(), viewer.motions)
    arrivals = Arrivals((folder / VIEWER_FILE).parent, nodes, monitor, opener("monitor", viewer.identity))
    looked, welcome, alone = 0.0, _Welcome(arrivals, nodes), _by_hand(folder)

    def snapshot() -> Snapshot:
        nonlocal looked  # when the status was read
        monitor.poll()
        arrivals.look(time.monotonic())
        found = monitor.snapshot()
        for name in welcome.into(feed, found.names):
            feed.note(f"{name}: joined the run", found.names.index(name))
        if found.time - looked >= _LOOK:
            looked = found.time
            if feed.ended is None and not alone and not running(folder):
                feed.end(_OVER)
        return found

    feed = LiveFeed(snapshot, _live_scene(programs, nodes[0]), stale=_silent_after(nodes[0]))
    try:
        yield feed
    finally:
        arrivals.close()
        transport.close()


class _Welcome:
    """Makes room on a page for nodes that join the run of these ``nodes``."""

    def __init__(self, arrivals: Arrivals, nodes: Sequence[NodeSettings]) -> None:
        self._arrivals, self._settings, self._known = arrivals, nodes[0], len(nodes)
        self._shown = len(nodes)

    def into(self, feed: LiveFeed, names: tuple[str, ...]) -> tuple[str, ...]:
        """Extend the ``feed`` where the snapshot at hand has more ``names`` than the last one; the new ones."""
        fresh = names[self._shown :]
        if fresh:
            self._shown = len(names)
            links = links_of(names, self._arrivals.hears, self._arrivals.anchors)
            joined = tuple(range(self._known, len(names)))
            feed.extend(replace(_scene_of(links, self._settings), joined=joined))
        return fresh


def _live_scene(programs: Sequence[LocalObserver], settings: NodeSettings) -> Scene:
    names = [program.name for program in programs]
    links = links_of(names, {program.name: program.hears for program in programs}, anchored_by(programs))
    return _scene_of(links, settings)


def _scene_of(links: MeasurementGraph, settings: NodeSettings) -> Scene:
    return Scene(links, settings.network, rate=settings.decay_rate or None, rate_name=DESIGNED)


def _silent_after(settings: NodeSettings) -> float:
    return max(2.0 * settings.stale, 5.0 * settings.period)


@contextmanager
def watched(live: LiveRun, port: int | None) -> Iterator[None]:
    """Show the run on the page at this ``port`` while the context lasts; without a port do nothing."""
    if port is None:
        yield
        return
    programs, settings = [node.program for node in live.plan.nodes], live.plan.nodes[0]
    told, welcome = 0, _Welcome(live.arrivals, live.plan.nodes)

    def snapshot() -> Snapshot:
        nonlocal told  # how many of the supervisor's events the page knows
        found = live.monitor.snapshot()
        welcome.into(feed, found.names)
        index = {name: k for k, name in enumerate(found.names)}
        events = live.supervisor.events
        for _, node, text in events[told:]:
            feed.note(f"{node}: {text}", index.get(node))
        told = len(events)
        if live.closing and feed.ended is None:  # what comes now is the nodes' going, not the run
            feed.end(_OVER)
        return found

    feed = LiveFeed(snapshot, _live_scene(programs, settings), live.supervisor, stale=_silent_after(settings))
    with serving(live_app(feed), port) as address:
        notice(f"Open {address}")
        try:
            yield
        finally:
            if feed.ended is None:
                feed.end(_OVER)
            time.sleep(_FAREWELL)
