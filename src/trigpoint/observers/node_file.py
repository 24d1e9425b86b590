"""Fields of a node file: matrices and labelled pairs out of a JSON object; what does not fit is a ``ProtocolError``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from trigpoint.arrays import FloatArray, as_matrix, decode_array
from trigpoint.errors import ArgumentError, ProtocolError


def further(entry: Mapping[str, Any], position: int, p: int) -> Iterable[tuple[str, FloatArray]]:
    """Further neighbours of the arc at this ``position``, each with its rows (p, n_k)."""
    for pair in pairs(entry, "more"):
        if not isinstance(pair[0], str):
            raise ProtocolError(f"arcs[{position}]: 'more' must pair names with matrices; got {pair[0]!r}")
        yield pair[0], matrix({"more": pair[1]}, "more", p, None)


def labelled(document: Mapping[str, Any], rows: int) -> Iterable[tuple[int, FloatArray]]:
    """Labels of readings, each with its matrix (``rows``, q)."""
    for pair in pairs(document, "feedthrough"):
        if type(pair[0]) is not int:
            raise ProtocolError(f"'feedthrough' must pair labels with matrices; got {pair[0]!r}")
        yield pair[0], matrix({"feedthrough": pair[1]}, "feedthrough", rows, None)


def pairs(entry: Mapping[str, Any], key: str) -> list[list[Any]]:
    """The list of pairs under ``key``."""
    pairs = entry.get(key)
    if not isinstance(pairs, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        raise ProtocolError(f"{key!r} must be a list of pairs")
    return pairs


def matrix(document: Mapping[str, Any], key: str, rows: int | None, columns: int | None) -> FloatArray:
    """The matrix under ``key``, of this many ``rows`` and ``columns`` where they are given."""
    try:
        return as_matrix(key, decode_array(document.get(key), key), rows, columns)
    except ArgumentError as error:
        raise ProtocolError(str(error)) from error
