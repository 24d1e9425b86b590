"""``trigpoint convert``, ``reproduce`` and ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from trigpoint.cli.compose import kind_of
from trigpoint.cli.shell import FAILS, HOLDS, Json, Out, console, emit, ending, guarded
from trigpoint.errors import FileFormatError
from trigpoint.io import ScenarioFile, load, save, write_atomically
from trigpoint.observers.run import Run
from trigpoint.papers import EXPERIMENTS, reproduce
from trigpoint.report import live_page, render, run_page
from trigpoint.runtime import read_log, read_run, run_of


@guarded
def convert(
    source: Annotated[Path, typer.Argument(help="File to read.")],
    target: Annotated[Path, typer.Argument(help="File to write; its ending names the format.")],
    as_json: Json = False,
) -> int:
    """Read a network in one format and write it in another (.csv, .tsv, .gkf, .graphml, .json).

    The log of a live run (.mcap) is written as a recorded run (.npz, .nc, .zarr).
    """
    loaded = read_run(source) if _is_log(source) else load(source)
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
def report(
    file: Annotated[Path, typer.Argument(help="A run written by simulate (.npz), or the log of a live run (.mcap).")],
    out: Out = None,
    as_json: Json = False,
) -> int:
    """Write the report of a run: one HTML file, beside the run unless --out names another place."""
    ending(out, ".html")
    if _is_log(file):
        log = read_log(file)
        page = live_page(log, run_of(log), title=f"Run {file.name}")
    else:
        run = _run(file)
        rate = run.attributes.get("guaranteed_rate")
        page = run_page(run, title=f"Run {file.name}", rate=rate if isinstance(rate, float) and rate > 0 else None)
    target = file.with_suffix(".html") if out is None else out
    write_atomically(target, render(page))
    if as_json:
        emit({"report": str(target)})
    else:
        console().print(f"written to {target}")
    return HOLDS


def _is_log(path: Path) -> bool:
    return path.suffix.lower() == ".mcap"


def _run(path: Path) -> Run:
    run = read_run(path) if _is_log(path) else load(path)
    if not isinstance(run, Run):
        raise FileFormatError(path, f"holds {kind_of(run)}; expected a recorded run (.npz written by simulate)")
    return run
