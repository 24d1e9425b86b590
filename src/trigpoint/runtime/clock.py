"""The only clock of the live runtime: seconds since 1970 that never run backwards."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Tells the time; the protocol below never asks anybody else."""

    def now(self) -> float:
        """Seconds since 1970; never less than before."""
        ...


class SystemClock:
    """The machine's monotonic clock, set once to its wall clock.

    A wall clock that is corrected meanwhile changes nothing here: the processes of one run keep the offsets they
    started with, and nodes measure what these are.
    """

    def __init__(self) -> None:
        self._start = time.time() - time.monotonic()

    def now(self) -> float:
        """Seconds since 1970 as this process knows them."""
        return self._start + time.monotonic()


def new_epoch() -> int:
    """A number that is larger for every later start of a process: nanoseconds since 1970."""
    return time.time_ns()
