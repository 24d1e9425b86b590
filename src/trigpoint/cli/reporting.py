"""``trigpoint report``: a page, and moving pictures, from a recorded run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from trigpoint.cli.compose import estimating, kind_of, read
from trigpoint.cli.shell import HOLDS, Json, Out, console, emit, ending, guarded
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io import load, write_atomically
from trigpoint.observers.run import Run
from trigpoint.report import ANIMATIONS, Scene, animation, render, run_page
from trigpoint.simulation.documents import scenario_from_document
from trigpoint.simulation.topology import with_absences

Animate = Annotated[
    Path | None, typer.Option("--animate", help="Also a moving picture: .gif, .html, or .mp4 (needs ffmpeg).")
]
NetworkFile = Annotated[Path | None, typer.Option("--network", help="The run's network: any file that simulate takes.")]
Frames = Annotated[int, typer.Option("--frames", help="Frames of the moving picture.")]


@guarded
def report(
    file: Annotated[Path, typer.Argument(help="A run written by simulate (.npz, .nc, .zarr).")],
    network: NetworkFile = None,
    animate: Animate = None,
    frames: Frames = 100,
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Write the report of a recorded run: one HTML file, beside the run unless --out names another place.

    With --network it shows the network coloured by the final error; --animate needs it.
    """
    ending(out, ".html")
    ending(animate, *(f".{kind}" for kind in ANIMATIONS))
    run = run_of(file)
    target = file.with_suffix(".html") if out is None else out
    if animate is not None and network is None:
        raise ArgumentError("--animate needs the run's network: add --network FILE")
    if animate is not None and animate.resolve() == target.resolve():
        raise ArgumentError(f"the report and the moving picture would both be {target}: name one of them otherwise")
    graph = None if network is None else graph_of(network, run)
    rate = _rate(run)
    write_atomically(target, render(run_page(run, title=f"Run {file.name}", graph=graph, rate=rate)))
    written = {"report": str(target)}
    if animate is not None and graph is not None:
        moving = animation(
            run,
            graph,
            animate.suffix.lower()[1:],  # type: ignore[arg-type]  # checked above
            scene=_scene(run, graph, rate),
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


def run_of(path: Path) -> Run:
    """Read a recorded run."""
    run = load(path)
    if not isinstance(run, Run):
        raise FileFormatError(path, f"holds {kind_of(run)}; expected a recorded run (.npz written by simulate)")
    return run


def graph_of(network: Path, run: Run) -> MeasurementGraph:
    """The graph in a file whose nodes are those of ``run``."""
    given = read(network)
    candidates = (given.graph, estimating(given, "unit").graph)
    graph = next((g for g in candidates if g is not None and g.names == run.names), None)
    if graph is None:
        raise FileFormatError(network, "is not the network of this run: the node names differ")
    return graph


def _rate(run: Run) -> float | None:
    rate = run.attributes.get("guaranteed_rate")
    return rate if isinstance(rate, float) and rate > 0 else None


def _scene(run: Run, graph: MeasurementGraph, rate: float | None) -> Scene:
    """Arcs as they worked, nodes where they were: as far as the run's own scenario says so."""
    try:
        scenario = scenario_from_document(run.attributes["scenario"])
    except (KeyError, ProtocolError):
        return Scene(rate=rate)  # a live run has none
    topology = with_absences(graph, scenario.topology, scenario.absences)
    active = None
    if topology is not None and topology.active.shape[1] == graph.n_arcs:
        active = np.array([topology.at(time) for time in run.times.tolist()])
    axes = (0, 1) if scenario.motion is not None and run.truth.shape[2] >= 4 else None
    return Scene(axes=axes, active=active, rate=rate)
