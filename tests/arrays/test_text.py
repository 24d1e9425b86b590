"""Arrays in JSON and digests: what is written is read back bit for bit, anything else is a ProtocolError."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from trigpoint.arrays import decode_array, digest_of, encode_array
from trigpoint.errors import ProtocolError

EIGHT_BYTES = base64.b64encode(bytes(8)).decode()


@settings(max_examples=60)
@given(
    hnp.arrays(
        np.float64,
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
        elements=st.floats(allow_nan=False, allow_infinity=False),
    )
)
def test_floats_come_back_bit_for_bit(array) -> None:
    back = decode_array(json.loads(json.dumps(encode_array(array))))
    assert back.shape == array.shape
    assert back.tobytes() == array.tobytes()
    assert not back.flags.writeable


@settings(max_examples=30)
@given(hnp.arrays(st.sampled_from([np.int64, np.int8, np.uint16]), hnp.array_shapes(max_dims=2, max_side=4)))
def test_whole_numbers_come_back_as_whole_numbers(array) -> None:
    back = decode_array(encode_array(array))
    assert back.dtype == np.int64
    assert np.array_equal(back, array)


def test_byte_order_and_memory_order_do_not_matter() -> None:
    array = np.arange(6.0).reshape(2, 3)
    assert encode_array(array.astype(">f8")) == encode_array(np.asfortranarray(array)) == encode_array(array)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ([], "must be an object"),
        ({"type": "f8", "shape": [1]}, "type, shape and base64"),
        ({"type": "f8", "shape": [1], "base64": EIGHT_BYTES, "more": 1}, "must be an object"),
        ({"type": "O", "shape": [1], "base64": EIGHT_BYTES}, "expected one of"),
        ({"type": ["f8"], "shape": [1], "base64": EIGHT_BYTES}, "expected one of"),
        ({"type": "f8", "shape": [1], "base64": b"AAAA"}, "expected one of"),
        ({"type": "f8", "shape": 1, "base64": EIGHT_BYTES}, "list of whole numbers"),
        ({"type": "f8", "shape": [-1], "base64": EIGHT_BYTES}, "list of whole numbers"),
        ({"type": "f8", "shape": [True], "base64": EIGHT_BYTES}, "list of whole numbers"),
        ({"type": "f8", "shape": [1.0], "base64": EIGHT_BYTES}, "list of whole numbers"),
        ({"type": "f8", "shape": [2**31], "base64": ""}, "list of whole numbers"),
        ({"type": "f8", "shape": [1], "base64": "!!!"}, "not base64"),
        ({"type": "f8", "shape": [1], "base64": "Å"}, "not base64"),
        ({"type": "f8", "shape": [2], "base64": EIGHT_BYTES}, "holds 8 bytes; its shape .* needs 16"),
        ({"type": "f8", "shape": [1] * 70, "base64": EIGHT_BYTES}, "whole numbers, at most 8"),
        ({"type": "f8", "shape": [0, 2**30, 2**30, 2**30], "base64": ""}, "which no array can have"),
    ],
)
def test_anything_else_is_a_protocol_error(document, words) -> None:
    with pytest.raises(ProtocolError, match=words):
        decode_array(document)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(bad) -> None:
    with pytest.raises(ProtocolError, match="gain must be finite"):
        decode_array(encode_array(np.array([0.0, bad])), "gain")


def test_digest_ignores_the_order_of_keys_and_nothing_else() -> None:
    first = {"a": 1, "b": {"c": [1.5, "ä"], "d": None}}
    second = {"b": {"d": None, "c": [1.5, "ä"]}, "a": 1}
    assert digest_of(first) == digest_of(second)
    assert len(digest_of(first)) == 64
    assert digest_of(first) != digest_of({**first, "a": 2})
    assert digest_of({"a": 1}) != digest_of({"a": "1"})


def test_digest_is_the_published_hash_of_the_canonical_text() -> None:
    assert digest_of({}) == "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"  # sha256 of "{}"


def test_digest_refuses_nan() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        digest_of({"a": float("nan")})
