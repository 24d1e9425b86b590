"""Recorded readings in a live run, instead of a simulated plant."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from trigpoint.errors import ArgumentError, FileFormatError, TrigpointError
from trigpoint.runtime.clock import Clock
from trigpoint.runtime.plan import LivePlan
from trigpoint.runtime.replay import read_readings
from trigpoint.runtime.sensors import Pace, Reading, ReadingPublisher, replay_readings
from trigpoint.runtime.transport import Transport

_LONGEST_WAIT = 20.0  # s for the nodes to be there; whoever is not by then misses the first readings


@dataclass(frozen=True)
class Record:
    """A file of readings that fit a network.

    Attributes:
        path: the file.
        speed: above 1 faster than recorded.
        silent: labels of the network that it holds no reading of.
    """

    path: Path
    speed: float
    silent: tuple[int, ...]


def record_of(path: Path, speed: float, plan: LivePlan) -> Record:
    """The record in ``path``, gone through once; every label must be one of the network's and have its length."""
    if not speed > 0.0:
        raise ArgumentError(f"--speed must be positive (1: as recorded, inf: at once); got {speed:g}")
    widths = _widths(plan)
    seen = set()
    for reading in read_readings(path):
        _check(path, reading, widths)
        seen.add(reading.label)
    return Record(path, speed, tuple(sorted(set(widths) - seen)))


def _widths(plan: LivePlan) -> dict[int, int]:
    """How many values the reading of each label has."""
    arcs = [arc for node in plan.nodes for arc in node.program.arcs]
    widths = {arc.label: int(arc.gain.shape[1]) for arc in arcs if arc.label is not None}
    return widths | {label: int(m.shape[1]) for node in plan.nodes for label, m in node.program.feedthrough}


def _check(path: Path, reading: Reading, widths: Mapping[int, int]) -> None:
    width = widths.get(reading.label)
    if width is None:
        known = ", ".join(str(label) for label in sorted(widths)[:12]) + (", ..." if len(widths) > 12 else "")
        raise FileFormatError(
            path, f"holds a reading of the arc {reading.label}, which the network lacks; its arcs are {known}"
        )
    if reading.values.shape != (width,):
        raise FileFormatError(
            path, f"holds a reading of the arc {reading.label} with {reading.values.shape[0]} values; expected {width}"
        )


class Player:
    """Publishes a record to the nodes of a plan, in a thread of its own, once they are there.

    Args:
        record: what is published.
        link: linked to the nodes, and to the monitor.
        publisher: speaks over it.
        clock: tells the time, and the time stamps.
    """

    def __init__(self, record: Record, link: Transport, publisher: ReadingPublisher, clock: Clock) -> None:
        self._record, self._link, self._publisher, self._clock = record, link, publisher, clock
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._asked: float | None = None
        self._trouble: TrigpointError | None = None

    @property
    def count(self) -> int:
        """Readings that were published."""
        return self._publisher.count

    def tick(self, ready: Callable[[], bool]) -> bool:
        """Begin when ``ready`` says that the nodes are there; whether the record is over.

        Raises:
            FileFormatError: the file was changed meanwhile.
        """
        if self._trouble is not None:
            raise self._trouble
        if self._thread is not None:
            return not self._thread.is_alive()
        now = self._clock.now()
        self._asked = now if self._asked is None else self._asked
        if ready() or now - self._asked > _LONGEST_WAIT:
            self._thread = threading.Thread(target=self._play, name="readings", daemon=True)
            self._thread.start()
        return False

    def close(self) -> None:
        """Stop where it is."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self._link.close()

    def _play(self) -> None:
        pace = Pace(self._clock.now, self._stop.wait)
        try:
            replay_readings(self._publisher, self._readings(), pace=pace, speed=self._record.speed)
        except TrigpointError as error:
            self._trouble = error

    def _readings(self) -> Iterator[Reading]:
        return read_readings(self._record.path)
