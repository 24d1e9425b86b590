"""The network formats: one frozen ``Format`` each, found by suffix."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io.edge_list import edge_list_text, read_edge_list
from trigpoint.io.gama import parse_gama, read_gama
from trigpoint.io.gama_writer import gama_text
from trigpoint.io.graphml import graphml_text, parse_graphml, read_graphml
from trigpoint.io.nodelink import nodelink_text, read_nodelink
from trigpoint.io.text import read_bytes
from trigpoint.io.xml_events import root_name
from trigpoint.model import Network


@dataclass(frozen=True)
class Format:
    """One file format.

    Args:
        name: its key in ``FORMATS``.
        suffixes: of file names, lower case, with the dot; the first is the usual one.
        read: file to object; raises ``FileFormatError``.
        write: object to the file's text (or bytes), written by ``save``; None where Trigpoint only reads. Raises
            ``ArgumentError`` for an object that the format cannot hold.
        text: one line about it.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[str | Path], Any]
    write: Callable[[Any], str | bytes] | None
    text: str


def read_xml(path: str | Path) -> Network | MeasurementGraph:
    """Read ``.xml``: GraphML or GNU Gama, as its outermost element says."""
    data = read_bytes(path)
    return parse_graphml(data, path) if root_name(path, data) == "graphml" else parse_gama(data, path)


def format_of(path: str | Path, formats: Mapping[str, Format]) -> Format:
    """The format of a file name; an unknown suffix is a ``FileFormatError`` that lists the known ones."""
    suffix = Path(path).suffix.lower()
    for candidate in formats.values():
        if suffix in candidate.suffixes:
            return candidate
    if suffix == ".mcap":
        raise FileFormatError(
            path,
            "is the log of a live run: read it by trigpoint.runtime.read_run (or read_log), or write it as a recorded "
            "run by 'trigpoint convert run.mcap run.npz'",
        )
    if os.path.isdir(path):
        raise FileFormatError(path, "is a folder, expected a file")
    known = [name for candidate in formats.values() for name in candidate.suffixes]
    close = difflib.get_close_matches(suffix, known, n=1, cutoff=0.7)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    got = f"the suffix {suffix!r}" if suffix else "a file name without a suffix"
    raise FileFormatError(path, f"got {got}, expected one of {', '.join(known)}{hint}")


def _measured(write: Callable[[Network], str]) -> Callable[[Any], str]:
    def checked(data: Any) -> str:
        if isinstance(data, MeasurementGraph):
            raise ArgumentError("a graph without measured values can be saved as .json or .graphml only")
        return write(_of_type(data, Network))

    return checked


def _attributed(write: Callable[[Network | MeasurementGraph], str]) -> Callable[[Any], str]:
    def checked(data: Any) -> str:
        return write(data if isinstance(data, MeasurementGraph) else _of_type(data, Network))

    return checked


def _of_type(data: Any, wanted: type[Network]) -> Network:
    if not isinstance(data, wanted):
        raise ArgumentError(f"this format holds a Network or a MeasurementGraph; got a {type(data).__name__}")
    return data


NETWORK_FORMATS: dict[str, Format] = {
    "csv": Format("csv", (".csv",), read_edge_list, _measured(edge_list_text), "edge list separated by commas"),
    "tsv": Format(
        "tsv",
        (".tsv",),
        read_edge_list,
        _measured(lambda data: edge_list_text(data, "\t")),
        "edge list separated by tabs",
    ),
    "gkf": Format("gkf", (".gkf",), read_gama, _measured(gama_text), "height network of GNU Gama"),
    "xml": Format("xml", (".xml",), read_xml, _measured(gama_text), "GNU Gama or GraphML, as the content says"),
    "graphml": Format(
        "graphml", (".graphml",), read_graphml, _attributed(graphml_text), "graph with attributes as XML"
    ),
    "json": Format("json", (".json",), read_nodelink, _attributed(nodelink_text), "graph with attributes as JSON"),
}
"""Formats that hold a network or a graph, by name."""
