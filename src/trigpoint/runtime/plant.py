"""The plant of a live run: a process that moves the truth on its own grid and publishes what sensors would read."""

from __future__ import annotations

import json
import queue
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray, decode_array, encode_array, frozen
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.runtime.clock import Clock
from trigpoint.runtime.codec import Frame, Kind, encode_frame
from trigpoint.runtime.endings import Order, listen_for_orders
from trigpoint.runtime.files import write_whole
from trigpoint.runtime.settings import Identity
from trigpoint.runtime.topics import reading_key, truth_key
from trigpoint.runtime.transport import Transport
from trigpoint.runtime.truth import Instrument, LinearPlant, Part, check_parts

KIND = "trigpoint/plant-settings"
VERSION = 1
_LARGEST_FILE = 1024**3


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
        listen: own address, for guests; empty for none. Nodes do not know it.
        guests: names that may connect there and hear the truth, with the role ``monitor`` of each.
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
    guests: Mapping[str, str] = field(default_factory=dict)
    identity: Identity | None = None

    def __post_init__(self) -> None:
        """Check what a computation would trip over."""
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise ArgumentError(f"period of a plant must be a positive number of seconds; got {self.period}")
        check_parts(self.parts, self.instruments, [part for _, part in self.shows])

    def truth(self, *, epoch: int = 0) -> LinearPlant:
        """The truth of these settings, at the start; the noise is that of the seed and of the process (``epoch``)."""
        shows = [part for _, part in self.shows]
        return LinearPlant(self.parts, self.instruments, shows=shows, period=self.period, seed=[self.seed, epoch])

    def to_document(self) -> dict[str, Any]:
        """The settings as a JSON object."""
        return {
            "kind": KIND,
            "version": VERSION,
            "network": self.network,
            "name": self.name,
            "period": self.period,
            "parts": [
                [encode_array(one.A), encode_array(one.start), _maybe(one.noise), _maybe(one.drive)]
                for one in self.parts
            ],
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
            "guests": dict(self.guests),
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
                    Part(decode_array(A, "A"), decode_array(start, "start"), _array(noise), _array(drive))
                    for A, start, noise, drive in given["parts"]
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
    """What a plant publishes, instant by instant of its grid: the frames of a ``LinearPlant``.

    Args:
        settings: what it is made of.
        epoch: of the frames it makes.
        origin: time of the parts' start.
    """

    def __init__(self, settings: PlantSettings, *, epoch: int, origin: float) -> None:
        self._settings, self._epoch, self._origin = settings, epoch, origin
        self._truth = settings.truth(epoch=epoch)
        self._step, self._sequence = 0, 0

    @property
    def time(self) -> float:
        """The instant of the present state."""
        return self._origin + self._step * self._settings.period

    @property
    def state(self) -> tuple[FloatArray, ...]:
        """The true state, part by part."""
        return self._truth.state

    def advance(self, step: int) -> None:
        """Move the truth on to the grid's point number ``step``."""
        if step > self._step:
            self._truth.move(step * self._settings.period)
            self._step = step

    def frames(self) -> Iterator[tuple[str, bytes]]:
        """Key and bytes of every reading and of the truth of every node, now."""
        settings, time = self._settings, self.time
        for label, value in self._truth.readings().items():
            frame = Frame(Kind.READING, settings.name, self._epoch, self._sequence, time, (float(label),), value)
            self._sequence += 1
            yield reading_key(settings.network, label), encode_frame(frame)
        for (name, _), state in zip(settings.shows, self._truth.truth(), strict=True):
            frame = Frame(Kind.TRUTH, name, self._epoch, self._step, time, (), frozen(state))
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
