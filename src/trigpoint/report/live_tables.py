"""Tables of a live run: links, events, nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trigpoint.observers.run import Run
from trigpoint.report._text import number, shortened
from trigpoint.report.page import Section, Table
from trigpoint.runtime.log_read import Log
from trigpoint.runtime.log_run import restarts

_ROWS = 200


def started_again(log: Log, run: Run) -> dict[str, list[float]]:
    """Instants [s of the run] at which another process of a node began to speak, by the nodes that have any."""
    start = float(run.attributes.get("start", 0.0))
    found = {name: restarts(log.estimates[name]) for name in run.names if name in log.estimates}
    return {name: [instant - start for instant in instants] for name, instants in found.items() if instants}


def links_section(log: Log) -> Section:
    """Every link as its node last told it, those that lost most first; warnings of the clocks."""
    rows: list[tuple[float, tuple[object, ...]]] = []
    warnings = []
    for name in log.names:
        status = log.status(name)
        if status is None:
            continue
        if status.warning:
            warnings.append(status.warning)
        for link in status.links:
            lost = link.lost / max(1, link.received + link.lost)
            cells = (
                shortened(name, 40),
                shortened(link.neighbour, 40),
                link.state.name.lower(),
                link.received,
                link.lost,
                _of_a_thousand(link.round_trip),
                _of_a_thousand(link.offset),
            )
            rows.append((lost, cells))
    if not rows:
        return Section("Links", "No node told anything of its links.")
    rows.sort(key=lambda row: -row[0])
    columns = ("node", "hears", "link", "received", "lost", "round trip [ms]", "clock offset [ms]")
    text = "\n\n".join([_more(len(rows), "links"), *warnings[:20]])
    align = ("left", "left", "left", "right", "right", "right", "right")
    return Section("Links", text, (Table(columns, [cells for _, cells in rows[:_ROWS]], align=align),))


def events_section(log: Log, run: Run, again: Mapping[str, Sequence[float]]) -> Section:
    """What happened: the events of the log, and new processes of nodes, by time."""
    start = float(run.attributes.get("start", 0.0))
    rows = [(event.time - start, event.node, event.text) for event in log.events]
    rows += [(instant, name, "speaks again, as a new process") for name, times in again.items() for instant in times]
    if not rows:
        return Section("Events", "Nothing was noted, and no node was started again.")
    rows.sort(key=lambda row: row[0])
    cells = [
        (number(time, 5), None if node is None else shortened(node, 40), shortened(text, 200))
        for time, node, text in rows[:_ROWS]
    ]
    table = Table(("time [s]", "node", "what"), cells, align=("right", "left", "left"))
    before = "Times before 0 are before every node was known." if rows[0][0] < 0.0 else ""
    return Section("Events", "\n\n".join([_more(len(rows), "events"), before]), (table,))


def nodes_section(log: Log, run: Run, again: Mapping[str, Sequence[float]], unit: str) -> Section:
    """Every node at the last sample, with what it last told of itself."""
    errors = np.sqrt((run.error[-1] ** 2).sum(axis=1))
    columns = (
        "node", f"final error [{unit}]" if unit else "final error", "uncertainty", "state", "hops", "estimates",
        "restarts", "dropped frames", "missed acts", "step [us]",
    )  # fmt: skip
    rows = []
    for k, name in enumerate(run.names[:_ROWS]):
        status, series = log.status(name), log.estimates.get(name)
        rows.append(
            (
                shortened(name, 40),
                number(float(errors[k]), 4),
                None if series is None else number(float(series.facts["uncertainty"][-1]), 4),
                str(run.status[-1, k]),
                None if status is None else status.hops,
                int(run.messages[-1, k]),
                len(again.get(name, ())),
                None if status is None else status.counters.dropped,
                None if status is None else status.missed,
                None if status is None else number(status.step_us, 3),
            )
        )
    align = ("left", "right", "right", "left", *("right",) * 6)
    table = Table(columns, rows, align=align)
    return Section("Nodes at the last sample", _more(len(run.names), "nodes"), (table,))


def _of_a_thousand(seconds: float | None) -> str | None:
    return None if seconds is None else number(1000.0 * seconds, 3)


def _more(count: int, noun: str) -> str:
    return f"The first {_ROWS} {noun} are listed; {number(count - _ROWS)} more are not." if count > _ROWS else ""
