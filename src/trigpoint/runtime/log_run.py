"""``read_run``: a log as a ``Run``, so that everything that takes a simulated run takes a live one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import BoolArray, FloatArray, IntArray, as_floats, frozen
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.observers.run import Run
from trigpoint.runtime.log_format import JOINED
from trigpoint.runtime.log_read import Log, Series, read_log

MOST_NUMBERS = 20_000_000
"""Numbers in one table of a run; a longer log is thinned out evenly."""

_PERIODS = 5.0
_LEAST_SILENCE = 0.5
_ANCHOR_TIMEOUT = 1.0


def read_run(path: str | Path, *, times: ArrayLike | None = None, away_after: float | None = None) -> Run:
    """Read the log at ``path`` and return its run; see ``run_of``, to which ``times`` and ``away_after`` go.

    Raises:
        FileFormatError: no log, a damaged message, or no estimate of any of its nodes.
        ArgumentError: ``times`` are not finite and increasing, or ``away_after`` is not positive.
    """
    return run_of(read_log(path), times=times, away_after=away_after)


def run_of(log: Log, *, times: ArrayLike | None = None, away_after: float | None = None) -> Run:
    """The tables of a ``log`` on one grid of instants, time 0 being the first of them.

    The grid are the instants of the truth, or, without a truth, as many instants as a node has estimates, evenly: from
    the first at which every node is known (see ``first_known``), as ``trigpoint run`` counts, to the last one before
    the nodes that are there at the end fall silent, one by one. Earlier instants are to be had by ``times``. An
    estimate between two of one process is interpolated by the cubic through both with the slopes of their neighbours,
    since holding the earlier one would show an error of age times ``||A z||`` that the node does not have; where the
    next is missing, the last is held. Truth is taken where it was published, and is NaN elsewhere.

    A node is ``away`` before its first estimate and from ``away_after`` seconds after its last one (five of its
    periods, at least 0.5 s, unless given); its estimate is NaN then. Otherwise it is ``anchored`` when the evidence in
    its last estimate is not older then than the log's attribute ``anchor_timeout`` (1 s where missing), else
    ``relative``: a node that falls silent is not called anchored beyond what it knew.

    We assume:
        - an estimate's values are the node's state; a node that estimates through another map (``M z + N y``) has no
          truth of its size, and its error is NaN.
        - where nodes differ in size, the missing states of smaller ones are 0 in truth and estimate.

    Args:
        log: what ``read_log`` returned.
        times: (T,) instants in the log's own seconds, instead of the grid; all of them are kept.
        away_after: seconds of silence after which a node counts as away.

    Returns:
        a ``Run`` of path ``live``; ``messages`` counts the estimates that were logged.

    Raises:
        FileFormatError: no estimate of any of the log's nodes, or more nodes and states than fit a table.
        ArgumentError: ``times`` are not finite and increasing, or ``away_after`` is not positive.
    """
    heard = {name: _ordered(log.estimates[name]) for name in log.names if name in log.estimates}
    if not heard:
        raise FileFormatError(log.path, "holds no estimate of any of its nodes: there is nothing to show")
    if away_after is not None and not away_after > 0.0:
        raise ArgumentError(f"away_after must be a positive number of seconds; got {away_after}")
    states = max(series.values.shape[1] for series in heard.values())
    room = MOST_NUMBERS // max(1, states * len(log.names))
    if not room:
        raise FileFormatError(log.path, f"{len(log.names)} nodes of {states} states are more than a table holds")
    grid = _grid(log, heard, room) if times is None else _given(times)
    shape = (grid.shape[0], len(log.names))
    estimate, truth = np.full((*shape, states), np.nan), np.full((*shape, states), np.nan)
    messages, status = np.zeros(shape, dtype=np.int64), np.full(shape, "away", dtype="<U8")
    timeout = log.attributes.get("anchor_timeout")
    timeout = float(timeout) if isinstance(timeout, int | float) else _ANCHOR_TIMEOUT
    for k, name in enumerate(log.names):
        size = heard[name].values.shape[1] if name in heard else states
        if name in log.truths and log.truths[name].values.shape[1] == size:
            truth[:, k, :size] = _exact(log.truths[name], grid)
            truth[:, k, size:] = 0.0
        if name in heard:
            series = heard[name]
            silence = _silence(series) if away_after is None else away_after
            last = np.searchsorted(series.times, grid, side="right") - 1
            present = (last >= 0) & (grid - series.times[last] <= silence)
            messages[:, k] = last + 1
            anchored = _anchored(series, last[present], grid[present], timeout)
            status[present, k] = np.where(anchored, "anchored", "relative")
            estimate[present, k, :size] = _between(series, grid[present], last[present], silence)
            estimate[present, k, size:] = 0.0
    run = Run(frozen(grid), truth, estimate, messages, status, log.names, "live", log.attributes)
    return _from(run, (first_known(run) or 0) if times is None else 0, log.network)


def first_known(run: Run) -> int | None:
    """Number of the first sample at which every node of ``run`` is known, or has been: its estimate, and its truth.

    Nodes that never speak do not count, nor those of the attribute ``joined``, which came later, nor does the truth of
    a node that has none. None where nobody ever is known.
    It decides where the run of a log and its report begin: before, an error would be that of part of the network.
    """
    truth = np.isfinite(run.truth).all(axis=2)
    known = (run.status != "away") & (truth | ~truth.any(axis=0))
    joined = run.attributes.get(JOINED, ())
    ever = known.any(axis=0) & np.array([name not in joined for name in run.names], dtype=bool)
    return int(known[:, ever].argmax(axis=0).max()) if ever.any() else None


def _from(run: Run, first: int, network: str) -> Run:
    """The samples from ``first`` on, time 0 being that one."""
    rest = slice(first, None)
    times = run.times[rest]
    attributes = {**run.attributes, "start": float(times[0]) if times.size else 0.0, "network": network}
    tables = run.truth[rest], run.estimate[rest], run.messages[rest], run.status[rest]
    return Run(frozen(times - times[:1]), *tables, run.names, run.path, attributes)


def restarts(series: Series) -> list[float]:
    """Times of the first estimate of every process but the first that sent ``series``."""
    epochs = series.epochs
    newer = np.flatnonzero(epochs[1:] > np.maximum.accumulate(epochs)[:-1]) + 1
    times: list[float] = series.times[newer].tolist()
    return times


def _ordered(series: Series) -> Series:
    """The messages by time, each instant once: they may have been overtaken on their way."""
    values = series.values
    _, order = np.unique(series.times, return_index=True)
    return Series(
        series.times[order],
        series.received[order],
        series.epochs[order],
        series.sequences[order],
        {name: column[order] for name, column in series.facts.items()},
        values[order].reshape(-1),
        np.arange(order.shape[0] + 1) * values.shape[1],
    )


def _given(times: ArrayLike) -> FloatArray:
    grid = as_floats("times", times)
    if grid.ndim != 1 or (np.diff(grid) <= 0.0).any():
        raise ArgumentError("times must be a list of increasing instants, in the log's own seconds")
    return grid


def _grid(log: Log, heard: dict[str, Series], room: int) -> FloatArray:
    """Instants from the first estimate to the end, when nodes that were still there begin to fall silent."""
    first = min(series.times[0] for series in heard.values())
    last = max(series.times[-1] for series in heard.values())
    end = min(series.times[-1] for series in heard.values() if last - series.times[-1] <= _silence(series))
    truths = [log.truths[name].times for name in log.names if name in log.truths]
    if truths:
        grid = np.unique(np.concatenate(truths))
        within = grid[(grid >= first) & (grid <= end)]
        grid = within if within.size else grid
        return grid[:: -(-grid.shape[0] // room)]
    count = max(len(series) for series in heard.values())
    return np.unique(np.linspace(first, end, min(room, count)))


def _exact(series: Series, grid: FloatArray) -> FloatArray:
    """The values at those instants of the ``grid`` that are its own; NaN at others."""
    series = _ordered(series)
    at = np.minimum(np.searchsorted(series.times, grid), len(series) - 1)
    return np.where((series.times[at] == grid)[:, None], series.values[at], np.nan)


def _silence(series: Series) -> float:
    """Seconds without an estimate after which a node counts as away."""
    steps = np.diff(series.times)
    return max(_LEAST_SILENCE, _PERIODS * float(np.median(steps)) if steps.size else 0.0)


def _anchored(series: Series, last: IntArray, grid: FloatArray, timeout: float) -> BoolArray:
    """Whether what each ``last`` estimate told of an anchor is fresh at the instant of the ``grid`` it stands for."""
    evidence = series.facts["evidence"][last]
    known: BoolArray = (evidence > 0.0) & (grid - evidence <= timeout)
    return known


def _between(series: Series, grid: FloatArray, last: IntArray, silence: float) -> FloatArray:
    """Cubic Hermite interpolation from ``last`` to the next estimate of the same process, else the last one held.

    No interval longer than ``silence`` is bridged. Slopes are those of the chords over two intervals (one at the ends),
    which keeps noise from being amplified where two estimates lie close together.
    """
    times, values, epochs = series.times, series.values, series.epochs
    count = len(series)
    after = np.minimum(last + 1, count - 1)
    same = (after > last) & (epochs[after] == epochs[last]) & (times[after] - times[last] <= silence)
    before = np.where((last > 0) & (epochs[np.maximum(last - 1, 0)] == epochs[last]), last - 1, last)
    beyond = np.minimum(after + 1, count - 1)
    beyond = np.where(epochs[beyond] == epochs[after], beyond, after)
    span = np.where(same, times[after] - times[last], 1.0)
    share = (np.where(same, grid - times[last], 0.0) / span)[:, None]
    run, next_run = times[after] - times[before], times[beyond] - times[last]
    with np.errstate(over="ignore", invalid="ignore"):  # a node that diverged may have said 1e308
        slope = (values[after] - values[before]) * (span / np.where(same, run, 1.0))[:, None]
        next_slope = (values[beyond] - values[last]) * (span / np.where(same, next_run, 1.0))[:, None]
        rise = values[after] - values[last]
        bend = slope + next_slope - 2.0 * rise
        moved = values[last] + share * (slope + share * (rise - slope - bend + share * bend))
    return np.where(same[:, None], moved, values[last])
