"""The truth that nodes estimate: how it moves, its noise, and what instruments read of it.

One definition for the process of ``trigpoint run`` and for runs in memory; no clock and no socket in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trigpoint.arrays import FloatArray, transition_and_integral
from trigpoint.errors import ArgumentError
from trigpoint.observers.local import LocalObserver

_KEPT = 64
_MOST_POINTS = 1000
_SNAP = 1e-6


class Plant(Protocol):
    """Moves by itself and is read. One object, changed by ``move`` alone."""

    def move(self, time: float) -> None:
        """Go on to ``time`` [s], which is not before the last one."""
        ...

    def truth(self) -> Sequence[FloatArray]:
        """What each node should estimate now, in the order of the nodes."""
        ...

    def readings(self) -> Mapping[int, FloatArray]:
        """The reading of every arc now, by label."""
        ...


@dataclass(frozen=True, eq=False)
class Part:
    """An independent part of the true state: one agent, or a whole shared plant, ``x' = A x + b``.

    Attributes:
        A: (n, n) dynamics.
        start: (n,) state at time 0.
        noise: (n, m) factor of the process noise of one period, or None.
        drive: (n,) b, constant; None for none.
    """

    A: FloatArray
    start: FloatArray
    noise: FloatArray | None = None
    drive: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Instrument:
    """One arc's sensor: ``y = sum of rows @ x_part`` plus noise, or a recorded reading that never changes.

    Attributes:
        label: number of the arc.
        rows: pairs of the number of a part and the (p, n) rows that it is multiplied by.
        deviation: standard deviation of the noise of each reading.
        recorded: (p,) the reading where it is not simulated.
    """

    label: int
    rows: tuple[tuple[int, FloatArray], ...]
    deviation: float = 0.0
    recorded: FloatArray | None = None


class LinearPlant:
    """Parts that move exactly, disturbed once a period, and instruments that read sums of rows times states.

    Args:
        parts: the true state.
        instruments: what is read.
        shows: number of the part that each node estimates; None: the nodes are the parts, in order.
        period: seconds between two disturbances of the parts that have process noise: at every multiple of it.
        seed: of all noise.

    Raises:
        ArgumentError: a start of another length than its dynamics, a part that does not exist, an instrument that reads
            nothing, process noise without a period.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        instruments: Sequence[Instrument],
        *,
        shows: Sequence[int] | None = None,
        period: float | None = None,
        seed: int | Sequence[int] = 0,
    ) -> None:
        self._shows = tuple(range(len(parts)) if shows is None else shows)
        check_parts(parts, instruments, self._shows)
        self._noisy = [(k, part.noise) for k, part in enumerate(parts) if part.noise is not None]
        if self._noisy and period is None:
            raise ArgumentError("process noise is that of one period: say how many seconds it has (period)")
        self._parts, self._instruments, self._period = tuple(parts), tuple(instruments), period
        self._state = [np.array(part.start, dtype=np.float64) for part in parts]
        self._drives = [np.zeros(len(part.start)) if part.drive is None else part.drive for part in parts]
        self._rng = np.random.default_rng(seed)
        self._maps: dict[tuple[bytes, float], tuple[FloatArray, FloatArray]] = {}
        self._groups: dict[bytes, list[int]] = {}
        for place, part in enumerate(self._parts):
            self._groups.setdefault(part.A.tobytes(), []).append(place)
        self._now = 0.0

    @staticmethod
    def of(
        programs: Sequence[LocalObserver],
        start: Sequence[FloatArray],
        *,
        inputs: Mapping[str, FloatArray] | None = None,
        deviations: Mapping[int, float] | None = None,
        seed: int = 0,
    ) -> LinearPlant:
        """The plant that these ``programs`` believe in: each node's own agent, readings as their arcs use them.

        Args:
            programs: of all nodes.
            start: (n,) of each agent at time 0.
            inputs: u of the nodes that have one, by name.
            deviations: standard deviation of each reading, by label; exact where not given.
            seed: of the readings' errors.
        """
        places = {program.name: k for k, program in enumerate(programs)}
        given, spread = inputs or {}, deviations or {}
        arcs: dict[int, Instrument] = {}
        for program in programs:
            for arc in program.arcs:
                if arc.label is None or arc.label in arcs:
                    continue
                rows = [(places[program.name], arc.sign * arc.output)]
                rows += [(places[name], -arc.sign * seen) for name, seen in arc.heard]
                arcs[arc.label] = Instrument(arc.label, tuple(rows), spread.get(arc.label, 0.0))
        drives = [
            None if program.B is None or program.name not in given else program.B @ given[program.name]
            for program in programs
        ]  # fmt: skip
        parts = [
            Part(program.A, first, drive=drive) for program, first, drive in zip(programs, start, drives, strict=True)
        ]
        return LinearPlant(parts, list(arcs.values()), seed=seed)

    def move(self, time: float) -> None:
        """Go on to ``time`` [s]; a leap over more than 1000 periods leaves their process noise out."""
        if time <= self._now:
            return
        if self._noisy and self._period is not None:
            first, last = (int(moment / self._period + _SNAP) for moment in (self._now, time))
            for point in range(first + 1, last + 1) if last - first < _MOST_POINTS else ():
                self._go(point * self._period)
                for k, factor in self._noisy:
                    self._state[k] = self._state[k] + factor @ self._rng.standard_normal(factor.shape[1])
        self._go(time)

    def _go(self, time: float) -> None:
        if time <= self._now:
            return
        duration = float(f"{time - self._now:.12g}")  # equal steps of a time axis differ in their last digits only
        for known, places in self._groups.items():
            key = (known, duration)
            if key not in self._maps:
                if len(self._maps) > _KEPT * len(self._groups):
                    self._maps.clear()
                self._maps[key] = transition_and_integral(self._parts[places[0]].A, duration)
            transition, integral = self._maps[key]
            states, drives = (np.array([rows[k] for k in places]) for rows in (self._state, self._drives))
            for k, moved in zip(places, states @ transition.T + drives @ integral.T, strict=True):
                self._state[k] = moved
        self._now = time

    @property
    def state(self) -> tuple[FloatArray, ...]:
        """The true state, part by part."""
        return tuple(state.copy() for state in self._state)

    def truth(self) -> list[FloatArray]:
        """What each node should estimate now."""
        return [self._state[part].copy() for part in self._shows]

    def readings(self) -> dict[int, FloatArray]:
        """All readings now, with errors drawn anew."""
        return {one.label: self.read(one) for one in self._instruments}

    def read(self, instrument: Instrument) -> FloatArray:
        """One reading of the present state by ``instrument``, with an error drawn anew."""
        value = instrument.recorded
        if value is None:
            value = np.asarray(sum(rows @ self._state[part] for part, rows in instrument.rows), dtype=np.float64)
        if instrument.deviation:
            value = value + instrument.deviation * self._rng.standard_normal(value.shape)
        return value


def check_parts(parts: Sequence[Part], instruments: Sequence[Instrument], shows: Sequence[int]) -> None:
    """Refuse parts, instruments and a list of shown parts that do not fit each other.

    Args:
        parts, instruments, shows: as in ``LinearPlant``.

    Raises:
        ArgumentError: see there.
    """
    for k, part in enumerate(parts):
        n = np.size(part.start)
        drive = (n,) if part.drive is None else np.shape(part.drive)
        factor = (n, 0) if part.noise is None else np.shape(part.noise)
        shapes = np.shape(part.A), np.shape(part.start), drive, factor[:1]
        if shapes != ((n, n), (n,), (n,), (n,)) or len(factor) != 2:
            raise ArgumentError(
                f"part {k} of a plant: A, start, drive and noise must have the shapes (n, n), (n,), (n,), (n, m); got "
                f"{np.shape(part.A)}, {np.shape(part.start)}, {drive}, {factor}"
            )
    numbers = [number for one in instruments for number, _ in one.rows] + list(shows)
    if any(not 0 <= number < len(parts) for number in numbers):
        raise ArgumentError(f"a plant of {len(parts)} parts was asked for the part {max(numbers)}")
    for one in instruments:
        if not one.rows and one.recorded is None:
            raise ArgumentError(f"the instrument {one.label} reads nothing: give it rows or a recorded reading")
        for number, rows in one.rows:
            size = np.size(parts[number].start)
            if np.ndim(rows) != 2 or np.shape(rows)[1] != size:
                raise ArgumentError(
                    f"the instrument {one.label} reads the part {number} of {size} states by rows "
                    f"of the shape {np.shape(rows)}"
                )
