"""The only clock of the live runtime: seconds since 1970 that never run backwards."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Protocol


class Clock(Protocol):
    """Tells the time; the protocol below never asks anybody else."""

    def now(self) -> float:
        """Seconds since 1970; never less than before."""
        ...


class SystemClock:
    """The machine's monotonic clock, set once to its wall clock.

    A wall clock that is corrected meanwhile changes nothing here: the processes of one run keep the offsets they
    started with, and nodes measure what these are. One that is started again by the same supervisor is told how its
    clock was set (``SET`` in its environment), else a correction in between would keep it apart from the others.

    Args:
        ahead: seconds by which it is ahead of the monotonic clock, which all processes of a machine share; None for
            the wall clock of now.
    """

    def __init__(self, ahead: float | None = None) -> None:
        self.ahead = time.time() - time.monotonic() if ahead is None else ahead

    def now(self) -> float:
        """Seconds since 1970 as this process knows them."""
        return self.ahead + time.monotonic()


SET = "TRIGPOINT_CLOCK_AHEAD"
"""Variable of the environment with the seconds by which a run's clock is ahead of the machine's monotonic one."""


def setting_of(clock: SystemClock) -> dict[str, str]:
    """What a process that shall have this ``clock``, to the last bit, needs in its environment."""
    return {SET: repr(clock.ahead)}


def told_clock(environment: Mapping[str, str]) -> SystemClock:
    """The clock that the ``environment`` tells of; the machine's where it tells of none."""
    try:
        ahead = float(environment.get(SET, "nan"))
    except ValueError:
        return SystemClock()
    return SystemClock(ahead if math.isfinite(ahead) else None)


def new_epoch(clock: Clock | None = None) -> int:
    """Nanoseconds since 1970 by this ``clock``, or the wall clock: larger for every later start of a process."""
    return time.time_ns() if clock is None else round(1e9 * clock.now())
