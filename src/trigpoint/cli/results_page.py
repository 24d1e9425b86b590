"""The page of the reproduced experiments: paper, claim, its number, ours, verdict, picture."""

from __future__ import annotations

from collections.abc import Sequence

from trigpoint.papers import Agreement, Cell, Reproduction
from trigpoint.report import Figure, Page, Section, Table, curves_figure, pictures_figure

VERDICTS: tuple[Agreement, ...] = ("agrees", "erratum", "not specified", "differs")

_SIGNS: dict[Agreement, str] = {"agrees": "✓", "erratum": "⚠", "not specified": "·", "differs": "✗"}
_LONG = 40
_NOTHING = "\u2013"
_COLUMNS = ("claim", "paper", "ours", "verdict", "note")
_ALIGN = ("left", "right", "right", "whole", "right")
_MEANING = (
    "✓ agrees: our number is the paper's to its printed digits, or what its statements give where it prints none. "
    "⚠ erratum: the paper's number or statement is known to be wrong; ours stands beside it. "
    "· not specified: the paper does not say enough to compare; the number is ours alone. "
    "✗ differs: they should agree and do not."
)


def results_page(results: Sequence[Reproduction]) -> Page:
    """One page for all ``results``, with a summary in front where there are several."""
    sections = [_section(result) for result in results]
    if len(results) > 1:
        sections.insert(0, _summary(results))
    total = sum(len(result.cells) for result in results)
    differing = sum(result.count("differs") for result in results)
    title = "The papers' numbers beside ours" if len(results) > 1 else results[0].source
    subtitle = f"{len(results)} experiment{'s' if len(results) > 1 else ''}, {total} claims, {differing} of them differ"
    return Page(title, subtitle, tuple(sections), contents=len(results) > 1)


def shown(cell: Cell, digits: int) -> tuple[str, str, str]:
    """Paper, ours and difference as text; statements as yes or no, a dash where there is nothing."""
    if cell.is_statement:
        paper = _NOTHING if cell.paper is None else "yes" if cell.paper else "no"
        return paper, "yes" if cell.ours else "no", _NOTHING
    paper = _NOTHING if cell.paper is None else f"{cell.paper:.{digits}g}"
    error = _NOTHING if cell.error is None else f"{cell.error:.1e}"
    return paper, f"{cell.ours:.{digits}g}", error


def _summary(results: Sequence[Reproduction]) -> Section:
    rows = [
        (result.name, result.source, *(result.count(verdict) or None for verdict in VERDICTS)) for result in results
    ]
    columns = (
        "experiment",
        "paper",
        *(f"{_SIGNS[verdict]} {verdict}" for verdict in VERDICTS),
    )
    return Section("Summary", _MEANING, (Table(columns, rows, align=("whole", "left", *["right"] * 4)),))


def _section(result: Reproduction) -> Section:
    items: list[Table | Figure] = []
    if result.fields:
        first = result.fields[0]
        pictures = [(one.title, one.values) for one in result.fields]
        drawing = pictures_figure(pictures, low=first.low, high=first.high, title=result.source)
        items.append(Figure(drawing, f"Grey values from {first.low:g} (black) to {first.high:g} (white)."))
    for series in result.series:
        drawing = curves_figure(
            series.x,
            series.lines,
            x_label=series.x_label,
            y_label=series.y_label,
            title=series.title,
            log_y=series.log_y,
        )
        items.append(Figure(drawing, series.caption))
    items.append(_table(result))
    return Section(f"{result.name}: {result.source}", result.text, tuple(items))


def _table(result: Reproduction) -> Table:
    """The claims; each remark once, below, with its number beside every claim that it belongs to."""
    rows: list[tuple[object, ...]] = []
    notes = list(dict.fromkeys(cell.note for cell in result.cells if cell.note))
    for cell in result.cells:
        values = shown(cell, 6)[:2] if cell.is_statement else (cell.paper, cell.ours)
        sign = f"{_SIGNS[cell.verdict]} {cell.verdict}"
        rows.append((cell.at, *values, sign, str(notes.index(cell.note) + 1) if cell.note else ""))
    many = len(rows) > _LONG
    width = len(_COLUMNS) if notes else len(_COLUMNS) - 1
    caption = f"all {len(rows)} numbers" if many else ""
    return Table(_COLUMNS[:width], [row[:width] for row in rows], caption, _ALIGN[:width], folded=many, notes=notes)
