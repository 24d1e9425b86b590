"""What a reproduction returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Agreement = Literal["agrees", "differs", "erratum"]


@dataclass(frozen=True)
class Cell:
    """One published number beside ours.

    Attributes:
        at: where it stands (row, column, symbol).
        paper: the printed number.
        ours: the computed number.
        error: ``ours - paper``.
        verdict: ``agrees`` to the printed digits, ``differs``, or ``erratum`` where the printed one is known wrong.
    """

    at: str
    paper: float
    ours: float
    error: float
    verdict: Agreement


@dataclass(frozen=True)
class Reproduction:
    """All numbers of one experiment.

    Attributes:
        name: name of the experiment.
        source: paper and place.
        text: what it is and what to look at.
        cells: published numbers beside ours.
    """

    name: str
    source: str
    text: str
    cells: tuple[Cell, ...]

    @property
    def agrees(self) -> bool:
        """True when no cell differs without a known erratum."""
        return all(cell.verdict != "differs" for cell in self.cells)


def cell(at: str, paper: float, ours: float, half_unit: float, *, erratum: bool = False) -> Cell:
    """Compare within half a unit of the last printed digit (and rounding); ``erratum`` marks a known misprint."""
    error = ours - paper
    close = abs(error) <= half_unit * (1.0 + 1e-9)
    return Cell(at, paper, float(ours), float(error), "agrees" if close else "erratum" if erratum else "differs")
