"""Readings from outside: a Python function or a recorded file, published as a simulated plant publishes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError
from trigpoint.runtime.codec import Frame, Kind, encode_frame
from trigpoint.runtime.topics import reading_key
from trigpoint.runtime.transport import Transport

LARGEST_LABEL = 2**53
"""Labels travel as f64."""


@dataclass(frozen=True, eq=False)
class Reading:
    """What the arc ``label`` measured (``values``, (p,)) at ``time`` [s]."""

    time: float
    label: int
    values: FloatArray

    def __post_init__(self) -> None:
        """Check every number once."""
        values = np.atleast_1d(as_floats("values", self.values))
        if values.ndim != 1 or not values.size:
            raise ArgumentError(f"values of a reading must be a vector of at least one number; got {values.shape}")
        if not np.isfinite(self.time):
            raise ArgumentError(f"the time of a reading must be finite; got {self.time}")
        if not 0 <= self.label < LARGEST_LABEL:
            raise ArgumentError(f"the label of a reading must be the number of an arc; got {self.label}")
        object.__setattr__(self, "values", values)


@dataclass(frozen=True)
class Pace:
    """Where readings get their time from.

    Attributes:
        now: seconds since 1970 (``SystemClock().now``).
        wait: waits for that many seconds, and returns True when it is time to stop (``threading.Event().wait``).
    """

    now: Callable[[], float]
    wait: Callable[[float], bool]


class ReadingPublisher:
    """Publishes readings over a ``transport`` as the sensor ``name`` of a ``network``.

    The nodes must know ``name`` as a guest with the role ``sensor``. Frames are numbered over all labels, so that a
    reading that comes late or twice is dropped by whoever hears it.

    Args:
        transport: linked to the nodes that need the readings.
        network: name of the network.
        name: name of the sensor.
        epoch: when this sensor started, nanoseconds since 1970 (``time.time_ns()``).
    """

    def __init__(self, transport: Transport, network: str, name: str, *, epoch: int) -> None:
        self._transport, self._network, self._name, self._epoch = transport, network, name, epoch
        self._sequence = 0

    @property
    def count(self) -> int:
        """Readings that were published."""
        return self._sequence

    def publish(self, reading: Reading) -> None:
        """Send one ``reading``; its time is what the receivers take for the instant of the measurement."""
        frame = Frame(
            Kind.READING,
            self._name,
            self._epoch,
            self._sequence,
            float(reading.time),
            (float(reading.label),),
            reading.values,
        )
        self._transport.publish(reading_key(self._network, reading.label), encode_frame(frame))
        self._sequence += 1


def publish_measured(
    publisher: ReadingPublisher,
    measure: Callable[[float], Mapping[int, ArrayLike]],
    *,
    period: float,
    pace: Pace,
) -> int:
    """Call ``measure`` with the time every ``period`` seconds, and publish what it returns, until told to stop.

    The instants are ``start + k period``; those that were missed since a call took too long are left out.

    Args:
        publisher: where the readings go.
        measure: from the time [s] to readings by label; an empty mapping where there is nothing to say.
        period: seconds.
        pace: time, and the sign to stop.

    Returns:
        the number of readings that were published.

    Raises:
        ArgumentError: ``period`` is not positive, or a reading is not made of finite numbers.
    """
    if not (np.isfinite(period) and period > 0.0):
        raise ArgumentError(f"period must be a positive number of seconds; got {period}")
    before, start, k = publisher.count, pace.now(), 0
    while not pace.wait(max(0.0, start + k * period - pace.now())):
        time = pace.now()
        for label, values in measure(time).items():
            publisher.publish(Reading(time, label, as_floats("values", values)))
        k = max(k + 1, int(np.ceil((pace.now() - start) / period)))
    return publisher.count - before


def replay_readings(publisher: ReadingPublisher, readings: Iterable[Reading], *, pace: Pace, speed: float = 1.0) -> int:
    """Publish recorded ``readings`` again, ``speed`` times as fast, until their end or until told to stop.

    The reading recorded at t is published, and stamped, at ``start + (t - t_0) / speed``, with t_0 the time of the
    first; one that is overdue is published at once with that stamp. With an infinite speed everything is published at
    once and stamped with the time of publishing.

    We assume:
        - the agents are as fast as the file: at another speed than 1 their dynamics do not fit the readings, unless
          they are constants.

    Args:
        publisher: where the readings go.
        readings: in the order in which they shall be published (``read_readings``).
        pace: time, and the sign to stop.
        speed: above 1 faster than recorded.

    Returns:
        the number of readings that were published.

    Raises:
        ArgumentError: ``speed`` is not positive.
    """
    if not speed > 0.0:
        raise ArgumentError(f"speed must be positive (1: as recorded, inf: at once); got {speed}")
    before, start, first = publisher.count, pace.now(), None
    for reading in readings:
        first = reading.time if first is None else first
        due = pace.now() if np.isinf(speed) else start + (reading.time - first) / speed
        if pace.wait(max(0.0, due - pace.now())):
            break
        publisher.publish(Reading(due, reading.label, reading.values))
    return publisher.count - before
