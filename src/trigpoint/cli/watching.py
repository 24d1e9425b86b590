"""``trigpoint watch``: a recorded run on the page; and the page of ``trigpoint run --watch``."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from trigpoint.arrays import FloatArray
from trigpoint.cli.compose import estimating, kind_of, read
from trigpoint.cli.live import LiveRun
from trigpoint.cli.shell import HOLDS, Json, emit, guarded, notice
from trigpoint.dashboard import Event, LiveFeed, ReplayFeed, Scene, live_app, page_url, serve, serving
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io import load
from trigpoint.observers.local import LocalObserver
from trigpoint.observers.run import Run
from trigpoint.runtime import Log, Snapshot, read_log, run_of

_OVER = "The run is over."
_FAREWELL = 0.5  # seconds for the pages to hear that the run is over


@guarded
def watch(
    file: Annotated[Path, typer.Argument(help="A run: .npz of simulate, run.mcap of run, or the folder it is in.")],
    network: Annotated[
        Path | None, typer.Argument(help="Its network: any file that simulate takes. A run.mcap names its own links.")
    ] = None,
    port: Annotated[int, typer.Option("--port", help="Port on 127.0.0.1.")] = 8765,
    as_json: Json = False,
) -> int:
    """Replay a run in the browser, from this machine only. Ends with Ctrl-C. What goes on now: run --watch."""
    app = live_app(feed_of(file, network))
    if as_json:
        emit({"address": page_url(app, port)})
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
    if network is not None:
        scene = _scene(network, log.names, title)
    elif "hears" in log.attributes:
        scene = Scene(links_of(log.names, log.attributes["hears"], log.attributes.get("anchors", ())), title)
    else:
        raise ArgumentError(f"{log.path} does not tell its links: name its network, too")
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


@contextmanager
def watched(live: LiveRun, port: int | None) -> Iterator[None]:
    """Show the run on the page at this ``port`` while the context lasts; without a port do nothing."""
    if port is None:
        yield
        return
    programs, settings = [node.program for node in live.plan.nodes], live.plan.nodes[0]
    hears = {program.name: program.hears for program in programs}
    index = {name: k for k, name in enumerate(live.plan.names)}
    told = 0

    def snapshot() -> Snapshot:
        nonlocal told  # how many of the supervisor's events the page knows
        events = live.supervisor.events
        for _, node, text in events[told:]:
            feed.note(f"{node}: {text}", index.get(node))
        told = len(events)
        if live.closing and feed.ended is None:  # what comes now is the nodes' going, not the run
            feed.end(_OVER)
        return live.monitor.snapshot()

    scene = Scene(
        links_of(live.plan.names, hears, anchored_by(programs)), live.plan.network, rate=settings.decay_rate or None
    )
    feed = LiveFeed(snapshot, scene, live.supervisor, stale=max(2.0 * settings.stale, 5.0 * settings.period))
    with serving(live_app(feed), port) as address:
        notice(f"Open {address}")
        try:
            yield
        finally:
            if feed.ended is None:
                feed.end(_OVER)
            time.sleep(_FAREWELL)
