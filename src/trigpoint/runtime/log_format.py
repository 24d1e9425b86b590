"""What a log holds: topics and JSON schemas of its messages, one a kind of frame."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from trigpoint.runtime.codec import FACTS, Frame, Kind
from trigpoint.runtime.status import LINK_FIELDS, STATUS_FIELDS
from trigpoint.runtime.topics import written

LABEL = "trigpoint"
"""Name of the metadata record that says what the file is."""

JOINED = "joined"
"""The attribute that names nodes which joined while the run went on."""

LOG_KIND = "trigpoint/log"
LOG_VERSION = "1"

_NUMBER = {"type": "number"}
_WHOLE = {"type": "integer", "minimum": 0}
_TEXT = {"type": "string"}
_HEAD: dict[str, Any] = {"time": _NUMBER, "epoch": _WHOLE, "sequence": _WHOLE}
_NUMBERS = {"type": "array", "items": _NUMBER}


def _schema(text: str, properties: Mapping[str, Any], optional: Mapping[str, Any] | None = None) -> dict[str, Any]:
    return {
        "type": "object",
        "description": text,
        "properties": {**properties, **(optional or {})},
        "required": list(properties),
    }


SCHEMAS: dict[str, dict[str, Any]] = {
    "trigpoint.Estimate": _schema(
        "What a node believes its state to be, and what it knows about that.",
        {**_HEAD, **dict.fromkeys(FACTS[Kind.ESTIMATE], _NUMBER), "values": _NUMBERS},
    ),
    "trigpoint.Status": _schema(
        "How a node fares, and its link to each neighbour.",
        {
            **_HEAD,
            **dict.fromkeys(STATUS_FIELDS, _NUMBER),
            "links": {
                "type": "array",
                "items": _schema("One link.", dict.fromkeys(LINK_FIELDS, _NUMBER), {"neighbour": _TEXT}),
            },
        },
    ),
    "trigpoint.Reading": _schema(
        "A measurement of one arc.", {**_HEAD, "sender": _TEXT, "label": {"type": "integer"}, "values": _NUMBERS}
    ),
    "trigpoint.Truth": _schema("The true state of a node of a simulated plant.", {**_HEAD, "values": _NUMBERS}),
    "trigpoint.Notice": _schema(
        "Hello, bye, ping, pong and control frames.",
        {**_HEAD, "says": {"enum": ["hello", "bye", "ping", "pong", "control"]}},
        dict.fromkeys((*FACTS[Kind.PONG], *FACTS[Kind.CONTROL]), _NUMBER),
    ),
    "trigpoint.Event": _schema(
        "Something that happened to a node, or (null) to the run.",
        {"time": _NUMBER, "text": _TEXT, "node": {"type": ["string", "null"]}},
    ),
}
"""JSON schema of each kind of message, by its name in the file."""

SCHEMA_TEXTS = {name: json.dumps(schema) for name, schema in SCHEMAS.items()}

EVENTS = "/event"

_CHANNELS = {Kind.ESTIMATE: ("estimate", "trigpoint.Estimate"), Kind.STATUS: ("status", "trigpoint.Status")}


def topic_of(frame: Frame) -> tuple[str, str]:
    """Topic and name of the schema under which ``frame`` is logged."""
    if frame.kind is Kind.READING:
        return f"/reading/{int(frame.facts[0])}", "trigpoint.Reading"
    if frame.kind is Kind.TRUTH:
        return f"/truth/{written(frame.sender)}", "trigpoint.Truth"
    channel, schema = _CHANNELS.get(frame.kind, ("notice", "trigpoint.Notice"))
    return f"/node/{written(frame.sender)}/{channel}", schema


def message_of(frame: Frame, hears: Sequence[str] = ()) -> dict[str, Any] | None:
    """The message that says what ``frame`` says, in JSON's types; None for a status of an impossible length.

    The links of a status get the names in ``hears`` where there are as many.
    """
    message: dict[str, Any] = {"time": frame.time, "epoch": frame.epoch, "sequence": frame.sequence}
    if frame.kind is Kind.STATUS:
        told = _status_of(frame.values.tolist(), hears)
        return None if told is None else message | told
    if frame.kind is Kind.READING:
        message["sender"], message["label"] = frame.sender, int(frame.facts[0])
    else:
        message.update(zip(FACTS[frame.kind], frame.facts, strict=True))
    if frame.kind in (Kind.ESTIMATE, Kind.READING, Kind.TRUTH):
        message["values"] = frame.values.tolist()
    else:
        message["says"] = frame.kind.name.lower()
    return message


def _status_of(values: list[float], hears: Sequence[str]) -> dict[str, Any] | None:
    fixed, each = len(STATUS_FIELDS), len(LINK_FIELDS)
    if len(values) < fixed or (len(values) - fixed) % each:
        return None
    rows = [values[k : k + each] for k in range(fixed, len(values), each)]
    links: list[dict[str, Any]] = [dict(zip(LINK_FIELDS, row, strict=True)) for row in rows]
    if len(links) == len(hears):
        links = [{"neighbour": name, **link} for name, link in zip(hears, links, strict=True)]
    return {**dict(zip(STATUS_FIELDS, values, strict=False)), "links": links}


def values_of_status(message: Mapping[str, Any]) -> list[float]:
    """The values of the STATUS frame that ``message`` was made of."""
    links = [link[name] for link in message["links"] for name in LINK_FIELDS]
    return [message[name] for name in STATUS_FIELDS] + links


def heard_by(attributes: Mapping[str, Any]) -> dict[str, list[str]]:
    """The attribute ``hears`` of a log: the neighbours of each node; empty where it is missing or something else."""
    given = attributes.get("hears")
    return {
        name: list(names)
        for name, names in (given.items() if isinstance(given, Mapping) else ())
        if isinstance(names, list | tuple) and all(isinstance(one, str) for one in names)
    }


def decode_message(data: bytes) -> Any:
    """The JSON value in ``data``; text that is none, NaN and infinity are ``ValueError`` or ``RecursionError``."""
    return _decoder.decode(data.decode("utf-8"))


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


_decoder = json.JSONDecoder(parse_constant=_no_constant)
