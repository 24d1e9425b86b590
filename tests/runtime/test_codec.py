"""Frames: what goes in comes out, and no bytes do any harm."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trigpoint.errors import ProtocolError
from trigpoint.runtime import Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.codec import LARGEST_FRAME, read_frame, write_frame

FINITE = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
FRAMES = st.builds(
    Frame,
    st.sampled_from(Kind),
    NAMES,
    st.integers(0, 2**64 - 1),
    FINITE,
    st.lists(FINITE, max_size=20).map(np.array),
)
HEAD = struct.Struct("<2sBBHHQd")


def frame(**changes: object) -> Frame:
    fields = {"kind": Kind.ESTIMATE, "sender": "a", "sequence": 3, "time": 0.5, "values": np.array([1.0, -2.0])}
    return Frame(**(fields | changes))  # type: ignore[arg-type]


def assert_same(left: Frame, right: Frame) -> None:
    assert (left.kind, left.sender, left.sequence, left.time) == (right.kind, right.sender, right.sequence, right.time)
    assert left.values.tobytes() == right.values.tobytes()


@given(FRAMES)
def test_a_frame_survives_its_bytes(sent: Frame) -> None:
    assert_same(decode_frame(encode_frame(sent)), sent)


@given(st.lists(FRAMES, max_size=5))
def test_a_stream_gives_the_frames_back_in_order_and_then_none(sent: list[Frame]) -> None:
    stream = io.BytesIO()
    for one in sent:
        write_frame(stream, one)
    stream.seek(0)
    for one in sent:
        received = read_frame(stream)
        assert received is not None
        assert_same(received, one)
    assert read_frame(stream) is None


def test_the_layout_on_the_wire_is_fixed() -> None:
    expected = HEAD.pack(b"TP", 1, 1, 1, 2, 3, 0.5) + b"a" + struct.pack("<2d", 1.0, -2.0)
    assert encode_frame(frame()) == expected


def test_received_values_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        decode_frame(encode_frame(frame())).values[0] = 1.0


def fuzzed(count: int, seed: int) -> int:
    """Decode garbage, damaged frames and extended frames; only ``ProtocolError`` is allowed. Number accepted."""
    rng = np.random.default_rng(seed)
    good = [encode_frame(frame(values=rng.normal(size=k), sender="näme"[: k % 5])) for k in range(4)]
    accepted = 0
    for k in range(count):
        base = good[k % 4]
        way = k % 5
        if way == 0:
            data = rng.bytes(int(rng.integers(0, 80)))
        elif way == 1:
            data = b"TP\x01" + rng.bytes(int(rng.integers(0, 60)))
        elif way == 2:
            damaged = bytearray(base)
            damaged[int(rng.integers(0, len(damaged)))] = int(rng.integers(0, 256))
            data = bytes(damaged)
        elif way == 3:
            data = base[: int(rng.integers(0, len(base)))]
        else:
            data = base + rng.bytes(int(rng.integers(1, 9)))
        try:
            decode_frame(data)
            accepted += 1
        except ProtocolError:
            pass
    return accepted


def test_a_hundred_thousand_damaged_frames_raise_protocol_errors_only() -> None:
    accepted = fuzzed(100_000, 1)
    assert 0 < accepted < 20_000  # a flipped bit in a number or a name is still a frame


@given(st.binary(max_size=200))
def test_any_bytes_on_a_stream_raise_protocol_errors_only(data: bytes) -> None:
    stream = io.BytesIO(data)
    try:
        while read_frame(stream) is not None:
            pass
    except ProtocolError:
        return
    assert stream.read() == b""


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "at least"),
        (HEAD.pack(b"XX", 1, 1, 0, 0, 0, 0.0), "expected protocol"),
        (HEAD.pack(b"TP", 2, 1, 0, 0, 0, 0.0), "version 2"),
        (HEAD.pack(b"TP", 1, 0, 0, 0, 0, 0.0), "unknown kind of frame 0"),
        (HEAD.pack(b"TP", 1, 5, 0, 0, 0, 0.0), "unknown kind of frame 5"),
        (HEAD.pack(b"TP", 1, 1, 1, 0, 0, 0.0), "length"),
        (HEAD.pack(b"TP", 1, 1, 1025, 0, 0, 0.0) + b"a" * 1025, "length"),
        (HEAD.pack(b"TP", 1, 1, 0, 4097, 0, 0.0) + bytes(8 * 4097), "length"),
        (HEAD.pack(b"TP", 1, 1, 1, 0, 0, 0.0) + b"\xff", "UTF-8"),
        (HEAD.pack(b"TP", 1, 1, 0, 0, 0, np.nan), "finite"),
        (HEAD.pack(b"TP", 1, 1, 0, 0, 0, np.inf), "finite"),
        (HEAD.pack(b"TP", 1, 1, 0, 1, 0, 0.0) + struct.pack("<d", np.nan), "finite"),
    ],
)
def test_each_fault_of_a_frame_is_named(data: bytes, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        decode_frame(data)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sender": "a" * 1025}, "at most"),
        ({"sender": "ü" * 513}, "at most"),
        ({"sender": "\ud800"}, "UTF-8"),
        ({"values": np.zeros(4097)}, "at most"),
        ({"values": np.zeros((1, 1))}, "at most"),
        ({"values": np.array([np.nan])}, "finite"),
        ({"values": np.array([-np.inf])}, "finite"),
        ({"time": np.nan}, "finite"),
        ({"sequence": -1}, "sequence"),
        ({"sequence": 2**64}, "sequence"),
    ],
)
def test_what_does_not_fit_a_frame_is_not_sent(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        encode_frame(frame(**changes))


def test_the_limits_themselves_fit() -> None:
    largest = frame(sender="a" * 1024, values=np.ones(4096), sequence=2**64 - 1)
    data = encode_frame(largest)
    assert len(data) == LARGEST_FRAME
    assert_same(decode_frame(data), largest)


@pytest.mark.parametrize("kept", range(1, 4 + 24 + 1 + 16))
def test_a_stream_that_ends_inside_a_frame_is_a_protocol_error(kept: int) -> None:
    stream = io.BytesIO()
    write_frame(stream, frame())
    assert len(stream.getvalue()) == 4 + 24 + 1 + 16
    with pytest.raises(ProtocolError, match="the stream ends inside a frame"):
        read_frame(io.BytesIO(stream.getvalue()[:kept]))


def test_an_announced_length_beyond_the_limit_is_refused_before_it_is_read() -> None:
    class Watched(io.BytesIO):
        asked = 0

        def read(self, size: int | None = -1, /) -> bytes:
            self.asked = max(self.asked, size or 0)
            return super().read(size)

    stream = Watched(struct.pack("<I", 2**32 - 1) + b"x" * 10)
    with pytest.raises(ProtocolError, match="exceeds the limit"):
        read_frame(stream)
    assert stream.asked == 4
