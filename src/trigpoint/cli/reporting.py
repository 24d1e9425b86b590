"""``trigpoint report``: a page, and moving pictures, from a recorded run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from trigpoint.arrays import FloatArray
from trigpoint.cli.compose import estimating, kind_of, read
from trigpoint.cli.shell import HOLDS, Json, Out, console, emit, ending, guarded
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io import load, write_atomically
from trigpoint.observers.run import Run
from trigpoint.report import ANIMATIONS, Page, Staging, animation, live_page, rate_of, render, run_page
from trigpoint.runtime import read_log, run_of
from trigpoint.simulation.documents import scenario_from_document
from trigpoint.simulation.topology import with_absences

Animate = Annotated[
    Path | None, typer.Option("--animate", help="Also a moving picture: .gif, .html, or .mp4 (needs ffmpeg).")
]
NetworkFile = Annotated[Path | None, typer.Option("--network", help="The run's network: any file that simulate takes.")]
Frames = Annotated[int, typer.Option("--frames", help="Frames of the moving picture.")]


@guarded
def report(
    file: Annotated[
        Path, typer.Argument(help="A run of simulate (.npz, .nc, .zarr), or the log of a live one (.mcap).")
    ],
    network: NetworkFile = None,
    animate: Animate = None,
    frames: Frames = 100,
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Write the report of a run: one HTML file, beside the run unless --out names another place.

    It is named like the run: run.html for run.npz, run.live.html for the log run.mcap.

    With --network it shows the network coloured by the final error; --animate needs it.
    """
    ending(out, ".html")
    ending(animate, *(f".{kind}" for kind in ANIMATIONS))
    log = read_log(file) if is_log(file) else None
    run = stored(file) if log is None else run_of(log)
    target = file.with_suffix(".html" if log is None else ".live.html") if out is None else out
    if animate is not None and network is None:
        raise ArgumentError("--animate needs the run's network: add --network FILE")
    if animate is not None and animate.resolve() == target.resolve():
        raise ArgumentError(f"the report and the moving picture would both be {target}: name one of them otherwise")
    graph, places = (None, None) if network is None else drawn_network(network, run)
    title = f"Run {file.name}"
    page = _page(run, title, graph, places) if log is None else live_page(log, run, title=title)
    write_atomically(target, render(page))
    written = {"report": str(target)}
    if animate is not None and graph is not None:
        moving = animation(
            run,
            graph,
            animate.suffix.lower()[1:],  # type: ignore[arg-type]  # checked above
            staging=_staging(run, graph, places),
            frames=frames,
            title=file.stem,
        )
        write_atomically(animate, moving)
        written["animation"] = str(animate)
    if as_json:
        emit(written)
    else:
        console().print("\n".join(f"written to {path}" for path in written.values()))
    return HOLDS


def is_log(path: Path) -> bool:
    """Whether ``path`` is named like the log of a live run."""
    return path.suffix.lower() == ".mcap"


def stored(path: Path) -> Run:
    """Read a recorded run."""
    run = load(path)
    if not isinstance(run, Run):
        raise FileFormatError(
            path, f"holds {kind_of(run)}; expected a recorded run (.npz written by simulate, .mcap by run)"
        )
    return run


def drawn_network(network: Path, run: Run) -> tuple[MeasurementGraph, FloatArray | None]:
    """The graph in a file whose nodes are those of ``run``, and where the file says they are (None: nowhere)."""
    given = read(network)
    part = estimating(given, "unit")
    for graph, measured in ((given.graph, given.network), (part.graph, part.network)):
        if graph is not None and graph.names == run.names:
            places = None if measured is None else measured.positions
            return graph, places if places is not None and np.isfinite(places).all() else None
    came = list(run.attributes.get("joined", ()))
    hint = (
        f"; {', '.join(map(str, came[:5]))} joined it, whom no file of a network holds: leave --network out"
        if came
        else ""
    )
    raise FileFormatError(network, f"is not the network of this run: the node names differ{hint}")


def _page(run: Run, title: str, graph: MeasurementGraph | None, places: FloatArray | None) -> Page:
    rate, name = rate_of(run) or (None, "")
    return run_page(run, title=title, graph=graph, positions=places, rate=rate, rate_name=name)


def _staging(run: Run, graph: MeasurementGraph, places: FloatArray | None) -> Staging:
    """Arcs as they worked, nodes where they were: as far as the run's own scenario says so."""
    rate, name = rate_of(run) or (None, "")
    staged = Staging(places, rate=rate, rate_name=name)
    try:
        scenario = scenario_from_document(run.attributes["scenario"])
    except (KeyError, ProtocolError):
        return staged  # a live run has none
    topology = with_absences(graph, scenario.topology, scenario.absences)
    active = None
    if topology is not None and topology.active.shape[1] == graph.n_arcs:
        active = np.array([topology.at(time) for time in run.times.tolist()])
    moves = scenario.motion is not None and run.truth.shape[2] >= 4
    return replace(staged, axes=(0, 1) if moves else None, active=active)
