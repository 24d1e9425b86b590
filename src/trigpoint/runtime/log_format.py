"""What a log holds: topics and JSON schemas of its messages, one a kind of frame."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from trigpoint.runtime.codec import FACTS, Frame, Kind
from trigpoint.runtime.topics import written

LABEL = "trigpoint"
"""Name of the metadata record that says what the file is."""

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
    "trigpoint.Status": _schema("How a node fares.", {**_HEAD, "values": _NUMBERS}),
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


def message_of(frame: Frame) -> dict[str, Any]:
    """The message that says what ``frame`` says, in JSON's types."""
    message: dict[str, Any] = {"time": frame.time, "epoch": frame.epoch, "sequence": frame.sequence}
    if frame.kind is Kind.READING:
        message["sender"], message["label"] = frame.sender, int(frame.facts[0])
    else:
        message.update(zip(FACTS[frame.kind], frame.facts, strict=True))
    if frame.kind in (Kind.ESTIMATE, Kind.STATUS, Kind.READING, Kind.TRUTH):
        message["values"] = frame.values.tolist()
    else:
        message["says"] = frame.kind.name.lower()
    return message
