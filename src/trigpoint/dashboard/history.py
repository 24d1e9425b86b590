"""A live run's past in bounded memory: when it is full, every second sample goes, and fewer are kept from then on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trigpoint.arrays import FloatArray

_MOST_SAMPLES = 4000
_FEWEST_SAMPLES = 100


class History:
    """Samples of every node from the first to the latest.

    Args:
        nodes: N.
        states: n, the longest estimate of a node; shorter ones end with NaN.
        budget: bytes that the tables may take; at least 100 and at most 4000 samples are kept whatever it is.
    """

    def __init__(self, nodes: int, states: int, budget: int = 64 * 2**20) -> None:
        row = np.dtype([
            ("time", "f8"), ("norm", "f8"),
            ("estimate", "f4", (nodes, states)), ("truth", "f4", (nodes, states)),
            ("error", "f4", (nodes,)), ("uncertainty", "f4", (nodes,)),
        ])  # fmt: skip
        samples = min(_MOST_SAMPLES, max(_FEWEST_SAMPLES, budget // row.itemsize))
        self._rows: NDArray[Any] = np.empty(samples - samples % 2, dtype=row)
        self.states = states
        self._nodes = nodes
        self._count = 0
        self._stride = 1
        self._seen = 0

    def grown(self, nodes: int) -> History:
        """The same samples with room for this many ``nodes``; of the new ones nothing is known."""
        found, count, before = History(nodes, self.states, 0), self._count, self._nodes
        found._rows = np.empty(self.capacity, dtype=found._rows.dtype)
        found._count, found._stride, found._seen = count, self._stride, self._seen
        for name in ("time", "norm"):
            found._rows[name][:count] = self._rows[name][:count]
        for name in ("estimate", "truth", "error", "uncertainty"):
            found._rows[name][:count] = np.nan
            found._rows[name][:count, :before] = self._rows[name][:count]
        return found

    @property
    def capacity(self) -> int:
        """Samples that fit."""
        return int(self._rows.shape[0])

    @property
    def stride(self) -> int:
        """Of how many samples one is kept now."""
        return self._stride

    def append(self, **row: Any) -> None:
        """Keep one sample (``time``, ``norm``, ``estimate``, ``truth``, ``error``, ``uncertainty``), if it is due."""
        due = self._seen % self._stride == 0
        self._seen += 1
        if not due:
            return
        if self._count == self.capacity:
            half = self.capacity // 2
            self._rows[:half] = self._rows[::2].copy()
            self._count, self._stride = half, 2 * self._stride
        # after halving, the sample at hand continues the wider grid: the capacity is even and the count a multiple
        with np.errstate(over="ignore"):  # beyond float32 a diverged estimate is infinite
            for name, value in row.items():
                self._rows[name][self._count] = value
        self._count += 1

    def column(self, name: str) -> FloatArray:
        """(T,) ``time`` or ``norm``."""
        return self._rows[name][: self._count].astype(np.float64)

    def of_node(self, name: str, node: int) -> FloatArray:
        """(T,) or (T, n) samples of the table ``name`` for ``node``."""
        return self._rows[name][: self._count, node].astype(np.float64)
