"""Logs for tests: small ones by our writer, strange ones by the plain library."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from trigpoint.runtime import LINK_FIELDS, STATUS_FIELDS, Frame, Kind, LogWriter

EPOCH = 1_700_000_000_000_000_000
START = 1_700_000_000.0
ATTRIBUTES = {"anchor_timeout": 1.0, "seed": 3, "hears": {"a": ["b/c", "d"], "b/c": ["a"]}}


def estimate(name: str, k: int, time: float, values: Any, epoch: int = EPOCH, evidence: float = 0.0) -> Frame:
    return Frame(Kind.ESTIMATE, name, epoch, k, time, (2.0, evidence, 0.0, 0.25), np.asarray(values, dtype=float))


def truth(name: str, k: int, time: float, values: Any) -> Frame:
    return Frame(Kind.TRUTH, name, EPOCH, k, time, (), np.asarray(values, dtype=float))


def reading(label: int, k: int, time: float, values: Any) -> Frame:
    return Frame(Kind.READING, "plant", EPOCH, k, time, (float(label),), np.asarray(values, dtype=float))


def status(name: str, k: int, time: float, values: Any) -> Frame:
    return Frame(Kind.STATUS, name, EPOCH, k, time, (), np.asarray(values, dtype=float))


def small_log(path: Path, rounds: int = 6, later: dict[str, Any] | None = None) -> Path:
    """Two nodes with truth, readings, statuses and events; the file is closed."""
    with LogWriter(path, network="net", names=["a", "b/c"], attributes=ATTRIBUTES) as log:
        log.event("began", time=START)
        for k in range(rounds):
            now = START + 0.1 * k
            for name in ("a", "b/c"):
                log.write(truth(name, k, now, [1.0, k]), now + 0.001)
                log.write(estimate(name, k, now, [1.5, k], evidence=now - 0.05), now + 0.002)
            log.write(reading(-3, k, now, [0.25]), now + 0.003)
            log.write(status("a", k, now, [1.0] * (len(STATUS_FIELDS) + len(LINK_FIELDS) * (k % 3))), now + 0.004)
        log.write(Frame(Kind.BYE, "a", EPOCH, 0, now), now)
        log.event("lost", "a", time=now)
        if later is not None:
            log.tell(later)
    return path


def foreign_log(
    path: Path,
    messages: list[tuple[str, bytes]],
    metadata: dict[str, str] | None = None,
    compression: CompressionType = CompressionType.ZSTD,
    encoding: str = "json",
    **options: Any,
) -> Path:
    """A file by the plain library: topics and texts as given."""
    known = {"kind": "trigpoint/log", "version": "1", "network": "net", "names": '["a"]', "attributes": "{}"}
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, **options)
        writer.start()
        writer.add_metadata("trigpoint", known if metadata is None else metadata)
        for k, (topic, data) in enumerate(messages):
            channel = writer.register_channel(topic, encoding, 0)
            writer.add_message(channel, k, data, k)
        writer.finish()
    return path


def estimate_text(**changes: Any) -> bytes:
    """An estimate as JSON, with some fields changed."""
    fields = {"time": 1.0, "epoch": 1, "sequence": 0, "hops": 0, "evidence": 0, "broken": 0, "uncertainty": 1}
    return json.dumps({**fields, "values": [1.0], **changes}).encode()
