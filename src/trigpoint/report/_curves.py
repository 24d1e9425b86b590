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
    from matplotlib.figure import Figure

_SIZE = (6.8, 3.2)
_COLOURS = (_engines.BLUE, _engines.ACCENT, "#2f7d4f", "#7b4fa3", "#b58900", "#0f8b8d", "#a3354a", "#5f6b76")
_DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)))
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
) -> str:
    """Draw curves over one axis and return the SVG text; a NaN leaves a gap.

    Args:
        x: (K,) ascending places, at least two.
        lines: name and (K,) values of each curve; up to about eight can be told apart.
        x_label: what ``x`` is.
        y_label: what the values are.
        title: stands above the picture.
        log_y: logarithmic vertical axis; values that are not positive are left out.

    Raises:
        ShapeError: ``x`` and a curve are not vectors of one length.
        ArgumentError: no curve, or fewer than two places.
        MissingExtraError: matplotlib is not installed.
    """
    places = as_floats("x", x)
    curves = {str(name): np.asarray(values, dtype=float) for name, values in lines.items()}
    if not curves or places.ndim != 1 or places.size < 2:
        raise ArgumentError(f"a figure needs a curve over at least two places; got {len(curves)} over {places.shape}")
    for name, values in curves.items():
        if values.shape != places.shape:
            raise ShapeError(f"curve {name!r} has shape {values.shape}; x has {places.shape}")

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_xlabel(printable(x_label), parse_math=False)
        axes.set_ylabel(printable(y_label), parse_math=False)
        axes.set_title(printable(title), parse_math=False)
        axes.grid(visible=True, which="major")
        axes.set_axisbelow(True)
        axes.margins(x=0.01)
        for k, (name, values) in enumerate(curves.items()):
            shown = np.where(values > 0.0, values, np.nan) if log_y else values
            few = "o" if places.size <= 12 else ""
            colour, dash = _COLOURS[k % len(_COLOURS)], _DASHES[k // len(_COLOURS) % len(_DASHES)]
            axes.plot(places, shown, color=colour, ls=dash, lw=1.5, marker=few, ms=3.5, label=shortened(name, 40))
        if log_y and any((values > 0.0).any() for values in curves.values()):
            axes.set_yscale("log")
        if len(curves) > 1:
            legend = figure.legend(loc="outside right upper") if len(curves) > 4 else axes.legend(loc="best")
            for text in legend.get_texts():
                text.set_parse_math(False)

    return _engines.draw(_SIZE, title or y_label or "Curves", paint)


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
