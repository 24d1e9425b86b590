"""What a reproduction returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from trigpoint.arrays import FloatArray

Agreement = Literal["agrees", "differs", "erratum", "not specified"]


@dataclass(frozen=True)
class Cell:
    """One published number beside ours.

    Attributes:
        at: where it stands (row, column, symbol).
        paper: the printed number; None where the paper prints none.
        ours: the computed number.
        error: ``ours - paper``; None without one.
        verdict: ``agrees`` to the printed digits, ``differs``, ``erratum`` where the printed one is known wrong, or
            ``not specified`` where the paper does not say enough to compare. Where the paper prints no number,
            ``agrees`` and ``differs`` speak of what its statements give, which ``note`` then names.
        note: why, where that needs saying.
        is_statement: the numbers are truth values, 1 for yes.
    """

    at: str
    paper: float | None
    ours: float
    error: float | None
    verdict: Agreement
    note: str = ""
    is_statement: bool = False


@dataclass(frozen=True, eq=False)
class Series:
    """Curves to draw under a ``title``.

    Attributes:
        title: what they show.
        x_label: what ``x`` is, with its unit.
        y_label: what the values are.
        x: (K,) ascending places.
        lines: name and (K,) values of each curve; NaN leaves a gap.
        log_y: logarithmic vertical axis.
        caption: a sentence below, or nothing.
    """

    title: str
    x_label: str
    y_label: str
    x: FloatArray
    lines: Mapping[str, FloatArray]
    log_y: bool = False
    caption: str = ""


@dataclass(frozen=True, eq=False)
class Field:
    """A picture under a ``title``: grey ``values`` (rows, columns), ``low`` is black and ``high`` white."""

    title: str
    values: FloatArray
    low: float
    high: float


@dataclass(frozen=True)
class Reproduction:
    """All numbers of one experiment.

    Attributes:
        name: name of the experiment.
        source: paper and place.
        text: what it is and what to look at.
        cells: published numbers beside ours.
        series: curves to draw.
        fields: pictures.
    """

    name: str
    source: str
    text: str
    cells: tuple[Cell, ...]
    series: tuple[Series, ...] = field(default=(), compare=False)
    fields: tuple[Field, ...] = field(default=(), compare=False)

    def count(self, verdict: Agreement) -> int:
        """Number of cells with that ``verdict``."""
        return sum(cell.verdict == verdict for cell in self.cells)

    @property
    def agrees(self) -> bool:
        """True when no cell differs without a known erratum."""
        return self.count("differs") == 0


def cell(at: str, paper: float, ours: float, half_unit: float, *, erratum: bool = False, note: str = "") -> Cell:
    """Compare within half a unit of the last printed digit (and rounding); ``erratum`` marks a known misprint."""
    error = ours - paper
    close = abs(error) <= half_unit * (1.0 + 1e-9)
    verdict: Agreement = "agrees" if close else "erratum" if erratum else "differs"
    return Cell(at, float(paper), float(ours), float(error), verdict, note)


def unspecified(at: str, ours: float, note: str) -> Cell:
    """A number of ours for which the paper does not say enough (``note``)."""
    return Cell(at, None, float(ours), None, "not specified", note)


def holds(at: str, claim: bool, note: str = "", *, erratum: bool = False) -> Cell:
    """A statement of the paper (1: it holds) beside what we found; ``erratum`` where it is known not to hold."""
    return replace(cell(at, 1.0, float(claim), 0.0, note=note, erratum=erratum), is_statement=True)


def expected(at: str, value: float, ours: float, tolerance: float, note: str) -> Cell:
    """A number that the paper does not print, against what its statements give (``value``), within ``tolerance``."""
    verdict: Agreement = "agrees" if abs(ours - value) <= tolerance else "differs"
    return Cell(at, None, float(ours), None, verdict, f"{note}: {value:.6g}")


def found(at: str, claim: bool, note: str) -> Cell:
    """A statement that is ours and not the paper's: why it must hold stands in ``note``."""
    return Cell(at, None, float(claim), None, "agrees" if claim else "differs", note, is_statement=True)
