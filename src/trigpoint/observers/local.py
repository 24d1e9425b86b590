"""``LocalObserver``: the program of one node. Pure values: state in, state out; no clock, no socket, no solver.

It is built from what the node may know: its own model, the gains on its own arcs, and its neighbours' output rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trigpoint.arrays import FloatArray, as_matrix, decode_array, encode_array, frozen, transition_and_integral
from trigpoint.errors import ArgumentError, ProtocolError

KIND = "trigpoint/local-observer"
VERSION = 1


@dataclass(frozen=True, eq=False)
class LocalArc:
    """One arc as the node at one of its ends sees it.

    The arc corrects the node's estimate by ``gain @ (sign * y + neighbour_output @ z_neighbour - output @ z_own)``.

    Attributes:
        label: the arc's number in the network: the key of its reading y.
        neighbour: name of the other end; None for the environment (then there is no ``z_neighbour``).
        sign: +1 where the node is the arc's head, -1 where it is the tail.
        gain: (n, p) correction gain, 1/s, the arc's weight included.
        output: (p, n) own output rows.
        neighbour_output: (p, n_j) the neighbour's output rows; None for the environment.
    """

    label: int
    neighbour: str | None
    sign: float
    gain: FloatArray
    output: FloatArray
    neighbour_output: FloatArray | None


@dataclass(frozen=True, eq=False)
class Message:
    """What ``sender`` tells its neighbours: its ``estimate`` (n,), the ``time`` [s] it is for, and its ``sequence``."""

    sender: str
    sequence: int
    time: float
    estimate: FloatArray


@dataclass(frozen=True, eq=False)
class LocalState:
    """All that a node remembers between two steps: ``time`` [s], ``sequence`` (steps so far), ``estimate`` (n,)."""

    time: float
    sequence: int
    estimate: FloatArray


@dataclass(frozen=True, eq=False)
class LocalObserver:
    """The estimator of one node: ``z' = A z + B u + sum over its arcs of gain (sign y + C_j z_j - C z)``.

    Args:
        name: the node's name.
        A: (n, n) own dynamics.
        B: (n, m) known input, or None.
        arcs: the node's arcs.

    A missing message or reading is normal: that arc is left out of the step, as if it were not there.

    Source: G16, equation (3) with the gain (9); R23 (7); W17 (3) and (10), one arc a neighbour.
    """

    name: str
    A: FloatArray
    B: FloatArray | None
    arcs: tuple[LocalArc, ...]
    _memo: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def n_states(self) -> int:
        """Number n of own states."""
        return int(self.A.shape[0])

    @property
    def hears(self) -> tuple[str, ...]:
        """Names of the neighbours whose messages are used, each once, in the order of the arcs."""
        return tuple(dict.fromkeys(arc.neighbour for arc in self.arcs if arc.neighbour is not None))

    def init(self, estimate: FloatArray | None = None, time: float = 0.0) -> LocalState:
        """First state, from a guess (n,) or from zero."""
        start = np.zeros(self.n_states) if estimate is None else np.asarray(estimate, dtype=np.float64)
        if start.shape != (self.n_states,):
            raise ArgumentError(f"estimate of node {self.name!r} must have shape ({self.n_states},); got {start.shape}")
        return LocalState(time, 0, frozen(start))

    def estimate(self, state: LocalState) -> FloatArray:
        """The node's estimate of its own state, (n,)."""
        return state.estimate

    def emit(self, state: LocalState) -> Message:
        """The message to every neighbour."""
        return Message(self.name, state.sequence, state.time, state.estimate)

    def derivative(
        self,
        state: LocalState,
        inbox: Mapping[str, Message],
        readings: Mapping[int, FloatArray],
        u: FloatArray | None = None,
    ) -> FloatArray:
        """``z'`` (n,) for continuous exchange, from what the node hears and reads now."""
        correction, _ = self._correction(state.estimate, inbox, readings)
        return self.A @ state.estimate + self._drive(u) + correction

    def step(
        self,
        state: LocalState,
        inbox: Mapping[str, Message],
        readings: Mapping[int, FloatArray],
        duration: float,
        u: FloatArray | None = None,
    ) -> LocalState:
        """The state ``duration`` seconds later, neighbours' values and readings held meanwhile.

        The own value is integrated exactly: ``z+ = e^{A h} z + int e^{A s} ds B u + Phi sum_k gain_k r_k`` with the
        innovations r_k at the start and ``Phi = int_0^h exp((A - sum gain C) s) ds``, so that the own correction is
        felt at once. For static states this is stable for every period.

        We assume:
            * ``inbox`` holds each neighbour's latest message; messages of strangers are ignored.

        Source: theory 6-F2 (neighbour-held sampling), extended to moving agents.
        """
        correction, heard = self._correction(state.estimate, inbox, readings)
        transition, drive, phi = self._maps(heard, float(duration))
        value = transition @ state.estimate + drive @ self._drive(u) + phi @ correction
        return LocalState(state.time + duration, state.sequence + 1, frozen(value))

    def _drive(self, u: FloatArray | None) -> FloatArray:
        if u is None:
            return np.zeros(self.n_states)
        if self.B is None or np.shape(u) != (self.B.shape[1],):
            raise ArgumentError(
                f"u of node {self.name!r} must fit B {None if self.B is None else self.B.shape}; got {np.shape(u)}"
            )
        return self.B @ u

    def _correction(
        self, own: FloatArray, inbox: Mapping[str, Message], readings: Mapping[int, FloatArray]
    ) -> tuple[FloatArray, tuple[int, ...]]:
        total = np.zeros(self.n_states)
        heard = []
        for position, arc in enumerate(self.arcs):
            reading = readings.get(arc.label)
            if reading is None:
                continue
            innovation = arc.sign * reading - arc.output @ own
            if arc.neighbour is not None:
                message = inbox.get(arc.neighbour)
                if message is None or arc.neighbour_output is None:
                    continue
                innovation = innovation + arc.neighbour_output @ message.estimate
            total += arc.gain @ innovation
            heard.append(position)
        return total, tuple(heard)

    def _maps(self, heard: tuple[int, ...], duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        # A memo, not a state: the maps depend on nothing but the arguments and the frozen fields.
        key = (heard, duration)
        if key not in self._memo:
            if len(self._memo) > 256:
                self._memo.clear()
            closed = self.A - sum((self.arcs[k].gain @ self.arcs[k].output for k in heard), np.zeros_like(self.A))
            transition, drive = transition_and_integral(self.A, duration)
            _, phi = transition_and_integral(closed, duration)
            self._memo[key] = (transition, drive, phi)
        maps: tuple[FloatArray, FloatArray, FloatArray] = self._memo[key]
        return maps

    # -- the node file ---------------------------------------------------------------------------------------------
    def to_document(self) -> dict[str, Any]:
        """The node file: everything this node knows, as a JSON object."""
        return {
            "kind": KIND,
            "version": VERSION,
            "name": self.name,
            "A": encode_array(self.A),
            "B": None if self.B is None else encode_array(self.B),
            "arcs": [
                {
                    "label": arc.label,
                    "neighbour": arc.neighbour,
                    "sign": arc.sign,
                    "gain": encode_array(arc.gain),
                    "output": encode_array(arc.output),
                    "neighbour_output": None if arc.neighbour_output is None else encode_array(arc.neighbour_output),
                }
                for arc in self.arcs
            ],
        }

    @staticmethod
    def from_document(document: Any) -> LocalObserver:
        """Read a node file; anything that does not fit is a ``ProtocolError`` that names the field."""
        if not isinstance(document, dict) or document.get("kind") != KIND:
            raise ProtocolError(f"this is no node file: its kind must be {KIND!r}")
        if document.get("version") != VERSION:
            raise ProtocolError(f"node file version {document.get('version')!r} is unknown; this reads {VERSION}")
        name, arcs = document.get("name"), document.get("arcs")
        if not isinstance(name, str) or not isinstance(arcs, list):
            raise ProtocolError("a node file needs the text 'name' and the list 'arcs'")
        A = _matrix(document, "A", None, None)
        n = A.shape[0]
        if A.shape[1] != n or n == 0:
            raise ProtocolError(f"A must be square with at least one row; got {A.shape}")
        B = None if document.get("B") is None else _matrix(document, "B", n, None)
        return LocalObserver(name, A, B, tuple(_read_arcs(arcs, n)))


def _read_arcs(arcs: list[Any], n: int) -> Iterable[LocalArc]:
    for position, entry in enumerate(arcs):
        if not isinstance(entry, dict):
            raise ProtocolError(f"arcs[{position}] must be an object")
        label, neighbour, sign = entry.get("label"), entry.get("neighbour"), entry.get("sign")
        if type(label) is not int or not (neighbour is None or isinstance(neighbour, str)) or sign not in (1.0, -1.0):
            raise ProtocolError(
                f"arcs[{position}] needs a whole number 'label', a text or null 'neighbour' and a 'sign' of 1 or -1"
            )
        gain = _matrix(entry, "gain", n, None)
        p = gain.shape[1]
        output = _matrix(entry, "output", p, n)
        other = None if neighbour is None else _matrix(entry, "neighbour_output", p, None)
        yield LocalArc(label, neighbour, float(sign), gain, output, other)


def _matrix(document: Mapping[str, Any], key: str, rows: int | None, columns: int | None) -> FloatArray:
    try:
        return as_matrix(key, decode_array(document.get(key), key), rows, columns)
    except ArgumentError as error:
        raise ProtocolError(str(error)) from error
