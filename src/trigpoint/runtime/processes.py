"""One process a node, in lockstep over pipes: the parent passes frames on, between neighbours only."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ProtocolError
from trigpoint.observers.local import LocalObserver
from trigpoint.runtime.codec import Frame, Kind, read_frame, write_frame
from trigpoint.runtime.node import write_node_file

_PATIENCE = 10.0


def run_processes(
    nodes: Sequence[LocalObserver],
    starts: FloatArray,
    readings: Callable[[int], FloatArray],
    period: float,
    steps: int,
) -> FloatArray:
    """Run every node as its own process for ``steps`` exchanges and return the estimates (steps + 1, N, n).

    Each process is given its node file and nothing else; messages travel as frames through pipes, in lockstep.

    Args:
        nodes: the programs, in the network's order.
        starts: (N, n) first estimates.
        readings: exchange number -> (M, p) readings of all arcs; a node is sent only its own.
        period: seconds between two exchanges.
        steps: number of exchanges.

    Raises:
        ProtocolError: a process ended or answered something else than its estimate.
    """
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        pipes = [
            stack.enter_context(_Pipe(node, start, Path(folder) / f"node-{k}.json"))
            for k, (node, start) in enumerate(zip(nodes, starts, strict=True))
        ]
        latest = {node.name: pipe.answer() for node, pipe in zip(nodes, pipes, strict=True)}
        history = [np.stack([latest[node.name].values for node in nodes])]
        for number in range(steps):
            values = readings(number)
            for node, pipe in zip(nodes, pipes, strict=True):
                for name in node.hears:
                    pipe.send(latest[name])
                for label in node.reads:
                    pipe.send(Frame(Kind.READING, "", label, 0.0, values[label]))
                pipe.send(Frame(Kind.STEP, "", number, period, np.zeros(0)))
            latest = {node.name: pipe.answer() for node, pipe in zip(nodes, pipes, strict=True)}
            history.append(np.stack([latest[node.name].values for node in nodes]))
        return np.stack(history)


class _Pipe:
    """A node's process with its two pipes; leaving the context ends it."""

    def __init__(self, node: LocalObserver, start: FloatArray, path: Path) -> None:
        self._node, self._start, self._path = node, start, path

    def __enter__(self) -> _Pipe:
        write_node_file(self._node, self._path)
        start = ",".join(repr(float(value)) for value in self._start)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "trigpoint.runtime", str(self._path), start],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._sink = cast(BinaryIO, self._process.stdin)
        self._source = cast(BinaryIO, self._process.stdout)
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(BrokenPipeError):  # the process may have ended first
            self._sink.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._source.close()

    def send(self, frame: Frame) -> None:
        try:
            write_frame(self._sink, frame)
            if frame.kind is Kind.STEP:
                self._sink.flush()
        except BrokenPipeError as error:
            raise ProtocolError(f"the process of node {self._node.name!r} has ended") from error

    def answer(self) -> Frame:
        frame = read_frame(self._source)
        if frame is None or frame.kind is not Kind.ESTIMATE or frame.sender != self._node.name:
            raise ProtocolError(f"the process of node {self._node.name!r} ended without its estimate")
        return frame
