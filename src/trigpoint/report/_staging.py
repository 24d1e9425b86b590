"""What a moving picture of a run shows, and how each frame is drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import BoolArray, FloatArray, as_floats
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph
from trigpoint.graphs.layout import node_positions
from trigpoint.report import _engines
from trigpoint.report._text import printable, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation

    from trigpoint.observers.run import Run

_DECADES = 6.0
_NO_VALUE = "#c9ced4"
_NAMED = 30


@dataclass(frozen=True, eq=False)
class Staging:
    """Choices for ``animation``.

    Args:
        positions: (N, 2) where the nodes are drawn; a layout of the graph unless given. Not with ``axes``.
        axes: two states that are a place in a plane: nodes are drawn where they are, with what they believe.
        active: (T, M) which arcs work at each sample; all unless given.
        rate: decay rate, 1/s: a dashed line beside the error.
        unit: unit of the error.
        rate_name: what ``rate`` is.

    Fewer than 30 nodes have their names beside them.
    """

    positions: ArrayLike | None = None
    axes: Sequence[int] | None = None
    active: ArrayLike | None = None
    rate: float | None = None
    unit: str = ""
    rate_name: str = "certified rate"

    def on(self, figure: Figure, run: Run, graph: MeasurementGraph, title: str) -> Callable[[int], None]:
        """Prepare ``figure`` for ``run`` on ``graph`` under ``title``; returns what draws a sample's frame."""
        places, believed = self._places(run, graph)
        left, right = figure.add_axes((0.02, 0.13, 0.45, 0.76)), figure.add_axes((0.67, 0.13, 0.31, 0.76))
        network = _Network(left, graph, places, believed, self._active(run, graph), _sizes(run))
        network.key(figure, self.unit)
        curve = _Curve(right, run, self)
        if graph.is_external.any():
            figure.text(0.02, 0.06, "in a ring: has an absolute reading", fontsize=7.5, color=_engines.MUTED)
        heading = figure.text(0.02, 0.95, "", fontsize=11.0, fontweight="bold", va="center")
        heading.set_parse_math(False)

        def update(sample: int) -> None:
            network.show(sample)
            curve.show(sample)
            heading.set_text(f"{title}   t = {run.times[sample]:.4g} s".strip())

        return update

    def _places(self, run: Run, graph: MeasurementGraph) -> tuple[FloatArray, FloatArray | None]:
        """(T, N, 2) places, and believed ones where the nodes move."""
        if self.axes is not None:
            chosen = [int(axis) for axis in self.axes]
            if len(chosen) != 2 or not all(0 <= axis < run.truth.shape[2] for axis in chosen):
                raise ArgumentError(f"axes must be two of the {run.truth.shape[2]} states; got {tuple(chosen)}")
            return run.truth[:, :, chosen], run.estimate[:, :, chosen]
        given = node_positions(graph) if self.positions is None else as_floats("positions", self.positions)
        if given.ndim != 2 or given.shape[0] != graph.n_nodes or given.shape[1] not in (2, 3):
            raise ShapeError(f"positions must have shape ({graph.n_nodes}, 2); got {given.shape}")
        return np.broadcast_to(given[:, :2], (run.times.shape[0], graph.n_nodes, 2)), None

    def _active(self, run: Run, graph: MeasurementGraph) -> BoolArray:
        shape = (run.times.shape[0], graph.n_arcs)
        if self.active is None:
            return np.ones(shape, dtype=bool)
        table = np.asarray(self.active, dtype=bool)
        if table.shape != shape:
            raise ShapeError(f"active must have shape (samples, arcs) = {shape}; got {table.shape}")
        return table


def _sizes(run: Run) -> FloatArray:
    """(T, N) error of each node; NaN where it is away."""
    return np.asarray(np.sqrt((run.error**2).sum(axis=2)))


class _Network:
    """The left panel."""

    def __init__(
        self,
        panel: Axes,
        graph: MeasurementGraph,
        places: FloatArray,
        believed: FloatArray | None,
        active: BoolArray,
        sizes: FloatArray,
    ) -> None:
        from matplotlib import colormaps
        from matplotlib.collections import LineCollection
        from matplotlib.colors import LogNorm

        self._places, self._believed, self._active, self._sizes = places, believed, active, sizes
        inner = np.flatnonzero(~graph.is_external)
        self._inner, self._pairs = inner, np.stack([graph.tail[inner], graph.head[inner]], axis=1)
        outer = np.flatnonzero(graph.is_external)
        self._outer, self._anchored = outer, graph.head[outer]
        usable = sizes[np.isfinite(sizes) & (sizes > 0.0)]
        high = float(usable.max()) if usable.size else 1.0
        low = max(float(usable.min()) if usable.size else 0.1, high * 10.0**-_DECADES)
        self._floor, norm = low, LogNorm(low, max(high, low * 1.001))
        diameter = float(np.clip(120.0 / np.sqrt(graph.n_nodes), 3.0, 12.0))
        self._lines: LineCollection = LineCollection([], colors=_engines.ARC, linewidths=1.0, zorder=1)
        self._gaps: LineCollection = LineCollection([], colors=_engines.ACCENT, linewidths=1.0, zorder=2)
        panel.add_collection(self._lines)
        panel.add_collection(self._gaps)
        start = places[0]
        self._ring: PathCollection = panel.scatter(
            start[:0, 0],
            start[:0, 1],
            s=(1.9 * diameter) ** 2,
            facecolors="none",
            edgecolors=_engines.INK,
            linewidths=1.1,
            zorder=3,
        )
        self._nodes: PathCollection = panel.scatter(
            start[:, 0], start[:, 1], c=np.full(len(start), low), norm=norm, s=diameter**2, zorder=4, lw=0.5,
            cmap=colormaps["cividis_r"].with_extremes(bad=_NO_VALUE), edgecolors=_engines.INK,
        )  # fmt: skip
        self._names = _named(panel, graph, start, diameter)
        _frame(panel, places)

    def key(self, figure: Figure, unit: str) -> None:
        """The colours' meaning, beside the panel."""
        bar: Any = figure.colorbar(self._nodes, cax=figure.add_axes((0.49, 0.13, 0.012, 0.76)))
        bar.set_label(
            printable(f"error [{unit}], darker is worse" if unit else "error, darker is worse"), parse_math=False
        )
        bar.outline.set_visible(False)

    def show(self, sample: int) -> None:
        """Draw one sample."""
        place, works = self._places[sample], self._active[sample]
        self._lines.set_segments(list(place[self._pairs[works[self._inner]]]))
        self._ring.set_offsets(place[np.unique(self._anchored[works[self._outer]])])
        self._nodes.set_offsets(place)
        for name, (x, y) in zip(self._names, place.tolist(), strict=False):
            name.xy = (x, y)
        size = self._sizes[sample]
        self._nodes.set_array(np.ma.masked_invalid(np.maximum(size, self._floor)))
        if self._believed is not None:
            ends = np.stack([place, self._believed[sample]], axis=1)
            self._gaps.set_segments(list(ends[np.isfinite(ends).all(axis=(1, 2))]))


def _named(panel: Axes, graph: MeasurementGraph, places: FloatArray, diameter: float) -> list[Annotation]:
    """The names of few nodes, each to the upper right, where the arcs of a grid leave room; none of many.

    Those of anchored nodes stand outside of their rings.
    """
    if graph.n_nodes >= _NAMED:
        return []
    look: dict[str, Any] = {
        "textcoords": "offset points",
        "fontsize": 7.5,
        "zorder": 5,
        "parse_math": False,
        "annotation_clip": False,
        "bbox": {"boxstyle": "square,pad=0.05", "facecolor": "white", "edgecolor": "none", "alpha": 0.7},
    }
    anchored = np.zeros(graph.n_nodes, dtype=bool)
    anchored[graph.head[graph.is_external]] = True
    gaps = np.where(anchored, 0.7, 0.45) * diameter + 1.5
    rows = zip(graph.names, places.tolist(), gaps.tolist(), strict=True)
    return [panel.annotate(shortened(name, 16), (x, y), xytext=(gap, gap), **look) for name, (x, y), gap in rows]


def _frame(panel: Axes, places: FloatArray) -> None:
    panel.set_aspect("equal", adjustable="box")
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    room = 0.08 * max(float((high - low).max()), 1e-9)
    panel.set_xlim(low[0] - room, high[0] + room)
    panel.set_ylim(low[1] - room, high[1] + room)
    panel.set_xticks([])
    panel.set_yticks([])
    for spine in panel.spines.values():
        spine.set_visible(True)
        spine.set_color(_engines.GRID)


class _Curve:
    """The right panel: the error norm so far, the rest pale, and the rate."""

    def __init__(self, panel: Axes, run: Run, staging: Staging) -> None:
        rate, unit = staging.rate, staging.unit
        norm = run.error_norm
        positive = norm > 0.0
        self._times, self._norm = run.times, np.where(positive, norm, np.nan)
        panel.set_yscale("log")
        panel.grid(visible=True)
        panel.set_axisbelow(True)
        panel.set_xlabel("time [s]")
        panel.set_ylabel(printable(f"error norm [{unit}]" if unit else "error norm"), parse_math=False)
        panel.plot(run.times, self._norm, color=_engines.GRID, lw=1.6, zorder=2)
        (self._past,) = panel.plot([], [], color=_engines.BLUE, lw=1.8, zorder=3)
        (self._point,) = panel.plot([], [], "o", color=_engines.BLUE, ms=5.5, zorder=5)
        if positive.any():
            low, high = float(norm[positive].min()), float(norm[positive].max())
            panel.set_ylim(low / 1.6, high * 1.6)
            _engines.plain_ticks(panel, low / 1.6, high * 1.6)
        if rate is not None and rate > 0.0 and positive[0]:
            line = norm[0] * np.exp(-np.minimum(rate * (run.times - run.times[0]), 600.0))
            panel.plot(run.times, line, color=_engines.ACCENT, lw=1.3, ls=(0, (5, 3)), label="rate", zorder=4)
            (text,) = panel.legend(loc="upper right").get_texts()
            text.set_parse_math(False)
            text.set_text(printable(f"{staging.rate_name}, {rate:.4g} 1/s"))

    def show(self, sample: int) -> None:
        """Draw one sample."""
        self._past.set_data(self._times[: sample + 1], self._norm[: sample + 1])
        self._point.set_data(self._times[sample : sample + 1], self._norm[sample : sample + 1])
