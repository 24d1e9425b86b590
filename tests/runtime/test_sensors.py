"""Readings from a function and from files: what is published, when, and with which time stamp."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from tests.runtime.logged import START, foreign_log, reading, small_log
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.runtime import (
    Delivery,
    Frame,
    Kind,
    LogWriter,
    Pace,
    Reading,
    ReadingPublisher,
    Reliable,
    Sink,
    decode_frame,
    publish_measured,
    read_readings,
    replay_readings,
)


@dataclass
class Bench:
    """A transport that keeps what it is given, and a time that passes only by waiting."""

    stop_at: float = np.inf
    time: float = 50.0
    sent: list[tuple[float, str, Frame]] = field(default_factory=list)
    delivery: Delivery = field(default_factory=Reliable)

    def publish(self, key: str, data: bytes) -> None:
        self.sent.append((self.time, key, decode_frame(data)))

    def subscribe(self, pattern: str, sink: Sink) -> None:
        pass

    def close(self) -> None:
        pass

    def wait(self, seconds: float) -> bool:
        self.time = min(self.time + seconds, self.stop_at)
        return self.time >= self.stop_at

    @property
    def pace(self) -> Pace:
        return Pace(lambda: self.time, self.wait)

    @property
    def publisher(self) -> ReadingPublisher:
        return ReadingPublisher(self, "net 1", "level", epoch=9)


def frames(bench: Bench) -> list[tuple[float, int, list[float]]]:
    return [(frame.time, int(frame.fact("label")), frame.values.tolist()) for _, _, frame in bench.sent]


def test_a_function_is_asked_on_a_grid() -> None:
    bench = Bench(stop_at=50.9)
    count = publish_measured(
        bench.publisher, lambda t: {3: 2.0 * t, 1: [t, 0.0]} if t < 50.5 else {}, period=0.25, pace=bench.pace
    )
    assert count == 4
    assert frames(bench) == [
        (50.0, 3, [100.0]),
        (50.0, 1, [50.0, 0.0]),
        (50.25, 3, [100.5]),
        (50.25, 1, [50.25, 0.0]),
    ]
    assert {(key, frame.sender, frame.epoch) for _, key, frame in bench.sent} == {
        ("trigpoint/net%201/reading/3", "level", 9),
        ("trigpoint/net%201/reading/1", "level", 9),
    }
    assert [frame.sequence for _, _, frame in bench.sent] == [0, 1, 2, 3]  # over all labels


def test_instants_that_were_missed_are_left_out() -> None:
    bench = Bench(stop_at=52.0)

    def slow(time: float) -> dict[int, float]:
        bench.time += 0.6
        return {0: time}

    publish_measured(bench.publisher, slow, period=0.25, pace=bench.pace)
    assert [frame.time for _, _, frame in bench.sent] == [50.0, 50.75, 51.5]


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_a_period_that_is_none_is_refused(period: float) -> None:
    bench = Bench()
    with pytest.raises(ArgumentError, match="period"):
        publish_measured(bench.publisher, lambda _: {}, period=period, pace=bench.pace)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Reading(0.0, 1, np.array([np.nan])), "finite"),
        (lambda: Reading(0.0, 1, np.zeros(0)), "at least one"),
        (lambda: Reading(0.0, 1, np.zeros((2, 2))), "vector"),
        (lambda: Reading(np.inf, 1, np.ones(1)), "time of a reading"),
        (lambda: Reading(0.0, -1, np.ones(1)), "label"),
        (lambda: Reading(0.0, 2**53, np.ones(1)), "label"),
    ],
)
def test_a_reading_that_is_none_is_refused(make: Callable[[], Reading], text: str) -> None:
    with pytest.raises(ArgumentError, match=text):
        make()


RECORDED = [Reading(7.0, 0, np.array([1.0])), Reading(7.5, 1, np.array([2.0])), Reading(9.0, 0, np.array([3.0]))]


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_a_file_is_replayed_at_any_speed(speed: float) -> None:
    bench = Bench()
    assert replay_readings(bench.publisher, RECORDED, pace=bench.pace, speed=speed) == 3
    expected = [50.0, 50.0 + 0.5 / speed, 50.0 + 2.0 / speed]
    assert [time for time, _, _ in bench.sent] == expected
    assert frames(bench) == [(t, r.label, r.values.tolist()) for t, r in zip(expected, RECORDED, strict=True)]


def test_at_an_infinite_speed_nothing_waits_and_stamps_are_now() -> None:
    bench = Bench()
    assert replay_readings(bench.publisher, RECORDED, pace=bench.pace, speed=np.inf) == 3
    assert [(time, frame.time) for time, _, frame in bench.sent] == [(50.0, 50.0)] * 3


def test_a_replay_ends_when_it_is_told() -> None:
    bench = Bench(stop_at=51.0)
    assert replay_readings(bench.publisher, RECORDED, pace=bench.pace) == 2


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan])
def test_a_speed_that_is_none_is_refused(speed: float) -> None:
    bench = Bench()
    with pytest.raises(ArgumentError, match="speed"):
        replay_readings(bench.publisher, RECORDED, pace=bench.pace, speed=speed)


def triples(path: Path) -> list[tuple[float, int, list[float]]]:
    return [(one.time, one.label, one.values.tolist()) for one in read_readings(path)]


def test_a_table_of_text_is_read(tmp_path: Path) -> None:
    path = tmp_path / "readings.CSV"
    path.write_text(
        "# levels\n\nTime, label ,value,value2\n0.5,3,1.25,\n0.5,0, 2 ,-1e-3\n\n1,3,0.5\n", encoding="utf-8-sig"
    )
    assert triples(path) == [(0.5, 3, [1.25]), (0.5, 0, [2.0, -0.001]), (1.0, 3, [0.5])]


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("1,2,3\n", 1, "first row must be time,label,value"),
        ("time,label\n", 1, "first row must be"),
        ("time,label,value\n1,2\n", 2, "holds a time"),
        ("time,label,value\n1,2, \n", 2, "at least one number"),
        ("time,label,value\n1\n", 2, "holds a time"),
        ("time,label,value\n1,x,3\n", 2, "holds a time"),
        ("time,label,value\n1,-2,3\n", 2, "number of an arc"),
        ("time,label,value\n\nnan,2,3\n", 3, "time of a reading"),
        ("time,label,value\n1,2,inf\n", 2, "finite"),
        ("time,label,value\n1,2,3\n0.5,2,3\n", 3, "the time goes back to 0.5"),
        ("", None, "no readings"),
        ("time,label,value\n", None, "no readings"),
        ("time,label,value\n1,2,\ud800", None, "cannot be read"),
        ("time,label,value\n1,2," + "3" * 200_000, None, "cannot be read"),
    ],
)
def test_a_table_with_a_fault_names_its_line(tmp_path: Path, text: str, line: int | None, message: str) -> None:
    path = tmp_path / "readings.csv"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(FileFormatError, match=message) as caught:
        triples(path)
    assert caught.value.line == line


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"\.mcap or \.csv"):
        triples(tmp_path / "readings.txt")
    with pytest.raises(FileFormatError, match="cannot be read"):
        triples(tmp_path / "none.csv")


def test_the_readings_of_a_log_are_replayed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a"], attributes={}) as log:
        for k in range(5):
            log.write(reading(k % 2, k, START + 0.1 * k, [k, -k]), START + 1.0)
    assert triples(path) == [(START + 0.1 * k, k % 2, [float(k), -float(k)]) for k in range(5)]
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-200])
    assert triples(cut) == triples(path)


@pytest.mark.parametrize("data", [b"{", b"[]", b'{"time": 1}', b'{"time": 1, "values": [[1], 2]}', b"[" * 100_000])
def test_a_message_that_is_no_reading_is_refused(tmp_path: Path, data: bytes) -> None:
    messages = [("/elsewhere", b"{"), ("/reading/3", b'{"time": 1, "values": [2]}'), ("/reading/3", data)]
    path = foreign_log(tmp_path / "x.mcap", messages, compression=CompressionType.NONE)
    recorded = read_readings(path)
    assert next(recorded).values.tolist() == [2.0]
    with pytest.raises(FileFormatError, match="is no reading"):
        next(recorded)


def test_a_label_of_the_environment_or_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no reading"):
        triples(small_log(tmp_path / "run.mcap"))  # its label is -3


def test_kinds_of_frames_are_readings() -> None:
    bench = Bench()
    bench.publisher.publish(RECORDED[0])
    assert bench.sent[0][2].kind is Kind.READING
