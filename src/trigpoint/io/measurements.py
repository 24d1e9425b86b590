"""From a table of texts to a measured network and back: the rules that the edge list, JSON and GraphML share."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from trigpoint.arrays import BoolArray, FloatArray, IntArray
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.io.layout import Layout
from trigpoint.io.text import parse_column, shown
from trigpoint.model import Network


@dataclass(frozen=True)
class Rows:
    """Measurements as texts, one entry a row; ``""`` as tail is the environment, ``""`` as cell is nothing given.

    ``lines`` holds the line of each row, or is None where the format has none (then ``label`` names the row).
    """

    path: object
    tail: Sequence[str]
    head: Sequence[str]
    layout: Layout
    cells: Mapping[str, Sequence[str]]
    lines: Sequence[int] | None = None
    label: Callable[[int], str] = "row {}".format

    def fail(self, row: int, text: str) -> FileFormatError:
        """The error for one row: with its line, or with its name in the text."""
        if self.lines is not None:
            return FileFormatError(self.path, text, self.lines[row])
        return FileFormatError(self.path, f"{self.label(row)}: {text}")


@dataclass(frozen=True)
class Notes:
    """What a file says beside the measurements: further nodes, places, known marks (with the line that says so)."""

    nodes: Sequence[str] = ()
    known: Mapping[str, int | None] = field(default_factory=dict)
    positions: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    unit: str = ""
    title: str = ""
    columns: Mapping[str, Sequence[str]] = field(default_factory=dict)


def build_network(rows: Rows, notes: Notes) -> Network:
    """Check every row and assemble the network; nodes in the order of ``notes.nodes``, then of first appearance.

    Raises:
        FileFormatError: no row, an empty head, a self-loop, a bad number, sigma not positive, a mixture of internal
            rows with and without sigma, a covariance that is not positive definite, exact readings that disagree.
    """
    if not len(rows.head):
        raise FileFormatError(rows.path, "got no measurement, expected at least one row below the header")
    tail, head, names = node_indices(rows, notes.nodes)
    external = tail == EXTERNAL
    values = np.stack([parse_column(name, rows.cells[name], rows.fail) for name in rows.layout.value], axis=1)
    covariance, given = _covariance(rows, external)
    exact = external & ~given
    _check_exact_readings(rows, head, values, exact)
    index = {name: k for k, name in enumerate(names)}
    known = _known(rows, notes, index, head[external], head[exact])
    try:
        return Network(
            MeasurementGraph(len(names), tail, head, None, names),
            values[:, 0] if rows.layout.is_scalar else values,
            covariance,
            exact=exact,
            known=known,
            positions=place_table(notes.positions, index),
            unit=notes.unit,
            title=notes.title,
            columns=notes.columns,
        )
    except ArgumentError as error:  # pragma: no cover - every case known is named with its line above
        raise FileFormatError(rows.path, str(error)) from error


def node_indices(rows: Rows, declared: Sequence[str]) -> tuple[IntArray, IntArray, list[str]]:
    """Tail and head (M,) as node indices, and the names: those declared, then the others as they appear."""
    order = dict.fromkeys(chain(declared, chain.from_iterable(zip(rows.tail, rows.head, strict=True))))
    order.pop("", None)
    index = {name: k for k, name in enumerate(order)}
    index[""] = EXTERNAL
    count = len(rows.head)
    tail = np.fromiter(map(index.__getitem__, rows.tail), dtype=np.int64, count=count)
    head = np.fromiter(map(index.__getitem__, rows.head), dtype=np.int64, count=count)
    empty = np.flatnonzero(head == EXTERNAL)
    if empty.size:
        raise rows.fail(
            int(empty[0]),
            "got an empty 'to', expected the name of the measured node; only 'from' may be empty (an absolute reading)",
        )
    loops = np.flatnonzero(tail == head)
    if loops.size:
        row = int(loops[0])
        raise rows.fail(
            row,
            f"got a self-loop from {shown(rows.head[row])} to itself, which measures nothing; "
            "leave 'from' empty for an absolute reading",
        )
    return tail, head, list(order)


def place_table(positions: Mapping[str, tuple[float, float]], index: Mapping[str, int]) -> FloatArray | None:
    """Positions (N, 2), NaN where none is given; None without any."""
    if not positions:
        return None
    n_nodes = sum(name != "" for name in index)
    table = np.full((n_nodes, 2), np.nan)
    for name, place in positions.items():
        table[index[name]] = place
    return table


def _covariance(rows: Rows, external: BoolArray) -> tuple[FloatArray | None, BoolArray]:
    """Variances (M,) or blocks (M, d, d), and which rows gave one; None when no row did."""
    count, size = len(rows.head), len(rows.layout.value)
    spread = rows.layout.spread
    if not spread:
        return None, np.zeros(count, dtype=np.bool_)
    given = _rows_with_spread(rows, spread)
    inner_given, inner_missing = np.flatnonzero(~external & given), np.flatnonzero(~external & ~given)
    if inner_given.size and inner_missing.size:
        row = int(inner_missing[0])
        other = int(inner_given[0])
        where = f"line {rows.lines[other]}" if rows.lines is not None else rows.label(other)
        raise rows.fail(
            row,
            f"got no {spread[0]} on this internal row, but {where} has one; "
            f"give every internal row a {spread[0]}, or none of them",
        )
    if not given.any():
        return None, given
    chosen = np.flatnonzero(given)
    blocks = np.zeros((count, size, size))
    blocks[chosen] = _spread_blocks(rows, chosen)
    blocks[~external & ~given] = np.eye(size)
    return (blocks[:, 0, 0] if rows.layout.is_scalar else blocks), given


def _rows_with_spread(rows: Rows, spread: Sequence[str]) -> BoolArray:
    count = len(rows.head)
    present = np.array([np.fromiter(map(bool, rows.cells[name]), dtype=np.bool_, count=count) for name in spread])
    partial = np.flatnonzero(present.any(axis=0) & ~present.all(axis=0))
    if partial.size:
        row = int(partial[0])
        missing = [name for name, cells in zip(spread, present, strict=True) if not cells[row]]
        raise rows.fail(row, f"got only some of {', '.join(spread)}; {', '.join(missing)} is missing: give all or none")
    return np.asarray(present.all(axis=0), dtype=np.bool_)


def _spread_blocks(rows: Rows, chosen: IntArray) -> FloatArray:
    """Covariance blocks (len(chosen), d, d) of the rows that give one, checked to be positive definite."""

    def fail(position: int, text: str) -> FileFormatError:
        return rows.fail(int(chosen[position]), text)

    layout, size = rows.layout, len(rows.layout.value)
    everything = chosen.shape[0] == len(rows.head)
    table = {}
    for name in layout.spread:
        cells = rows.cells[name]
        table[name] = parse_column(name, cells if everything else [cells[k] for k in chosen.tolist()], fail)
    blocks = np.zeros((chosen.shape[0], size, size))
    if layout.cov:
        for name, (a, b) in zip(layout.cov, zip(*np.triu_indices(size), strict=True), strict=True):
            blocks[:, a, b] = blocks[:, b, a] = table[name]
        bad = np.flatnonzero(np.linalg.eigvalsh(blocks)[:, 0] <= 0)
        if bad.size:
            raise fail(
                int(bad[0]),
                f"got the covariance {blocks[bad[0]].tolist()}, which is not positive definite; "
                "check the order of the columns (upper triangle, row by row)",
            )
        return blocks
    for axis, name in enumerate(layout.sigma * (size if len(layout.sigma) == 1 else 1)):
        sigma = table[name]
        bad = np.flatnonzero(sigma <= 0)
        if bad.size:
            raise fail(
                int(bad[0]),
                f"got {name} = {sigma[bad[0]]}, expected a positive standard deviation; "
                "leave it empty where an absolute reading is exact",
            )
        with np.errstate(over="ignore", under="ignore"):
            variance = sigma * sigma
        bad = np.flatnonzero((variance <= 0) | ~np.isfinite(variance))
        if bad.size:
            raise fail(int(bad[0]), f"got {name} = {sigma[bad[0]]}, whose square is no number; choose another unit")
        blocks[:, axis, axis] = variance
    return blocks


def _check_exact_readings(rows: Rows, head: IntArray, values: FloatArray, exact: BoolArray) -> None:
    first: dict[int, int] = {}
    for row in np.flatnonzero(exact).tolist():
        other = first.setdefault(int(head[row]), row)
        if other != row and not np.array_equal(values[row], values[other]):
            raise rows.fail(
                row,
                f"got a second exact reading of {shown(rows.head[row])}, {_plain(values[row])}, which contradicts "
                f"{_plain(values[other])}; give one of them a sigma, or leave one out",
            )


def _known(
    rows: Rows, notes: Notes, index: Mapping[str, int], readings: IntArray, exact_readings: IntArray
) -> list[int]:
    marks = []
    for name, line in notes.known.items():
        node = index[name]
        count, exact = int((readings == node).sum()), int((exact_readings == node).sum())
        if count != 1 or exact != 1:
            raise FileFormatError(
                rows.path,
                f"the known mark {shown(name)} must have exactly one absolute reading, without sigma; "
                f"got {count}, {exact} of them exact",
                line,
            )
        marks.append(node)
    return marks


def _plain(values: FloatArray) -> str:
    return str(float(values[0])) if values.shape[0] == 1 else str(values.tolist())


def check_text(what: str, text: str, forbidden: Collection[str] = ("\0",)) -> None:
    """Refuse text that the format cannot hold: NUL, lone surrogates and what ``forbidden`` lists."""
    bad = next((mark for mark in forbidden if mark in text), None)
    if bad is None:
        bad = next((mark for mark in text if "\ud800" <= mark <= "\udfff"), None)
    if bad is not None:
        raise ArgumentError(f"{what} {shown(text)} holds {bad!r}, which the file cannot hold; rename it")
