"""``trigpoint convert``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trigpoint.cli.reporting import is_log
from trigpoint.cli.shell import HOLDS, Json, console, emit, guarded
from trigpoint.errors import FileFormatError
from trigpoint.io import ScenarioFile, load, save
from trigpoint.observers import Run
from trigpoint.runtime import read_run

_RUNS = (".npz", ".nc", ".zarr")


@guarded
def convert(
    source: Annotated[Path, typer.Argument(help="File to read.")],
    target: Annotated[Path, typer.Argument(help="File to write; its ending names the format.")],
    as_json: Json = False,
) -> int:
    """Read a network in one format and write it in another (.csv, .tsv, .gkf, .graphml, .json;
    .xml is read as GNU Gama or GraphML, as it says, and written as GNU Gama).

    The log of a live run (.mcap) is written as a recorded run (.npz, .nc, .zarr).
    """
    loaded = read_run(source) if is_log(source) else load(source)
    if isinstance(loaded, ScenarioFile):
        if loaded.network is None:
            raise FileFormatError(source, "states a [plant], which is no network to convert")
        loaded = loaded.network
    if isinstance(loaded, Run) and target.suffix.lower() not in _RUNS:
        raise FileFormatError(source, f"holds a recorded run: convert writes it as {', '.join(_RUNS)}")
    save(loaded, target)
    if as_json:
        emit({"from": str(source), "to": str(target)})
    else:
        console().print(f"written to {target}")
    return HOLDS
