"""The page of a live run, from its log."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.observers.run import Run
from trigpoint.report._series import series_figure
from trigpoint.report._text import number, shortened
from trigpoint.report.figures import error_figure
from trigpoint.report.live_tables import events_section, links_section, nodes_section, started_again
from trigpoint.report.page import Figure, Page, Section, Table
from trigpoint.runtime.log_read import Log

_POINTS = 2000
_LINES = 6


def live_page(log: Log, run: Run, *, title: str, unit: str = "") -> Page:
    """Describe a live run: summary, errors (or estimates), whom to trust, links, events, restarts, nodes.

    Args:
        log: what ``read_log`` returned.
        run: the same run as tables (``run_of(log)``).
        title: the page's title.
        unit: unit of the state, written beside the errors.

    Without a truth in the log there are no errors, and the page shows estimates. The error is that of the nodes that
    are there; it is shown from the first sample at which as many were there as ever. Tables end after 200 rows and say
    how many more there are.

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
            _values_section(run, again, unit),
            _trust_section(log, run),
            links_section(log),
            events_section(log, run, again),
            nodes_section(log, run, again, unit),
        ]
    subtitle = (
        f"live, network {shortened(log.network, 60)}, {number(len(run.names))} nodes, "
        f"{number(float(run.times[-1]), 4)} s, {number(run.times.shape[0])} samples"
    )
    return Page(title, subtitle, tuple(sections))


def _first_full(run: Run) -> int | None:
    """Number of the first sample with a known error and as many nodes as ever; None where no error is known."""
    present = np.where(np.isfinite(run.error_norm), (run.status != "away").sum(axis=1), 0)
    return int(np.argmax(present)) if present.any() else None


def _state_of(log: Log) -> str:
    text = "" if log.complete else f"The log is not complete: {log.damage}. What follows is what could be read."
    return f"{text} {log.odd} messages of a wrong size were left out." if log.odd else text


def _of(quantity: str, unit: str) -> str:
    return f"{quantity} [{unit}]" if unit else quantity


def _four(value: float | None) -> str | None:
    return None if value is None else number(float(value), 4)


def _summary(log: Log, run: Run, restarts: int, unit: str) -> Table:
    rows: list[tuple[str, object]] = []
    first = _first_full(run)
    if first is not None:
        norm = run.error_norm
        rows += [
            (_of("error norm, first sample", unit), _four(norm[first])),
            (_of("error norm, last sample", unit), _four(norm[-1])),
            ("measured decay rate [1/s]", _four(run.measured_decay_rate())),
        ]
    last = run.status[-1]
    rows += [(f"nodes {word} at the end", int((last == word).sum())) for word in ("anchored", "relative", "away")]
    rows += [
        ("restarts", restarts),
        ("estimates in the log", sum(map(len, log.estimates.values()))),
        ("readings in the log", sum(map(len, log.readings.values()))),
        ("statuses in the log", sum(map(len, log.statuses.values()))),
    ]
    plain = (bool, int, float, str)
    rows += [
        (shortened(str(key), 80), shortened(value, 60) if isinstance(value, str) else value)
        for key, value in log.attributes.items()
        if isinstance(value, plain)
    ]
    return Table(("quantity", "value"), tuple(rows), align=("left", "right"))


def _thin(run: Run) -> slice:
    return slice(None, None, max(1, -(-run.times.shape[0] // _POINTS)))


def _values_section(run: Run, again: dict[str, list[float]], unit: str) -> Section:
    instants = sorted(instant for instants in again.values() for instant in instants)[:100]
    first = _first_full(run)
    thin = _thin(run)
    if first is not None:
        times, norm = run.times[first:][thin], run.error_norm[first:][thin]
        known = np.isfinite(norm)
        rate = run.attributes.get("guaranteed_rate")
        usable = isinstance(rate, int | float) and not isinstance(rate, bool) and np.isfinite(rate) and rate > 0.0
        svg = error_figure(times[known], norm[known], rate=float(rate) if usable and rate else None, unit=unit)
        caption = "Euclidean norm of the error of all nodes that are there, estimate minus truth."
        if usable:
            caption += " The dashed line is the guaranteed rate; restarts and lost arcs begin the decay anew."
        return Section("Error over time", items=(Figure(svg, caption),))
    shown = run.names[:_LINES]
    lines = {name: run.estimate[thin, k, 0] for k, name in enumerate(shown)}
    svg = series_figure(run.times[thin], lines, label=_of("first state", unit), events=instants)
    caption = f"What {number(len(shown))} of {number(len(run.names))} nodes believed; a gap where a node was away."
    return Section("Estimates over time", "The log holds no truth: errors are not known.", (Figure(svg, caption),))


def _trust_section(log: Log, run: Run) -> Section:
    thin = _thin(run)
    times = run.times[thin]
    counts = {word: (run.status[thin] == word).sum(axis=1).astype(float) for word in ("anchored", "relative", "away")}
    figures = [
        Figure(
            series_figure(times, counts, label="nodes"),
            "Anchored: fresh readings lead to an anchor. Relative: only differences are known. Away: silent.",
        )
    ]
    uncertainty = _uncertainty(log, run, thin)
    present = np.isfinite(uncertainty).any(axis=1)
    if present.any():
        known = uncertainty[present]
        lines = {"largest": np.nanmax(known, axis=1), "median": np.nanmedian(known, axis=1)}
        svg = series_figure(times[present], lines, label="uncertainty", decades=True)
        figures.append(Figure(svg, "What the nodes say of their own uncertainty (one standard deviation of a state)."))
    return Section("Whom to trust", items=tuple(figures))


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
