"""``trigpoint convert`` and ``watch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trigpoint.cli.reporting import graph_of, run_of
from trigpoint.cli.shell import HOLDS, Json, console, emit, guarded
from trigpoint.dashboard import page_url, replay_app, serve
from trigpoint.errors import FileFormatError
from trigpoint.io import ScenarioFile, load, save


@guarded
def convert(
    source: Annotated[Path, typer.Argument(help="File to read.")],
    target: Annotated[Path, typer.Argument(help="File to write; its ending names the format.")],
    as_json: Json = False,
) -> int:
    """Read a network in one format and write it in another (.csv, .tsv, .gkf, .graphml, .json)."""
    loaded = load(source)
    if isinstance(loaded, ScenarioFile):
        if loaded.network is None:
            raise FileFormatError(source, "states a [plant], which is no network to convert")
        loaded = loaded.network
    save(loaded, target)
    if as_json:
        emit({"from": str(source), "to": str(target)})
    else:
        console().print(f"written to {target}")
    return HOLDS


@guarded
def watch(
    file: Annotated[Path, typer.Argument(help="A run written by simulate (.npz).")],
    network: Annotated[Path, typer.Argument(help="Its network: any file that simulate takes.")],
    port: Annotated[int, typer.Option("--port", help="Port on 127.0.0.1.")] = 8765,
    as_json: Json = False,
) -> int:
    """Replay a recorded run in the browser, from this machine only. Ends with Ctrl-C."""
    run = run_of(file)
    graph = graph_of(network, run)
    app = replay_app(run, graph)
    if as_json:
        emit({"address": page_url(app, port)})
    serve(app, port)
    return HOLDS
