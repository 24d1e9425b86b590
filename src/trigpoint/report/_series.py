"""Quantities over time as SVG text: a line each, and vertical marks for what happened."""

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

_SIZE = (6.8, 2.8)
_COLOURS = (_engines.BLUE, _engines.ACCENT, "#3f7d4e", "#7a4e9e", "#8a6d1d", "#5f6b76")
_LARGEST = 1e100  # matplotlib's ticks for more overflow


def series_figure(
    times: ArrayLike, lines: Mapping[str, ArrayLike], *, label: str, events: Sequence[float] = (), decades: bool = False
) -> str:
    """Draw quantities over time and return the SVG text.

    Args:
        times: (T,) seconds, T >= 1.
        lines: (T,) values of each quantity, by its name; NaN leaves a gap.
        label: what the values are, with their unit.
        events: instants to mark with a vertical line.
        decades: a logarithmic axis; values that are not positive leave a gap then.

    Raises:
        ShapeError: a line has another length than ``times``.
        ArgumentError: no sample, no line, or times that are not finite.
        MissingExtraError: matplotlib is not installed.
    """
    t, instants = as_floats("times", times), as_floats("events", list(events))
    if t.ndim != 1 or not t.size or not lines:
        raise ArgumentError("a figure over time needs at least one sample and one line")
    values = {name: _checked(name, t, line, decades=decades) for name, line in lines.items()}

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_xlabel("time [s]")
        axes.set_ylabel(printable(label), parse_math=False)
        axes.grid(visible=True, which="major")
        axes.set_axisbelow(True)
        if not any(np.isfinite(line).any() for line in values.values()):
            axes.text(0.5, 0.5, "nothing is known", ha="center", transform=axes.transAxes)
            axes.set_yticks([])
            return
        if decades:
            axes.set_yscale("log")
        for k, line in enumerate(values.values()):
            axes.plot(t, line, color=_COLOURS[k % len(_COLOURS)], lw=1.4, ls="-" if k < len(_COLOURS) else "--")
        for instant in instants:
            axes.axvline(float(instant), color=_engines.MUTED, lw=0.8, ls=":")
        _name(axes, list(values))

    return _engines.draw(_SIZE, f"{label} over time", paint)


def _checked(name: str, t: FloatArray, line: ArrayLike, *, decades: bool) -> FloatArray:
    values = np.array(line, dtype=np.float64)
    if values.shape != t.shape:
        raise ShapeError(f"the line {name!r} has the shape {values.shape}; times has {t.shape}")
    shown = np.isfinite(values) & (np.abs(values) < _LARGEST)
    if decades:
        shown &= values > 1.0 / _LARGEST
    return np.where(shown, values, np.nan)


def _name(axes: Axes, names: list[str]) -> None:
    if len(names) == 1:
        return
    drawn = axes.get_lines()[: len(names)]
    legend = axes.legend(drawn, ["line"] * len(names), loc="upper left", bbox_to_anchor=(1.0, 1.0))
    for text, name in zip(legend.get_texts(), names, strict=True):
        text.set_parse_math(False)
        text.set_text(shortened(name, 24))
