"""A recorded run as one ``.npz`` file: plain arrays and a JSON header, nothing pickled."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.io.text import read_bytes
from trigpoint.observers.run import Run

_KIND = "trigpoint/run"
_VERSION = 1
_ARRAYS = ("times", "truth", "estimate", "messages", "status")
_OPTIONAL = ("delivered", "bytes", "lambda_min")


def read_run(path: str | Path) -> Run:
    """Read a run written by ``write_run``; anything else is a ``FileFormatError``."""
    data = read_bytes(path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            header: Any = json.loads(str(archive["header"]))
            if not isinstance(header, dict) or (header.get("kind"), header.get("version")) != (_KIND, _VERSION):
                raise FileFormatError(path, f"is not a recorded run of version {_VERSION}")
            arrays = {name: archive[name] for name in _ARRAYS}
            arrays |= {name: archive[name] for name in _OPTIONAL if name in archive}
        names = tuple(str(name) for name in header["names"])
        return Run(**arrays, names=names, path=str(header["path"]), attributes=dict(header["attributes"]))
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(path, "is not a recorded run (.npz written by simulate), or is damaged") from error


def run_bytes(run: Any) -> bytes:
    """The bytes of a run's file."""
    if not isinstance(run, Run):
        raise ArgumentError(
            f".npz holds recorded runs; got a {type(run).__name__} (networks are saved as .csv, .json, .graphml, .gkf)"
        )
    header = {
        "kind": _KIND,
        "version": _VERSION,
        "names": list(run.names),
        "path": run.path,
        "attributes": dict(run.attributes),
    }
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {name: getattr(run, name) for name in _ARRAYS}
    arrays |= {name: getattr(run, name) for name in _OPTIONAL if getattr(run, name) is not None}
    np.savez_compressed(buffer, header=np.array(json.dumps(header)), **arrays)
    return buffer.getvalue()
