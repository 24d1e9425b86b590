"""When each node acts: its own period, phase and clock. Pure values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError, ShapeError


@dataclass(frozen=True, eq=False)
class Clocks:
    """The nodes' clocks; each number is one for all nodes, or one a node.

    Node i's clock shows ``offset_i + (1 + drift_i) t``. It acts at ``phase_i + k period_i`` by the rate of its own
    clock, up to ``jitter_i`` seconds late (uniform). It measures elapsed time and the age of messages by its clock.

    Args:
        period: seconds between two exchanges; the scenario's unless given.
        phase: seconds before the first one.
        offset: seconds by which the clock is wrong at time 0.
        drift: relative rate error, for example 1e-4.
        jitter: seconds.
    """

    period: FloatArray | None
    phase: FloatArray
    offset: FloatArray
    drift: FloatArray
    jitter: FloatArray

    def __init__(
        self,
        period: ArrayLike | None = None,
        *,
        phase: ArrayLike = 0.0,
        offset: ArrayLike = 0.0,
        drift: ArrayLike = 0.0,
        jitter: ArrayLike = 0.0,
    ) -> None:
        given = {"phase": phase, "offset": offset, "drift": drift, "jitter": jitter}
        if period is not None:
            given["period"] = period
        table = {name: np.atleast_1d(as_floats(name, value)) for name, value in given.items()}
        for name, least in (("period", 1e-300), ("phase", 0.0), ("jitter", 0.0)):
            if name in table and (table[name] < least).any():
                raise ArgumentError(f"{name} of a clock must be {'positive' if least else 'at least 0'}; got {given}")
        if (table["drift"] <= -1.0).any():
            raise ArgumentError(f"drift of a clock must be above -1; got {table['drift'].tolist()}")
        object.__setattr__(self, "period", table.get("period"))
        for name in ("phase", "offset", "drift", "jitter"):
            object.__setattr__(self, name, table[name])

    def of(self, count: int, period: float) -> list[Clock]:
        """One clock a node, for ``count`` nodes and the scenario's ``period``."""
        columns = []
        for name in ("period", "phase", "offset", "drift", "jitter"):
            value = getattr(self, name)
            value = np.array([period]) if value is None else value
            if value.shape not in ((1,), (count,)):
                raise ShapeError(f"{name} of the clocks must be one number or {count}; got shape {value.shape}")
            columns.append(np.broadcast_to(value, (count,)).tolist())
        return [Clock(*row) for row in zip(*columns, strict=True)]


@dataclass(frozen=True)
class Clock:
    """One node's clock: see ``Clocks``."""

    period: float
    phase: float
    offset: float
    drift: float
    jitter: float

    def shows(self, time: float) -> float:
        """What it shows at the true ``time``."""
        return self.offset + (1.0 + self.drift) * time

    def acts(self, rng: np.random.Generator) -> Iterator[float]:
        """True times at which the node acts; jitter is drawn from ``rng``, one number each."""
        number = 0
        while True:
            time = (self.phase + number * self.period) / (1.0 + self.drift)
            yield time + (self.jitter * float(rng.random()) if self.jitter else 0.0)
            number += 1
