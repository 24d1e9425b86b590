"""``LogWriter``: every frame of a live run in one MCAP file that survives the end of its writer."""

from __future__ import annotations

import contextlib
import json
import math
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.runtime.codec import Frame
from trigpoint.runtime.log_format import (
    EVENTS,
    LABEL,
    LOG_KIND,
    LOG_VERSION,
    SCHEMA_TEXTS,
    heard_by,
    message_of,
    topic_of,
)
from trigpoint.runtime.mcap_write import McapWriter

FLUSH_EVERY = 0.4
"""Seconds between two closings of a chunk: what a killed writer loses at most, and the time that the disk takes."""

_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False, check_circular=False).encode


class LogWriter:
    """The log of one live run: MCAP, messages in JSON with their JSON schemas, readable by standard tools.

    A thread of its own closes a chunk every 0.4 s and waits for the disk, so that a writer that is killed loses less
    than the last second; ``read_log`` recovers the rest. ``write`` and ``event`` may be called from any thread.

    Args:
        path: the file (``run.mcap``); what was there is replaced.
        network: name of the network.
        names: names of its nodes, in the order that the tables of ``read_run`` shall have.
        attributes: numbers and texts that describe the run. ``anchor_timeout`` [s] tells ``read_run`` how long an
            estimate counts as anchored after the last anchor reading that it heard of; ``hears`` (the names of each
            node's neighbours, in the order of ``program.hears``) names the links of a status; ``guaranteed_rate``
            [1/s], or ``decay_rate_predicted`` [1/s] where the end of a run tells it, is drawn in the report.

    Raises:
        FileFormatError: the file cannot be written.
        ArgumentError: the attributes are no JSON.
        MissingExtraError: mcap is not installed.
    """

    def __init__(self, path: str | Path, *, network: str, names: Sequence[str], attributes: Mapping[str, Any]) -> None:
        texts = {"names": _plain(list(names)), "attributes": _plain(dict(attributes))}
        metadata = {"kind": LOG_KIND, "version": LOG_VERSION, "network": network, **texts}
        self._file = McapWriter(Path(path), SCHEMA_TEXTS, LABEL, metadata)
        self._hears = heard_by(attributes)
        self._dropped = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._flush_often, name="trigpoint-log", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Frames that were not logged: a file holds at most 65 000 topics, and a status has a length that fits."""
        return self._dropped

    @property
    def failure(self) -> str | None:
        """Why nothing is written any more (the disk is full, say), or None."""
        return self._file.failure

    def write(self, frame: Frame, received_at: float) -> None:
        """Log ``frame``, which came in at the time ``received_at`` [s].

        Raises:
            FileFormatError: the disk refused what was written before, or the log is closed.
            ArgumentError: a number of the frame is not finite.
        """
        topic, schema = topic_of(frame)
        message = message_of(frame, self._hears.get(frame.sender, ()))
        if message is None:
            self._dropped += 1
        else:
            self._add(topic, schema, message, frame.sequence, (received_at, frame.time))

    def event(self, text: str, node: str | None = None, *, time: float) -> None:
        """Log that something (``text``) happened at ``time`` [s] to ``node``, or to the run (None)."""
        message = {"time": float(time), "text": text, "node": node}
        self._add(EVENTS, "trigpoint.Event", message, 0, (time, time))

    def tell(self, attributes: Mapping[str, Any]) -> None:
        """Add to what describes the run; ``attributes`` that were told before are replaced.

        Nodes that join while it goes on are named in ``joined``, all of them, and get the last places in the tables.

        Raises:
            FileFormatError: the disk refuses, or the log is closed.
            ArgumentError: the attributes are no JSON.
        """
        self._file.describe({"attributes": _plain(dict(attributes))})
        self._hears |= heard_by(attributes)

    def flush(self) -> None:
        """Bring all that was written to the disk now."""
        self._file.flush()

    def close(self) -> None:
        """Write the rest and the end of the file; a second call does nothing.

        Raises:
            FileFormatError: the disk refuses.
        """
        self._ended.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self._file.close()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _add(
        self, topic: str, schema: str, message: Mapping[str, Any], sequence: int, times: tuple[float, float]
    ) -> None:
        try:
            data = _encode(message).encode("ascii")
            received, sent = (_nanoseconds(time) for time in times)
        except ValueError as error:
            raise ArgumentError(f"what is logged under {topic} must consist of finite numbers; {error}") from error
        if not self._file.add(topic, schema, data, sequence, (received, sent)):
            self._dropped += 1

    def _flush_often(self) -> None:
        while not self._ended.wait(FLUSH_EVERY):
            with contextlib.suppress(FileFormatError):  # kept by the file; the next write and close say it
                self._file.flush()


def _plain(value: Any) -> str:
    try:
        return _encode(value)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"names and attributes of a log must be plain numbers and texts; {error}") from error


def _nanoseconds(time: float) -> int:
    """The container's time, which begins in 1970 and has 64 bits; a clock that is far off is brought to the ends."""
    if not math.isfinite(time):
        raise ValueError(f"the time {time} is not finite")
    return round(min(max(time, 0.0), 9e9) * 1e9)
