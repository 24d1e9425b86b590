"""Nodes as real processes: bit for bit what was simulated, from a node file alone, and nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trigpoint
import trigpoint as tp
from tests.runtime.nodes import DOUBLE, STATIC, drawn_readings, grid_observer, in_one_process, programs
from trigpoint.errors import ProtocolError
from trigpoint.observers.local import Message
from trigpoint.runtime import Frame, Kind, processes, run_processes, write_node_file
from trigpoint.runtime.codec import read_frame, write_frame
from trigpoint.simulation import Scenario, simulate

SOURCE = Path(trigpoint.__file__).resolve().parents[1]
PERIOD = 0.05
MINIMAL = {"PYTHONPATH": str(SOURCE), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


@pytest.fixture(autouse=True)
def _one_thread_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")


def children() -> set[int]:
    """Processes whose parent is this one."""
    found = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == os.getpid():
                found.add(int(entry.name))
    return found


def node_process(arguments: list[str], folder: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "trigpoint.runtime", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=folder,
        env=MINIMAL,
    )


def ended(arguments: list[str], folder: Path, data: bytes = b"") -> tuple[int, str]:
    process = node_process(arguments, folder)
    _, errors = process.communicate(data, timeout=60)
    return process.returncode, errors.decode()


def test_nine_processes_are_bit_for_bit_the_programs_that_were_simulated() -> None:
    observer = grid_observer(3, 3, STATIC)
    before, nodes = children(), programs(observer)
    starts = np.random.default_rng(1).normal(size=(9, 1))
    live = run_processes(nodes, starts, drawn_readings(observer, 7), PERIOD, 6)
    assert live.shape == (7, 9, 1)
    np.testing.assert_array_equal(live, in_one_process(nodes, starts, drawn_readings(observer, 7), PERIOD, 6))
    assert children() == before


def test_processes_of_moving_agents_follow_the_simulator_bit_for_bit() -> None:
    observer = grid_observer(2, 2, DOUBLE)
    rng = np.random.default_rng(2)
    truth, error = rng.normal(size=(4, 2)), rng.normal(size=(4, 2))
    steps = 8
    times = PERIOD * np.arange(steps + 1)
    scenario = Scenario(times, error, truth, period=PERIOD, path="reference")
    run = simulate(observer.problem, observer, scenario)
    incidence = observer.graph.incidence().toarray()

    def readings(number: int) -> np.ndarray:
        return incidence.T @ run.truth[number] @ DOUBLE.C.T

    live = run_processes(programs(observer), truth + error, readings, PERIOD, steps)
    np.testing.assert_array_equal(live[0], run.estimate[0])
    np.testing.assert_allclose(live, run.estimate, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(live, in_one_process(programs(observer), truth + error, readings, PERIOD, steps))


def test_static_processes_forget_a_wrong_start() -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(2), STATIC)
    observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.FromGraph(4.0)))
    truth = np.array([[3.0], [5.0]])
    values = observer.graph.incidence().toarray().T @ truth
    live = run_processes(programs(observer), truth + 1.0, lambda _: values, 0.5, 40)
    assert np.abs(live[-1] - truth).max() < 1e-5


def test_a_process_needs_its_node_file_and_nothing_else(tmp_path: Path) -> None:
    local = grid_observer(2, 2, DOUBLE).local(3)
    write_node_file(local, tmp_path / "node.json")
    process = node_process(["node.json", "1.0,2.0"], tmp_path)
    state, rng = local.init(np.array([1.0, 2.0])), np.random.default_rng(4)
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        greeting = read_frame(process.stdout)
        assert greeting is not None
        np.testing.assert_array_equal(greeting.values, [1.0, 2.0])
        for number in range(4):
            inbox = {name: Message(name, number, 0.0, rng.normal(size=2)) for name in local.hears}
            readings = {arc.label: rng.normal(size=1) for arc in local.arcs}
            for name, message in inbox.items():
                write_frame(process.stdin, Frame(Kind.ESTIMATE, name, number, 0.0, message.estimate))
            for label, values in readings.items():
                write_frame(process.stdin, Frame(Kind.READING, "", label, 0.0, values))
            write_frame(process.stdin, Frame(Kind.STEP, "", number, PERIOD, np.zeros(0)))
            process.stdin.flush()
            answer = read_frame(process.stdout)
            state = local.step(state, inbox, readings, PERIOD)
            assert answer is not None
            assert answer.values.tobytes() == state.estimate.tobytes()
        write_frame(process.stdin, Frame(Kind.STOP, "", 0, 0.0, np.zeros(0)))
        process.stdin.flush()
        assert process.wait(30) == 0
        assert process.stdout.read() == b""
    assert [path.name for path in tmp_path.iterdir()] == ["node.json"]


def test_a_stranger_ends_a_process_with_one_line(tmp_path: Path) -> None:
    write_node_file(grid_observer(2, 2, STATIC).local(0), tmp_path / "node.json")
    stream = BytesIO()
    write_frame(stream, Frame(Kind.ESTIMATE, "3", 0, 0.0, np.zeros(1)))
    code, errors = ended(["node.json"], tmp_path, stream.getvalue())
    assert code == 2
    assert errors == "node '0' does not listen to '3'\n"


@pytest.mark.parametrize(
    ("content", "arguments", "message"),
    [
        (b'{"kind": "trigpoint/local-observer", "version": 7}', ["node.json"], "version 7"),
        (b"[" * 100_000, ["node.json"], "not a node file"),
        (None, ["absent.json"], "not a node file"),
        (None, [], "usage"),
        (None, ["node.json", "one,two"], "separated by commas"),
        (None, ["node.json", "1.0,2.0,3.0"], "must have shape"),
    ],
)
def test_what_a_process_cannot_use_is_exit_code_2_and_one_line(
    tmp_path: Path, content: bytes | None, arguments: list[str], message: str
) -> None:
    write_node_file(grid_observer(2, 2, STATIC).local(0), tmp_path / "node.json")
    if content is not None:
        (tmp_path / "node.json").write_bytes(content)
    code, errors = ended(arguments, tmp_path)
    assert code == 2
    assert message in errors
    assert errors.count("\n") == 1
    assert "Traceback" not in errors


def test_a_killed_process_is_a_protocol_error_and_leaves_no_orphan() -> None:
    observer = grid_observer(2, 2, STATIC)
    before, drawn = children(), drawn_readings(observer, 3)

    def readings(number: int) -> np.ndarray:
        if number == 2:
            os.kill(max(children() - before), signal.SIGKILL)
        return drawn(number)

    with pytest.raises(ProtocolError, match=r"the process of node '[0-3]'"):
        run_processes(programs(observer), np.zeros((4, 1)), readings, PERIOD, 5)
    assert children() == before


def test_a_process_that_never_starts_is_a_protocol_error(monkeypatch: pytest.MonkeyPatch) -> None:
    before = children()
    monkeypatch.setattr(processes, "write_node_file", lambda _, path: path.write_text("{}"))
    with pytest.raises(ProtocolError, match="ended without its estimate"):
        run_processes(programs(grid_observer(1, 2, STATIC)), np.zeros((2, 1)), lambda _: np.zeros((2, 1)), PERIOD, 1)
    assert children() == before


def test_an_error_of_the_caller_leaves_no_orphan() -> None:
    before = children()

    def readings(number: int) -> np.ndarray:
        raise KeyError("no such sensor")

    with pytest.raises(KeyError, match="no such sensor"):
        run_processes(programs(grid_observer(1, 2, STATIC)), np.zeros((2, 1)), readings, PERIOD, 3)
    assert children() == before


def test_each_process_is_sent_what_its_node_may_know(monkeypatch: pytest.MonkeyPatch) -> None:
    observer = grid_observer(2, 2, STATIC)
    sent: dict[str, list[Frame]] = {}
    send = processes._Pipe.send

    def watched(pipe: Any, frame: Frame) -> None:
        sent.setdefault(pipe._node.name, []).append(frame)
        send(pipe, frame)

    monkeypatch.setattr(processes._Pipe, "send", watched)
    run_processes(programs(observer), np.zeros((4, 1)), drawn_readings(observer, 5), PERIOD, 2)
    for node in programs(observer):
        frames = sent[node.name]
        assert {f.sender for f in frames if f.kind is Kind.ESTIMATE} == set(node.hears)
        assert {f.sequence for f in frames if f.kind is Kind.READING} == {arc.label for arc in node.arcs}
        assert sum(f.kind is Kind.STEP for f in frames) == 2


def test_the_runtime_loads_no_solver() -> None:
    code = "import sys, trigpoint.runtime; print(*sorted(n for n in sys.modules if '.' not in n))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=MINIMAL, check=True)
    loaded = set(done.stdout.split())
    assert "numpy" in loaded
    assert not loaded & {"scipy", "networkx", "pydantic", "rich", "typer", "matplotlib", "xarray"}
