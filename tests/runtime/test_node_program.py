"""One node's program without any process: it steps like the simulated one and refuses what is not its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.runtime.nodes import DOUBLE, STATIC, grid_observer
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.observers.local import LocalObserver, Message
from trigpoint.runtime import Frame, Kind, NodeProgram, read_node_file, write_node_file
from trigpoint.runtime.node import start_value

LOCAL = grid_observer(2, 2, DOUBLE).local(3)


def estimate(sender: str, values: object = (1.0, 2.0)) -> Frame:
    return Frame(Kind.ESTIMATE, sender, 0, 0.0, np.asarray(values, dtype=float))


def reading(label: int, values: object = (0.5,)) -> Frame:
    return Frame(Kind.READING, "", label, 0.0, np.asarray(values, dtype=float))


def step(duration: float) -> Frame:
    return Frame(Kind.STEP, "", 0, duration, np.zeros(0))


def test_the_program_steps_like_the_local_observer() -> None:
    program, state = NodeProgram(LOCAL, np.array([3.0, -1.0])), LOCAL.init(np.array([3.0, -1.0]))
    rng = np.random.default_rng(0)
    for number in range(5):
        inbox = {name: Message(name, number, 0.0, rng.normal(size=2)) for name in LOCAL.hears}
        readings = {arc.label: rng.normal(size=1) for arc in LOCAL.arcs}
        for name, message in inbox.items():
            assert program.receive(estimate(name, message.estimate)) == ()
        for label, values in readings.items():
            assert program.receive(reading(label, values)) == ()
        (answer,) = program.receive(step(0.1))
        state = LOCAL.step(state, inbox, readings, 0.1)
        assert answer.kind is Kind.ESTIMATE
        assert (answer.sender, answer.sequence, answer.time) == (LOCAL.name, state.sequence, state.time)
        assert answer.values.tobytes() == state.estimate.tobytes()


def test_what_was_heard_is_used_once() -> None:
    program = NodeProgram(LOCAL)
    for arc in LOCAL.arcs:
        program.receive(reading(arc.label))
    for name in LOCAL.hears:
        program.receive(estimate(name))
    program.receive(step(0.1))
    before = program.greeting().values
    (silent,) = program.receive(step(0.1))
    expected = LOCAL.step(LOCAL.init(before), {}, {}, 0.1).estimate
    np.testing.assert_array_equal(silent.values, expected)


@pytest.mark.parametrize("name", ["0", LOCAL.name, "", "nobody"])
def test_strangers_are_refused(name: str) -> None:
    assert name not in LOCAL.hears
    with pytest.raises(ProtocolError, match="does not listen"):
        NodeProgram(LOCAL).receive(estimate(name))


def test_readings_of_other_nodes_arcs_are_refused() -> None:
    own = {arc.label for arc in LOCAL.arcs}
    for label in {0, 1, 2, 3, 4, 99} - own:
        with pytest.raises(ProtocolError, match=f"reading {label} is none of node"):
            NodeProgram(LOCAL).receive(reading(label))


@pytest.mark.parametrize("values", [(), (1.0,), (1.0, 2.0, 3.0)])
def test_an_estimate_of_the_wrong_size_is_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(ProtocolError, match="numbers, not"):
        NodeProgram(LOCAL).receive(estimate(LOCAL.hears[0], values))


@pytest.mark.parametrize("values", [(), (1.0, 2.0)])
def test_a_reading_of_the_wrong_size_is_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(ProtocolError, match="wrong size"):
        NodeProgram(LOCAL).receive(reading(LOCAL.arcs[0].label, values))


@pytest.mark.parametrize("duration", [0.0, -0.0, -1.0, float("nan")])
def test_a_step_must_take_a_positive_time(duration: float) -> None:
    with pytest.raises(ProtocolError, match="positive time"):
        NodeProgram(LOCAL).receive(step(duration))


def test_a_refused_frame_changes_nothing() -> None:
    program, untouched = NodeProgram(LOCAL), NodeProgram(LOCAL)
    for bad in (estimate("nobody"), estimate(LOCAL.hears[0], ()), reading(99), step(-1.0)):
        with pytest.raises(ProtocolError):
            program.receive(bad)
    np.testing.assert_array_equal(program.receive(step(0.2))[0].values, untouched.receive(step(0.2))[0].values)


def test_a_stop_answers_nothing() -> None:
    assert NodeProgram(LOCAL).receive(Frame(Kind.STOP, "", 0, 0.0, np.zeros(0))) == ()


@pytest.mark.parametrize("start", [np.zeros(3), np.zeros((2, 1)), np.array(1.0)])
def test_a_first_estimate_of_the_wrong_size_is_refused(start: np.ndarray) -> None:
    with pytest.raises(ArgumentError, match="must have shape"):
        NodeProgram(LOCAL, start)


def test_a_node_file_holds_the_whole_program(tmp_path: Path) -> None:
    path = tmp_path / "node.json"
    write_node_file(LOCAL, path)
    again = read_node_file(path)
    assert again.to_document() == LOCAL.to_document()
    known = {"kind", "version", "name", "A", "B", "arcs", "readout", "feedthrough", "exchange", "acceleration"}
    assert set(json.loads(path.read_text(encoding="utf-8"))) == known


def test_a_node_file_names_nobody_but_the_neighbours(tmp_path: Path) -> None:
    observer = grid_observer(3, 3, STATIC)
    write_node_file(observer.local(0), tmp_path / "node.json")
    document = json.loads((tmp_path / "node.json").read_text(encoding="utf-8"))
    assert {arc["neighbour"] for arc in document["arcs"]} == {"1", "3"}


BROKEN = [
    b"",
    b"{",
    b"[]",
    b"null",
    b"\xff\xfe",
    b"\0" * 20,
    b"[" * 100_000,
    b'{"version": ' + b"9" * 5000 + b"}",
    b'{"kind": "trigpoint/problem", "version": 1}',
    b'{"kind": "trigpoint/local-observer", "version": 2}',
    b'{"kind": "trigpoint/local-observer", "version": 1, "name": "a", "arcs": [], "A": 1}',
]


@pytest.mark.parametrize("content", BROKEN, ids=range(len(BROKEN)))
def test_a_damaged_node_file_is_a_file_format_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "node.json"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"node\.json"):
        read_node_file(path)


def test_a_missing_or_huge_node_file_is_a_file_format_error(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="not a node file"):
        read_node_file(tmp_path / "none.json")
    with (tmp_path / "huge.json").open("wb") as stream:
        stream.truncate(16 * 1024 * 1024 + 1)
    with pytest.raises(FileFormatError, match="at most"):
        read_node_file(tmp_path / "huge.json")


VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4) | st.just([]) | st.just({})


@given(st.sampled_from(["kind", "version", "name", "A", "B", "arcs"]), VALUES)
@settings(max_examples=150)
def test_a_changed_field_is_a_protocol_error_or_a_program(key: str, value: object) -> None:
    try:
        LocalObserver.from_document({**LOCAL.to_document(), key: value})
    except ProtocolError:
        return
    assert (key, value) in (("version", 1), ("version", True), ("B", None), ("arcs", [])) or key == "name"


@given(st.sampled_from(["label", "neighbour", "sign", "gain", "output", "neighbour_output"]), VALUES)
@settings(max_examples=150)
def test_a_changed_arc_is_a_protocol_error_or_a_program(key: str, value: object) -> None:
    document = LOCAL.to_document()
    arc = {**document["arcs"][0], key: value}
    try:
        read = LocalObserver.from_document({**document, "arcs": [arc]})
    except ProtocolError:
        return
    assert key in ("label", "neighbour", "sign")
    assert getattr(read.arcs[0], key) == value


def test_a_start_is_read_from_text() -> None:
    assert start_value(None) is None
    assert start_value("") is None
    np.testing.assert_array_equal(start_value("1.5,-2e-3"), [1.5, -2e-3])
    for text in ("x", "1,,2", "1;2"):
        with pytest.raises(ArgumentError, match="separated by commas"):
            start_value(text)
