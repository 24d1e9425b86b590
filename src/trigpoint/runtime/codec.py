"""Frames on the wire: fixed little-endian, versioned, with strict limits. Bytes are never unpickled.

Layout: ``TP``, version (u8), kind (u8), length of the sender's name in bytes (u16), number of values (u16), sequence
(u64), time in seconds (f64), the name (UTF-8), the values (f64 each). On a stream a frame follows its length (u32).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import BinaryIO

import numpy as np

from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ProtocolError

VERSION = 1
_MAGIC = b"TP"
_HEAD = struct.Struct("<2sBBHHQd")
_LENGTH = struct.Struct("<I")
_LONGEST_NAME = 1024
_MOST_VALUES = 4096
LARGEST_FRAME = _HEAD.size + _LONGEST_NAME + 8 * _MOST_VALUES


class Kind(IntEnum):
    """What a frame says."""

    ESTIMATE = 1
    READING = 2
    STEP = 3
    STOP = 4


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame.

    Attributes:
        kind: what it says.
        sender: name of the node that sent it; empty for the supervisor.
        sequence: number of an estimate, or the arc of a reading.
        time: seconds: when an estimate was made, or how long a step takes.
        values: the estimate, or the reading; empty for a step.
    """

    kind: Kind
    sender: str
    sequence: int
    time: float
    values: FloatArray


def encode_frame(frame: Frame) -> bytes:
    """Bytes of one frame; what does not fit the limits is a ``ProtocolError``."""
    try:
        name = frame.sender.encode("utf-8")
    except UnicodeEncodeError as error:
        raise ProtocolError(f"the sender's name {frame.sender!r} is no UTF-8") from error
    values = np.ascontiguousarray(frame.values, dtype="<f8")
    if len(name) > _LONGEST_NAME or values.ndim != 1 or values.shape[0] > _MOST_VALUES:
        raise ProtocolError(f"a frame holds at most {_LONGEST_NAME} bytes of name and {_MOST_VALUES} values")
    if not 0 <= frame.sequence < 2**64:
        raise ProtocolError(f"a frame's sequence must fit 64 bits; got {frame.sequence}")
    if not np.isfinite(values).all() or not np.isfinite(frame.time):
        raise ProtocolError("a frame's numbers must be finite")
    head = _HEAD.pack(
        _MAGIC, VERSION, int(frame.kind), len(name), values.shape[0], frame.sequence, float(frame.time)
    )  # fmt: skip
    return head + name + values.tobytes()


def decode_frame(data: bytes) -> Frame:
    """Read one frame from ``data``; anything malformed is a ``ProtocolError`` that says what is wrong."""
    if len(data) < _HEAD.size:
        raise ProtocolError(f"a frame has at least {_HEAD.size} bytes; got {len(data)}")
    magic, version, kind, name_length, count, sequence, time = _HEAD.unpack_from(data)
    if magic != _MAGIC or version != VERSION:
        raise ProtocolError(f"expected protocol {_MAGIC!r} version {VERSION}; got {magic!r} version {version}")
    if kind not in Kind.__members__.values():
        raise ProtocolError(f"unknown kind of frame {kind}")
    if name_length > _LONGEST_NAME or count > _MOST_VALUES or len(data) != _HEAD.size + name_length + 8 * count:
        raise ProtocolError(f"the frame's length {len(data)} does not fit its head")
    try:
        sender = data[_HEAD.size : _HEAD.size + name_length].decode("utf-8")
    except UnicodeDecodeError as error:
        raise ProtocolError("the sender's name is not UTF-8") from error
    values = frozen(np.frombuffer(data, dtype="<f8", offset=_HEAD.size + name_length))
    if not np.isfinite(values).all() or not np.isfinite(time):
        raise ProtocolError("a frame's numbers must be finite")
    return Frame(Kind(kind), sender, sequence, time, values)


def write_frame(stream: BinaryIO, frame: Frame) -> None:
    """Write one frame after its length."""
    data = encode_frame(frame)
    stream.write(_LENGTH.pack(len(data)) + data)


def read_frame(stream: BinaryIO) -> Frame | None:
    """Read one frame, or None at the end of the stream; a truncated one is a ``ProtocolError``."""
    head = stream.read(_LENGTH.size)
    if not head:
        return None
    if len(head) < _LENGTH.size:
        raise ProtocolError("the stream ends inside a frame's length")
    (length,) = _LENGTH.unpack(head)
    if length > LARGEST_FRAME:
        raise ProtocolError(f"a frame of {length} bytes exceeds the limit of {LARGEST_FRAME}")
    data = stream.read(length)
    if len(data) < length:
        raise ProtocolError("the stream ends inside a frame")
    return decode_frame(data)
