"""The simulated truth of a live run: a process that moves it on its own grid and publishes what sensors would read."""

from __future__ import annotations

import json
import queue
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray, decode_array, encode_array, frozen, transition_and_integral
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.runtime.clock import Clock
from trigpoint.runtime.codec import Frame, Kind, encode_frame
from trigpoint.runtime.endings import Order, listen_for_orders
from trigpoint.runtime.files import write_whole
from trigpoint.runtime.settings import Identity
from trigpoint.runtime.topics import reading_key, truth_key
from trigpoint.runtime.transport import Transport

KIND = "trigpoint/plant-settings"
VERSION = 1
_LARGEST_FILE = 1024**3


@dataclass(frozen=True, eq=False)
class Part:
    """An independent part of the true state: one agent, or a whole shared plant.

    Attributes:
        A: (n, n) dynamics.
        start: (n,) state at the plant's origin.
        noise: (n, n) factor of the process noise of one period, or None.
    """

    A: FloatArray
    start: FloatArray
    noise: FloatArray | None = None


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


@dataclass(frozen=True, eq=False)
class PlantSettings:
    """One simulated plant.

    Attributes:
        network: name of the network.
        name: the plant's own name, a guest of every node.
        period: seconds between two readings of every instrument.
        parts: the true state.
        instruments: what is read.
        shows: pairs of the name of a node and the number of the part that it estimates.
        seed: of the noise.
        origin: time of the parts' ``start``, seconds since 1970; None for when the process starts. A plant that is
            started again goes on where it would be by now (past process noise apart).
        peers: addresses to connect to, by name: the nodes, the monitor.
        listen: own address; empty for none.
        identity: certificates for TLS and QUIC.
    """

    network: str
    name: str
    period: float
    parts: tuple[Part, ...]
    instruments: tuple[Instrument, ...]
    shows: tuple[tuple[str, int], ...]
    seed: int = 0
    origin: float | None = None
    peers: Mapping[str, str] = field(default_factory=dict)
    listen: str = ""
    identity: Identity | None = None

    def __post_init__(self) -> None:
        """Check what a computation would trip over."""
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise ArgumentError(f"period of a plant must be a positive number of seconds; got {self.period}")
        numbers = [part for one in self.instruments for part, _ in one.rows] + [part for _, part in self.shows]
        if any(not 0 <= number < len(self.parts) for number in numbers):
            raise ArgumentError(f"a plant of {len(self.parts)} parts was asked for the part {max(numbers)}")
        for one in self.instruments:
            if not one.rows and one.recorded is None:
                raise ArgumentError(f"the instrument {one.label} reads nothing: give it rows or a recorded reading")

    def to_document(self) -> dict[str, Any]:
        """The settings as a JSON object."""
        return {
            "kind": KIND,
            "version": VERSION,
            "network": self.network,
            "name": self.name,
            "period": self.period,
            "parts": [[encode_array(one.A), encode_array(one.start), _maybe(one.noise)] for one in self.parts],
            "instruments": [
                {
                    "label": int(one.label),
                    "rows": [[int(part), encode_array(rows)] for part, rows in one.rows],
                    "deviation": float(one.deviation),
                    "recorded": _maybe(one.recorded),
                }
                for one in self.instruments
            ],
            "shows": [[name, int(part)] for name, part in self.shows],
            "seed": self.seed,
            "origin": self.origin,
            "peers": dict(self.peers),
            "listen": self.listen,
            "identity": None if self.identity is None else vars(self.identity),
        }

    @staticmethod
    def from_document(document: Any) -> PlantSettings:
        """Read settings; anything that does not fit is a ``ProtocolError``."""
        if not isinstance(document, dict) or document.get("kind") != KIND or document.get("version") != VERSION:
            raise ProtocolError(f"these are no plant settings: expected kind {KIND!r}, version {VERSION}")
        given = {key: value for key, value in document.items() if key not in ("kind", "version")}
        try:
            identity = given.get("identity")
            changed = {
                "parts": tuple(
                    Part(decode_array(A, "A"), decode_array(start, "start"), _array(noise))
                    for A, start, noise in given["parts"]
                ),
                "instruments": tuple(_instrument(one) for one in given["instruments"]),
                "shows": tuple((str(name), int(part)) for name, part in given["shows"]),
                "identity": None if identity is None else Identity(**identity),
            }
            return PlantSettings(**{**given, **changed})
        except (ArgumentError, AttributeError, KeyError, TypeError, ValueError) as error:
            raise ProtocolError(f"plant settings: {error}") from error


def write_plant(settings: PlantSettings, path: Path) -> None:
    """Write the plant's ``settings`` to ``path``, readable by its owner only: they hold the truth."""
    write_whole(path, json.dumps(settings.to_document()).encode("utf-8"))


def read_plant(path: Path) -> PlantSettings:
    """Read the plant's settings in ``path``; a damaged file is a ``FileFormatError``."""
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise FileFormatError(path, f"plant settings have at most {_LARGEST_FILE} bytes")
        return PlantSettings.from_document(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, RecursionError, ValueError) as error:
        raise FileFormatError(path, f"no plant settings: {error}") from error


class SimulatedPlant:
    """The truth as it moves; no clock and no socket in it.

    Args:
        settings: what it is made of.
        epoch: of the frames it makes.
        origin: time of the parts' start.
    """

    def __init__(self, settings: PlantSettings, *, epoch: int, origin: float) -> None:
        self._settings, self._epoch, self._origin = settings, epoch, origin
        self._rng = np.random.default_rng([settings.seed, epoch])
        self._step, self._sequence = 0, 0
        self._state = [np.array(part.start) for part in settings.parts]
        self._known: dict[tuple[bytes, float], FloatArray] = {}

    @property
    def time(self) -> float:
        """The instant of the present state."""
        return self._origin + self._step * self._settings.period

    @property
    def state(self) -> list[FloatArray]:
        """The true state, part by part."""
        return self._state

    def advance(self, step: int) -> None:
        """Move the truth on to the grid's point number ``step``."""
        count = step - self._step
        if count <= 0:
            return
        noisy = count < 1000 and any(part.noise is not None for part in self._settings.parts)
        for _ in range(count if noisy else 1):
            duration = self._settings.period * (1 if noisy else count)
            for k, part in enumerate(self._settings.parts):
                moved = self._transition(part.A, duration) @ self._state[k]
                if noisy and part.noise is not None:
                    moved = moved + part.noise @ self._rng.standard_normal(part.noise.shape[1])
                self._state[k] = moved
        self._step = step

    def _transition(self, A: FloatArray, duration: float) -> FloatArray:
        key = A.tobytes(), duration
        if key not in self._known:
            if len(self._known) > 256:
                self._known.clear()
            self._known[key] = transition_and_integral(A, duration)[0]
        return self._known[key]

    def read(self, instrument: Instrument) -> FloatArray:
        """One reading of the present state, with fresh noise."""
        value = instrument.recorded
        if value is None:
            value = np.asarray(sum(rows @ self._state[part] for part, rows in instrument.rows))
        if instrument.deviation:
            value = value + instrument.deviation * self._rng.standard_normal(value.shape)
        return value

    def frames(self) -> Iterator[tuple[str, bytes]]:
        """Key and bytes of every reading and of the truth of every node, now."""
        settings, time = self._settings, self.time
        for one in settings.instruments:
            frame = Frame(
                Kind.READING, settings.name, self._epoch, self._sequence, time, (float(one.label),), self.read(one)
            )  # fmt: skip
            self._sequence += 1
            yield reading_key(settings.network, one.label), encode_frame(frame)
        for name, part in settings.shows:
            frame = Frame(Kind.TRUTH, name, self._epoch, self._step, time, (), frozen(self._state[part]))
            yield truth_key(settings.network, name), encode_frame(frame)


class PlantLoop:
    """Publishes on the grid ``origin + k period`` until it is told to stop; points that were missed are left out.

    Args:
        settings, transport, clock: what to publish, where, when.
        epoch: of the frames.
    """

    def __init__(self, settings: PlantSettings, transport: Transport, clock: Clock, *, epoch: int) -> None:
        self._settings, self._transport, self._clock = settings, transport, clock
        origin = clock.now() if settings.origin is None else settings.origin
        self._origin = origin
        self._plant = SimulatedPlant(settings, epoch=epoch, origin=origin)
        self._orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
        self.missed = 0

    def tell(self, order: Order) -> None:
        """Take an order, from any thread."""
        self._orders.put(order)

    def run(self, *, tied: bool = False) -> None:
        """Go on until told to stop (or, ``tied``, until standard input ends)."""
        listen_for_orders(self.tell, tied=tied)
        period = self._settings.period
        step = max(0, int(np.ceil((self._clock.now() - self._origin) / period)))
        while True:
            wait = self._origin + step * period - self._clock.now()
            try:
                order = self._orders.get(timeout=max(0.0, wait)) if wait > 0.0 else self._orders.get_nowait()
            except queue.Empty:
                self._plant.advance(step)
                for key, data in self._plant.frames():
                    self._transport.publish(key, data)
                late = max(0, int((self._clock.now() - self._origin) / period) - step - 1)
                self.missed += late
                step += 1 + late
                continue
            if order is Order.STOP:
                return


def _maybe(array: FloatArray | None) -> dict[str, Any] | None:
    return None if array is None else encode_array(array)


def _array(document: Any) -> FloatArray | None:
    return None if document is None else decode_array(document)


def _instrument(given: Mapping[str, Any]) -> Instrument:
    rows = tuple((int(part), decode_array(matrix, "rows")) for part, matrix in given["rows"])
    return Instrument(int(given["label"]), rows, float(given["deviation"]), _array(given["recorded"]))
