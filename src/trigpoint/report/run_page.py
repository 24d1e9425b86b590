"""The page of one recorded run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph
from trigpoint.report._facts import fact_rows
from trigpoint.report._text import number, shortened
from trigpoint.report.figures import connectivity_figure, error_figure, network_figure, trajectory_figure
from trigpoint.report.page import Figure, Page, Section, Table

if TYPE_CHECKING:
    from trigpoint.observers.run import Run

_ROWS = 200
_PATHS = 24


def run_page(
    run: Run,
    *,
    title: str,
    graph: MeasurementGraph | None = None,
    positions: ArrayLike | None = None,
    rate: float | None = None,
    rate_name: str = "guaranteed rate",
    unit: str = "",
) -> Page:
    """Describe a recorded run: summary, error over time, the network (where given) and every node's final error.

    Where the topology changed also how well it was connected, where few nodes moved in a plane also their paths.

    Args:
        run: what ``simulate`` or a live run recorded; at least one sample.
        title: the page's title.
        graph: the network; it is drawn with each node's final error.
        positions: (N, 2) or (N, 3) places of the nodes.
        rate: decay rate, 1/s; drawn beside the error.
        rate_name: what ``rate`` is.
        unit: unit of the state, written beside the errors.

    Samples with a NaN (a node that had not started) are left out of the error figure. The table of nodes ends after
    200 rows and says how many more there are.

    Raises:
        ArgumentError: the run has no samples.
        ShapeError: the graph has another number of nodes than the run.
        MissingExtraError: matplotlib is not installed.
    """
    if not run.times.size:
        raise ArgumentError("the run has no samples: there is nothing to report")
    if graph is not None and graph.n_nodes != len(run.names):
        raise ShapeError(f"graph has {graph.n_nodes} nodes; the run has {len(run.names)}")
    final: FloatArray = np.sqrt((run.error[-1] ** 2).sum(axis=1))
    count = len(run.names)
    subtitle = f"{_count(count, 'node')}, {_count(run.times.shape[0], 'sample')}, {_span(run)}, engine {run.path}"
    sections = [
        Section("Summary", items=(_summary(run, final, rate, rate_name, unit),)),
        _error_section(run, rate, rate_name, unit),
    ]
    if run.lambda_min is not None:
        sections.append(_connectivity_section(run))
    if _moves(run):
        caption = "Lines: where the nodes were, from open to full circles; dotted: where they believed to be."
        sections.append(Section("Paths", items=(Figure(trajectory_figure(run, unit=unit), caption),)))
    if graph is not None:
        sections.append(_network_section(graph, positions, final, unit))
    sections.append(_nodes_section(run, final, unit))
    return Page(title, subtitle, tuple(sections))


def _count(count: int, noun: str) -> str:
    return f"{number(count)} {noun}{'' if count == 1 else 's'}"


def _span(run: Run) -> str:
    return f"{number(float(run.times[0]))} s to {number(float(run.times[-1]))} s"


def _of(quantity: str, unit: str) -> str:
    return f"{quantity} [{unit}]" if unit else quantity


def _four(value: float | None) -> str | None:
    return None if value is None else number(float(value), 4)


def _finite_samples(run: Run) -> tuple[FloatArray, FloatArray]:
    norm = run.error_norm
    keep = np.isfinite(norm)
    return run.times[keep], norm[keep]


def _summary(run: Run, final: FloatArray, rate: float | None, rate_name: str, unit: str) -> Table:
    norm = run.error_norm
    largest = int(np.nanargmax(final)) if np.isfinite(final).any() else None
    level = 0.01 * float(norm[0])
    measured = run.measured_decay_rate() if np.isfinite(norm).all() else None
    rows: list[tuple[str, object]] = [
        (_of("error norm, first sample", unit), _four(norm[0])),
        (_of("error norm, last sample", unit), _four(norm[-1])),
        ("time to 1 % of the first error [s]", _four(run.time_to(level) if level > 0.0 else None)),
        ("measured decay rate [1/s]", _four(measured)),
    ]
    if rate is not None and rate != run.attributes.get("guaranteed_rate"):
        rows.append((f"{rate_name} [1/s]", _four(rate)))
    if largest is not None:
        rows.append((_of("largest final error of a node", unit), _four(final[largest])))
        rows.append(("node with the largest final error", shortened(run.names[largest], 80)))
    rows.append(("messages sent in all", int(run.messages[-1].sum())))
    relative = int((run.status[-1] == "relative").sum())
    rows.append(("nodes known only relatively at the end", relative))
    rows += fact_rows(run, unit)
    return Table(("quantity", "value"), tuple(rows), align=("left", "right"))


def _error_section(run: Run, rate: float | None, rate_name: str, unit: str) -> Section:
    times, norm = _finite_samples(run)
    missing = run.times.shape[0] - times.shape[0]
    if not times.size:
        return Section("Error over time", "No sample has an error for every node: at least one is NaN throughout.")
    level = 0.01 * float(norm[0])
    reached = run.time_to(level) if level > 0.0 and not missing and norm[-1] > 0.0 else None
    marks = () if reached is None else ((reached, level, f"1 % after {number(reached, 3)} s"),)
    caption = "Euclidean norm of the whole network's error, estimate minus truth."
    if rate is not None:
        caption += f" The dashed line is the {rate_name}, from the first sample."
    if missing:
        caption += f" {_count(missing, 'sample')} with a node without an estimate left out."
    svg = error_figure(times, norm, rate=rate, rate_label=rate_name, unit=unit, marks=marks)
    return Section("Error over time", items=(Figure(svg, caption),))


def _connectivity_section(run: Run) -> Section:
    """``1 / lambda_min`` of the topology at work, beside the gain in force."""
    assert run.lambda_min is not None  # asked before
    gain = run.attributes.get("gain")
    known = float(gain) if isinstance(gain, (int, float)) and gain > 0.0 else None
    svg = connectivity_figure(run.times, run.lambda_min, known)
    caption = "The gain that the topology needs; shaded where some node has no path to an anchor."
    return Section("Connectivity", items=(Figure(svg, caption),))


def _moves(run: Run) -> bool:
    """True where a map of paths says something: few nodes, at least four states, a truth that moves."""
    few = len(run.names) <= _PATHS and run.truth.shape[2] >= 4 and run.times.size > 1
    return bool(few and np.ptp(run.truth[:, :, :2], axis=0).max() > 0.0)


def _network_section(graph: MeasurementGraph, positions: ArrayLike | None, final: FloatArray, unit: str) -> Section:
    svg = network_figure(graph, positions, final, f"{_of('final error', unit)}, darker is worse")
    inner = graph.n_arcs - int(graph.is_external.sum())
    caption = (
        f"{_count(graph.n_nodes, 'node')}, {_count(inner, 'internal arc')} and "
        f"{_count(graph.n_arcs - inner, 'external arc')}, coloured by the error at the last sample."
    )
    return Section("Network", items=(Figure(svg, caption),))


def _nodes_section(run: Run, final: FloatArray, unit: str) -> Section:
    columns = ("node", _of("final error", unit), "messages", "status")
    rows = tuple(
        (run.names[k], _four(final[k]), int(run.messages[-1, k]), str(run.status[-1, k]))
        for k in range(min(_ROWS, len(run.names)))
    )
    more = len(run.names) - len(rows)
    text = f"The first {_ROWS} nodes are listed; {number(more)} more are not." if more else ""
    return Section("Nodes at the last sample", text, (Table(columns, rows, align=("left", "right", "right", "left")),))
