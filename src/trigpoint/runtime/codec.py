"""Frames on the wire: fixed little-endian, versioned, with strict limits. Bytes are never unpickled.

Layout of the head (32 bytes): ``TP``, version (u8), kind (u8), length of the sender's name in bytes (u16), number of
values (u16), epoch (u64), sequence (u64), time in seconds (f64). Then the name (UTF-8), the facts of the kind (f64
each, as many as ``FACTS`` lists for it), the values (f64 each).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError, ProtocolError

VERSION = 2
_MAGIC = b"TP"
_HEAD = struct.Struct("<2sBBHHQQd")
_LONGEST_NAME = 1024
MOST_VALUES = 4096
"""Values of one frame at most."""


class Kind(IntEnum):
    """What a frame says."""

    HELLO = 1
    BYE = 2
    ESTIMATE = 3
    READING = 4
    STATUS = 5
    PING = 6
    PONG = 7
    TRUTH = 8
    CONTROL = 9


FACTS: dict[Kind, tuple[str, ...]] = {
    Kind.HELLO: (),
    Kind.BYE: (),
    Kind.ESTIMATE: ("hops", "evidence", "broken", "uncertainty"),
    Kind.READING: ("label",),
    Kind.STATUS: (),
    Kind.PING: (),
    Kind.PONG: ("asked", "received"),
    Kind.TRUTH: (),
    Kind.CONTROL: ("order",),
}
"""Names of the numbers that stand before a frame's values, by kind."""

_TOLD = {int(kind): (kind, len(facts)) for kind, facts in FACTS.items()}
_FORMATS = tuple(f"<{count}d" for count in range(1 + max(len(facts) for facts in FACTS.values())))
_FEW = 32

LARGEST_FRAME = _HEAD.size + _LONGEST_NAME + 8 * (max(len(facts) for facts in FACTS.values()) + MOST_VALUES)


def require_name(name: str) -> None:
    """Refuse a ``name`` that no frame can carry: an ``ArgumentError``."""
    if not 0 < len(name.encode("utf-8", "surrogatepass")) <= _LONGEST_NAME:
        raise ArgumentError(f"a live node's name has 1 to {_LONGEST_NAME} bytes; rename {name[:40]!r}")


def frame_size(name: str, count: int) -> int:
    """Bytes of the longest frame of a sender of this ``name`` with ``count`` values, whatever its kind."""
    return _HEAD.size + len(name.encode("utf-8")) + 8 * (max(len(facts) for facts in FACTS.values()) + count)


_NOTHING = frozen(np.zeros(0))


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame.

    Attributes:
        kind: what it says.
        sender: name of the node, or of the sensor, that sent it.
        epoch: when the sender's process started, nanoseconds since 1970: a restarted sender counts from 0 again.
        sequence: number of the frame among the sender's frames of this kind and epoch.
        time: seconds by the sender's clock: what the values are for.
        facts: the numbers that ``FACTS`` lists for the kind, in that order.
        values: estimate, reading, truth or status; empty for others.
    """

    kind: Kind
    sender: str
    epoch: int
    sequence: int
    time: float
    facts: tuple[float, ...] = ()
    values: FloatArray = field(default_factory=lambda: _NOTHING)

    @property
    def age_key(self) -> tuple[int, int]:
        """Frames of one sender and kind are ordered by it."""
        return self.epoch, self.sequence

    def fact(self, name: str) -> float:
        """The fact called ``name``."""
        return self.facts[FACTS[self.kind].index(name)]


def encode_frame(frame: Frame) -> bytes:
    """Bytes of one frame; what does not fit the limits is a ``ProtocolError``."""
    try:
        name = frame.sender.encode("utf-8")
    except UnicodeEncodeError as error:
        raise ProtocolError(f"the sender's name {frame.sender!r} is no UTF-8") from error
    values = np.ascontiguousarray(frame.values, dtype="<f8")
    if len(name) > _LONGEST_NAME or values.ndim != 1 or values.shape[0] > MOST_VALUES:
        raise ProtocolError(f"a frame holds at most {_LONGEST_NAME} bytes of name and {MOST_VALUES} values")
    if not (0 <= frame.sequence < 2**64 and 0 <= frame.epoch < 2**64):
        raise ProtocolError(f"sequence and epoch must fit 64 bits; got {frame.sequence} and {frame.epoch}")
    if len(frame.facts) != len(FACTS[frame.kind]):
        raise ProtocolError(f"{frame.kind.name} has the facts {FACTS[frame.kind]}; got {len(frame.facts)} numbers")
    if not (math.isfinite(frame.time) and all(map(math.isfinite, frame.facts)) and _all_finite(values)):
        raise ProtocolError("a frame's numbers must be finite")
    head = _HEAD.pack(
        _MAGIC, VERSION, int(frame.kind), len(name), values.shape[0], frame.epoch, frame.sequence, float(frame.time)
    )  # fmt: skip
    return head + name + struct.pack(_FORMATS[len(frame.facts)], *frame.facts) + values.tobytes()


def decode_frame(data: bytes) -> Frame:
    """Read one frame from ``data``; anything malformed is a ``ProtocolError`` that says what is wrong."""
    if not _HEAD.size <= len(data) <= LARGEST_FRAME:
        raise ProtocolError(f"a frame has {_HEAD.size} to {LARGEST_FRAME} bytes; got {len(data)}")
    magic, version, kind, name_length, count, epoch, sequence, time = _HEAD.unpack_from(data)
    if magic != _MAGIC or version != VERSION:
        raise ProtocolError(f"expected protocol {_MAGIC!r} version {VERSION}; got {magic!r} version {version}")
    if kind not in _TOLD:
        raise ProtocolError(f"unknown kind of frame {kind}")
    kind, told = _TOLD[kind]
    if name_length > _LONGEST_NAME or count > MOST_VALUES or len(data) != _HEAD.size + name_length + 8 * (told + count):
        raise ProtocolError(f"the frame's length {len(data)} does not fit its head")
    try:
        sender = data[_HEAD.size : _HEAD.size + name_length].decode("utf-8")
    except UnicodeDecodeError as error:
        raise ProtocolError("the sender's name is not UTF-8") from error
    start = _HEAD.size + name_length
    facts = struct.unpack_from(_FORMATS[told], data, start)
    values = _NOTHING
    if count:
        values = np.frombuffer(data, "<f8", count, start + 8 * told).astype(np.float64)
        values.setflags(write=False)
    if not (math.isfinite(time) and all(map(math.isfinite, facts)) and _all_finite(values)):
        raise ProtocolError("a frame's numbers must be finite")
    return Frame(kind, sender, epoch, sequence, time, facts, values)


def _all_finite(values: FloatArray) -> bool:
    if values.shape[0] <= _FEW:  # faster so
        return all(map(math.isfinite, values.tolist()))
    return bool(np.isfinite(values).all())
