"""The error over time as SVG text, beside the straight line of its certified rate."""

from __future__ import annotations

from collections.abc import Sequence
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

_SIZE = (6.8, 3.6)
_DECADES = 200.0  # shown from 1e-200 to 1e200: matplotlib's ticks for more overflow


def error_figure(
    times: ArrayLike,
    error_norm: ArrayLike,
    rate: float | None = None,
    rate_label: str = "certified rate",
    unit: str = "",
    marks: Sequence[tuple[float, float, str]] = (),
) -> str:
    """Draw the error norm over time on a logarithmic axis and return the SVG text.

    Args:
        times: (T,) seconds, T >= 1.
        error_norm: (T,) norms, not negative; zeros have no place on a logarithmic axis and are left out.
        rate: 1/s; the straight line ``e(t_0) exp(-rate (t - t_0))`` from the first sample that is not zero.
        rate_label: what the straight line is.
        unit: unit of the norm.
        marks: points (time, level, label) to point out, such as the time to 1 %.

    Raises:
        ShapeError: ``times`` and ``error_norm`` are not vectors of one equal length.
        ArgumentError: no sample, a number that is not finite, a negative norm, a mark at a level that is not positive.
        MissingExtraError: matplotlib is not installed.
    """
    t, norm = _checked_samples(times, error_norm)
    slope = None if rate is None else _checked_rate(rate)
    points = [(float(a), float(b), str(c)) for a, b, c in marks]
    _check_marks(points)
    keep = norm > 0.0
    t, norm = t[keep], norm[keep]

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_xlabel("time [s]")
        axes.set_ylabel(printable(f"error norm [{unit}]" if unit else "error norm"), parse_math=False)
        if not t.size:
            axes.text(0.5, 0.5, "the error is zero at every sample", ha="center", transform=axes.transAxes)
            axes.set_yticks([])
            return
        _draw_error(axes, t, norm)
        if slope is not None:
            _draw_rate(axes, t, norm, slope)
        _draw_marks(axes, points, float(t[0] + 0.35 * (t[-1] - t[0])))
        _error_range(axes, norm, points)
        if slope is not None:
            names = ["error", f"{rate_label}, {slope:.4g} 1/s"]
            for text, name in zip(axes.legend(loc="upper right").get_texts(), names, strict=True):
                text.set_parse_math(False)
                text.set_text(printable(name))

    return _engines.draw(_SIZE, "Error norm over time, logarithmic scale", paint)


def _checked_samples(times: ArrayLike, error_norm: ArrayLike) -> tuple[FloatArray, FloatArray]:
    t, norm = as_floats("times", times), as_floats("error_norm", error_norm)
    if t.ndim != 1 or t.shape != norm.shape:
        raise ShapeError(f"times {t.shape} and error_norm {norm.shape} must be vectors of one equal length")
    if not t.size:
        raise ArgumentError("times is empty: an error figure needs at least one sample")
    if (norm < 0.0).any():
        k = int(np.argmax(norm < 0.0))
        raise ArgumentError(f"error_norm[{k}] = {norm[k]} is negative; pass Euclidean norms, such as run.error_norm")
    return t, norm


def _checked_rate(rate: float) -> float:
    number = as_floats("rate", rate)
    if number.ndim:
        raise ArgumentError(f"rate must be one number, 1/s; got an array of shape {number.shape}")
    return float(number)


def _check_marks(points: list[tuple[float, float, str]]) -> None:
    for time, level, label in points:
        if not (np.isfinite(time) and np.isfinite(level) and level > 0.0):
            raise ArgumentError(
                f"mark {label!r} at ({time}, {level}) has no place on a logarithmic axis: "
                "its time must be finite, its level positive"
            )


def _draw_error(axes: Axes, t: FloatArray, norm: FloatArray) -> None:
    axes.set_autoscaley_on(False)  # the range is set at the end; automatic room overflows for extreme norms
    axes.set_yscale("log")
    axes.grid(visible=True, which="major")
    axes.set_axisbelow(True)
    few = t.shape[0] <= 30
    axes.plot(t, norm, color=_engines.BLUE, lw=1.8, marker="o" if few else "", ms=3.5, zorder=4, label="error")


def _draw_rate(axes: Axes, t: FloatArray, norm: FloatArray, rate: float) -> None:
    """Draw the straight line from the first sample to the last, cut short where it is far outside the picture."""
    levels = np.log(norm)
    fall, span = rate * float(t[-1] - t[0]), float(t[-1] - t[0])
    room = levels[0] - max(float(levels.min()) - 7.0, -740.0) if fall > 0.0 else float(levels.max()) + 7.0 - levels[0]
    share = min(1.0, room / abs(fall)) if fall else 1.0
    ends = np.exp([levels[0], min(levels[0] - share * fall, 709.0)])
    line = [float(t[0]), float(t[0]) + share * span]
    axes.plot(line, ends, color=_engines.ACCENT, lw=1.4, ls=(0, (5, 3)), zorder=5, label="rate")


def _draw_marks(axes: Axes, points: list[tuple[float, float, str]], early: float) -> None:
    """Point marks out; the text stands below a falling curve, above it where there is no room to the left."""
    for time, level, label in points:
        axes.plot([time], [level], "D", color="white", mec=_engines.INK, mew=1.2, ms=5.5, zorder=6, label="_nolegend_")
        axes.annotate(
            shortened(label, 60),
            (time, level),
            xytext=(7, 6) if time < early else (-7, -6),
            ha="left" if time < early else "right",
            va="bottom" if time < early else "top",
            textcoords="offset points",
            fontsize=8.5,
            zorder=7,
            parse_math=False,
            bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )


def _error_range(axes: Axes, norm: FloatArray, points: list[tuple[float, float, str]]) -> None:
    """Show the error, at least a decade of it; the straight line may leave below."""
    levels = np.log10(np.concatenate([norm, [level for _, level, _ in points]]))
    low, high = float(levels.min()), float(levels.max())
    room = max(0.05 * (high - low), 0.5 * (1.0 - (high - low)), 0.1)
    low = float(np.clip(low - room, -_DECADES, _DECADES - 1.0))
    high = float(np.clip(high + room, low + 1.0, _DECADES))
    axes.set_ylim(10.0**low, 10.0**high)
    _engines.plain_ticks(axes, 10.0**low, 10.0**high)
    axes.margins(x=0.02)
