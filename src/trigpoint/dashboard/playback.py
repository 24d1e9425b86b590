"""Playing, pausing and seeking as a pure value: no clock and no socket in it.

Commands are JSON objects from the page::

    {"type": "play"} | {"type": "pause"} | {"type": "seek", "frame": k} | {"type": "speed", "value": s}
    {"type": "trace", "node": i}        answered by the whole error history of node i; changes nothing
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, ProtocolError

_FASTEST = 1e6
_KEYS = {"play": set(), "pause": set(), "seek": {"frame"}, "speed": {"value"}, "trace": {"node"}}


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
        """Apply one command; play at the end begins again."""
        match command["type"]:
            case "play":
                at_end = self.index == self.times.shape[0] - 1
                return replace(self, clock=float(self.times[0]) if at_end else self.clock, playing=True)
            case "pause":
                return replace(self, playing=False)
            case "seek":
                return replace(self, clock=float(self.times[_whole(command, "frame", self.times.shape[0])]))
            case "speed":
                return replace(self, speed=_speed(command["value"]))
            case _:
                return self


def decode_command(text: str) -> dict[str, Any]:
    """Read one command; anything else is a ``ProtocolError`` that says why."""
    try:
        command = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"a command must be JSON ({error})") from error
    kind = command.get("type") if isinstance(command, dict) else None
    if not isinstance(kind, str) or kind not in _KEYS:
        raise ProtocolError(f"a command must be an object of type {', '.join(_KEYS)}")
    if set(command) != {"type", *_KEYS[kind]}:
        raise ProtocolError(f"the command {kind} has the keys {', '.join(['type', *sorted(_KEYS[kind])])}, no other")
    return dict(command)


def _whole(command: Mapping[str, Any], key: str, count: int) -> int:
    value = command[key]
    if type(value) is not int or not 0 <= value < count:
        raise ProtocolError(f"{key} must be a whole number, 0 <= {key} < {count}; got {str(value)[:40]}")
    return value


def traced_node(command: Mapping[str, Any], count: int) -> int:
    """Return the node that a trace command asks for."""
    return _whole(command, "node", count)


def _speed(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value <= _FASTEST:
        raise ProtocolError(f"speed must be a positive number of at most {_FASTEST:g}; got {str(value)[:40]}")
    return float(value)
