"""GraphML, as networkx writes and reads it; see ``nodelink`` for what the attributes mean.

Read here event by event and not through networkx, which builds a tree first: so an error has its line, the edges keep
their order, and no document type is ever expanded.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io.atomic import write_atomically
from trigpoint.io.nodelink import AttributedGraph, Link, from_attributes, to_attributes
from trigpoint.io.text import number_text, parse_number, read_bytes, shown
from trigpoint.io.xml_events import escape, parse_xml
from trigpoint.model import Network

_NUMBERS = ("int", "long", "float", "double")
_TRUTH = {"true": True, "false": False, "1": True, "0": False}


def read_graphml(path: str | Path) -> Network | MeasurementGraph:
    """Read the GraphML file at ``path``: a network where edges have values, else a bare graph.

    Raises:
        FileFormatError: with the line: not XML, a DOCTYPE, a node declared twice or not at all, a bad number, a
            hyperedge.
    """
    return parse_graphml(read_bytes(path), path)


def parse_graphml(data: bytes, path: object = "<data>") -> Network | MeasurementGraph:
    """Read ``data``, the content of a GraphML file; ``path`` is what error messages call it."""
    reader = _Reader(path)
    parse_xml(path, data, reader)
    return from_attributes(AttributedGraph(reader.nodes, reader.links, reader.is_directed, reader.graph), path)


def write_graphml(data: Network | MeasurementGraph, path: str | Path) -> None:
    """Write ``data``, a network or graph, as GraphML to ``path``; ``read_graphml`` reads it, networkx too."""
    write_atomically(path, graphml_text(data))


def graphml_text(data: Network | MeasurementGraph) -> str:
    """Return the GraphML document of ``data``, a network or graph.

    Raises:
        ArgumentError: correlated arcs, weight blocks (save as .json), an empty name, a text that XML cannot hold.
    """
    source = to_attributes(data)
    keys: dict[tuple[str, str], tuple[str, str]] = {}
    body = [f"  {line}" for line in _data_lines("graph", source.graph, keys)]
    for name, attributes in source.nodes.items():
        body.extend(_element(f'node id="{escape(name, "the name")}"', "node", attributes, keys))
    for k, link in enumerate(source.links):
        ends = f'edge source="{escape(link.source)}" target="{escape(link.target)}" id="{k}"'
        body.extend(_element(ends, "edge", link.attributes, keys))
    declared = [
        f'<key id="{key}" for="{domain}" attr.name="{escape(name, "the column")}" attr.type="{kind}"/>'
        for (domain, name), (key, kind) in keys.items()
    ]
    head = ['<?xml version="1.0" encoding="UTF-8"?>', '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">']
    return "\n".join([*head, *declared, '<graph edgedefault="directed">', *body, "</graph>", "</graphml>"]) + "\n"


def _element(
    tag: str, domain: str, attributes: Mapping[str, Any], keys: dict[tuple[str, str], tuple[str, str]]
) -> list[str]:
    lines = _data_lines(domain, attributes, keys)
    return [f"  <{tag}>", *(f"    {line}" for line in lines), f"  </{tag.split()[0]}>"] if lines else [f"  <{tag}/>"]


def _data_lines(domain: str, attributes: Mapping[str, Any], keys: dict[tuple[str, str], tuple[str, str]]) -> list[str]:
    lines = []
    for name, value in attributes.items():
        if isinstance(value, list):
            raise ArgumentError("GraphML cannot hold weight blocks; save the graph as .json")
        kind = "boolean" if isinstance(value, bool) else "double" if isinstance(value, float) else "string"
        text = str(value).lower() if kind == "boolean" else number_text(value) if kind == "double" else escape(value)
        key, _ = keys.setdefault((domain, name), (f"d{len(keys)}", kind))
        lines.append(f'<data key="{key}">{text}</data>')
    return lines


class _Reader:
    """Collects the events of one file."""

    def __init__(self, path: object) -> None:
        self.path = path
        self.nodes: dict[str, dict[str, Any]] = {}
        self.links: list[Link] = []
        self.graph: dict[str, Any] = {}
        self.is_directed = True
        self._keys: dict[str, tuple[str, str, str]] = {}
        self._defaults: dict[str, tuple[str, int]] = {}
        self._target: list[tuple[str, dict[str, Any]]] = []
        self._open: list[tuple[str, Mapping[str, str], int]] = []

    def start(self, name: str, attributes: Mapping[str, str], line: int) -> None:
        """An element opens."""
        if not self._open and name != "graphml":
            raise FileFormatError(self.path, f"got the document <{name}>, expected <graphml>", line)
        if name in ("hyperedge", "port"):
            raise FileFormatError(self.path, f"got <{name}>, expected nodes and edges between two nodes only", line)
        self._open.append((name, attributes, line))
        if name == "key":
            kind = attributes.get("attr.type", "string")
            label = attributes.get("attr.name", attributes.get("id", ""))
            self._keys[attributes.get("id", "")] = (attributes.get("for", "all"), label, kind)
        elif name == "graph":
            if self._target:
                raise FileFormatError(self.path, "got a graph inside a graph, expected one graph", line)
            self.is_directed = attributes.get("edgedefault", "directed") != "undirected"
            self._target.append(("graph", self.graph))
        elif name == "node":
            self._start_node(attributes, line)
        elif name == "edge":
            self._start_edge(attributes, line)

    def end(self, name: str, text: str) -> None:
        """An element closes."""
        _, attributes, line = self._open.pop()
        if name in ("node", "edge"):
            self._target.pop()
        elif name == "default" and self._open[-1][0] == "key":
            self._defaults[self._open[-1][1].get("id", "")] = (text, line)
        elif name == "data" and self._target:
            key = attributes.get("key", "")
            if key not in self._keys:
                raise FileFormatError(self.path, f"got data for the key {shown(key)}, which no <key> declares", line)
            self._target[-1][1][self._keys[key][1]] = self._typed(key, text, line)

    def _start_node(self, attributes: Mapping[str, str], line: int) -> None:
        name = attributes.get("id")
        if name is None:
            raise FileFormatError(self.path, "got a node without id='...'; name it", line)
        if name in self.nodes:
            raise FileFormatError(self.path, f"got the node {shown(name)} twice; rename one of them", line)
        self.nodes[name] = self._with_defaults("node")
        self._target.append(("node", self.nodes[name]))

    def _start_edge(self, attributes: Mapping[str, str], line: int) -> None:
        for end in ("source", "target"):
            if end not in attributes:
                raise FileFormatError(self.path, f"got an edge without {end}='...'; name the node", line)
        if "directed" in attributes and (attributes["directed"] == "true") != self.is_directed:
            raise FileFormatError(self.path, "got directed and undirected edges in one graph; expected one kind", line)
        entry = self._with_defaults("edge")
        self.links.append(Link(attributes["source"], attributes["target"], entry, line))
        self._target.append(("edge", entry))

    def _with_defaults(self, domain: str) -> dict[str, Any]:
        found = {}
        for key, (text, line) in self._defaults.items():
            where, label, _ = self._keys[key]
            if where in (domain, "all"):
                found[label] = self._typed(key, text, line)
        return found

    def _typed(self, key: str, text: str, line: int) -> Any:
        _, label, kind = self._keys[key]
        if kind == "boolean":
            if text.strip().lower() not in _TRUTH:
                raise FileFormatError(self.path, f"{label}: got {shown(text)}, expected true or false", line)
            return _TRUTH[text.strip().lower()]
        if kind in _NUMBERS:
            try:
                return parse_number(text)
            except ValueError as error:
                raise FileFormatError(self.path, f"{label}: {error}", line) from None
        return text
