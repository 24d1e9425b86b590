"""Samples of a live run while it goes on, for its summary."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.observers import Run
from trigpoint.runtime.log_run import first_known
from trigpoint.runtime.monitor import Snapshot

_SAMPLE, _MOST_SAMPLES = 0.05, 4000


class Recorder:
    """Samples of a run: every node's truth and estimate as they were known last.

    Twice the time between samples is taken, and every other sample forgotten, whenever ``most`` are reached.
    """

    def __init__(self, names: tuple[str, ...], every: float = _SAMPLE, most: int = _MOST_SAMPLES) -> None:
        self._names, self._every, self._most = names, every, most
        self._rows: list[tuple[float, FloatArray, FloatArray]] = []
        self._due = 0.0

    def take(self, snapshot: Snapshot) -> None:
        """Keep ``snapshot`` if it is time; of nodes that joined later nothing is kept."""
        if snapshot.time < self._due:
            return
        self._due = snapshot.time + self._every
        count = len(self._names)
        self._rows.append((snapshot.time, _table(snapshot.truth[:count]), _table(snapshot.estimate[:count])))
        if len(self._rows) >= self._most:
            self._rows, self._every = self._rows[::2], 2.0 * self._every

    def run(self) -> Run | None:
        """The samples from ``first_known`` on, as ``read_run`` has them; None unless everybody was known then."""
        if not self._rows:
            return None
        width = max(table.shape[1] for row in self._rows for table in row[1:])
        times, *tables = zip(*self._rows, strict=True)
        truth, estimate = (np.array([_widened(one, width) for one in table]) for table in tables)
        status = np.where(np.isnan(estimate).any(axis=2), "away", "anchored")
        sent = np.zeros(status.shape, dtype=np.int64)
        run = Run(np.array(times), truth, estimate, sent, status, self._names, "live")
        first = first_known(run)
        if first is None or np.isnan(run.error[first]).any():
            return None
        return Run(
            run.times[first:], truth[first:], estimate[first:], sent[first:], status[first:], self._names, "live"
        )  # fmt: skip


def _table(rows: tuple[FloatArray | None, ...]) -> FloatArray:
    """(N, n), missing states of smaller nodes 0, all of them NaN where a node is not known."""
    table = np.zeros((len(rows), max([1, *(row.shape[0] for row in rows if row is not None)])))
    for k, row in enumerate(rows):
        table[k, : None if row is None else row.shape[0]] = np.nan if row is None else row
    return table


def _widened(table: FloatArray, width: int) -> FloatArray:
    """The same with ``width`` columns: before every node was known nobody knew how many there are."""
    more = np.zeros((table.shape[0], width - table.shape[1]))
    more[np.isnan(table).any(axis=1)] = np.nan
    return np.hstack([table, more])
