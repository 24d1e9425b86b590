"""Arrays inside JSON: base64 of little-endian numbers with their shape, and a digest over a whole document."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trigpoint.arrays.core import frozen, require_finite
from trigpoint.errors import ArgumentError, ProtocolError

_TYPES = {"f8": "<f8", "i8": "<i8"}
_LARGEST = 2**31
_MOST_AXES = 8


def encode_array(array: NDArray[Any]) -> dict[str, Any]:
    """Return ``array`` as a JSON object ``{"type", "shape", "base64"}``, little-endian f8 or i8."""
    if not np.can_cast(array.dtype, np.int64) and not np.can_cast(array.dtype, np.float64):
        raise ArgumentError(f"only real and whole numbers can be written; got dtype {array.dtype}")
    kind = "i8" if np.can_cast(array.dtype, np.int64) and array.dtype != np.bool_ else "f8"
    data = np.ascontiguousarray(array, dtype=_TYPES[kind])
    return {"type": kind, "shape": list(array.shape), "base64": base64.b64encode(data.tobytes()).decode("ascii")}


def decode_array(document: Any, name: str = "array") -> NDArray[Any]:
    """Read the ``document`` that ``encode_array`` wrote; anything else is a ``ProtocolError`` that says ``name``.

    Nothing is executed or imported.
    """
    if not isinstance(document, dict) or set(document) != {"type", "shape", "base64"}:
        raise ProtocolError(f"{name} must be an object with type, shape and base64")
    kind, shape, text = document["type"], document["shape"], document["base64"]
    if not isinstance(kind, str) or kind not in _TYPES or not isinstance(text, str):
        raise ProtocolError(f"{name} has type {kind!r}; expected one of {sorted(_TYPES)}")
    if not isinstance(shape, list) or len(shape) > _MOST_AXES:
        raise ProtocolError(
            f"{name} has the shape {str(shape)[:80]}; expected a list of whole numbers, at most {_MOST_AXES}"
        )
    if not all(type(k) is int and 0 <= k < _LARGEST for k in shape):
        raise ProtocolError(f"{name} has the shape {shape!r}; expected a list of whole numbers")
    try:
        data = base64.b64decode(text, validate=True)
    except ValueError as error:
        raise ProtocolError(f"{name} is not base64 ({error})") from error
    expected = 8
    for length in shape:
        expected *= length
    if len(data) != expected:
        raise ProtocolError(f"{name} holds {len(data)} bytes; its shape {shape} needs {expected}")
    try:
        array = frozen(np.frombuffer(data, dtype=_TYPES[kind]).reshape(shape), kind)
    except ValueError as error:
        raise ProtocolError(f"{name} has the shape {shape}, which no array can have ({error})") from error
    try:
        require_finite(name, array)
    except ValueError as error:
        raise ProtocolError(str(error)) from error
    return array


def digest_of(document: Mapping[str, Any]) -> str:
    """SHA-256 of a JSON document in its canonical form (sorted keys, no spaces), as hexadecimal text."""
    canonical = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()
