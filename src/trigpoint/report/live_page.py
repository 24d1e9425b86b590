"""The page of a live run, from its log."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.observers.run import Run
from trigpoint.report._facts import fact_rows, rate_of
from trigpoint.report._text import number, shortened
from trigpoint.report.figures import curves_figure, error_figure
from trigpoint.report.live_tables import events_section, links_section, nodes_section, started_again
from trigpoint.report.page import Figure, Page, Section, Table
from trigpoint.runtime.log_read import Log
from trigpoint.runtime.log_run import first_known

_POINTS = 2000
_LINES = 6
_STATED = (
    "What the nodes say of the root mean square error of one of their states, and what it was where the truth is "
    "known. What they say is a bound for constants; for agents that move a figure (docs/explanation/self-knowledge.md)."
)


def live_page(log: Log, run: Run, *, title: str, unit: str = "") -> Page:
    """Describe a live run: summary, errors (or estimates), whom to trust, links, events, restarts, nodes.

    Args:
        log: what ``read_log`` returned.
        run: the same run as tables (``run_of(log)``).
        title: the page's title.
        unit: unit of the state, written beside the errors.

    Without a truth in the log there are no errors, and the page shows estimates. The error is that of the nodes that
    are there; it is shown from the first sample at which every node was known (``first_known``). Tables end
    after 200 rows and say how many more there are.

    Raises:
        ArgumentError: the run has no samples.
        MissingExtraError: matplotlib is not installed.
    """
    if not run.times.size:
        raise ArgumentError("the run has no samples: there is nothing to report")
    again = started_again(log, run)
    with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged has infinite errors
        sections = [
            Section("Summary", _state_of(log), (_summary(log, run, sum(map(len, again.values())), unit),)),
            _values_section(log, run, again, unit),
            _trust_section(log, run, unit),
            links_section(log),
            events_section(log, run, again),
            nodes_section(log, run, again, unit),
        ]
    subtitle = (
        f"live, network {shortened(log.network, 60)}, {number(len(run.names))} nodes, "
        f"{number(float(run.times[-1]), 4)} s, {number(run.times.shape[0])} samples"
    )
    return Page(title, subtitle, tuple(sections))


def _first_error(run: Run) -> int | None:
    """Number of the first sample with a known error once every node is known; None where there is none."""
    known = np.flatnonzero(np.isfinite(run.error_norm) & (run.status != "away").any(axis=1))
    later = known[known >= (first_known(run) or 0)]
    return int(later[0]) if later.size else None


def _earlier(log: Log, run: Run) -> float:
    """Seconds from the first estimate in the log to time 0; 0 where there are none before it."""
    spoken = [float(series.times.min()) for series in log.estimates.values() if len(series)]
    return max(0.0, float(run.attributes.get("start", 0.0)) - min(spoken, default=np.inf))


def _state_of(log: Log) -> str:
    text = "" if log.complete else f"The log is not complete: {log.damage}. What follows is what could be read."
    return f"{text} {log.odd} messages of a wrong size were left out." if log.odd else text


def _of(quantity: str, unit: str) -> str:
    return f"{quantity} [{unit}]" if unit else quantity


def _four(value: float | None) -> str | None:
    return None if value is None else number(float(value), 4)


def _summary(log: Log, run: Run, restarts: int, unit: str) -> Table:
    rows: list[tuple[str, object]] = []
    first = _first_error(run)
    if first is not None:
        norm = run.error_norm
        rows += [
            (_of("error norm, first sample", unit), _four(norm[first])),
            (_of("error norm, last sample", unit), _four(norm[-1])),
            ("measured decay rate [1/s]", _four(run.measured_decay_rate())),
        ]
    rows.append(("first estimate before time 0 [s]", number(_earlier(log, run), 3)))
    last = run.status[-1]
    rows += [(f"nodes {word} at the end", int((last == word).sum())) for word in ("anchored", "relative", "away")]
    rows += [
        ("restarts", restarts),
        ("estimates in the log", sum(map(len, log.estimates.values()))),
        ("readings in the log", sum(map(len, log.readings.values()))),
        ("statuses in the log", sum(map(len, log.statuses.values()))),
    ]
    rows += fact_rows(run, unit)
    return Table(("quantity", "value"), tuple(rows), align=("left", "right"))


def _thin(run: Run) -> slice:
    return slice(None, None, max(1, -(-run.times.shape[0] // _POINTS)))


def _values_section(log: Log, run: Run, again: dict[str, list[float]], unit: str) -> Section:
    instants = sorted(instant for instants in again.values() for instant in instants)[:100]
    first = _first_error(run)
    thin = _thin(run)
    if first is not None:
        times, norm = run.times[first:][thin], run.error_norm[first:][thin]
        known = np.isfinite(norm)
        rate, name = rate_of(run) or (None, "")
        svg = error_figure(times[known], norm[known], rate=rate, rate_label=name, unit=unit)
        caption = (
            "Euclidean norm of the error of all nodes that are there, estimate minus truth. Time 0 is the first "
            f"instant at which every node was known, {number(_earlier(log, run), 3)} s after the first estimate."
        )
        if rate is not None:
            caption += f" Dashed: {name}; restarts and lost arcs begin the decay anew."
        return Section("Error over time", items=(Figure(svg, caption),))
    shown = run.names[:_LINES]
    lines = {name: run.estimate[thin, k, 0] for k, name in enumerate(shown)}
    svg = curves_figure(run.times[thin], lines, y_label=_of("first state", unit), events=instants)
    caption = f"What {number(len(shown))} of {number(len(run.names))} nodes believed; a gap where a node was away."
    return Section("Estimates over time", "The log holds no truth: errors are not known.", (Figure(svg, caption),))


def _trust_section(log: Log, run: Run, unit: str) -> Section:
    thin = _thin(run)
    times = run.times[thin]
    counts = {word: (run.status[thin] == word).sum(axis=1).astype(float) for word in ("anchored", "relative", "away")}
    figures = [
        Figure(
            curves_figure(times, counts, y_label="nodes"),
            "Anchored: fresh readings lead to an anchor. Relative: only differences are known. Away: silent.",
        )
    ]
    lines = _spread("stated", _uncertainty(log, run, thin)) | _spread("true", _root_mean_square(run, thin))
    if any(name.endswith("stated") for name in lines):
        svg = curves_figure(times, lines, y_label=_of("error of a state", unit), log_y=True)
        figures.append(Figure(svg, _STATED))
    return Section("Whom to trust", items=tuple(figures))


def _spread(kind: str, table: FloatArray) -> dict[str, FloatArray]:
    """Largest and median of the nodes at each sample; nothing where nobody is ever known."""
    known = np.isfinite(table).any(axis=1)
    if not known.any():
        return {}
    lines = {}
    for word, of in (("largest", np.nanmax), ("median", np.nanmedian)):
        line = np.full(table.shape[0], np.nan)
        line[known] = of(table[known], axis=1)
        lines[f"{word}, {kind}"] = line
    return lines


def _root_mean_square(run: Run, thin: slice) -> FloatArray:
    """(T, N) root mean square error over a node's states; NaN where it is away or its truth unknown."""
    there = run.status[thin] != "away"
    return np.where(there, np.sqrt((run.error[thin] ** 2).mean(axis=2)), np.nan)


def _uncertainty(log: Log, run: Run, thin: slice) -> FloatArray:
    """(T, N) the last uncertainty that each node told; NaN while it is away."""
    instants = run.times[thin] + float(run.attributes.get("start", 0.0))
    table = np.full((instants.shape[0], len(run.names)), np.nan)
    for k, name in enumerate(run.names):
        series = log.estimates.get(name)
        if series is None:
            continue
        order = np.argsort(series.times, kind="stable")
        last = np.searchsorted(series.times[order], instants, side="right") - 1
        told = series.facts["uncertainty"][order][np.maximum(last, 0)]
        table[:, k] = np.where((last >= 0) & (run.status[thin, k] != "away"), told, np.nan)
    return table
