"""Damaged, foreign and hostile logs: what can be read is read, everything else is a clear error."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType

from tests.runtime.logged import START, estimate, estimate_text, foreign_log, reading, small_log
from trigpoint.errors import FileFormatError
from trigpoint.runtime import STATUS_FIELDS, Log, LogWriter, read_log, read_run
from trigpoint.runtime.mcap_write import MAGIC


@pytest.fixture(scope="module")
def pieces(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of several small chunks."""
    path = tmp_path_factory.mktemp("pieces") / "run.mcap"
    with LogWriter(path, network="n", names=["a"], attributes={}) as log:
        for k in range(9):
            log.write(estimate("a", k, START + k, [k]), START + k)
            log.write(reading(0, k, START + k, [k]), START + k)
            if k % 3 == 2:
                log.flush()
    return path.read_bytes()


def outcome(path: Path, data: bytes) -> Log | None:
    path.write_bytes(data)
    try:
        log = read_log(path)
    except FileFormatError:
        return None
    assert log.complete == (log.damage == "")
    return log


def recovered(path: Path, data: bytes) -> int:
    """Number of estimates that are read, in order; -1 where the file is refused. A gap is told."""
    log = outcome(path, data)
    if log is None:
        return -1
    if "a" not in log.estimates:
        return 0
    sequences = log.estimates["a"].sequences.tolist()
    assert sequences == sorted(set(sequences))
    assert sequences == list(range(len(sequences))) or not log.complete
    return len(sequences)


def check_cuts(path: Path, data: bytes, lengths: list[int]) -> None:
    counts = [recovered(path, data[:length]) for length in lengths]
    assert counts == sorted(counts)  # a longer piece never gives less
    assert set(counts) == {-1, 0, 3, 6, 9}


def test_a_file_cut_anywhere_gives_the_chunks_before(tmp_path: Path, pieces: bytes) -> None:
    check_cuts(tmp_path / "cut.mcap", pieces, list(range(0, len(pieces), 23)))


@pytest.mark.slow
def test_a_file_cut_at_every_byte_gives_the_chunks_before(tmp_path: Path, pieces: bytes) -> None:
    check_cuts(tmp_path / "cut.mcap", pieces, list(range(len(pieces))))


@given(st.data())
def test_bytes_that_turned_do_no_harm(
    tmp_path_factory: pytest.TempPathFactory, pieces: bytes, data: st.DataObject
) -> None:
    spoiled = bytearray(pieces)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(8, len(pieces) - 1))
        spoiled[at : at + 1] = data.draw(st.binary(max_size=9))
    assert recovered(tmp_path_factory.mktemp("spoiled") / "run.mcap", bytes(spoiled)) <= 9


@pytest.mark.slow
def test_every_byte_turned_in_turn_does_no_harm(tmp_path: Path, pieces: bytes) -> None:
    for at in range(len(pieces)):
        spoiled = pieces[:at] + bytes([255 if at % 2 else pieces[at] ^ 1]) + pieces[at + 1 :]
        assert recovered(tmp_path / "run.mcap", spoiled) <= 9


@given(st.binary(max_size=60))
def test_random_bytes_behind_the_magic_do_no_harm(tmp_path_factory: pytest.TempPathFactory, tail: bytes) -> None:
    assert outcome(tmp_path_factory.mktemp("random") / "run.mcap", MAGIC + tail) is None


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "is cut in its first bytes"),
        (MAGIC[:5], "is cut in its first bytes"),
        (b"PK\x03\x04 something else", "is no MCAP file"),
        (MAGIC, "no log of a live run; its head may be lost"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, text: str) -> None:
    (tmp_path / "run.mcap").write_bytes(content)
    with pytest.raises(FileFormatError, match=text):
        read_log(tmp_path / "run.mcap")


def test_a_file_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none.mcap"):
        with pytest.raises(FileFormatError, match="cannot be read"):
            read_log(path)


def test_a_file_that_goes_away_meanwhile_is_said(tmp_path: Path) -> None:
    from trigpoint.runtime.mcap_read import McapReader

    path = small_log(tmp_path / "run.mcap")
    reader = McapReader(path)
    path.unlink()
    with pytest.raises(FileFormatError, match="cannot be read"):
        list(reader.messages())


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"kind": "other"}, "no log of a live run"),
        ({"version": "2"}, "version '2'"),
        ({"names": "["}, "no JSON"),
        ({"names": "[" * 100_000}, "no JSON"),
        ({"names": "[1]"}, "different names"),
        ({"names": '["a", "a"]'}, "different names"),
        ({"attributes": "[]"}, "different names and an object"),
    ],
)
def test_a_wrong_head_is_refused(tmp_path: Path, changes: dict[str, str], text: str) -> None:
    head = {"kind": "trigpoint/log", "version": "1", "network": "n", "names": "[]", "attributes": "{}"}
    with pytest.raises(FileFormatError, match=text):
        read_log(foreign_log(tmp_path / "run.mcap", [], {**head, **changes}))


WRONG: list[tuple[str, bytes]] = [
    ("/node/a/estimate", b"{"),
    ("/node/a/estimate", b"\xff"),
    ("/node/a/estimate", b"[]"),
    ("/node/a/estimate", b"{}"),
    ("/node/a/estimate", b"[" * 100_000),
    ("/node/a/estimate", estimate_text(time="now")),
    ("/node/a/estimate", estimate_text(time=None)),
    ("/node/a/estimate", estimate_text(epoch=-1)),
    ("/node/a/estimate", estimate_text(epoch=2**64)),
    ("/node/a/estimate", estimate_text(sequence=0.5)),
    ("/node/a/estimate", estimate_text(values=3)),
    ("/node/a/estimate", estimate_text(values="123")),
    ("/node/a/estimate", estimate_text(values=[[1.0]])),
    ("/node/a/estimate", estimate_text(values=[10**400])),
    ("/node/a/estimate", estimate_text(values=[0.0] * 4097)),
    ("/node/a/estimate", estimate_text(values=[float("nan")])),
    ("/node/a/estimate", estimate_text(time=1.0).replace(b"1.0", b"1e999")),
    ("/node/a/estimate", estimate_text().replace(b'"hops": 0', b'"hops": 1e999')),
    ("/node/a/status", estimate_text()),
    (
        "/node/a/status",
        json.dumps(dict.fromkeys((*STATUS_FIELDS, "time", "epoch", "sequence"), 1) | {"links": 3}).encode(),
    ),
    ("/reading/one", estimate_text()),
    ("/reading/--5", estimate_text()),
    ("/event", b'{"time": 1, "text": 2, "node": null}'),
    ("/event", b'{"time": 1, "text": "x", "node": 3}'),
    ("/event", b'{"time": 1e999, "text": "x", "node": null}'),
]


@pytest.mark.parametrize(("topic", "data"), WRONG, ids=range(len(WRONG)))
def test_a_message_that_does_not_follow_its_schema_is_refused(tmp_path: Path, topic: str, data: bytes) -> None:
    path = foreign_log(tmp_path / "run.mcap", [(topic, data)])
    with pytest.raises(FileFormatError, match=r"schema|finite|whole number"):
        read_log(path)


def test_one_reading_under_two_topics_is_refused(tmp_path: Path) -> None:
    path = foreign_log(tmp_path / "run.mcap", [("/reading/5", estimate_text()), ("/reading/05", estimate_text())])
    with pytest.raises(FileFormatError, match="under two topics"):
        read_log(path)


def test_a_message_of_another_size_is_left_out_and_counted(tmp_path: Path) -> None:
    texts = [estimate_text(values=values) for values in ([1.0, 2.0], [3.0], [4.0, 5.0])]
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a"], attributes={}) as log:
        for k, text in enumerate(texts):
            log.write(estimate("a", k, 1.0 + k, json.loads(text)["values"]), 1.0)
    log_read = read_log(path)
    assert log_read.odd == 1
    assert log_read.estimates["a"].values.tolist() == [[1.0, 2.0], [4.0, 5.0]]


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunks", [True, False])
def test_files_by_other_writers_are_read(tmp_path: Path, compression: CompressionType, chunks: bool) -> None:
    messages = [("/node/a/estimate", estimate_text()), ("/elsewhere", b"{"), ("/node/a/other/thing", b"{}")]
    path = foreign_log(tmp_path / "run.mcap", messages, compression=compression, use_chunking=chunks)
    log = read_log(path)
    assert log.complete
    assert log.estimates["a"].values.tolist() == [[1.0]]


def test_topics_in_other_encodings_are_passed_over(tmp_path: Path) -> None:
    assert not read_log(foreign_log(tmp_path / "x.mcap", [("/node/a/estimate", b"\x00")], encoding="cdr")).estimates


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(data: bytes, size: int, compression: bytes = b"zstd", crc: int = 0) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, crc)
    named = struct.pack("<I", len(compression)) + compression
    return record(6, head + named + struct.pack("<Q", len(data)) + data)


def packed(data: bytes) -> bytes:
    return zstandard.ZstdCompressor().compress(data)


MESSAGE = record(5, struct.pack("<HIQQ", 7, 0, 0, 0) + b"{}")
ZEROS = b"\x00" * 2**20
HOSTILE: dict[str, tuple[bytes, str]] = {
    "a record of 2^63 bytes": (struct.pack("<BQ", 6, 2**63), "more than"),
    "a chunk that says it is huge": (chunk(packed(b""), 2**40), "larger than"),
    "a chunk that is larger than it says": (chunk(packed(ZEROS), 10), "does not fit"),
    "an lz4 chunk that is none": (chunk(b"this is no frame of lz4", 23, b"lz4"), "cannot be decompressed"),
    "a zstd chunk that is none": (chunk(b"abc", 3), "cannot be decompressed"),
    "an unknown compression": (chunk(b"abc", 3, b"xz"), "which this cannot read"),
    "a wrong checksum": (chunk(b"abc", 3, b"", zlib.crc32(b"abd")), "does not fit"),
    "a chunk that ends within a record": (chunk(b"abc", 3, b""), "ends within a record"),
    "a record in a chunk that is longer than it": (chunk(MESSAGE[:-1], len(MESSAGE) - 1, b""), "ends within a record"),
    "a message without a channel": (chunk(MESSAGE, len(MESSAGE), b""), "which nothing describes"),
    "a message without a head": (record(5, b"{}"), "shorter than its head"),
    "a channel that is none": (record(4, b"\x01\x00\x00\x00\xff\xff\xff\xff"), "malformed"),
    "a name that is no text": (record(3, b"\x01\x00\x01\x00\x00\x00\xff"), "malformed"),
    "lists of 2^32 bytes": (record(12, b"\x00\x00\x00\x00\xff\xff\xff\xff"), "malformed"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_records_end_the_reading_and_are_told(tmp_path: Path, pieces: bytes, name: str) -> None:
    data, text = HOSTILE[name]
    end = pieces.index(struct.pack("<BQ", 15, 4))  # the record that ends the data
    log = outcome(tmp_path / "run.mcap", pieces[:end] + data + pieces[end:])
    assert log is not None
    assert text in log.damage
    assert not log.complete
    assert len(log.estimates["a"]) == 9


def test_the_last_bytes_belong_to_it(tmp_path: Path, pieces: bytes) -> None:
    log = outcome(tmp_path / "run.mcap", pieces[:-1])
    assert log is not None
    assert log.damage == "its last bytes are missing"


@pytest.mark.parametrize(
    ("names", "values", "text"),
    [
        (["b"], [1.0], "no estimate of any"),
        ([str(k) for k in range(20_000)] + ["a"], [0.0] * 4096, "than a table holds"),
    ],
)
def test_a_log_that_makes_no_run_is_refused(tmp_path: Path, names: list[str], values: Any, text: str) -> None:
    with LogWriter(tmp_path / "run.mcap", network="n", names=names, attributes={}) as log:
        log.write(estimate("a", 0, 1.0, np.array(values)), 1.0)
    with pytest.raises(FileFormatError, match=text):
        read_run(tmp_path / "run.mcap")
