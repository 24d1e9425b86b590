"""Curves over a common axis, and grey pictures, as SVG text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.report import _engines
from trigpoint.report._text import printable, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE = (6.8, 3.2)
_COLOURS = (_engines.BLUE, _engines.ACCENT, "#2f7d4f", "#7b4fa3", "#b58900", "#0f8b8d", "#a3354a", "#5f6b76")
_DASHES = ("-", (0, (5, 2.5)), (0, (1, 1.8)), (0, (6, 2, 1, 2)), (0, (9, 3)))
_WIDTHS = (2.6, 1.7, 1.7, 1.5, 1.3)
_ALONE = 1.7
_MARKERS = ("o", "x", "s", "+", "^")
_FEW = 12
_INSIDE = 4
_LARGEST = 1e100  # matplotlib's ticks for more overflow
_COLUMNS = 4
_WIDTH = 6.8


def curves_figure(
    x: ArrayLike,
    lines: Mapping[str, ArrayLike],
    *,
    x_label: str = "time [s]",
    y_label: str = "",
    title: str = "",
    log_y: bool = False,
    events: Sequence[float] = (),
) -> str:
    """Draw curves over one axis and return the SVG text; what is not finite leaves a gap.

    Curves that coincide stay visible: the first is wide and whole, those over it are thinner and broken.

    Args:
        x: (K,) ascending places, K >= 1.
        lines: name and (K,) values of each curve; up to about eight can be told apart.
        x_label: what ``x`` is.
        y_label: what the values are, with their unit.
        title: stands above the picture.
        log_y: logarithmic vertical axis; values that are not positive are left out.
        events: places to mark with a vertical line.

    Raises:
        ShapeError: a curve has another length than ``x``.
        ArgumentError: no curve, no place, or places that are not finite.
        MissingExtraError: matplotlib is not installed.
    """
    places, marks = as_floats("x", x), as_floats("events", list(events))
    if not lines or places.ndim != 1 or not places.size:
        raise ArgumentError(f"a figure needs a curve over at least one place; got {len(lines)} over {places.shape}")
    curves = {str(name): _shown(str(name), places, values, log_y=log_y) for name, values in lines.items()}

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_xlabel(printable(x_label), parse_math=False)
        axes.set_ylabel(printable(y_label), parse_math=False)
        axes.set_title(printable(title), parse_math=False)
        axes.grid(visible=True, which="major")
        axes.set_axisbelow(True)
        axes.margins(x=0.01)
        known = np.concatenate([values[np.isfinite(values)] for values in curves.values()])
        if not known.size:
            axes.text(0.5, 0.5, "nothing is known", ha="center", transform=axes.transAxes)
            axes.set_yticks([])
            return
        for k, values in enumerate(curves.values()):
            _draw(axes, places, values, k, _ALONE if len(curves) == 1 else _WIDTHS[k % len(_WIDTHS)])
        for mark in marks.tolist():
            axes.axvline(mark, color=_engines.MUTED, lw=0.8, ls=":")
        if log_y:
            axes.set_yscale("log")
            _engines.plain_ticks(axes, float(known.min()), float(known.max()))
        _name(figure, axes, list(curves))

    return _engines.draw(_SIZE, title or y_label or "Curves", paint)


def _shown(name: str, places: FloatArray, line: ArrayLike, *, log_y: bool) -> FloatArray:
    values = np.array(line, dtype=np.float64)
    if values.shape != places.shape:
        raise ShapeError(f"curve {name!r} has shape {values.shape}; x has {places.shape}")
    shown = np.isfinite(values) & (np.abs(values) < _LARGEST)
    if log_y:
        shown &= values > 1.0 / _LARGEST
    return np.where(shown, values, np.nan)


def _draw(axes: Axes, places: FloatArray, values: FloatArray, k: int, width: float) -> None:
    few = places.size <= _FEW
    turn = k % len(_DASHES)
    axes.plot(
        places, values, color=_COLOURS[k % len(_COLOURS)], ls=_DASHES[turn], lw=width,
        marker=_MARKERS[turn] if few else "", ms=5.5 if turn else 4.0, mfc="none" if turn else None,
    )  # fmt: skip


def _name(figure: Figure, axes: Axes, names: list[str]) -> None:
    """A legend where there is something to tell apart; outside where it would cover the curves."""
    if len(names) == 1:
        return
    drawn, blank = axes.get_lines()[: len(names)], ["line"] * len(names)
    if len(names) > _INSIDE:
        legend = figure.legend(drawn, blank, loc="outside right upper", handlelength=3.2)
    else:
        legend = axes.legend(drawn, blank, loc="best", handlelength=3.2)
    for text, name in zip(legend.get_texts(), names, strict=True):
        text.set_parse_math(False)
        text.set_text(shortened(name, 40))


def pictures_figure(
    pictures: Sequence[tuple[str, ArrayLike]], *, low: float = 0.0, high: float = 1.0, title: str = ""
) -> str:
    """Draw grey pictures side by side, a title above each, and return the SVG text.

    Args:
        pictures: title and (rows, columns) table of each, at least one; all of one shape.
        low: value that is drawn black.
        high: value that is drawn white, above ``low``.
        title: what they show together, for readers who do not see them.

    Raises:
        ShapeError: a picture that is no table, or of another shape than the first.
        ArgumentError: no picture, or ``high`` not above ``low``.
        MissingExtraError: matplotlib is not installed.
    """
    tables: list[tuple[str, FloatArray]] = [(str(name), as_floats("pictures", table)) for name, table in pictures]
    if not tables or not low < high:
        raise ArgumentError(f"expected a picture and low < high; got {len(tables)} pictures, {low} and {high}")
    shape = tables[0][1].shape
    for name, table in tables:
        if table.ndim != 2 or table.shape != shape or not table.size:
            raise ShapeError(f"picture {name!r} has shape {table.shape}; expected a table of shape {shape}")
    columns = min(_COLUMNS, len(tables))
    rows = -(-len(tables) // columns)
    height = rows * (_WIDTH / columns * shape[0] / shape[1] + 0.3)

    def paint(figure: Figure) -> None:
        for k, (name, table) in enumerate(tables):
            axes = figure.add_subplot(rows, columns, k + 1)
            axes.imshow(table, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
            axes.set_title(shortened(name, 40), parse_math=False, fontsize=9.0, fontweight="normal")
            axes.set_xticks([])
            axes.set_yticks([])
            for spine in axes.spines.values():
                spine.set_visible(True)

    return _engines.draw((_WIDTH, height), title or "Pictures", paint)
