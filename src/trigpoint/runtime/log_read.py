"""``read_log``: what a live run left behind, as tables; a log whose writer was killed gives all but its last moment."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import FileFormatError, ProtocolError
from trigpoint.runtime.codec import FACTS, Frame, Kind
from trigpoint.runtime.log_format import (
    JOINED,
    LABEL,
    LOG_KIND,
    LOG_VERSION,
    decode_message,
    heard_by,
    values_of_status,
)
from trigpoint.runtime.mcap_read import Channel, McapReader
from trigpoint.runtime.status import LINK_FIELDS, STATUS_FIELDS, NodeStatus, node_status
from trigpoint.runtime.topics import name_of

MOST_VALUES = 4096
"""Numbers in one message of a log; a frame holds no more."""


@dataclass(frozen=True, eq=False)
class Series:
    """What came in under one topic, in the order of arrival.

    Attributes:
        times: (T,) seconds by the sender's clock: what the values are for.
        received: (T,) seconds by the clock of whoever logged.
        epochs: (T,) when the sender's process had started, nanoseconds since 1970.
        sequences: (T,) the sender's numbers.
        facts: (T,) each: hops, evidence, broken and uncertainty of estimates.
        numbers: all values, one message after the other.
        offsets: (T + 1,) where the values of each message begin in ``numbers``.
    """

    times: FloatArray
    received: FloatArray
    epochs: NDArray[np.uint64]
    sequences: NDArray[np.uint64]
    facts: Mapping[str, FloatArray]
    numbers: FloatArray
    offsets: IntArray

    def __len__(self) -> int:
        return int(self.times.shape[0])

    @property
    def values(self) -> FloatArray:
        """(T, n) values of all messages, which have one size (estimates, readings and truths do)."""
        return self.numbers.reshape(len(self), -1)

    def row(self, k: int) -> FloatArray:
        """Values of the message number ``k``."""
        return self.numbers[self.offsets[k] : self.offsets[k + 1]]


@dataclass(frozen=True)
class LogEvent:
    """What happened (``text``) at ``time`` [s] to ``node``, or to the run (None)."""

    time: float
    text: str
    node: str | None = None


@dataclass(frozen=True, eq=False)
class Log:
    """A live run as it was logged.

    Attributes:
        path: the file.
        network: name of the network.
        names: names of its nodes, in order; those that joined while it went on come last.
        attributes: what the writer said about the run, the last word of each.
        complete: True when the writer closed the file.
        damage: why it is not complete; empty when it is.
        estimates: by node.
        truths: by node; empty where nothing simulated the truth.
        statuses: by node; values in the order of ``STATUS_FIELDS``, then of ``LINK_FIELDS`` for each link.
        readings: by label.
        events: in the order of arrival.
        odd: messages that were left out since they have another size than the first of their topic.
    """

    path: str
    network: str
    names: tuple[str, ...]
    attributes: Mapping[str, Any]
    complete: bool
    damage: str
    estimates: Mapping[str, Series]
    truths: Mapping[str, Series]
    statuses: Mapping[str, Series]
    readings: Mapping[int, Series]
    events: tuple[LogEvent, ...]
    odd: int = 0

    def status(self, name: str) -> NodeStatus | None:
        """The last status of the node ``name``; None where it sent none, or one that means nothing.

        Its neighbours have the names that the log's attribute ``hears`` gives, else #1, #2, ...
        """
        series = self.statuses.get(name)
        if series is None:
            return None
        values = series.row(len(series) - 1)
        count = (values.shape[0] - len(STATUS_FIELDS)) // len(LINK_FIELDS)
        hears = heard_by(self.attributes).get(name, [])
        hears = hears if len(hears) == count else [f"#{k + 1}" for k in range(count)]
        frame = Frame(Kind.STATUS, name, 0, 0, float(series.times[-1]), (), values)
        try:
            return node_status(frame, hears)
        except ProtocolError:
            return None


def read_log(path: str | Path) -> Log:
    """Read the log at ``path`` as far as it goes; messages of other topics are passed over.

    The file is read as a stream; what stays in memory are the numbers, 40 bytes and 8 a value for each message.

    Raises:
        FileFormatError: no log of this version, or a message that does not follow the schema of its topic.
        MissingExtraError: mcap is not installed.
    """
    reader = McapReader(path)
    gatherers: dict[Channel, _Gatherer] = {}
    events: list[LogEvent] = []
    odd = 0
    for channel, received, _, data in reader.messages():
        if channel not in gatherers:
            gatherers[channel] = _Gatherer(channel)
        gatherer = gatherers[channel]
        if not gatherer.family:
            continue
        try:
            message = decode_message(data)
            if gatherer.family == "event":
                events.append(_event(message))
            else:
                odd += not gatherer.take(message, received)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            what = f"{type(error).__name__}: {error}"
            raise FileFormatError(
                path, f"a message of {channel.topic!r} does not follow its schema ({what})"
            ) from error
    network, names, attributes = _header(reader)
    tables = _tables(path, [one for one in gatherers.values() if one.times])
    return Log(
        str(path),
        network,
        names,
        attributes,
        reader.complete,
        reader.damage,
        tables["estimate"],
        tables["truth"],
        tables["status"],
        tables["reading"],
        tuple(events),
        odd,
    )


class _Gatherer:
    """The numbers of one topic as they come in."""

    def __init__(self, channel: Channel) -> None:
        parts = channel.topic.split("/") if channel.encoding == "json" else []
        self.family, self.name = "", ""
        if parts == ["", "event"]:
            self.family = "event"
        elif len(parts) == 4 and parts[:2] == ["", "node"] and parts[3] in ("estimate", "status"):
            self.family, self.name = parts[3], name_of(parts[2])
        elif len(parts) == 3 and parts[0] == "" and parts[1] in ("reading", "truth"):
            self.family, self.name = parts[1], name_of(parts[2])
        self.told = FACTS[Kind.ESTIMATE] if self.family == "estimate" else ()
        self.times, self.received = array("d"), array("d")
        self.epochs, self.sequences = array("Q"), array("Q")
        self.facts = {name: array("d") for name in self.told}
        self.numbers, self.offsets = array("d"), array("q", [0])

    def take(self, message: Any, received: int) -> bool:
        """Take in one message; False when it was left out for its size."""
        values = values_of_status(message) if self.family == "status" else message["values"]
        count = len(values)
        if not isinstance(values, list) or count > MOST_VALUES:
            raise ValueError(f"values must be a list of at most {MOST_VALUES} numbers")
        if self.family != "status" and self.times and count != self.offsets[1]:
            return False
        self.epochs.append(message["epoch"])
        self.sequences.append(message["sequence"])
        for name, column in self.facts.items():
            column.append(message[name])
        self.numbers.extend(values)
        self.times.append(message["time"])
        self.received.append(received / 1e9)
        self.offsets.append(len(self.numbers))
        return True

    def series(self) -> Series:
        """What was taken in."""
        return Series(
            np.array(self.times),
            np.array(self.received),
            np.array(self.epochs),
            np.array(self.sequences),
            {name: np.array(column) for name, column in self.facts.items()},
            np.array(self.numbers),
            np.array(self.offsets),
        )


def _tables(path: str | Path, gatherers: list[_Gatherer]) -> dict[str, dict[Any, Series]]:
    tables: dict[str, dict[Any, Series]] = {name: {} for name in ("estimate", "truth", "status", "reading")}
    for one in gatherers:
        series = one.series()
        columns = (series.times, series.numbers, *series.facts.values())
        if not all(np.isfinite(column).all() for column in columns):  # 1e999 is JSON, but no number of ours
            raise FileFormatError(path, f"a number under {one.family} {one.name!r} is not finite")
        key = _label(path, one.name) if one.family == "reading" else one.name
        if key in tables[one.family]:
            raise FileFormatError(path, f"{one.family} {one.name!r} stands under two topics")
        tables[one.family][key] = series
    return tables


def _label(path: str | Path, text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise FileFormatError(path, f"a reading's topic must end in a whole number; got {text[:40]!r}") from error


def _event(message: Any) -> LogEvent:
    time, text, node = float(message["time"]), message["text"], message["node"]
    if not isinstance(text, str) or not isinstance(node, str | None) or not np.isfinite(time):
        raise ValueError("an event has a finite time, a text, and a node or null")
    return LogEvent(time, text, node)


def _header(reader: McapReader) -> tuple[str, tuple[str, ...], dict[str, Any]]:
    """Network, names of the nodes and attributes: the first record says what the file is, later ones add to it."""
    given, *later = reader.metadata.get(LABEL, [{}])
    if given.get("kind") != LOG_KIND:
        lost = "" if reader.complete else f"; its head may be lost: {reader.damage}"
        raise FileFormatError(reader.path, f"is an MCAP file, but no log of a live run{lost}")
    if given.get("version") != LOG_VERSION:
        raise FileFormatError(
            reader.path, f"is a log of version {given.get('version')!r}; this reads version {LOG_VERSION}"
        )
    try:
        names = decode_message(given.get("names", "").encode())
        attributes, *further = (decode_message(one.get("attributes", "").encode()) for one in (given, *later))
    except (ValueError, RecursionError) as error:
        raise FileFormatError(reader.path, f"its description is no JSON: {error}") from error
    for more in further:
        if isinstance(attributes, dict) and isinstance(more, dict):
            attributes |= more
    joined = attributes.get(JOINED, []) if isinstance(attributes, dict) else []
    names = [*names, *joined] if isinstance(names, list) and isinstance(joined, list) else names
    texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not texts or not isinstance(attributes, dict) or len(set(names)) != len(names):
        raise FileFormatError(reader.path, "its description must hold different names and an object of attributes")
    return given.get("network", ""), tuple(names), attributes
