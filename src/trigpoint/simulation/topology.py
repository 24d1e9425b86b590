"""Which arcs work when, and which nodes are away. Pure values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import BoolArray, FloatArray, as_floats
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import MeasurementGraph


@dataclass(frozen=True, eq=False)
class Topology:
    """Arcs that work from ``times[k]`` to before ``times[k + 1]``; before the first time as after it.

    An arc that does not work gives no reading and carries no message.

    Args:
        times: (K,) ascending seconds.
        active: (K, M) which of the problem's arcs work.
    """

    times: FloatArray
    active: BoolArray

    def __init__(self, times: ArrayLike, active: ArrayLike) -> None:
        instants = np.atleast_1d(as_floats("times", times))
        table = np.asarray(active)
        if instants.ndim != 1 or (np.diff(instants) <= 0).any():
            raise ArgumentError("times of a topology must ascend")
        if table.dtype != np.bool_ or table.ndim != 2 or table.shape[0] != instants.shape[0]:
            raise ShapeError(
                f"active must be true or false, one row a time and one column an arc; got {table.dtype} {table.shape} "
                f"for {instants.shape[0]} times"
            )
        object.__setattr__(self, "times", instants)
        object.__setattr__(self, "active", np.array(table))
        self.active.setflags(write=False)

    @staticmethod
    def random(n_arcs: int, dwell: float, arrival: float, until: float, seed: int = 0) -> Topology:
        """Every ``dwell`` seconds each of ``n_arcs`` arcs works with probability ``arrival``, drawn anew.

        Args: ``until``, seconds to cover; ``seed`` of the draw. Source: theory 6-F4.
        """
        if not (dwell > 0.0 and until >= 0.0 and 0.0 < arrival <= 1.0):
            raise ArgumentError(
                f"a random topology needs dwell > 0, until >= 0, 0 < arrival <= 1; got {dwell}, {until}, {arrival}"
            )
        count = int(np.floor(until / dwell * (1.0 + 1e-12))) + 1
        draws = np.random.default_rng(seed).random((count, n_arcs)) < arrival
        return Topology(dwell * np.arange(count), draws)

    @staticmethod
    def schedule(graph: MeasurementGraph, changes: Sequence[tuple[float, Sequence[int]]]) -> Topology:
        """From each time on the arcs listed beside it work: ``changes`` are (seconds, arc numbers of ``graph``)."""
        active = np.zeros((len(changes), graph.n_arcs), dtype=bool)
        for row, (_, arcs) in enumerate(changes):
            if any(not 0 <= arc < graph.n_arcs for arc in arcs):
                raise ArgumentError(f"arcs of a schedule must be numbers from 0 to {graph.n_arcs - 1}; got {arcs}")
            active[row, list(arcs)] = True
        return Topology([time for time, _ in changes], active)

    def at(self, time: float) -> BoolArray:
        """(M,) which arcs work at ``time``; changes count from a billionth of a second before."""
        row = int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1
        return np.asarray(self.active[max(row, 0)])

    def graph_at(self, graph: MeasurementGraph, time: float) -> MeasurementGraph:
        """The part of ``graph`` that works at ``time``."""
        return graph.without_arcs(np.flatnonzero(~self.at(time)))


@dataclass(frozen=True)
class Absence:
    """A node that is away from ``start`` to before ``stop`` [s] and comes back with an empty state (zero).

    Args:
        node: its index.
        start: seconds; 0 for a node that joins late.
        stop: seconds; infinity for one that leaves for good.
    """

    node: int
    start: float
    stop: float = float("inf")

    def __post_init__(self) -> None:
        """Check the interval."""
        if not (self.node >= 0 and np.isfinite(self.start) and self.start < self.stop):
            raise ArgumentError(f"an absence needs a node and start < stop; got {self}")


def is_away(absences: Sequence[Absence], node: int, time: float) -> bool:
    """True where one of the ``absences`` holds for the ``node`` at ``time``."""
    return any(one.node == node and one.start - 1e-9 <= time < one.stop - 1e-9 for one in absences)


def with_absences(graph: MeasurementGraph, topology: Topology | None, absences: Sequence[Absence]) -> Topology | None:
    """The ``topology`` of ``graph`` in which absent nodes' arcs do not work; None where all arcs always work."""
    if not absences:
        return topology
    base = Topology([0.0], np.ones((1, graph.n_arcs), dtype=bool)) if topology is None else topology
    instants = {*base.times.tolist(), *(one.start for one in absences)}
    instants |= {one.stop for one in absences if np.isfinite(one.stop)}
    times, ends = np.array(sorted(instants)), abs(graph.incidence()).tocsr()
    rows = []
    for time in times.tolist():
        away = np.array([is_away(absences, node, time) for node in range(graph.n_nodes)])
        touched = np.asarray(ends[away].sum(axis=0)).ravel() > 0.0
        rows.append(base.at(time) & ~touched)
    return Topology(times, np.array(rows))
