"""``trigpoint convert``, ``reproduce`` and ``watch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from trigpoint.cli.reporting import graph_of, run_of
from trigpoint.cli.shell import FAILS, HOLDS, Json, console, emit, guarded
from trigpoint.dashboard import page_url, replay_app, serve
from trigpoint.errors import FileFormatError
from trigpoint.io import ScenarioFile, load, save
from trigpoint.papers import EXPERIMENTS, reproduce


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
def reproduce_command(
    name: Annotated[str | None, typer.Argument(help="Experiment; none lists them.")] = None,
    as_json: Json = False,
) -> int:
    """Compute a paper's experiment and print its published numbers beside ours. Exit code 1: some number differs."""
    if name is None:
        if as_json:
            emit({"experiments": sorted(EXPERIMENTS)})
        else:
            console().print("\n".join(sorted(EXPERIMENTS)))
        return HOLDS
    result = reproduce(name)
    if as_json:
        emit({"name": result.name, "source": result.source, "cells": [vars(cell) for cell in result.cells]})
    else:
        table = Table("", "paper", "ours", "difference", "verdict", box=None, pad_edge=False)
        for cell in result.cells:
            table.add_row(cell.at, f"{cell.paper:.10g}", f"{cell.ours:.10g}", f"{cell.error:.1e}", cell.verdict)
        screen = console()
        screen.print(f"{result.source}\n{result.text}\n")
        screen.print(table)
    return HOLDS if result.agrees else FAILS


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
