"""Logs: what goes in comes out, standard tools read them, and no death of the writer loses more than a moment."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from tests.machine import effort, until, with_time
from tests.runtime.logged import EPOCH, START, estimate, small_log, status
from trigpoint.errors import ArgumentError, FileFormatError, MissingExtraError
from trigpoint.runtime import (
    FACTS,
    LINK_FIELDS,
    STATUS_FIELDS,
    Frame,
    Kind,
    Log,
    LogWriter,
    Series,
    State,
    mcap_write,
    read_log,
    read_run,
)

NAMES = ("a", "b/c", "µ %2F", "")
FINITE = st.floats(allow_nan=False, allow_infinity=False)
KINDS = (Kind.ESTIMATE, Kind.TRUTH, Kind.STATUS, Kind.READING)
SENT = st.builds(
    lambda kind, name, epoch, sequence, time, facts, values: Frame(
        kind,
        name,
        epoch,
        sequence,
        time,
        (float(sequence % 7),) if kind is Kind.READING else tuple(facts[: len(FACTS[kind])]),
        np.array(values * 20)[: len(STATUS_FIELDS) + 2 * len(LINK_FIELDS)] if kind is Kind.STATUS else np.array(values),
    ),
    st.sampled_from(KINDS),
    st.sampled_from(NAMES),
    st.integers(0, 2**64 - 1),
    st.integers(0, 2**64 - 1),
    FINITE,
    st.lists(FINITE, min_size=4, max_size=4),
    st.lists(FINITE, min_size=2, max_size=2),
)


def table(log: Log, frame: Frame) -> Series:
    if frame.kind is Kind.READING:
        return log.readings[int(frame.facts[0])]
    family = {Kind.ESTIMATE: log.estimates, Kind.TRUTH: log.truths, Kind.STATUS: log.statuses}
    return family[frame.kind][frame.sender]


@given(st.lists(SENT, max_size=12))
def test_what_goes_in_comes_out(tmp_path_factory: pytest.TempPathFactory, sent: list[Frame]) -> None:
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with LogWriter(path, network="n", names=NAMES, attributes={"x": [1, "two"]}) as writer:
        for frame in sent:
            writer.write(frame, 5.25)
    log = read_log(path)
    assert (log.complete, log.damage, log.odd) == (True, "", 0)
    assert (log.network, log.names, log.attributes) == ("n", NAMES, {"x": [1, "two"]})
    seen: dict[int, int] = {}
    for frame in sent:
        series = table(log, frame)
        k = seen.get(id(series), 0)
        seen[id(series)] = k + 1
        assert series.row(k).tobytes() == frame.values.tobytes()
        assert (series.times[k], series.received[k]) == (frame.time, 5.25)
        assert (int(series.epochs[k]), int(series.sequences[k])) == frame.age_key
        assert [column[k] for column in series.facts.values()] == list(frame.facts if series.facts else ())
    assert all(seen[id(series)] == len(series) for series in (table(log, frame) for frame in sent))


def test_events_and_ragged_statuses(tmp_path: Path) -> None:
    log = read_log(small_log(tmp_path / "run.mcap"))
    assert [(event.time, event.text, event.node) for event in log.events] == [
        (START, "began", None),
        (START + 0.5, "lost", "a"),
    ]
    links = [(log.statuses["a"].row(k).shape[0] - len(STATUS_FIELDS)) // len(LINK_FIELDS) for k in range(6)]
    assert links == [0, 1, 2, 0, 1, 2]
    told = log.status("a")
    assert told is not None
    assert (told.name, told.anchored, told.hops, told.counters.accepted) == ("a", True, 1, 1)
    assert [(link.neighbour, link.state, link.round_trip) for link in told.links] == [
        ("b/c", State.HEARD, 1.0),
        ("d", State.HEARD, 1.0),
    ]
    assert log.status("b/c") is None
    assert log.estimates["b/c"].values.shape == (6, 2)


def test_statuses_that_mean_nothing_do_no_harm(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap", network="n", names=["a"], attributes={"hears": {"a": 3}}) as log:
        log.write(status("a", 0, 1.0, [1.0] * 5), 1.0)  # no length that a status can have
        log.write(status("a", 1, 1.0, [1.0] * len(STATUS_FIELDS) + [99.0] * len(LINK_FIELDS)), 1.0)  # no such state
    assert log.dropped == 1
    read = read_log(tmp_path / "run.mcap")
    assert len(read.statuses["a"]) == 1
    assert read.status("a") is None


def fits(value: Any, schema: dict[str, Any]) -> bool:
    """The part of JSON Schema that the log uses, read anew."""
    if "enum" in schema:
        return value in schema["enum"]
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    types = {"object": dict, "array": list, "string": str, "number": int | float, "integer": int, "null": type(None)}
    if isinstance(value, bool) or not any(isinstance(value, types[kind]) for kind in kinds):
        return False
    if isinstance(value, dict):
        known = schema["properties"]
        return set(schema["required"]) <= set(value) <= set(known) and all(fits(value[k], known[k]) for k in value)
    if isinstance(value, list):
        return all(fits(entry, schema["items"]) for entry in value)
    return "minimum" not in schema or value >= schema["minimum"]


def test_the_plain_library_reads_it_and_every_message_fits_its_schema(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    small_log(path, later={"seed": 4, "joined": ["d"]})
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        found = list(reader.iter_messages())
        described, later = reader.iter_metadata()
    assert summary.statistics.message_count == len(found) == 2 + 6 * 6 + 1
    assert summary.statistics.chunk_count == len(summary.chunk_indexes)
    assert {channel.topic for channel in summary.channels.values()} == {
        "/event",
        "/reading/-3",
        "/node/a/estimate",
        "/node/a/status",
        "/node/a/notice",
        "/node/b%2Fc/estimate",
        "/truth/a",
        "/truth/b%2Fc",
    }
    assert described.metadata["kind"] == "trigpoint/log"
    assert later.metadata == {"attributes": '{"seed":4,"joined":["d"]}'}
    assert summary.statistics.metadata_count == len(summary.metadata_indexes) == 2
    for schema, channel, message in found:
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert fits(json.loads(message.data), json.loads(schema.data)), (channel.topic, message.data)
    assert not fits({"time": "now"}, json.loads(found[0][0].data))  # type: ignore[union-attr]


def test_one_topic_can_be_read_through_the_index(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a"], attributes={}) as log:
        for k in range(40):
            log.write(estimate("a" if k % 2 else "b", k, START + k, [k]), START + k)
            if k % 10 == 9:
                log.flush()
    with path.open("rb") as stream:
        reader = make_reader(stream)
        found = list(reader.iter_messages("/node/a/estimate"))
        summary = reader.get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == 4
    assert [message.sequence for _, _, message in found] == list(range(1, 40, 2))


KILLED = """
import sys, time
sys.path.insert(0, {root!r})
from tests.runtime.logged import estimate
from trigpoint.runtime import LogWriter
log = LogWriter(sys.argv[1], network="n", names=["a"], attributes={{}})
k = 0
while True:
    now = time.time()
    log.write(estimate("a", k, now, [now]), now)
    print(k, now, flush=True)
    k += 1
    time.sleep(0.002)
"""


def test_a_killed_writer_loses_less_than_the_last_second(tmp_path: Path) -> None:
    with_time(lambda attempt: kill_a_writer(tmp_path / f"run-{attempt}.mcap"))


def kill_a_writer(path: Path) -> None:
    root = str(Path(__file__).resolve().parents[2])
    command = [sys.executable, "-c", KILLED.format(root=root), str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        began, line = None, ""
        for line in process.stdout:
            now = float(line.split()[1])
            began = now if began is None else began
            if now > began + 2.3:
                break
        process.send_signal(signal.SIGKILL)
        rest = process.stdout.read().splitlines()
        assert process.wait() == -signal.SIGKILL
    last = float((rest[-1] if rest and len(rest[-1].split()) == 2 else line).split()[1])
    log = read_log(path)
    series = log.estimates["a"]
    assert not log.complete
    assert "the writer was stopped" in log.damage
    assert series.sequences.tolist() == list(range(len(series)))  # nothing before is missing
    assert last - series.times[-1] < 1.0


def test_what_was_written_is_on_the_disk_soon_without_being_closed(tmp_path: Path) -> None:
    log = LogWriter(tmp_path / "run.mcap", network="n", names=["a"], attributes={})
    log.write(estimate("a", 0, 1.0, [2.0]), 1.0)
    assert until(lambda: read_log(tmp_path / "run.mcap").estimates)
    assert read_log(tmp_path / "run.mcap").estimates["a"].values.tolist() == [[2.0]]
    log.close()
    log.close()
    assert log.failure is None


@pytest.mark.parametrize("place", ["missing/run.mcap", "."])
def test_a_place_that_cannot_be_written_is_said_at_once(tmp_path: Path, place: str) -> None:
    with pytest.raises(FileFormatError, match="cannot be written"):
        LogWriter(tmp_path / place, network="n", names=[], attributes={})


def test_a_full_disk_is_said_at_once(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").symlink_to("/dev/full")
    with pytest.raises(FileFormatError, match="No space left"):
        LogWriter(tmp_path / "run.mcap", network="n", names=[], attributes={})


def test_a_disk_that_fills_up_is_said_by_the_next_call_and_what_was_written_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    log = LogWriter(path, network="n", names=["a"], attributes={})
    log.write(estimate("a", 0, 1.0, [2.0]), 1.0)
    log.flush()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 50, before[1]))
        log.write(estimate("a", 1, 1.0, np.random.default_rng(0).normal(size=500)), 1.0)
        with pytest.raises(FileFormatError, match="cannot be written"):
            log.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert log.failure is not None
    with pytest.raises(FileFormatError, match="what was written before can be read"):
        log.write(estimate("a", 2, 1.0, [2.0]), 1.0)
    with pytest.raises(FileFormatError, match="what was written before can be read"):
        log.close()
    assert read_log(path).estimates["a"].values.tolist() == [[2.0]]


def test_a_closed_log_takes_nothing(tmp_path: Path) -> None:
    log = LogWriter(tmp_path / "run.mcap", network="n", names=[], attributes={})
    log.close()
    with pytest.raises(FileFormatError, match="is closed"):
        log.event("late", time=1.0)


def test_numbers_that_are_none_are_refused(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap", network="n", names=["a"], attributes={}) as log:
        for frame, at in ((estimate("a", 0, 1.0, [np.nan]), 1.0), (estimate("a", 0, 1.0, [1.0]), np.inf)):
            with pytest.raises(ArgumentError, match="finite"):
                log.write(frame, at)
    for attributes in ({"x": np.nan}, {"x": object()}):
        with pytest.raises(ArgumentError, match="plain numbers"):
            LogWriter(tmp_path / "other.mcap", network="n", names=[], attributes=attributes)


def test_what_is_told_later_counts_at_once_and_the_last_word_of_it(tmp_path: Path) -> None:
    """Also where the writer is killed then; a node that joined is named in the statuses of its neighbours, and read."""
    path = tmp_path / "run.mcap"
    log = LogWriter(path, network="n", names=["a"], attributes={"seed": 1, "gain": 2.0, "hears": {"a": []}})
    log.write(estimate("a", 0, START, [1.0]), START)
    log.tell({"joined": ["d"], "hears": {"a": ["d"], "d": ["a"]}, "seed": 2})
    log.write(status("a", 0, START, [1.0] * (len(STATUS_FIELDS) + len(LINK_FIELDS))), START)
    log.write(estimate("d", 0, START, [3.0]), START)
    log.tell({"seed": 3})
    found = read_log(path)
    assert not found.complete
    assert found.names == ("a", "d")
    assert (found.attributes["seed"], found.attributes["gain"]) == (3, 2.0)
    log.close()
    found = read_log(path)
    assert found.complete
    assert [link.neighbour for link in found.status("a").links] == ["d"]  # type: ignore[union-attr]
    assert read_run(path).estimate[0].tolist() == [[1.0], [3.0]]
    with pytest.raises(ArgumentError, match="plain numbers"):
        log.tell({"x": object()})
    with pytest.raises(FileFormatError, match="is closed"):
        log.tell({"x": 1})


@pytest.mark.parametrize("more", ["{", "[]", '{"joined": ["a"]}', '{"joined": [3]}', '{"joined": "b"}'])
def test_a_later_description_that_means_nothing(tmp_path: Path, more: str) -> None:
    """No JSON, or names twice, are said; what is no object or no list of names is passed over."""
    path = tmp_path / "run.mcap"
    log = LogWriter(path, network="n", names=["a"], attributes={})
    log._file.describe({"attributes": more})
    log.close()
    if more in ("[]", '{"joined": "b"}'):
        assert read_log(path).names == ("a",)
    else:
        with pytest.raises(FileFormatError, match="its description"):
            read_log(path)


def test_many_messages_do_not_wait_for_the_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trigpoint.runtime.log.FLUSH_EVERY", 1e6)
    monkeypatch.setattr(mcap_write, "_FULL", 1000)
    log = LogWriter(tmp_path / "run.mcap", network="n", names=["a"], attributes={})
    for k in range(20):
        log.write(status("a", k, START, [1.0] * len(STATUS_FIELDS)), START)
    assert len(read_log(tmp_path / "run.mcap").statuses["a"]) > 10
    log.close()


def test_topics_beyond_what_a_file_holds_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_write, "MOST_CHANNELS", 3)
    with LogWriter(tmp_path / "run.mcap", network="n", names=["0"], attributes={}) as log:
        for k in range(5):
            log.write(estimate(str(k), 0, 1.0, [2.0]), 1.0)
            log.write(estimate("0", 1 + k, 1.0, [2.0]), 1.0)
    assert log.dropped == 2
    assert sorted(read_log(tmp_path / "run.mcap").estimates) == ["0", "1", "2"]


def test_without_the_package_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = small_log(tmp_path / "run.mcap")
    monkeypatch.setitem(sys.modules, "mcap", None)
    with pytest.raises(MissingExtraError, match="live"):
        LogWriter(tmp_path / "new.mcap", network="n", names=[], attributes={})
    with pytest.raises(MissingExtraError, match="live"):
        read_log(path)


@pytest.mark.slow
def test_a_long_run_of_many_nodes_is_read_in_seconds_and_little_memory(tmp_path: Path) -> None:
    """200 nodes at 10 Hz for 60 s with their truth and one reading each: 360 000 messages."""
    path, rng = tmp_path / "run.mcap", np.random.default_rng(0)
    names = [f"n{k}" for k in range(200)]
    with effort() as written, LogWriter(path, network="n", names=names, attributes={}) as log:
        for k in range(600):
            now = START + 0.1 * k
            for label, (name, x) in enumerate(zip(names, rng.normal(size=(200, 3)), strict=True)):
                log.write(estimate(name, k, now, x[:2], evidence=now), now)
                log.write(Frame(Kind.TRUTH, name, EPOCH, k, now, (), x[1:]), now)
                log.write(Frame(Kind.READING, "plant", EPOCH, k, now, (float(label),), x[:1]), now)
    size = path.stat().st_size / 360_000
    code = (
        "import sys, mcap.records, zstandard; from pathlib import Path; from trigpoint.runtime import read_log;"
        f"sys.path.insert(0, {str(Path(__file__).resolve().parents[2])!r}); from tests.machine import effort\n"
        "peak = lambda: int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0])\n"
        "with effort() as spent: before = peak(); log = read_log(sys.argv[1]); after = peak()\n"
        "print(spent.units, after - before, sum(len(s) for s in log.estimates.values()))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    units, kilobytes, count = map(float, done.stdout.split())
    print(
        f"{size:.0f} bytes a message, written with {written.units:.0f} units of effort, read with {units:.0f}, "
        f"{kilobytes / 1024:.0f} MiB"
    )
    assert count == 120_000
    assert size < 100.0
    assert written.units < 3000.0  # 30 s where a unit takes 10 ms, of 60 s that the run takes
    assert units < 2000.0
    assert kilobytes < 200 * 1024
