"""Writing the MCAP container, with chunks that are closed on demand."""

from __future__ import annotations

import os
import struct
import threading
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trigpoint.errors import FileFormatError, MissingExtraError

MAGIC = b"\x89MCAP0\r\n"
MOST_CHANNELS = 65_000
_MESSAGE = struct.Struct("<BQHIQQ")
_FULL = 4 * 1024 * 1024  # bytes of messages that may wait for the next closing
_LARGEST_TIME = 2**63 - 1


class McapWriter:
    """One MCAP file under construction.

    ``mcap.writer.Writer`` closes a chunk when it is full, which may take minutes; here ``flush`` closes it, so that
    everything before the last ``flush`` survives the end of the process. Chunks are compressed by Zstandard, carry a
    checksum and an index, and hold the schemas and channels that they are the first to need.

    We assume:
        - ``add`` and ``flush`` may be called from several threads; ``add`` waits for the disk only when 4 MiB wait.
        - after a failure of the disk nothing more is written; every later call says so.

    Args:
        path: the file; what was there is replaced.
        schemas: JSON schema of each kind of message, as text, by name.
        label: name of the metadata records.
        metadata: texts that describe the file, written at once.
    """

    def __init__(self, path: Path, schemas: Mapping[str, str], label: str, metadata: Mapping[str, str]) -> None:
        try:
            import zstandard
            from mcap import records
            from mcap.data_stream import RecordBuilder
        except ImportError as error:
            raise MissingExtraError("mcap", "live", "a log") from error
        self.path = path
        self._records, self._builder = records, RecordBuilder
        self._compress = zstandard.ZstdCompressor(level=3).compress
        self._schemas = {
            name: records.Schema(id=k, data=text.encode("utf-8"), encoding="jsonschema", name=name)
            for k, (name, text) in enumerate(schemas.items(), start=1)
        }
        self._channels: dict[str, Any] = {}
        self._counts: dict[int, int] = {}
        self._told: set[str] = set()
        self._chunk, self._index = bytearray(), dict[int, list[int]]()
        self._chunk_indexes = bytearray()
        self._chunks, self._first, self._last, self._position = 0, _LARGEST_TIME, 0, 0
        self._failure: str | None = None
        self._adding, self._writing = threading.Lock(), threading.Lock()
        self._descriptor = self._open()
        self._label = label
        self._metadata_indexes: list[Any] = []
        self._describe(metadata, MAGIC + self._bytes(records.Header(profile="", library="trigpoint")))

    @property
    def failure(self) -> str | None:
        """Why nothing is written any more, or None."""
        return self._failure

    def add(self, topic: str, schema: str, data: bytes, sequence: int, times: tuple[int, int]) -> bool:
        """Take in one message: its JSON text, its number and when it was received and sent, nanoseconds since 1970.

        Returns:
            False when the file has as many topics as it can hold and this is a further one.

        Raises:
            FileFormatError: the disk refused an earlier chunk, or the file is closed.
        """
        self._check()
        received, sent = times
        with self._adding:
            channel = self._channels.get(topic) or self._new_channel(topic, schema)
            if channel is None:
                return False
            index = self._index.setdefault(channel.id, [])
            index += (received, len(self._chunk))
            self._counts[channel.id] += 1
            self._first, self._last = min(self._first, received), max(self._last, received)
            number = sequence & 0xFFFFFFFF
            self._chunk += _MESSAGE.pack(5, 22 + len(data), channel.id, number, received, sent)
            self._chunk += data
            full = len(self._chunk) > _FULL
        if full:
            self.flush()
        return True

    def describe(self, metadata: Mapping[str, str]) -> None:
        """Bring a further record of ``metadata`` to the disk, under the file's label, behind what was added so far.

        Raises:
            FileFormatError: the disk refuses, or the file is closed.
        """
        self._describe(metadata)

    def _describe(self, metadata: Mapping[str, str], before: bytes = b"") -> None:
        record = self._bytes(self._records.Metadata(name=self._label, metadata=dict(metadata)))
        with self._writing:
            self._check()
            self._close_chunk()
            place = self._position + len(before)
            self._put(before + record)
            self._metadata_indexes.append(
                self._records.MetadataIndex(offset=place, length=len(record), name=self._label)
            )

    def flush(self) -> None:
        """Close the chunk and bring it to the disk; a refusal is a ``FileFormatError``."""
        with self._writing:
            self._check()
            self._close_chunk()

    def close(self) -> None:
        """Write what waits, the summary and the end; a second call does nothing."""
        with self._writing:
            if self._descriptor is None:
                return
            try:
                self._check()
                self._close_chunk()
                self._put(self._ending())
            finally:
                os.close(self._descriptor)
                self._descriptor = None

    def _open(self) -> int | None:
        try:
            return os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        except OSError as error:
            raise FileFormatError(self.path, f"the log cannot be written ({error.strerror})") from error

    def _check(self) -> None:
        if self._failure is not None:
            raise FileFormatError(self.path, self._failure)
        if self._descriptor is None:
            raise FileFormatError(self.path, "the log is closed: nothing can be written any more")

    def _bytes(self, *records: Any) -> bytes:
        builder = self._builder()
        for record in records:
            record.write(builder)
        return bytes(builder.end())  # type: ignore[no-untyped-call]

    def _new_channel(self, topic: str, schema: str) -> Any:
        if len(self._channels) >= MOST_CHANNELS:
            return None
        known = self._schemas[schema]
        channel = self._records.Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding="json", metadata={}, schema_id=known.id
        )
        self._chunk += self._bytes(*(() if schema in self._told else (known,)), channel)
        self._told.add(schema)
        self._channels[topic] = channel
        self._counts[channel.id] = 0
        return channel

    def _put(self, data: bytes) -> None:
        """Write ``data`` and wait for the disk; the lock for writing is held."""
        assert self._descriptor is not None
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._descriptor, view) :]
            os.fsync(self._descriptor)
        except OSError as error:
            self._failure = f"the log cannot be written ({error.strerror}); what was written before can be read"
            raise FileFormatError(self.path, self._failure) from error
        self._position += len(data)

    def _close_chunk(self) -> None:
        with self._adding:
            chunk, index = bytes(self._chunk), self._index
            self._chunk, self._index = bytearray(), {}
        if not index:
            return
        received = [time for entries in index.values() for time in entries[::2]]
        record = self._records.Chunk(
            compression="zstd",
            data=self._compress(chunk),
            message_start_time=min(received),
            message_end_time=max(received),
            uncompressed_crc=zlib.crc32(chunk),
            uncompressed_size=len(chunk),
        )
        parts = [self._bytes(record)]
        offsets, at = {}, self._position + len(parts[0])
        for channel, entries in index.items():
            pairs = list(zip(entries[::2], entries[1::2], strict=True))
            parts.append(self._bytes(self._records.MessageIndex(channel_id=channel, records=pairs)))
            offsets[channel] = at
            at += len(parts[-1])
        # kept as bytes: for many topics the index of an hour as objects would fill the memory
        self._chunk_indexes += self._bytes(
            self._records.ChunkIndex(
                chunk_length=len(parts[0]),
                chunk_start_offset=self._position,
                compression="zstd",
                compressed_size=len(record.data),
                message_end_time=record.message_end_time,
                message_index_length=at - self._position - len(parts[0]),
                message_index_offsets=offsets,
                message_start_time=record.message_start_time,
                uncompressed_size=len(chunk),
            )
        )
        self._chunks += 1
        self._put(b"".join(parts))

    def _ending(self) -> bytes:
        records = self._records
        count = sum(self._counts.values())
        statistics = records.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=count,
            metadata_count=len(self._metadata_indexes),
            message_start_time=self._first if count else 0,
            message_end_time=self._last,
            schema_count=len(self._told),
        )
        groups = (
            (3, self._bytes(*(self._schemas[name] for name in self._schemas if name in self._told))),
            (4, self._bytes(*self._channels.values())),
            (11, self._bytes(statistics)),
            (8, bytes(self._chunk_indexes)),
            (13, self._bytes(*self._metadata_indexes)),
        )
        data_end = self._bytes(records.DataEnd(data_section_crc=0))
        start = at = self._position + len(data_end)
        offsets = b""
        for opcode, group in groups:
            if group:
                offsets += self._bytes(
                    records.SummaryOffset(group_opcode=opcode, group_start=at, group_length=len(group))
                )
            at += len(group)
        summary = b"".join(group for _, group in groups) + offsets
        checked = summary + struct.pack("<BQQQ", 2, 20, start, at)
        footer = records.Footer(summary_start=start, summary_offset_start=at, summary_crc=zlib.crc32(checked))
        return data_end + summary + self._bytes(footer) + MAGIC
