"""Edge lists: measured networks as comma- or tab-separated text.

``from,to,value[,sigma]``, one row a measurement ``value = x[to] - x[from]``; an empty ``from`` is an absolute reading
of ``to``, exact without sigma. Vectors have ``value_x,value_y[,value_z]`` with ``sigma`` (all axes alike),
``sigma_x,...`` or the upper triangle ``cov_xx,cov_xy,...``. Further columns are kept. Blanks around a field are
dropped unless it stands in quotes. Lines that begin with ``#`` are comments; those above the header are the title.
Comments that begin with ``#@`` say what a table cannot (a name with blanks stands in quotes)::

    #@ unit m
    #@ node NAME              a node, in this order, also when no row mentions it
    #@ known NAME             a known mark; its exact reading stands among the rows
    #@ position NAME X Y      its place in a picture
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.io.atomic import write_atomically
from trigpoint.io.layout import Layout, is_reserved, layout_of, network_cells
from trigpoint.io.measurements import Notes, Rows, build_network, check_text
from trigpoint.io.records import DIRECTIVE, Record, plain_columns, quote, read_records, split_lines
from trigpoint.io.text import nearest, number_text, parse_number, read_text, shown
from trigpoint.model import Network

_DIRECTIVES = {"unit": "TEXT", "node": "NAME", "known": "NAME", "position": "NAME X Y"}
_ENDS = ("from", "to")


def read_edge_list(path: str | Path) -> Network:
    """Read the edge list at ``path``; ``.tsv`` is separated by tabs, everything else by commas.

    Nodes stand in the order of first appearance. Without any sigma the covariance is None (unit weights); with sigma on
    absolute readings only, internal arcs get variance 1; exact readings have variance 0 in the array.

    Raises:
        FileFormatError: with the line, what was got, what was expected and what to do.

    Cost O(size of the file).
    """
    delimiter = "\t" if Path(path).suffix.lower() == ".tsv" else ","
    return parse_edge_list(read_text(path), path, delimiter)


def write_edge_list(network: Network, path: str | Path) -> None:
    """Write ``network`` to ``path``, for ``read_edge_list``; ``edge_list_text`` says what cannot be written."""
    delimiter = "\t" if Path(path).suffix.lower() == ".tsv" else ","
    write_atomically(path, edge_list_text(network, delimiter))


def parse_edge_list(text: str, path: object = "<text>", delimiter: str = ",") -> Network:
    """Read an edge list from ``text`` with fields between ``delimiter``; error messages call it ``path``."""
    source = _Source(path, text.removeprefix("\ufeff"), delimiter)
    layout = _checked_header(path, source.header, delimiter)
    columns, lines = source.columns()
    cells = {name: columns[name] for name in (*layout.value, *layout.spread)}
    rows = Rows(path, columns["from"], columns["to"], layout, cells, lines)
    extra = {name: column for name, column in columns.items() if name not in cells and name not in (*_ENDS, "")}
    return build_network(rows, _read_notes(path, source.notes, rows, "\n".join(source.title), extra))


def edge_list_text(network: Network, delimiter: str = ",") -> str:
    """Return the edge list of ``network`` as text, with ``delimiter`` between the fields.

    Node order and isolated nodes are kept (``#@ node`` lines, where the rows alone would give another order). A reading
    that is not exact needs a sigma: where the covariance is None, it is written as 1.

    Raises:
        ArgumentError: arcs correlated with each other, arc weights, more than three numbers an arc, an empty name, a
            text with NUL, a further column called like one of the format's own.
    """
    _check_writable(network)
    layout, cells = network_cells(network)
    graph = network.graph
    names = [quote(name, delimiter) for name in graph.names]
    tails = ["" if out else names[k] for k, out in zip(graph.tail.tolist(), graph.is_external.tolist(), strict=True)]
    heads = [names[k] for k in graph.head.tolist()]
    extra = [[quote(text, delimiter) for text in texts] for texts in network.columns.values()]
    header = [*_ENDS, *layout.value, *layout.spread, *network.columns]
    table = [tails, heads, *(cells[name] for name in (*layout.value, *layout.spread)), *extra]
    lines = [*_note_lines(network), delimiter.join(quote(name, delimiter) for name in header)]
    lines.extend(map(delimiter.join, zip(*table, strict=True)))
    return "\n".join(lines) + "\n"


# -- reading -----------------------------------------------------------------------------------------------------------
class _Source:
    """The text of one edge list, read up to its header when made and to its end by ``columns``."""

    def __init__(self, path: object, text: str, delimiter: str) -> None:
        self.path, self.delimiter = path, delimiter
        self.title: list[str] = []
        self.notes: list[Record] = []
        self._text = text
        self._records = read_records(path, text, delimiter)
        for record in self._records:
            if record.is_directive:
                self.notes.append(record)
            elif record.comment is not None:
                self.title.append(record.comment.removeprefix(" "))
            else:
                self.header = record
                return
        raise FileFormatError(path, "got no header, the first line must be from,to,value[,sigma]")

    def columns(self) -> tuple[dict[str, Sequence[str]], Sequence[int]]:
        """The cells by column, and the line of each row."""
        names = self.header.fields
        rest = split_lines(self._text)[self.header.line :]
        while rest and not rest[-1].strip():
            rest.pop()
        table: Sequence[Sequence[str]] | None = plain_columns(rest, self.delimiter, len(names))
        lines: Sequence[int] = range(self.header.line + 1, self.header.line + 1 + len(rest))
        if table is None:
            table, lines = self._columns_by_row(len(names))
        columns = dict(zip(names, table, strict=True))
        self._check_unnamed(columns, lines)
        return columns, lines

    def _columns_by_row(self, width: int) -> tuple[list[Sequence[str]], list[int]]:
        body: list[list[str]] = []
        lines: list[int] = []
        for record in self._records:
            if record.is_directive:
                self.notes.append(record)
            elif record.comment is None:
                if len(record.fields) != width:
                    raise self._wrong_length(len(record.fields), width, record.line)
                body.append(record.fields)
                lines.append(record.line)
        return (list(zip(*body, strict=True)) if body else [()] * width), lines

    def _wrong_length(self, got: int, width: int, line: int) -> FileFormatError:
        remedy = "put a field that holds the separator in quotes" if got > width else "fill the row up"
        text = f"got {got} fields, expected {width} as in the header (line {self.header.line}); {remedy}"
        return FileFormatError(self.path, text, line)

    def _check_unnamed(self, columns: dict[str, Sequence[str]], lines: Sequence[int]) -> None:
        """Spreadsheets add empty columns at the right; one with content needs a name."""
        for row, text in enumerate(columns.get("", ())):
            if text:
                header = f"name it in the header (line {self.header.line})"
                raise FileFormatError(self.path, f"got {shown(text)} in a column without a name; {header}", lines[row])


def _checked_header(path: object, header: Record, delimiter: str) -> Layout:
    names = header.fields
    named = [name for name in names if name]
    twice = next((name for k, name in enumerate(named) if name in named[:k]), None)
    if twice is not None:
        raise FileFormatError(path, f"got the column {shown(twice)} twice; rename one of them", header.line)
    for end in _ENDS:
        if end not in names:
            hint = nearest(end, names) + _separator_hint(names, delimiter)
            wanted = "the first line must be from,to,value[,sigma]" + (
                " with tabs for commas" if delimiter == "\t" else ""
            )
            raise FileFormatError(path, f"got no column {end!r} among {names}{hint}; {wanted}", header.line)
    try:
        return layout_of([name for name in named if name not in _ENDS])
    except ValueError as error:
        raise FileFormatError(path, str(error), header.line) from None


def _separator_hint(names: Sequence[str], delimiter: str) -> str:
    if len(names) == 1:
        for mark, called in ((";", "semicolons"), ("\t", "tabs"), (",", "commas")):
            if mark != delimiter and mark in names[0]:
                wanted = "tabs" if delimiter == "\t" else "commas"
                return f"; the fields seem to be separated by {called}, expected {wanted} (.csv: commas, .tsv: tabs)"
    return ""


@dataclass
class _Collected:
    nodes: dict[str, int] = field(default_factory=dict)
    known: dict[str, int | None] = field(default_factory=dict)
    positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    unit: str = ""


def _read_notes(path: object, records: list[Record], rows: Rows, title: str, extra: dict[str, Sequence[str]]) -> Notes:
    found = _Collected()
    for record in records:
        _read_directive(path, record, found)
    appearing = {*rows.tail, *rows.head, *found.nodes} if records else set()
    for record in records:
        name = record.fields[1]
        if record.fields[0] in ("known", "position") and name not in appearing:
            hint = f"{nearest(name, appearing)}; add '#@ node' if it is meant"
            raise FileFormatError(path, f"got {shown(name)}, which no row mentions{hint}", record.line)
    return Notes(list(found.nodes), found.known, found.positions, found.unit, title, extra)


def _read_directive(path: object, record: Record, found: _Collected) -> None:
    word, *rest = record.fields or [""]
    if word not in _DIRECTIVES:
        raise FileFormatError(
            path,
            f"got '#@ {word}', expected one of {', '.join(_DIRECTIVES)} after '#@'{nearest(word, _DIRECTIVES)}; "
            "an ordinary comment begins with '# '",
            record.line,
        )
    shape = _DIRECTIVES[word]
    if len(rest) != len(shape.split()):
        raise FileFormatError(
            path,
            f"got {shown(' '.join(rest))}, expected '#@ {word} {shape}'; put a text with blanks in quotes",
            record.line,
        )
    if word == "unit":
        found.unit = rest[0]
        return
    name = rest[0]
    tables: dict[str, Collection[str]] = {"node": found.nodes, "known": found.known, "position": found.positions}
    if name in tables[word]:
        raise FileFormatError(path, f"got '#@ {word}' twice for {shown(name)}; leave one out", record.line)
    if word == "node":
        found.nodes[name] = record.line
    elif word == "known":
        found.known[name] = record.line
    else:
        try:
            found.positions[name] = (parse_number(rest[1]), parse_number(rest[2]))
        except ValueError as error:
            raise FileFormatError(path, f"position of {shown(name)}: {error}", record.line) from None


# -- writing -----------------------------------------------------------------------------------------------------------
def _check_writable(network: Network) -> None:
    if network.graph.n_arcs == 0:
        raise ArgumentError("the network has no measurement; an edge list holds at least one")
    if network.graph.weight is not None:
        raise ArgumentError(
            "an edge list holds standard deviations, not arc weights; save as .json or .graphml, "
            "or leave the weights out with graph.with_weight(None)"
        )
    for name in network.graph.names:
        if not name:
            raise ArgumentError("a node has the empty name, which means the environment in an edge list; rename it")
        check_text("the name", name)
    for column, texts in network.columns.items():
        if not column or column in _ENDS or is_reserved(column):
            raise ArgumentError(f"a further column cannot be called {column!r}; rename it")
        for text in (column, *texts):
            check_text("the column text", text)
    check_text("the title", network.title)
    check_text("the unit", network.unit)


def _note_lines(network: Network) -> list[str]:
    graph = network.graph
    names = [quote(name, " ") for name in graph.names]
    lines = [
        f"# {line}".rstrip(" ") if not line else f"# {line}" for line in network.title.split("\n") if network.title
    ]
    if network.unit:
        lines.append(f"{DIRECTIVE} unit {quote(network.unit, ' ')}")
    ends = np.stack([np.where(graph.is_external, graph.head, graph.tail), graph.head], axis=1).ravel()
    first = np.unique(ends, return_index=True)
    if first[0].size != graph.n_nodes or (np.diff(first[1]) < 0).any():
        lines.extend(f"{DIRECTIVE} node {name}" for name in names)
    lines.extend(f"{DIRECTIVE} known {names[mark]}" for mark in network.known)
    if network.positions is not None:
        for name, place in zip(names, network.positions.tolist(), strict=True):
            if np.isfinite(place).all():
                lines.append(f"{DIRECTIVE} position {name} {number_text(place[0])} {number_text(place[1])}")
    return lines
