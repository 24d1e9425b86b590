"""Pictures of a run as SVG text: how well the topology is connected, and where the agents were and were believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import BoolArray, FloatArray, as_floats, as_indices
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.report import _engines
from trigpoint.report._text import printable, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from trigpoint.observers.run import Run

COLOURS = ("#1d5f9e", "#c2410c", "#2f7d4f", "#7a4fa3", "#8a6d1b", "#0f7b8a", "#a8325e", "#4a5560")
"""One a node, in turn; told apart on paper and with the usual kinds of colour blindness."""

_SHOWN = 24


def connectivity_figure(
    times: ArrayLike, lambda_min: ArrayLike | Mapping[str, ArrayLike], gain: float | None = None
) -> str:
    """Draw ``1 / lambda_min(t)``, the gain that the topology needs, beside the ``gain`` in force; return SVG text.

    Args:
        times: (T,) seconds.
        lambda_min: (T,) smallest eigenvalues (``run.lambda_min``), or several by name; zero where some node has no path
            to an anchor: no gain helps there, and the time is shaded.
        gain: the coupling gain; a dashed line.

    Raises:
        ShapeError: a series that does not fit the times.
        ArgumentError: no sample, a negative or non-finite eigenvalue, a gain that is not positive.
        MissingExtraError: matplotlib is not installed.
    """
    t = as_floats("times", times)
    given = lambda_min if isinstance(lambda_min, Mapping) else {"": lambda_min}
    several = {str(name): as_floats(f"lambda_min {name}".strip(), values) for name, values in given.items()}
    if t.ndim != 1 or not t.size or not several:
        raise ArgumentError("a connectivity figure needs at least one time and one series of lambda_min")
    for name, values in several.items():
        if values.shape != t.shape:
            raise ShapeError(f"lambda_min {name} {values.shape} and times {t.shape} must be vectors of one length")
        if (values < 0.0).any():
            raise ArgumentError(f"lambda_min {name} is negative at time {t[values < 0.0][0]:g}: pass run.lambda_min")
    if gain is not None and not gain > 0.0:
        raise ArgumentError(f"gain must be positive; got {gain}")

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_xlabel("time [s]")
        axes.set_ylabel(r"$1/\lambda_{\min}$, the gain needed")
        axes.set_yscale("log")
        axes.grid(visible=True, which="major")
        axes.set_axisbelow(True)
        for k, (name, values) in enumerate(several.items()):
            _needed(axes, t, values, COLOURS[k % len(COLOURS)], name)
        if gain is not None:
            axes.axhline(gain, color=_engines.ACCENT, lw=1.4, ls=(0, (5, 3)), label=f"gain in force, {gain:.4g}")
        axes.margins(x=0.0, y=0.1)
        _plain_ticks(axes, several, gain)
        if gain is not None or any(several):
            beside = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": 4, "borderaxespad": 0.2}
            for text in axes.legend(**beside).get_texts():
                text.set_parse_math(False)

    return _engines.draw((6.8, 3.2), "Gain needed over time, logarithmic scale", paint)


def _needed(axes: Axes, t: FloatArray, values: FloatArray, colour: str, name: str) -> None:
    known = values > 0.0
    needed = np.full(values.shape, np.nan)
    needed[known] = 1.0 / values[known]
    label = printable(name) if name else "gain needed"
    axes.plot(t, needed, color=colour, lw=1.6, label=label, marker="o" if t.size <= 30 else "", ms=3.0)
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    for first, last in _stretches(~known):
        axes.axvspan(edges[first], edges[last + 1], color=_engines.GRID, lw=0, zorder=0)


def _stretches(where: BoolArray) -> list[tuple[int, int]]:
    """(first, last) of every unbroken stretch of True."""
    steps = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in steps.reshape(-1, 2)]


def _plain_ticks(axes: Axes, several: Mapping[str, FloatArray], gain: float | None) -> None:
    """The vertical axis over what is drawn; without numbers where nothing is."""
    sizes = [1.0 / values[values > 0.0] for values in several.values()]
    levels = np.concatenate([*sizes, [] if gain is None else [gain]])
    if not levels.size:
        axes.set_yticks([])
        return
    _engines.plain_ticks(axes, float(levels.min()), float(levels.max()))


def trajectory_figure(
    run: Run, axes: Sequence[int] | None = None, nodes: ArrayLike | None = None, unit: str = ""
) -> str:
    """Draw where the nodes were (lines) and where they believed to be (dotted); return SVG text.

    Args:
        run: what ``simulate`` or a live run recorded.
        axes: two states that are a place in a plane: a map is drawn; or one: it is drawn over time. The first two of
            four or more, else the first, unless given.
        nodes: which nodes; the first 24 unless given.
        unit: unit of these states.

    A map begins at open circles and ends at full ones.

    Raises:
        ArgumentError: axes or nodes that the run does not have.
        MissingExtraError: matplotlib is not installed.
    """
    chosen = plane_of(run) if axes is None else tuple(int(axis) for axis in axes)
    if len(chosen) not in (1, 2) or not all(0 <= axis < run.truth.shape[2] for axis in chosen):
        raise ArgumentError(f"axes must be one or two of the {run.truth.shape[2]} states; got {chosen}")
    count = len(run.names)
    picked = np.arange(min(count, _SHOWN)) if nodes is None else as_indices("nodes", nodes, 0, count)
    if not picked.size or not run.times.size:
        raise ArgumentError("a trajectory figure needs at least one node and one sample")
    bracket = f" [{unit}]" if unit else ""

    def paint(figure: Figure) -> None:
        panel = figure.add_subplot()
        if len(chosen) == 2:
            panel.set_aspect("equal", adjustable="datalim")
        labels = ("time [s]", f"state {chosen[0]}{bracket}")
        if len(chosen) == 2:
            labels = (f"state {chosen[0]}{bracket}", f"state {chosen[1]}{bracket}")
        panel.set_xlabel(printable(labels[0]), parse_math=False)
        panel.set_ylabel(printable(labels[1]), parse_math=False)
        panel.grid(visible=True)
        panel.set_axisbelow(True)
        for k, node in enumerate(picked.tolist()):
            _draw_path(panel, run, node, chosen, COLOURS[k % len(COLOURS)])
        _draw_key(panel, run, picked.tolist())

    what = "Paths of the nodes and of their estimates" if len(chosen) == 2 else "States and their estimates over time"
    return _engines.draw((6.8, 5.4 if len(chosen) == 2 else 3.6), what, paint)


def plane_of(run: Run) -> tuple[int, ...]:
    """The states that are drawn unless somebody says otherwise: (0, 1) of four or more states, else (0,)."""
    return (0, 1) if run.truth.shape[2] >= 4 else (0,)


def _draw_path(panel: Axes, run: Run, node: int, chosen: tuple[int, ...], colour: str) -> None:
    truth, estimate = run.truth[:, node, list(chosen)], run.estimate[:, node, list(chosen)]
    if len(chosen) == 1:
        panel.plot(run.times, truth[:, 0], color=colour, lw=1.5, zorder=3)
        panel.plot(run.times, estimate[:, 0], color=colour, lw=1.3, ls=(0, (1, 1.6)), zorder=4)
        return
    panel.plot(*truth.T, color=colour, lw=1.5, zorder=3)
    panel.plot(*estimate.T, color=colour, lw=1.2, ls=(0, (1, 1.6)), zorder=4)
    panel.plot(*truth[0], "o", color="white", mec=colour, ms=5.0, zorder=5)
    panel.plot(*truth[-1], "o", color=colour, ms=5.0, zorder=6)


def _draw_key(panel: Axes, run: Run, picked: list[int]) -> None:
    handles = [
        panel.plot([], [], color=_engines.INK, lw=1.5)[0],
        panel.plot([], [], color=_engines.INK, lw=1.2, ls=(0, (1, 1.6)))[0],
    ]
    names = ["truth", "estimate"]
    if len(picked) <= len(COLOURS):
        handles += [panel.plot([], [], color=COLOURS[k], lw=4.0)[0] for k in range(len(picked))]
        names += [shortened(run.names[node], 20) for node in picked]
    legend = panel.legend(handles, [""] * len(names), loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    for text, name in zip(legend.get_texts(), names, strict=True):
        text.set_parse_math(False)
        text.set_text(name)
