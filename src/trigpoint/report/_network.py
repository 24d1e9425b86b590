"""The network drawn as SVG text: nodes coloured by a value, known marks, external arcs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import BoolArray, FloatArray, IntArray, as_floats, as_indices
from trigpoint.errors import ShapeError
from trigpoint.graphs import MeasurementGraph
from trigpoint.graphs.layout import arc_pairs, node_positions
from trigpoint.report import _engines
from trigpoint.report._text import printable, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection
    from matplotlib.figure import Figure

_NAMED = 60
_AS_IMAGE = 6000
_WIDTH = 6.8
_COLOURS = "cividis_r"
_NO_VALUE = "#c9ced4"
_PLAIN = "#e8eef5"
_COMPASS = np.deg2rad([270.0, 90.0, 0.0, 180.0, 315.0, 225.0, 45.0, 135.0])  # preferred first: below, above, beside
_STEM_ROOM = 0.3  # a name is wider than an arc: keep it farther away from a stem
_GROUND_KEY = np.array([[0.0, 0.5], [0.0, -0.5], [-0.42, -0.5], [0.42, -0.5], [0.0, -0.5], [0.0, 0.5]])
_GROUND = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, -0.42], [1.0, 0.42], [1.0, 0.0], [0.0, 0.0]])


@dataclass(frozen=True, eq=False)
class _Network:
    graph: MeasurementGraph
    places: FloatArray
    values: FloatArray
    known: BoolArray
    pairs: IntArray
    counts: IntArray

    @property
    def diameter(self) -> float:
        """Diameter of a node in points: large for a few nodes, dots for thousands."""
        return float(np.clip(150.0 / np.sqrt(self.graph.n_nodes), 2.2, 10.5))

    @property
    def as_image(self) -> bool:
        """Thousands of shapes are embedded as an image: a browser draws it at once."""
        return self.graph.n_nodes > _AS_IMAGE


def network_figure(
    graph: MeasurementGraph,
    positions: ArrayLike | None = None,
    node_values: ArrayLike | None = None,
    label: str = "",
    known: ArrayLike = (),
    title: str = "",
) -> str:
    """Draw a measurement graph and return the SVG text; equal input gives equal text.

    Args:
        graph: the network; arcs between the same two nodes are one line, wider for more of them; an external arc is a
            short stem with a bar, turned away from the other arcs.
        positions: (N, 2) or (N, 3) places (the plan view is drawn, equal scales); None: see :func:`node_positions`.
        node_values: (N,) numbers that colour the nodes; grey where NaN or infinite.
        label: what the colours mean, with the unit (``standard deviation [mm]``).
        known: nodes that are known marks; drawn as triangles, without colour.
        title: a line above the network.

    Names stand beside the nodes up to 60 nodes; above 6000 nodes the drawing is an embedded image.

    Raises:
        ShapeError: ``positions`` or ``node_values`` do not have one row a node.
        ArgumentError: a position that is not finite, a known mark that is no node.
        MissingExtraError: matplotlib is not installed.
    """
    places = node_positions(graph) if positions is None else _checked_places(graph, positions)
    marked = np.zeros(graph.n_nodes, dtype=np.bool_)
    marked[as_indices("known", known, 0, graph.n_nodes)] = True
    network = _Network(graph, places, _checked_values(graph, node_values), marked, *arc_pairs(graph))
    what = title or f"Network of {graph.n_nodes} nodes and {graph.n_arcs} arcs"
    coloured = bool(np.isfinite(network.values[~marked]).any())

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        _draw_arcs(axes, network)
        free = _draw_ground(axes, network)
        nodes = _draw_nodes(axes, network, node_values is not None)
        _draw_names(axes, network, free)
        if title:
            axes.set_title(printable(title), parse_math=False)
        _frame(axes)
        if nodes is not None and coloured:
            bar = figure.colorbar(nodes, ax=axes, shrink=0.8, aspect=28, pad=0.02)
            bar.outline.set_visible(False)
            bar.set_label(printable(label), parse_math=False)

    described = f"{what}, coloured by {label}" if coloured and label else what
    return _engines.draw(_size(places, coloured), described, paint)


def _checked_places(graph: MeasurementGraph, positions: ArrayLike) -> FloatArray:
    places = as_floats("positions", positions)
    if places.ndim != 2 or places.shape[0] != graph.n_nodes or places.shape[1] not in (2, 3):
        raise ShapeError(f"positions must have shape ({graph.n_nodes}, 2) or ({graph.n_nodes}, 3); got {places.shape}")
    return places[:, :2]


def _checked_values(graph: MeasurementGraph, node_values: ArrayLike | None) -> FloatArray:
    if node_values is None:
        return np.full(graph.n_nodes, np.nan)
    values = np.array(node_values, dtype=np.float64)
    if values.shape != (graph.n_nodes,):
        raise ShapeError(f"node_values must have shape ({graph.n_nodes},), one number a node; got {values.shape}")
    values[~np.isfinite(values)] = np.nan
    return values


def _size(places: FloatArray, coloured: bool) -> tuple[float, float]:
    width, height = np.ptp(places, axis=0)
    shape = float(np.clip(height / width, 0.12, 1.0)) if width > 0.0 else (1.0 if height > 0.0 else 0.12)
    return _WIDTH, (_WIDTH - (1.2 if coloured else 0.2)) * shape + 0.7


def _markers(axes: Axes, network: _Network, nodes: IntArray | BoolArray, **look: Any) -> PathCollection:
    x, y = network.places[nodes].T
    return axes.scatter(x, y, rasterized=network.as_image, **look)


def _draw_arcs(axes: Axes, network: _Network) -> None:
    """One broken line for each width, so that thousands of arcs are a handful of SVG elements."""
    base = 0.5 if network.graph.n_nodes > 600 else 1.0
    widths = np.minimum(network.counts, 4)
    for width in np.unique(widths).tolist():
        ends = network.places[network.pairs[widths == width]]
        broken = np.full((ends.shape[0], 3, 2), np.nan)
        broken[:, :2] = ends
        x, y = broken.reshape(-1, 2).T
        thick = base * (0.1 + 0.9 * width)
        axes.plot(x, y, color=_engines.ARC, lw=thick, zorder=1, rasterized=network.as_image)


def _crowding(network: _Network) -> FloatArray:
    """(N, 8) how near the nearest arc comes to each compass direction: the largest cosine, -1 where there is none."""
    ends = np.concatenate([network.pairs, network.pairs[:, ::-1]])
    offset = network.places[ends[:, 1]] - network.places[ends[:, 0]]
    crowding = np.full((network.graph.n_nodes, _COMPASS.shape[0]), -1.0)
    np.maximum.at(crowding, ends[:, 0], _closeness(np.arctan2(offset[:, 1], offset[:, 0])))
    return crowding


def _closeness(angles: FloatArray) -> FloatArray:
    """Cosine between each angle and each compass direction, rounded so that equal ones tie on every machine."""
    return np.asarray(np.round(np.cos(angles[:, None] - _COMPASS), 6), dtype=np.float64)


def _draw_ground(axes: Axes, network: _Network) -> FloatArray:
    """Draw the external arcs, each towards free space; return the free directions left for the names (N,)."""
    crowding = _crowding(network)
    anchored = network.graph.anchored_nodes
    direction = np.argmin(crowding[anchored], axis=1)
    for k in np.unique(direction).tolist():
        cos, sin = np.cos(_COMPASS[k]), np.sin(_COMPASS[k])
        look = {
            "s": (3.0 * network.diameter + 4.0) ** 2,
            "marker": _GROUND @ np.array([[cos, sin], [-sin, cos]]),
            "facecolors": "none",
            "edgecolors": _engines.ACCENT,
            "linewidths": 0.6 + 0.08 * network.diameter,
        }
        _markers(axes, network, anchored[direction == k], zorder=2, **look)
    if anchored.size:
        key: dict[str, Any] = {"s": 170, "marker": _GROUND_KEY, "fc": "none", "ec": _engines.ACCENT, "lw": 1.3}
        axes.scatter([], [], label="external arc", **key)
    crowding[anchored] = np.maximum(crowding[anchored], _closeness(_COMPASS[direction]) + _STEM_ROOM)
    free: FloatArray = _COMPASS[np.argmin(crowding, axis=1)]
    return free


def _draw_nodes(axes: Axes, network: _Network, valued: bool) -> PathCollection | None:
    """Draw the nodes by kind; return the coloured ones for the colour bar."""
    finite = np.isfinite(network.values) & ~network.known
    blank = ~np.isfinite(network.values) & ~network.known
    area = network.diameter**2
    look = {"s": area, "edgecolors": _engines.INK, "linewidths": 0.7 if network.diameter > 5.0 else 0.0, "zorder": 3}
    coloured = None
    if blank.any():
        fill, label = (_NO_VALUE, "no value") if valued else (_PLAIN, "_nolegend_")
        _markers(axes, network, blank, facecolors=fill, label=label, **look)
    if finite.any():
        values = network.values[finite]
        low, high = _colour_range(values)
        coloured = _markers(axes, network, finite, c=values, cmap=_COLOURS, vmin=low, vmax=high, **look)
    if network.known.any():
        look |= {"s": 1.7 * area, "edgecolors": "white", "linewidths": 0.6, "zorder": 4}
        _markers(axes, network, network.known, marker="^", facecolors=_engines.INK, label="known mark", **look)
    return coloured


def _colour_range(values: FloatArray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    if high - low > 1e-12 * max(abs(low), abs(high)):
        return low, high
    room = 0.05 * abs(high) or 1.0
    return low - room, high + room


def _draw_names(axes: Axes, network: _Network, directions: FloatArray) -> None:
    if network.graph.n_nodes > _NAMED:
        return
    distances = np.where(network.known, 0.75, 0.5) * network.diameter + 3.0
    for name, place, turn, distance in zip(network.graph.names, network.places, directions, distances, strict=True):
        x, y = round(float(np.cos(turn)), 6), round(float(np.sin(turn)), 6)
        axes.annotate(
            shortened(name, 24), xy=(float(place[0]), float(place[1])), xytext=(distance * x, distance * y),
            textcoords="offset points", fontsize=8, zorder=5, parse_math=False,
            ha="center" if abs(x) < 0.1 else ("left" if x > 0 else "right"),
            va="center" if abs(y) < 0.1 else ("bottom" if y > 0 else "top"),
            bbox={"boxstyle": "square,pad=0.08", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
        )  # fmt: skip


def _frame(axes: Axes) -> None:
    axes.set_axis_off()
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(
            loc="upper left", bbox_to_anchor=(0.0, 0.0), ncols=3, borderaxespad=0.0, handletextpad=0.3, markerscale=0.9
        )
