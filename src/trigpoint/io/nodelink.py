"""Graphs with attributes, as networkx writes them: the common part of JSON node-link and GraphML, and JSON itself.

The environment is the node with the empty name. Edges carry ``value`` (or ``value_x``, ...) with ``sigma`` (or
``sigma_x``, ..., ``cov_xx``, ...) and ``weight``; nodes carry ``x``, ``y`` (a place in a picture) and ``known``; the
graph carries ``title`` and ``unit``. Further edge attributes are the network's further columns. A file without any
value is a bare ``MeasurementGraph``.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io.atomic import write_atomically
from trigpoint.io.layout import Layout, covariance_blocks, is_reserved, layout_of, network_cells
from trigpoint.io.measurements import Notes, Rows, build_network, node_indices
from trigpoint.io.text import nearest, parse_number, read_text, shown
from trigpoint.model import Network

ENVIRONMENT = ""
_NOT_COLUMNS = ("source", "target", "key", "id", "weight", "from", "to")


@dataclass(frozen=True)
class Link:
    """One edge of a file: its ends by name, its attributes, its line where the format has lines."""

    source: str
    target: str
    attributes: Mapping[str, Any]
    line: int | None = None


@dataclass(frozen=True)
class AttributedGraph:
    """What a file of nodes and edges says, before it is a network: node name -> attributes, edges in file order."""

    nodes: Mapping[str, Mapping[str, Any]]
    links: Sequence[Link]
    is_directed: bool = True
    graph: Mapping[str, Any] = field(default_factory=dict)


def read_nodelink(path: str | Path) -> Network | MeasurementGraph:
    """Read the JSON at ``path``: ``nodes``, and ``links`` or ``edges``, as ``networkx.node_link_data`` gives them.

    Raises:
        FileFormatError: no JSON (with the line), no node-link document, or an edge that does not fit (named).
    """
    return nodelink_from_document(parse_json(read_text(path), path), path)


def write_nodelink(data: Network | MeasurementGraph, path: str | Path) -> None:
    """Write ``data``, a network or graph, to ``path``; ``read_nodelink`` gives it back, whatever its covariance."""
    write_atomically(path, nodelink_text(data))


def parse_json(text: str, path: object) -> Any:
    """Read JSON from ``text`` (``path`` in messages); NaN and Infinity, which JSON does not have, are refused."""

    def refuse(word: str) -> None:
        line = next((k for k, content in enumerate(text.split("\n"), 1) if word in content), None)
        raise FileFormatError(path, f"got {word}, which is no JSON number; leave the attribute out", line)

    try:
        return json.loads(text, parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise FileFormatError(path, f"this is no JSON ({error.msg}); correct the file", error.lineno) from None
    except FileFormatError:
        raise
    except (RecursionError, ValueError) as error:
        raise FileFormatError(path, f"the JSON cannot be read ({error})") from None


def refuse_repeated_keys(text: str, path: object) -> None:
    """Refuse JSON in which an object has a key twice: readers differ in which of the two they take."""

    def once(pairs: list[tuple[str, Any]]) -> None:
        keys = [key for key, _ in pairs]
        if len(set(keys)) != len(keys):
            twice, _ = Counter(keys).most_common(1)[0]
            raise FileFormatError(path, f"has the key {twice[:40]!r} twice in one object; leave one of them out")

    try:
        json.loads(text, object_pairs_hook=once)
    except RecursionError as error:
        raise FileFormatError(path, f"the JSON cannot be read ({error})") from None


def nodelink_from_document(document: Any, path: object) -> Network | MeasurementGraph:
    """Turn a parsed JSON node-link document into a network (or a bare graph without values)."""
    return from_attributes(_parse_document(document, path), path)


def nodelink_text(data: Network | MeasurementGraph) -> str:
    """Return the JSON node-link document of ``data``, a network or graph: one node or edge a line."""
    joint = isinstance(data, Network) and sp.issparse(data.covariance) and covariance_blocks(data) is None
    graph = to_attributes(data, with_spread=not joint)
    notes = dict(graph.graph)
    if joint and isinstance(data, Network):
        entries = sp.coo_array(data.covariance)
        rows, columns = (index.tolist() for index in entries.coords)
        notes["covariance"] = {"rows": rows, "columns": columns, "entries": entries.data.tolist()}
    nodes = [{"id": name, **attributes} for name, attributes in graph.nodes.items()]
    links = [
        {"source": link.source, "target": link.target, "key": k, **link.attributes}
        for k, link in enumerate(graph.links)
    ]
    parts = [
        '"directed": true',
        '"multigraph": true',
        f'"graph": {_dump(notes)}',
        f'"nodes": [\n  {_join(nodes)}\n]',
        f'"links": [\n  {_join(links)}\n]',
    ]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _dump(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def _join(items: Sequence[Any]) -> str:
    return ",\n  ".join(map(_dump, items))


# -- common to JSON and GraphML ----------------------------------------------------------------------------------------
def from_attributes(source: AttributedGraph, path: object) -> Network | MeasurementGraph:
    """Check an attributed graph and make it a network, or a bare graph when no edge has a value."""
    columns = dict.fromkeys(name for link in source.links for name in link.attributes)
    has_values = any(is_reserved(name) for name in columns)
    names = [name for name in source.nodes if name != ENVIRONMENT]
    if not names:
        raise FileFormatError(path, "got no node, expected at least one")
    layout = Layout(())
    if has_values:
        if not source.is_directed:
            raise FileFormatError(
                path, "got values on an undirected graph, expected a directed one: value = x[target] - x[source]"
            )
        try:
            layout = layout_of([name for name in columns if is_reserved(name)])
        except ValueError as error:
            raise FileFormatError(path, str(error)) from None
    rows = _rows(source, layout, path)
    weight = _weights(source.links, rows)
    if not has_values:
        tail, head, order = node_indices(rows, names)
        return _graph(path, len(order), tail, head, weight, order)
    extra = [name for name in columns if not is_reserved(name) and name not in _NOT_COLUMNS]
    notes = _notes(source, names, path)
    texts = {name: tuple(_cell(link.attributes.get(name)) for link in source.links) for name in extra}
    network = build_network(rows, Notes(names, notes.known, notes.positions, notes.unit, notes.title, texts))
    joint = _joint_covariance(source.graph.get("covariance"), network, path)
    return network if weight is None and joint is None else _completed(network, weight, joint, path)


def to_attributes(data: Network | MeasurementGraph, with_spread: bool = True) -> AttributedGraph:
    """Return a network or graph as nodes and edges with attributes, the environment last if an arc uses it."""
    network = data if isinstance(data, Network) else None
    graph = network.graph if network is not None else data
    assert isinstance(graph, MeasurementGraph)
    if ENVIRONMENT in graph.names:
        raise ArgumentError("a node has the empty name, which means the environment in this format; rename it")
    nodes: dict[str, dict[str, Any]] = {name: {} for name in graph.names}
    attributes: list[dict[str, Any]] = [{} for _ in range(graph.n_arcs)]
    notes: dict[str, Any] = {}
    if network is not None:
        notes = {key: text for key, text in (("title", network.title), ("unit", network.unit)) if text}
        _add_measurements(network, attributes, with_spread)
        _add_node_notes(network, list(nodes.values()))
    if graph.weight is not None:
        for entry, weight in zip(attributes, graph.weight.tolist(), strict=True):
            entry["weight"] = weight
    if graph.is_external.any():
        nodes[ENVIRONMENT] = {}
    tails = graph.at_tail(np.array(graph.names, dtype=object), ENVIRONMENT)
    heads = (graph.names[k] for k in graph.head.tolist())
    links = [Link(tail, head, entry) for tail, head, entry in zip(tails, heads, attributes, strict=True)]
    return AttributedGraph(nodes, links, True, notes)


def _add_measurements(network: Network, attributes: list[dict[str, Any]], with_spread: bool) -> None:
    for column in network.columns:
        if is_reserved(column) or column in _NOT_COLUMNS or not column:
            raise ArgumentError(f"a further column cannot be called {column!r}; rename it")
    plain = network if with_spread else Network(network.graph, network.values, exact=network.exact)
    _, cells = network_cells(plain)
    for name, numbers in cells.items():
        for entry, number in zip(attributes, numbers, strict=True):
            if number:
                entry[name] = float(number)
    for name, texts in network.columns.items():
        for entry, text in zip(attributes, texts, strict=True):
            entry[name] = text


def _add_node_notes(network: Network, nodes: list[dict[str, Any]]) -> None:
    for mark in network.known:
        nodes[mark]["known"] = True
    if network.positions is not None:
        for entry, place in zip(nodes, network.positions.tolist(), strict=True):
            if np.isfinite(place).all():
                entry["x"], entry["y"] = place


def _rows(source: AttributedGraph, layout: Layout, path: object) -> Rows:
    links = source.links
    tail, head = [link.source for link in links], [link.target for link in links]
    lines = [link.line for link in links if link.line is not None]

    def label(k: int) -> str:
        return f"edge {k} ({shown(tail[k])} -> {shown(head[k])})"

    cells = {n: [_cell(link.attributes.get(n)) for link in links] for n in (*layout.value, *layout.spread)}
    rows = Rows(path, tail, head, layout, cells, lines if lines and len(lines) == len(links) else None, label)
    for k, link in enumerate(links):
        for end in (link.source, link.target):
            if end not in source.nodes:
                raise rows.fail(k, f"got the node {shown(end)}, which is not listed{nearest(end, source.nodes)}")
        if link.target == ENVIRONMENT and not layout.value and link.source != ENVIRONMENT:
            # without a value an arc to the environment says the same as one from it
            tail[k], head[k] = ENVIRONMENT, link.source
        elif link.target == ENVIRONMENT:
            raise rows.fail(k, "got an edge into the environment (node ''), expected one out of it; turn it round")
    return rows


def _cell(value: Any) -> str:
    return "" if value is None else value if isinstance(value, str) else str(value)


def _weights(links: Sequence[Link], rows: Rows) -> list[Any] | None:
    if not any("weight" in link.attributes for link in links):
        return None
    weights = []
    for k, link in enumerate(links):
        weight = link.attributes.get("weight", 1.0)
        if not isinstance(weight, list):
            try:
                weight = parse_number(_cell(weight))
            except ValueError as error:
                raise rows.fail(k, f"weight: {error}") from None
            if not weight > 0:
                raise rows.fail(k, f"got weight = {weight}, expected a positive number; leave an edge of no weight out")
        weights.append(weight)
    return weights


def _graph(
    path: object, n_nodes: int, tail: Any, head: Any, weight: list[Any] | None, names: Sequence[str]
) -> MeasurementGraph:
    try:
        return MeasurementGraph(n_nodes, tail, head, weight, names)
    except ArgumentError as error:
        raise FileFormatError(path, str(error)) from None


def _notes(source: AttributedGraph, names: list[str], path: object) -> Notes:
    known: dict[str, int | None] = {}
    positions: dict[str, tuple[float, float]] = {}
    for name in names:
        entry = source.nodes[name]
        mark = entry.get("known", False)
        if not isinstance(mark, bool):
            raise FileFormatError(path, f"node {shown(name)}: got known = {shown(mark)}, expected true or false")
        if mark:
            known[name] = None
        if "x" in entry and "y" in entry:
            try:
                positions[name] = (parse_number(_cell(entry["x"])), parse_number(_cell(entry["y"])))
            except ValueError as error:
                raise FileFormatError(path, f"node {shown(name)}: position: {error}") from None
    unit, title = _cell(source.graph.get("unit")), _cell(source.graph.get("title"))
    return Notes(names, known, positions, unit, title)


def _joint_covariance(entry: Any, network: Network, path: object) -> sp.csr_array | None:
    if entry is None:
        return None
    size = network.graph.n_arcs * network.dimension
    wanted = f"expected rows, columns and entries of a symmetric ({size}, {size}) matrix with a positive diagonal"
    try:
        index = np.array([entry["rows"], entry["columns"]], dtype=np.int64)
        data = np.array(entry["entries"], dtype=np.float64)
        joint = sp.csr_array(sp.coo_array((data, index), shape=(size, size)))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise FileFormatError(
            path, f"got a graph attribute 'covariance' that cannot be read ({error}); {wanted}"
        ) from None
    positive = joint.diagonal() > 0
    free = np.repeat(~network.exact, network.dimension)
    if not np.isfinite(joint.data).all() or not positive[free].all() or abs(joint - joint.T).max() > 0:
        raise FileFormatError(path, f"got a graph attribute 'covariance' that is no covariance; {wanted}")
    return joint


def _completed(network: Network, weight: list[Any] | None, joint: sp.csr_array | None, path: object) -> Network:
    graph = network.graph
    weighted = graph if weight is None else _graph(path, graph.n_nodes, graph.tail, graph.head, weight, graph.names)
    return Network(
        weighted,
        network.values,
        network.covariance if joint is None else joint,
        exact=network.exact,
        known=network.known,
        positions=network.positions,
        unit=network.unit,
        title=network.title,
        columns=network.columns,
    )


# -- the JSON document -------------------------------------------------------------------------------------------------
def _parse_document(document: Any, path: object) -> AttributedGraph:
    if not isinstance(document, dict):
        raise FileFormatError(path, f"got a JSON {type(document).__name__}, expected an object with nodes and links")
    links = document.get("links", document.get("edges"))
    nodes = document.get("nodes")
    if not isinstance(nodes, list) or not isinstance(links, list):
        raise FileFormatError(
            path,
            f"got an object with the keys {shown(list(document))}, expected node-link data: nodes, and links or edges",
        )
    table: dict[str, Mapping[str, Any]] = {}
    for k, node in enumerate(nodes):
        if not isinstance(node, dict) or "id" not in node:
            raise FileFormatError(path, f"node {k}: got {shown(node)}, expected an object with an id")
        name = _end(node["id"], f"node {k}: id", path)
        if name in table:
            raise FileFormatError(path, f"node {k}: got the id {shown(name)} twice; rename one of them")
        table[name] = node
    read = [_parse_link(link, k, path) for k, link in enumerate(links)]
    directed = document.get("directed", False)
    notes = document.get("graph", {})
    if not isinstance(notes, dict) or not isinstance(directed, bool):
        raise FileFormatError(path, "got 'graph' or 'directed' of a wrong type, expected an object and true or false")
    return AttributedGraph(table, read, directed, notes)


def _parse_link(link: Any, k: int, path: object) -> Link:
    if not isinstance(link, dict) or "source" not in link or "target" not in link:
        raise FileFormatError(path, f"edge {k}: got {shown(link)}, expected an object with source and target")
    rest = {
        name: value for name, value in link.items() if name not in ("source", "target", "key") and value is not None
    }
    return Link(_end(link["source"], f"edge {k}: source", path), _end(link["target"], f"edge {k}: target", path), rest)


def _end(value: Any, what: str, path: object) -> str:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise FileFormatError(path, f"{what}: got {shown(value)}, expected a name (text or number)")
    return str(value)
