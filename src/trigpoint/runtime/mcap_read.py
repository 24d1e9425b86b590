"""Reading the MCAP container as a stream: a file that was never finished gives what it still holds."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from trigpoint.errors import FileFormatError, MissingExtraError
from trigpoint.runtime.mcap_write import MAGIC

_LARGEST_RECORD = 64 * 1024 * 1024
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE_CODE, _CHUNK, _STATISTICS, _METADATA = 2, 3, 4, 5, 6, 11, 12


class _DamageError(Exception):
    """The rest of the file cannot be read; the text says why."""


@dataclass(frozen=True)
class Channel:
    """Where messages belong: their ``topic``, their ``encoding``, and the name of their ``schema`` (empty: none)."""

    topic: str
    encoding: str
    schema: str


class McapReader:
    """Reads the file at ``path`` once, from its beginning; one chunk is in memory at a time.

    After ``messages`` has ended, ``complete`` tells whether the file has its end, and ``damage`` why not. ``metadata``
    are the records by name, in order, as far as the reading has come.

    Raises:
        FileFormatError: the file cannot be opened, or is no MCAP file.
        MissingExtraError: mcap is not installed.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            from mcap import data_stream, exceptions, records
        except ImportError as error:
            raise MissingExtraError("mcap", "live", "reading a log") from error
        self.path = path
        self.metadata: dict[str, list[Mapping[str, str]]] = {}
        self.complete, self.damage = False, ""
        self._records, self._stream_of = records, data_stream.ReadDataStream
        # what the parsers of single records make of bytes that are none; UnicodeDecodeError is a ValueError
        self._malformed = (exceptions.McapError, struct.error, ValueError, OverflowError)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._count, self._promised = 0, -1
        try:
            with Path(path).open("rb") as stream:
                start = stream.read(len(MAGIC))
        except OSError as error:
            raise FileFormatError(path, f"cannot be read ({error.strerror or error})") from error
        if start != MAGIC:
            short = MAGIC.startswith(start)
            raise FileFormatError(path, "is cut in its first bytes" if short else "is no MCAP file")

    def messages(self) -> Iterator[tuple[Channel, int, int, bytes]]:
        """Channel, times of arrival and of sending [ns] and text of every message that can be read."""
        position = len(MAGIC)
        try:
            with Path(self.path).open("rb") as stream:
                stream.seek(position)
                while True:
                    opcode, content = _next_record(stream)
                    if opcode == _FOOTER:
                        self._end(stream.read(len(MAGIC)))
                        return
                    yield from self._messages_in(opcode, content)
                    position += _RECORD.size + len(content)
        except _DamageError as damage:
            self.damage = f"{damage} (byte {position})"
        except OSError as error:
            raise FileFormatError(self.path, f"cannot be read ({error.strerror or error})") from error

    def _end(self, magic: bytes) -> None:
        if magic != MAGIC:
            self.damage = "its last bytes are missing"
        elif self._promised not in (-1, self._count):
            self.damage = f"its end promises {self._promised} messages; {self._count} were found"
        self.complete = not self.damage

    def _messages_in(self, opcode: int, content: bytes) -> Iterator[tuple[Channel, int, int, bytes]]:
        if opcode == _CHUNK:
            yield from self._messages_of_chunk(self._chunk(content))
        elif opcode == _MESSAGE_CODE:
            yield self._message(content, 0, len(content))
        elif opcode == _STATISTICS:
            self._promised = self._parsed(self._records.Statistics.read, content).message_count
        elif opcode == _METADATA:
            record = self._parsed(self._records.Metadata.read, content)
            self.metadata.setdefault(record.name, []).append(record.metadata)
        else:
            self._describe(opcode, content)

    def _messages_of_chunk(self, data: bytes) -> Iterator[tuple[Channel, int, int, bytes]]:
        at = 0
        while at < len(data):
            if at + _RECORD.size > len(data):
                raise _DamageError("a chunk ends within a record")
            opcode, length = _RECORD.unpack_from(data, at)
            at += _RECORD.size
            if at + length > len(data):
                raise _DamageError("a chunk ends within a record")
            if opcode == _MESSAGE_CODE:
                yield self._message(data, at, length)
            else:
                self._describe(opcode, data[at : at + length])
            at += length

    def _message(self, data: bytes, at: int, length: int) -> tuple[Channel, int, int, bytes]:
        if length < _MESSAGE.size:
            raise _DamageError("a message is shorter than its head")
        number, _, received, sent = _MESSAGE.unpack_from(data, at)
        if number not in self._channels:
            raise _DamageError(f"a message belongs to the channel {number}, which nothing describes")
        self._count += 1
        return self._channels[number], received, sent, data[at + _MESSAGE.size : at + length]

    def _describe(self, opcode: int, content: bytes) -> None:
        if opcode == _SCHEMA:
            schema = self._parsed(self._records.Schema.read, content)
            self._schemas[schema.id] = schema.name
        elif opcode == _CHANNEL:
            channel = self._parsed(self._records.Channel.read, content)
            name = self._schemas.get(channel.schema_id, "")
            self._channels[channel.id] = Channel(channel.topic, channel.message_encoding, name)

    def _parsed(self, read: Callable[[Any], Any], content: bytes) -> Any:
        try:
            return read(self._stream_of(io.BytesIO(content)))
        except self._malformed as error:
            raise _DamageError(f"a record is malformed: {error or type(error).__name__}") from error

    def _chunk(self, content: bytes) -> bytes:
        chunk = self._parsed(self._records.Chunk.read, content)
        if chunk.uncompressed_size > _LARGEST_RECORD:
            raise _DamageError(f"a chunk of {chunk.uncompressed_size} bytes is larger than {_LARGEST_RECORD}")
        data = _decompressed(chunk.compression, chunk.data, chunk.uncompressed_size)
        if len(data) != chunk.uncompressed_size or (chunk.uncompressed_crc not in (0, zlib.crc32(data))):
            raise _DamageError("a chunk's checksum or size does not fit its content")
        return data


def _next_record(stream: BinaryIO) -> tuple[int, bytes]:
    head = stream.read(_RECORD.size)
    if len(head) < _RECORD.size:
        raise _DamageError("it ends without its end: the writer was stopped")
    opcode, length = _RECORD.unpack(head)
    if length > _LARGEST_RECORD:
        raise _DamageError(f"a record says that it has {length} bytes, more than {_LARGEST_RECORD}")
    content = stream.read(length)
    if len(content) < length:
        raise _DamageError("it ends within a record: the writer was stopped")
    return opcode, content


def _decompressed(compression: str, data: bytes, size: int) -> bytes:
    """At most ``size`` + 1 bytes, whatever the data say about their length."""
    if not compression:
        return data
    if compression == "zstd":
        import zstandard

        try:
            with zstandard.ZstdDecompressor().stream_reader(data) as stream:
                return stream.read(size + 1)
        except zstandard.ZstdError as error:
            raise _DamageError(f"a chunk cannot be decompressed: {error}") from error
    if compression == "lz4":
        import lz4.frame

        try:
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
        except RuntimeError as error:
            raise _DamageError(f"a chunk cannot be decompressed: {error}") from error
    raise _DamageError(f"a chunk is compressed by {compression!r}, which this cannot read")
