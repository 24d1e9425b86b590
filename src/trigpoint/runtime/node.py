"""The program of one node without any input or output: frames in, frames out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.observers.local import LocalObserver, Message
from trigpoint.runtime.codec import Frame, Kind

_LARGEST_FILE = 16 * 1024 * 1024


class NodeProgram:
    """Runs one ``LocalObserver``: collects its neighbours' estimates and its arcs' readings, steps when told to.

    Strangers' estimates and readings of other nodes' arcs are refused: a node uses only what its node file names.

    Args:
        observer: the program, as read from a node file.
        estimate: (n,) first estimate; zero unless given.
    """

    def __init__(self, observer: LocalObserver, estimate: FloatArray | None = None) -> None:
        self._observer = observer
        self._state = observer.init(estimate)
        self._hears = frozenset(observer.hears)
        self._labels = {arc.label: arc.output.shape[0] for arc in observer.arcs if arc.label is not None}
        self._inbox: dict[str, Message] = {}
        self._readings: dict[int, FloatArray] = {}

    def greeting(self) -> Frame:
        """The estimate to announce now."""
        message = self._observer.emit(self._state)
        return Frame(Kind.ESTIMATE, message.sender, message.sequence, message.time, message.estimate)

    def receive(self, frame: Frame) -> tuple[Frame, ...]:
        """Take one frame; a step answers with the new estimate, everything else with nothing."""
        if frame.kind is Kind.ESTIMATE:
            self._hear(frame)
        elif frame.kind is Kind.READING:
            self._read(frame)
        elif frame.kind is Kind.STEP:
            if not frame.time > 0.0:
                raise ProtocolError(f"a step must take a positive time; got {frame.time}")
            self._state = self._observer.step(self._state, self._inbox, self._readings, frame.time)
            self._inbox, self._readings = {}, {}
            return (self.greeting(),)
        return ()

    def _hear(self, frame: Frame) -> None:
        if frame.sender not in self._hears:
            raise ProtocolError(f"node {self._observer.name!r} does not listen to {frame.sender!r}")
        widths = {rows.shape[1] for arc in self._observer.arcs for name, rows in arc.heard if name == frame.sender}
        if {frame.values.shape[0]} != widths:
            raise ProtocolError(f"the estimate of {frame.sender!r} has {frame.values.shape[0]} numbers, not {widths}")
        self._inbox[frame.sender] = Message(frame.sender, frame.sequence, frame.time, frame.values)

    def _read(self, frame: Frame) -> None:
        if self._labels.get(frame.sequence) != frame.values.shape[0]:
            raise ProtocolError(f"reading {frame.sequence} is none of node {self._observer.name!r}, or of wrong size")
        self._readings[frame.sequence] = frame.values


def write_node_file(observer: LocalObserver, path: Path) -> None:
    """Write all that one node needs to know (``observer``) to ``path``, as JSON."""
    path.write_text(json.dumps(observer.to_document(), indent=1), encoding="utf-8")


def read_node_file(path: Path) -> LocalObserver:
    """Read the node file ``path``; a damaged one is a ``FileFormatError``."""
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise FileFormatError(path, f"a node file has at most {_LARGEST_FILE} bytes")
        document: Any = json.loads(path.read_text(encoding="utf-8"))
        return LocalObserver.from_document(document)
    except (OSError, RecursionError, ValueError) as error:  # damaged text, JSON and protocol errors are ValueErrors
        raise FileFormatError(path, f"not a node file: {error}") from error


def start_value(text: str | None) -> FloatArray | None:
    """Numbers separated by commas, or None; other text is an ``ArgumentError``."""
    try:
        return None if not text else np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise ArgumentError(f"the start must be numbers separated by commas; got {text!r}") from error
