"""``LocalObserver``: the program of one node. Pure values: state in, state out; no clock, no socket, no solver.

It is built from what the node may know: its own model, the gains on its own arcs, and its neighbours' output rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeVar, get_args

import numpy as np

from trigpoint.arrays import FloatArray, encode_array, frozen, propagate, transition_and_integral
from trigpoint.errors import ArgumentError, ProtocolError
from trigpoint.observers.acceleration import accelerated, chebyshev_factor
from trigpoint.observers.arc import Correction, correction_of
from trigpoint.observers.arc import LocalArc as LocalArc
from trigpoint.observers.node_file import further, labelled, matrix

KIND = "trigpoint/local-observer"
VERSION = 2

Exchange = Literal["held", "euler", "innovation-held", "discrete"]
EXCHANGES: tuple[str, ...] = get_args(Exchange)
"""What ``step`` makes of a period; ``LocalObserver`` says what each means."""

_KEPT = 256
_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Message:
    """What ``sender`` tells its neighbours: its ``estimate`` z (n,), the ``time`` it is for, and its ``sequence``."""

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
        readout: (q, n) with ``estimate = readout z``; None where z is the estimate.
        feedthrough: pairs (label, (q, p) matrix): readings that enter the estimate directly.
        exchange: what one step of h seconds does. ``held``: the neighbours' values and the readings are held, the own
            value moves on exactly; ``innovation-held``: the whole innovation is held; ``euler``: one explicit Euler
            step; ``discrete``: ``z+ = A z + B u + sum of the corrections``, whatever h.
        acceleration: rho of the Chebyshev semi-iteration, ``discrete`` only; None for none.

    A missing message or reading is normal: that arc is left out of the step, as if it were not there.

    Source: G16, equation (3) with the gain (9); R23 (7); W17 (3), (4) and (10), one arc a neighbour.
    """

    name: str
    A: FloatArray
    B: FloatArray | None
    arcs: tuple[LocalArc, ...]
    readout: FloatArray | None = None
    feedthrough: tuple[tuple[int, FloatArray], ...] = ()
    exchange: Exchange = "held"
    acceleration: float | None = None
    _memo: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def n_states(self) -> int:
        """Number n of own states."""
        return int(self.A.shape[0])

    @cached_property
    def hears(self) -> tuple[str, ...]:
        """Names of the neighbours whose messages are used, each once, in the order of the arcs."""
        return tuple(dict.fromkeys(name for arc in self.arcs for name, _ in arc.heard))

    @cached_property
    def reads(self) -> tuple[int, ...]:
        """Labels of the readings that are used, each once, in the order of the arcs."""
        labels = [arc.label for arc in self.arcs if arc.label is not None]
        return tuple(dict.fromkeys([*labels, *(label for label, _ in self.feedthrough)]))

    @cached_property
    def _labels(self) -> tuple[int, ...]:
        return tuple(dict.fromkeys(arc.label for arc in self.arcs if arc.label is not None))

    def init(self, estimate: FloatArray | None = None, time: float = 0.0) -> LocalState:
        """First state, from a guess (n,) or from zero."""
        start = np.zeros(self.n_states) if estimate is None else np.asarray(estimate, dtype=np.float64)
        if start.shape != (self.n_states,):
            raise ArgumentError(f"estimate of node {self.name!r} must have shape ({self.n_states},); got {start.shape}")
        return LocalState(time, 0, frozen(start))

    def estimate(self, state: LocalState, readings: Mapping[int, FloatArray] | None = None) -> FloatArray:
        """The node's estimate (q,): ``readout z``, plus ``feedthrough`` of ``readings``; NaN where one is missing."""
        value = state.estimate if self.readout is None else self.readout @ state.estimate
        for label, weight in self.feedthrough:
            reading = None if readings is None else readings.get(label)
            value = value + (np.full(weight.shape[0], np.nan) if reading is None else weight @ reading)
        return value

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
        heard, parts = self._taken(state.estimate, inbox, readings)
        return self.A @ state.estimate + self._drive(u) + self._correction(heard).matrix @ np.concatenate(parts)

    def step(
        self,
        state: LocalState,
        inbox: Mapping[str, Message],
        readings: Mapping[int, FloatArray],
        duration: float,
        u: FloatArray | None = None,
    ) -> LocalState:
        """The state ``duration`` seconds later, after one exchange.

        ``held``, the default: neighbours' values and readings are held, and the own value is integrated exactly,
        ``z+ = e^{A h} z + int e^{A s} ds B u + Phi sum_k gain_k r_k`` with the innovations r_k at the start and
        ``Phi = int_0^h exp((A - sum gain C) s) ds``: stable for every period where the states are static.
        ``innovation-held`` has ``Phi = int e^{A s} ds``, ``euler`` and ``discrete`` the maps that their names say.

        We assume: ``inbox`` holds each neighbour's latest message; messages of strangers are ignored.
        Source: theory 6-F2 (neighbour-held sampling), extended to moving agents; 6-F1, 6-F7.
        """
        heard, parts = self._taken(state.estimate, inbox, readings)
        whole, drive = self._whole_map(heard, float(duration))
        value = whole.dot(np.concatenate(parts))  # on so few numbers half the cost of @
        if u is not None:
            value = value + drive @ self._drive(u)
        if self.acceleration is not None:
            value = accelerated(value, state.estimate, chebyshev_factor(state.sequence, self.acceleration))
        value.setflags(write=False)
        return LocalState(state.time + duration, state.sequence + 1, value)

    def moved(
        self, estimate: FloatArray, age: float, u: FloatArray | None = None, model: FloatArray | None = None
    ) -> FloatArray:
        """``e^{A age} z + int e^{A s} ds B u`` (n,): what the ``estimate`` z of ``age`` seconds ago has become by now.

        Nothing corrects it on the way. A map (``discrete``) does not move between its steps, nor does anything for an
        age of 0 or less.

        Args:
            estimate: z of this node, or of one whose dynamics are ``model``.
            age: seconds.
            u: the node's known input (m,), or None.
            model: A of another node, which has no input here; None for the own.
        """
        if self.exchange == "discrete" or age <= 0.0:
            return estimate
        return propagate(self.A if model is None else model, estimate, age, None if u is None else self._drive(u))

    def innovations(
        self, state: LocalState, inbox: Mapping[str, Message], readings: Mapping[int, FloatArray]
    ) -> tuple[FloatArray | None, ...]:
        """Of every arc ``sign y + C_j z_j - C z`` (p,), where ``state`` is z, ``inbox`` z_j and ``readings`` y.

        None where something is missing.
        """
        return tuple(_innovation(arc, state.estimate, inbox, readings) for arc in self.arcs)

    def _drive(self, u: FloatArray | None) -> FloatArray:
        if u is None:
            return np.zeros(self.n_states)
        if self.B is None or np.shape(u) != (self.B.shape[1],):
            raise ArgumentError(
                f"u of node {self.name!r} must fit B {None if self.B is None else self.B.shape}; got {np.shape(u)}"
            )
        return self.B @ u

    @cached_property
    def _all(self) -> tuple[int, ...]:
        return tuple(range(len(self.arcs)))

    @cached_property
    def _needs(self) -> tuple[tuple[int | None, frozenset[str]], ...]:
        return tuple((arc.label, frozenset(name for name, _ in arc.heard)) for arc in self.arcs)

    def _taken(
        self, own: FloatArray, inbox: Mapping[str, Message], readings: Mapping[int, FloatArray]
    ) -> tuple[tuple[int, ...], list[FloatArray]]:
        """Positions of the arcs for which everything is there, and what they use: own value, messages, readings."""
        try:
            parts = [own, *[inbox[name].estimate for name in self.hears]]
            return self._all, parts + [readings[label] for label in self._labels]
        except KeyError:
            said = inbox.keys()
            pairs = enumerate(self._needs)
            heard = tuple([k for k, (label, names) in pairs if (label is None or label in readings) and said >= names])
            used = self._correction(heard)
            parts = [own, *[inbox[name].estimate for name in used.names]]
            return heard, parts + [readings[label] for label in used.labels]

    def _kept(self, key: Any, value: _T) -> _T:
        # A memo, not a state: values depend on nothing but their keys and the frozen fields.
        if len(self._memo) > _KEPT // (1 + len(self.arcs) // 16):  # what one hears of many seldom comes again
            self._memo.clear()
        self._memo[key] = value
        return value

    def _whole_map(self, heard: tuple[int, ...], duration: float) -> tuple[FloatArray, FloatArray]:
        """One step as one product on what the arcs that are ``heard`` use, and what multiplies ``B u``."""
        key = (heard, duration)
        known: tuple[FloatArray, FloatArray] | None = self._memo.get(key)
        if known is None:
            transition, drive, phi = self._maps(heard, duration)
            whole = phi @ self._correction(heard).matrix  # a new array
            whole[:, : self.n_states] += transition
            known = self._kept(key, (whole, drive))
        return known

    def _correction(self, heard: tuple[int, ...]) -> Correction:
        known: Correction | None = self._memo.get(heard)
        if known is None:
            known = self._kept(heard, correction_of([self.arcs[k] for k in heard], self.n_states))
        return known

    def maps(self, duration: float, *, alone: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
        """``(T, D, Phi)`` of ``z+ = T z + D B u + Phi correction`` over ``duration`` [s] when everybody is heard.

        With ``alone`` nobody is: only arcs without neighbours count.
        """
        heard = tuple(k for k, arc in enumerate(self.arcs) if not (alone and arc.heard))
        return self._maps(heard, float(duration))

    def _maps(self, heard: tuple[int, ...], duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        if self.exchange in ("discrete", "euler"):
            identity = np.eye(self.n_states)
            if self.exchange == "discrete":
                return self.A, identity, identity
            return identity + duration * self.A, duration * identity, duration * identity
        transition, drive = transition_and_integral(self.A, duration)
        if self.exchange == "innovation-held":
            return transition, drive, drive
        closed = self.A - sum((self.arcs[k].gain @ self.arcs[k].output for k in heard), np.zeros_like(self.A))
        return transition, drive, transition_and_integral(closed, duration)[1]

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
                    "more": [[name, encode_array(rows)] for name, rows in arc.more],
                }
                for arc in self.arcs
            ],
            "readout": None if self.readout is None else encode_array(self.readout),
            "feedthrough": [[label, encode_array(matrix)] for label, matrix in self.feedthrough],
            "exchange": self.exchange,
            "acceleration": self.acceleration,
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
        A = matrix(document, "A", None, None)
        n = A.shape[0]
        if A.shape[1] != n or n == 0:
            raise ProtocolError(f"A must be square with at least one row; got {A.shape}")
        B = None if document.get("B") is None else matrix(document, "B", n, None)
        readout = None if document.get("readout") is None else matrix(document, "readout", None, n)
        exchange, acceleration = document.get("exchange"), document.get("acceleration")
        if exchange not in EXCHANGES:
            raise ProtocolError(f"exchange must be one of {', '.join(EXCHANGES)}; got {exchange!r}")
        if acceleration is not None and not (type(acceleration) is float and 0.0 < acceleration < 1.0):
            raise ProtocolError(f"acceleration must be null or a number between 0 and 1; got {acceleration!r}")
        feedthrough = tuple(labelled(document, n if readout is None else readout.shape[0]))
        return LocalObserver(name, A, B, tuple(_read_arcs(arcs, n)), readout, feedthrough, exchange, acceleration)


def _innovation(
    arc: LocalArc, own: FloatArray, inbox: Mapping[str, Message], readings: Mapping[int, FloatArray]
) -> FloatArray | None:
    """``sign y + sum of rows z - output z_own``; None where the reading or a message is missing."""
    innovation = -(arc.output @ own)
    if arc.label is not None:
        reading = readings.get(arc.label)
        if reading is None:
            return None
        innovation = arc.sign * reading - arc.output @ own
    for name, rows in arc.heard:
        message = inbox.get(name)
        if message is None:
            return None
        innovation = innovation + rows @ message.estimate
    return innovation


def _read_arcs(arcs: list[Any], n: int) -> Iterable[LocalArc]:
    for position, entry in enumerate(arcs):
        if not isinstance(entry, dict):
            raise ProtocolError(f"arcs[{position}] must be an object")
        label, neighbour, sign = entry.get("label"), entry.get("neighbour"), entry.get("sign")
        whole = type(label) is int or (label is None and "label" in entry)
        if not whole or not (neighbour is None or isinstance(neighbour, str)) or sign not in (1.0, -1.0):
            raise ProtocolError(
                f"arcs[{position}] needs a whole number or null 'label', a text or null 'neighbour' and a 'sign' "
                "of 1 or -1"
            )
        gain = matrix(entry, "gain", n, None)
        p = gain.shape[1]
        output = matrix(entry, "output", p, n)
        other = None if neighbour is None else matrix(entry, "neighbour_output", p, None)
        yield LocalArc(label, neighbour, float(sign), gain, output, other, tuple(further(entry, position, p)))
