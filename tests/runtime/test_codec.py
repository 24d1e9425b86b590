"""Frames: what goes in comes out, and no bytes do any harm."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trigpoint.errors import ProtocolError
from trigpoint.runtime import FACTS, Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.codec import LARGEST_FRAME, VERSION

FINITE = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
HEAD = struct.Struct("<2sBBHHQQd")


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    kind = draw(st.sampled_from(Kind))
    facts = tuple(draw(FINITE) for _ in FACTS[kind])
    values = np.array(draw(st.lists(FINITE, max_size=40)))
    numbers = st.integers(0, 2**64 - 1)
    return Frame(kind, draw(NAMES), draw(numbers), draw(numbers), draw(FINITE), facts, values)


def frame(**changes: object) -> Frame:
    fields = {
        "kind": Kind.ESTIMATE, "sender": "a", "epoch": 9, "sequence": 3, "time": 0.5, "facts": (1.0, 0.25, 0.0, 2.0),
        "values": np.array([1.0, -2.0]),
    }  # fmt: skip
    return Frame(**(fields | changes))  # type: ignore[arg-type]


def head(magic=b"TP", version=VERSION, kind=1, name=0, count=0, time=0.0) -> bytes:
    return HEAD.pack(magic, version, kind, name, count, 0, 0, time)


@given(frames())
def test_a_frame_survives_its_bytes(sent: Frame) -> None:
    found = decode_frame(encode_frame(sent))
    for name in ("kind", "sender", "epoch", "sequence", "time", "facts"):
        assert getattr(found, name) == getattr(sent, name)
    assert found.values.tobytes() == sent.values.tobytes()


def test_the_layout_on_the_wire_is_fixed() -> None:
    expected = HEAD.pack(b"TP", 2, 3, 1, 2, 9, 3, 0.5) + b"a" + struct.pack("<6d", 1.0, 0.25, 0.0, 2.0, 1.0, -2.0)
    assert encode_frame(frame()) == expected


def test_facts_have_names() -> None:
    assert frame().fact("uncertainty") == 2.0
    assert frame().age_key == (9, 3)


def test_received_values_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        decode_frame(encode_frame(frame())).values[0] = 1.0


@given(st.binary(max_size=200))
def test_any_bytes_are_a_frame_or_a_protocol_error(data: bytes) -> None:
    try:
        assert encode_frame(decode_frame(data)) == data
    except ProtocolError:
        return


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "32 to"),
        (bytes(LARGEST_FRAME + 1), "32 to"),
        (head(magic=b"XX"), "expected protocol"),
        (head(version=1), "version 1"),
        (head(kind=0), "unknown kind of frame 0"),
        (head(kind=10), "unknown kind of frame 10"),
        (head(name=1), "length"),
        (head(kind=3), "length"),
        (head(name=1025) + b"a" * 1025, "length"),
        (head(count=4097) + bytes(8 * 4097), "length"),
        (head(name=1) + b"\xff", "UTF-8"),
        (head(time=np.nan), "finite"),
        (head(time=np.inf), "finite"),
        (head(count=1) + struct.pack("<d", np.nan), "finite"),
        (head(count=100) + struct.pack("<100d", *([0.0] * 99), np.inf), "finite"),
        (head(kind=3) + struct.pack("<4d", 0.0, np.nan, 0.0, 0.0), "finite"),
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
        ({"values": np.full(100, -np.inf)}, "finite"),
        ({"facts": (np.inf, 0.0, 0.0, 0.0)}, "finite"),
        ({"facts": (1.0,)}, "has the facts"),
        ({"time": np.nan}, "finite"),
        ({"sequence": -1}, "sequence"),
        ({"sequence": 2**64}, "sequence"),
        ({"epoch": 2**64}, "epoch"),
    ],
)
def test_what_does_not_fit_a_frame_is_not_sent(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        encode_frame(frame(**changes))


def test_the_limits_themselves_fit() -> None:
    largest = frame(sender="a" * 1024, values=np.ones(4096), sequence=2**64 - 1, epoch=2**64 - 1)
    data = encode_frame(largest)
    assert len(data) == LARGEST_FRAME
    assert decode_frame(data).values.shape == (4096,)
