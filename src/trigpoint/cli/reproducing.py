"""``trigpoint reproduce``: the papers' numbers beside ours."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from trigpoint.cli.results_page import VERDICTS, results_page, shown
from trigpoint.cli.shell import FAILS, HOLDS, Json, console, emit, ending, guarded, tracked
from trigpoint.errors import ArgumentError
from trigpoint.io import write_atomically
from trigpoint.io.text import nearest
from trigpoint.papers import EXPERIMENTS, Reproduction, reproduce
from trigpoint.report import render

_IMAGE = "r23-image"

Name = Annotated[str | None, typer.Argument(help="Experiment; none lists them.")]
Whole = Annotated[bool, typer.Option("--all", help="All experiments.")]
Image = Annotated[Path | None, typer.Option("--image", help=f"Grey picture for {_IMAGE} (.pgm, .png, .npy).")]
Where = Annotated[Path | None, typer.Option("--out", help="Page to write: FILE.html, or with --all a folder.")]


@guarded
def reproduce_command(
    name: Name = None, whole: Whole = False, image: Image = None, out: Where = None, as_json: Json = False
) -> int:
    """Compute a paper's experiment and print its published numbers beside ours. Exit code 1: some number differs.

    Errata and what the paper leaves open are told apart and do not count as differences. --out writes one page with
    the pictures.
    """
    if name is None and not whole:
        if image is not None or out is not None:
            raise ArgumentError("--image and --out need an experiment, or --all; trigpoint reproduce lists them")
        return _list(as_json)
    if name is not None and whole:
        raise ArgumentError(f"give either an experiment or --all; got {name!r} and --all")
    if image is not None and name not in (None, _IMAGE):
        raise ArgumentError(f"--image belongs to {_IMAGE}; got {name!r}")
    if name is not None and name not in EXPERIMENTS:
        hint = nearest(name, EXPERIMENTS)
        raise ArgumentError(f"no experiment is called {name!r}{hint} (trigpoint reproduce lists them)")
    target = _target(out, whole=whole)
    names = [name] if name is not None else list(EXPERIMENTS)
    results = [
        reproduce(one, image=image) if image is not None and one == _IMAGE else reproduce(one)
        for one in tracked("reproducing")(names)
    ]
    if target is not None:
        write_atomically(target, render(results_page(results)))
    if as_json:
        emit({"results": [_facts(result) for result in results]} if whole else _facts(results[0]))
    else:
        _show(results, target, whole=whole)
    return HOLDS if all(result.agrees for result in results) else FAILS


def _list(as_json: bool) -> int:
    if as_json:
        emit({"experiments": list(EXPERIMENTS)})
    else:
        table = Table(show_header=False, box=None, pad_edge=False)
        for name, run in EXPERIMENTS.items():
            table.add_row(name, (inspect.getdoc(run) or "").split("\n\n")[0].replace("\n", " ").replace("`", ""))
        console().print(table)
    return HOLDS


def _target(out: Path | None, *, whole: bool) -> Path | None:
    """The file to write, with ``--all`` also given by its folder."""
    if out is not None and whole and (out.is_dir() or not out.suffix):
        out.mkdir(parents=True, exist_ok=True)
        return out / "reproduce.html"
    ending(out, ".html")
    return out


def _facts(result: Reproduction) -> dict[str, Any]:
    keys = ("at", "paper", "ours", "error", "verdict")
    cells = [{key: getattr(cell, key) for key in keys} for cell in result.cells]
    return {"name": result.name, "source": result.source, "cells": cells}


def _show(results: list[Reproduction], target: Path | None, *, whole: bool) -> None:
    screen = console()
    if whole:
        table = Table("", *VERDICTS, box=None, pad_edge=False)
        for result in results:
            table.add_row(result.name, *(str(result.count(verdict)) for verdict in VERDICTS))
    else:
        screen.print(f"{results[0].source}\n{results[0].text}\n")
        table = Table("", "paper", "ours", "difference", "verdict", "", box=None, pad_edge=False)
        for cell in results[0].cells:
            paper, ours, error = shown(cell, 10)
            table.add_row(cell.at, paper, ours, error, cell.verdict, cell.note)
    screen.print(table)
    if target is not None:
        screen.print(f"written to {target}")
