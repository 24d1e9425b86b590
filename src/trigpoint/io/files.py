"""Any file in and out: the format is chosen by the suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from trigpoint.errors import ArgumentError, FileFormatError, TrigpointError
from trigpoint.io.atomic import write_atomically
from trigpoint.io.documents import READERS, WRITERS
from trigpoint.io.formats import NETWORK_FORMATS, Format, format_of
from trigpoint.io.nodelink import nodelink_from_document, parse_json, refuse_repeated_keys
from trigpoint.io.run_file import read_run, run_bytes
from trigpoint.io.run_tables import netcdf_bytes, read_netcdf, read_zarr, tables, zarr_bytes
from trigpoint.io.scenario import read_scenario
from trigpoint.io.text import nearest, read_text, shown

DOCUMENT_PREFIX = "trigpoint/"
"""A JSON object whose ``kind`` begins so is a document of Trigpoint's own."""

DOCUMENTS: dict[str, Callable[[dict[str, Any]], object]] = dict(READERS)
"""Readers of JSON documents by their ``kind`` (such as ``trigpoint/problem``)."""

DOCUMENT_WRITERS: dict[type, Callable[[Any], str]] = dict(WRITERS)
"""Writers of objects to JSON text by exact type."""


def read_json(path: str | Path) -> object:
    """Read ``.json``: a document of Trigpoint's own (``DOCUMENTS``), else node-link data.

    Raises:
        FileFormatError: no JSON, an unknown ``kind``, or a document that its reader refuses.
    """
    text = read_text(path)
    document = parse_json(text, path)
    kind = document.get("kind") if isinstance(document, dict) else None
    if not isinstance(kind, str) or not kind.startswith(DOCUMENT_PREFIX):
        return nodelink_from_document(document, path)
    if kind not in DOCUMENTS:
        hint = nearest(kind, DOCUMENTS)
        raise FileFormatError(path, f"got the kind {shown(kind)}, expected one of {sorted(DOCUMENTS)}{hint}")
    refuse_repeated_keys(text, path)
    try:
        return DOCUMENTS[kind](document)
    except FileFormatError:
        raise
    except TrigpointError as error:
        raise FileFormatError(path, str(error)) from error


def _write_json(data: Any) -> str | bytes:
    if type(data) in DOCUMENT_WRITERS:
        return DOCUMENT_WRITERS[type(data)](data)
    write = NETWORK_FORMATS["json"].write
    assert write is not None
    return write(data)


FORMATS: dict[str, Format] = {
    **NETWORK_FORMATS,
    "json": replace(NETWORK_FORMATS["json"], read=read_json, write=_write_json),
    "npz": Format("npz", (".npz",), read_run, run_bytes, "recorded run: arrays and a header, nothing pickled"),
    "nc": Format("nc", (".nc",), read_netcdf, netcdf_bytes, "recorded run as NetCDF"),
    "zarr": Format("zarr", (".zarr",), read_zarr, zarr_bytes, "recorded run as Zarr, in one zip file"),
    "toml": Format("toml", (".toml",), read_scenario, None, "scenario: network, agent, design, simulation, run"),
}
"""Every format that ``load`` and ``save`` know, by name."""


def load(path: str | Path) -> Any:
    """Read the file at ``path`` in the format that its suffix names (any case).

    Returns:
        a ``Network``, a ``MeasurementGraph`` (no values in the file), a ``ScenarioFile``, or what a JSON document's
        reader makes of it.

    Raises:
        FileFormatError: an unknown suffix, a file that cannot be read, or content that does not fit, with its line.
    """
    return format_of(path, FORMATS).read(path)


def require_writer(path: str | Path) -> None:
    """Check that the format which the suffix of ``path`` names can be written here, before anything is computed.

    Raises:
        FileFormatError: an unknown suffix.
        MissingExtraError: the format needs an extra that is not installed.
    """
    if format_of(path, FORMATS).name in ("nc", "zarr"):
        tables()


def save(data: Any, path: str | Path) -> None:
    """Write ``data`` in the format that the suffix of ``path`` names: whole, or not at all.

    Raises:
        ArgumentError: the format cannot hold ``data``, or is only read.
        FileFormatError: an unknown suffix, or a place that cannot be written.
    """
    chosen = format_of(path, FORMATS)
    if chosen.write is None:
        writable = [suffix for known in FORMATS.values() if known.write is not None for suffix in known.suffixes]
        raise ArgumentError(f"{chosen.suffixes[0]} files are written by hand; save as one of {', '.join(writable)}")
    write_atomically(path, chosen.write(data))
