"""When things happen in a sampled run: exchanges at k h, and outputs in between."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from trigpoint.arrays import FloatArray

_SNAP = 1e-9


@dataclass(frozen=True)
class Tick:
    """One exchange: its number, and the outputs (index, time after the exchange) before the next one.

    Attributes:
        number: 0, 1, 2, ...
        outputs: (index, time after the exchange) of each.
        share: of the horizon that has been gone through, for a progress bar.
    """

    number: int
    outputs: tuple[tuple[int, float], ...]
    share: float = 0.0


def ticks(times: FloatArray, period: float) -> Iterator[Tick]:
    """Exchanges 0, 1, 2, ... up to the last output; times within 1e-9 periods of an exchange are moved onto it."""
    places = []
    for index, time in enumerate(times.tolist()):
        number = int(time / period + _SNAP)
        after = time - number * period
        places.append((number, index, 0.0 if abs(after) <= _SNAP * period else after))
    position = 0
    for number in range(places[-1][0] + 1):
        outputs = []
        while position < len(places) and places[position][0] == number:
            outputs.append(places[position][1:])
            position += 1
        yield Tick(number, tuple(outputs), number / (places[-1][0] or 1))
