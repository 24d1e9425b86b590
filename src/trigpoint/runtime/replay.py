"""Recorded readings: the log of a live run, any MCAP file with the same topics, or a table of text."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

from trigpoint.arrays import as_floats
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.runtime.log_format import decode_message
from trigpoint.runtime.mcap_read import McapReader
from trigpoint.runtime.sensors import Reading

_HEAD = ["time", "label"]


def read_readings(path: str | Path) -> Iterator[Reading]:
    """The readings recorded in the file at ``path``, one after the other; the file is read as a stream.

    ``.mcap``: the messages in JSON under ``/reading/LABEL``, in the order of their arrival, as far as the file goes.
    ``.csv``: the columns ``time,label,value`` and further values, one reading a row, in the order of time; empty lines
    and lines that begin with ``#`` are passed over.

    Raises:
        FileFormatError: another ending, a row or message that is no reading (with its line), or no reading at all.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".mcap", ".csv"):
        raise FileFormatError(path, f"recorded readings are .mcap or .csv files; got the ending {suffix!r}")
    count = 0
    for reading in _from_mcap(path) if suffix == ".mcap" else _from_csv(path):
        count += 1
        yield reading
    if not count:
        raise FileFormatError(path, "holds no readings: there is nothing to replay")


def _from_mcap(path: str | Path) -> Iterator[Reading]:
    for channel, _, _, data in McapReader(path).messages():
        if channel.encoding != "json" or not channel.topic.startswith("/reading/"):
            continue
        try:
            message = decode_message(data)
            values = as_floats("values", message["values"])
            yield Reading(float(message["time"]), int(channel.topic.removeprefix("/reading/")), values)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise FileFormatError(path, f"a message of {channel.topic!r} is no reading ({error})") from error


def _from_csv(path: str | Path) -> Iterator[Reading]:
    last = -float("inf")
    headed = False
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as stream:
            table = csv.reader(stream)
            for row in table:
                line = table.line_num
                if not any(row) or row[0].startswith("#"):
                    continue
                if not headed:
                    headed = True
                    _check_head(path, row, line)
                    continue
                reading = _row(path, row, line)
                if reading.time < last:
                    raise FileFormatError(path, f"the time goes back to {reading.time}: sort the rows", line)
                last = reading.time
                yield reading
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(path, f"cannot be read as a table of readings ({error})") from error


def _check_head(path: str | Path, row: list[str], line: int) -> None:
    if [name.strip().lower() for name in row[:2]] != _HEAD or len(row) < 3:
        raise FileFormatError(path, f"the first row must be time,label,value,...; got {','.join(row)[:60]!r}", line)


def _row(path: str | Path, row: list[str], line: int) -> Reading:
    if len(row) < 3:
        raise FileFormatError(
            path, f"a row holds a time, the number of an arc, and values; got {','.join(row)!r}", line
        )
    try:
        values = as_floats("values", [float(text) for text in row[2:] if text.strip()])
        return Reading(float(row[0]), int(row[1]), values)
    except (ArgumentError, ValueError) as error:
        raise FileFormatError(path, f"a row holds a time, the number of an arc, and values ({error})", line) from error
