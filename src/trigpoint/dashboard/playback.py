"""Playing, pausing and seeking as a pure value: no clock and no socket in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.dashboard.commands import whole
from trigpoint.errors import ArgumentError, ProtocolError

_FASTEST = 1e6


@dataclass(frozen=True, eq=False)
class Playback:
    """Where a replay of the samples at ``times`` stands.

    ``clock`` counts in the run's own seconds, ``speed`` of them a second while ``playing``.
    """

    times: FloatArray
    speed: float
    clock: float
    playing: bool

    @staticmethod
    def start(times: FloatArray, speed: float) -> Playback:
        """Begin at the first sample, playing."""
        if not (math.isfinite(speed) and 0.0 < speed <= _FASTEST):
            raise ArgumentError(
                f"speed must be positive and at most {_FASTEST:g} (1 is the run's own time); got {speed}"
            )
        return Playback(times, float(speed), float(times[0]), playing=times.shape[0] > 1)

    @property
    def index(self) -> int:
        """The last sample at or before the clock."""
        return max(0, int(np.searchsorted(self.times, self.clock, side="right")) - 1)

    @property
    def wait(self) -> float:
        """Seconds of real time until the next sample is due; infinite while paused."""
        if not self.playing:
            return math.inf
        following = min(self.index + 1, self.times.shape[0] - 1)
        return max(0.0, float(self.times[following]) - self.clock) / self.speed

    def advanced(self, seconds: float) -> Playback:
        """Let real time pass; stop at the last sample."""
        if not self.playing:
            return self
        end = float(self.times[-1])
        clock = min(self.clock + seconds * self.speed, end)
        return replace(self, clock=clock, playing=clock < end)

    def obeying(self, command: Mapping[str, Any]) -> Playback:
        """Apply one ``command`` (play, pause, seek, speed); play at the end begins again."""
        match command["type"]:
            case "play":
                at_end = self.index == self.times.shape[0] - 1
                return replace(self, clock=float(self.times[0]) if at_end else self.clock, playing=True)
            case "pause":
                return replace(self, playing=False)
            case "seek":
                return replace(self, clock=float(self.times[whole(command, "frame", self.times.shape[0])]))
            case _:
                return replace(self, speed=_speed(command["value"]))


def _speed(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value <= _FASTEST:
        raise ProtocolError(f"speed must be a positive number of at most {_FASTEST:g}; got {str(value)[:40]}")
    return float(value)
