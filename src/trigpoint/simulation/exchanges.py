"""Sampled runs of assembled observers, all nodes at once: one clock, every message arrives after the same delay."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray, IntArray, transition_and_integral
from trigpoint.linalg.blocks import Ranges, diagonal_of
from trigpoint.observers.acceleration import accelerated, chebyshev_factor
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalState
from trigpoint.simulation.channel import Channel
from trigpoint.simulation.clockwork import ticks
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress
from trigpoint.simulation.wire import HEAD_BYTES
from trigpoint.simulation.world import World, drawn_from, padded

Readings = dict[int, FloatArray]
_Maps = tuple[sp.csr_array, FloatArray, sp.csr_array]
_SNAP = 1e-9


@dataclass(frozen=True, eq=False)
class Traffic:
    """What went over the wire so far: (T, N) messages sent, messages each node has taken in, bytes sent (or None)."""

    sent: IntArray
    delivered: IntArray | None = None
    bytes: IntArray | None = None


@dataclass(frozen=True, eq=False)
class Recorded:
    """Truth and estimates (T, N, n) at the first T output times, and the traffic."""

    truth: FloatArray
    estimate: FloatArray
    traffic: Traffic


@dataclass(frozen=True, eq=False)
class Start:
    """Truth (n,) and the nodes' values z at time 0."""

    truth: FloatArray
    values: list[FloatArray]


@dataclass(frozen=True, eq=False)
class Sampling:
    """An exchange every ``period`` seconds."""

    period: float
    progress: Progress


@dataclass(frozen=True, eq=False)
class ArcForm:
    """Every arc of every program as a row: ``innovation = own z + other z_heard + reading y``, ``z' += gain`` of it.

    Attributes:
        own, other: sparse (rows, total) what the node's own value and its neighbours' values are multiplied by.
        reading: sparse (rows, readings).
        gain: sparse (total, rows).
        node: (rows,) whose arc it is.
        hears: (rows,) True where the row uses a message.
    """

    own: sp.csr_array
    other: sp.csr_array
    reading: sp.csr_array
    gain: sp.csr_array
    node: IntArray
    hears: FloatArray

    @staticmethod
    def of(observer: AssembledObserver) -> ArcForm:
        """Take the programs apart."""
        states, position = observer.states, {name: k for k, name in enumerate(observer.names)}
        sizes = observer.channels.readings
        rows = Ranges.of(arc.output.shape[0] for node in observer.nodes for arc in node.arcs)
        own, other, reading, gain = (_Blocks() for _ in range(4))
        owner, hears, number = [], [], 0
        for k, node in enumerate(observer.nodes):
            for arc in node.arcs:
                row = rows.start(number)
                own.add(row, states.start(k), -arc.output)
                for name, block in arc.heard:
                    other.add(row, states.start(position[name]), block)
                if arc.label is not None:
                    reading.add(row, sizes.start(arc.label), arc.sign * np.eye(arc.output.shape[0]))
                gain.add(states.start(k), row, arc.gain)
                owner += [k] * arc.output.shape[0]
                hears += [float(bool(arc.heard))] * arc.output.shape[0]
                number += 1
        shape = (rows.total, states.total)
        return ArcForm(
            own.matrix(shape),
            other.matrix(shape),
            reading.matrix((rows.total, sizes.total)),
            gain.matrix((states.total, rows.total)),
            np.array(owner, dtype=np.int64),
            np.array(hears),
        )


class _Blocks:
    def __init__(self) -> None:
        self._parts: list[tuple[IntArray, IntArray, FloatArray]] = []

    def add(self, row: int, column: int, block: FloatArray) -> None:
        i, j = np.nonzero(block)
        self._parts.append((i + row, j + column, np.asarray(block)[i, j]))

    def matrix(self, shape: tuple[int, int]) -> sp.csr_array:
        if not self._parts:
            return sp.csr_array(shape)
        i, j, entries = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        return sp.csr_array(sp.coo_array((entries, (i, j)), shape=shape))


def sampled(observer: AssembledObserver, world: World, scenario: Scenario, how: Sampling, start: Start) -> Recorded:
    """One exchange after the other; noise is drawn in the order of the reference path. Ctrl-C keeps what there is."""
    rng, truth = np.random.default_rng(scenario.seed), start.truth
    engine = AtOnce(observer, world, start, scenario.channel or Channel(), how.period)
    deviation, process = (0.0, 0.0) if scenario.noise is None else (scenario.noise.measurement, scenario.noise.process)
    factors = [] if process == 0.0 else world.noise_factors(process, how.period)
    truths, estimates, counts = [], [], []
    try:
        for tick in how.progress(ticks(scenario.times, how.period)):
            noise = deviation * rng.standard_normal(world.channels.C.shape[0]) if deviation else None
            readings = world.read(truth, noise)
            engine.exchange(readings)
            for _, late in tick.outputs:
                # A map says nothing about the time between two exchanges: there the last values stand.
                shown = 0.0 if observer.is_discrete else late
                now, known = _later(world, scenario, truth, tick.number * how.period, 0.0 if world.is_map else late)
                truths.append(padded(world.shown(now)))
                value = engine.after(shown) + (known if shown else 0.0)
                estimates.append(estimates_of(observer, value, readings if late == 0.0 else world.read(now)))
                counts.append((tick.number, late))
            moved, known = _later(world, scenario, truth, tick.number * how.period, how.period)
            engine.settle(how.period, known)
            truth = moved + drawn_from(factors, rng) if factors else moved
    except KeyboardInterrupt:
        if not estimates:
            raise
    kept = len(estimates)
    return Recorded(
        np.stack(truths[:kept]), np.stack(estimates), traffic_of(observer, scenario, counts[:kept], how.period)
    )  # fmt: skip


def _later(
    world: World, scenario: Scenario, truth: FloatArray, time: float, duration: float
) -> tuple[FloatArray, FloatArray | float]:
    """The truth ``duration`` later, and what a given motion adds for each node to its free motion."""
    free = world.advance(truth, duration)
    if scenario.motion is None or duration == 0.0:
        return free, 0.0
    moved = scenario.motion.at(time + duration).ravel()
    return moved, np.concatenate(world.shown(moved - free)) if scenario.motion.known else 0.0


def traffic_of(
    observer: AssembledObserver, scenario: Scenario, counts: list[tuple[int, float]], period: float
) -> Traffic:  # fmt: skip
    """Nobody loses anything: numbers follow from the exchanges before each output, and from the delay."""
    channel = scenario.channel or Channel()
    listeners = Counter(sender for node in observer.nodes for sender in node.hears)
    sent = np.array([listeners[name] for name in observer.names], dtype=np.int64)
    received = np.array([len(node.hears) for node in observer.nodes], dtype=np.int64)
    size = [HEAD_BYTES + int(np.ceil(channel.bits_per_value * node.n_states / 8.0)) for node in observer.nodes]
    spoken = np.array([number + (late > 0.0) for number, late in counts], dtype=np.int64)
    heard = np.maximum(spoken - int(np.ceil(channel.delay / period - _SNAP)), 0)
    return Traffic(spoken[:, None] * sent, heard[:, None] * received, spoken[:, None] * sent * np.array(size))


def estimates_of(observer: AssembledObserver, stacked: FloatArray, readings: Readings) -> FloatArray:
    """What each node believes (N, longest), from all values z."""
    values = np.split(stacked, observer.states.starts[1:-1])
    pairs = zip(observer.nodes, values, strict=True)
    return padded([node.estimate(LocalState(0.0, 0, value), readings) for node, value in pairs])


class AtOnce:
    """``z+ = T z + D B u + Phi gain (reading y + own z + other z_heard)``, sparse.

    Args:
        observer, world, start: what runs, in which world, from where.
        channel: its delay, its rounding and its policy for old messages; nothing random.
        period: seconds between two exchanges.
    """

    def __init__(
        self, observer: AssembledObserver, world: World, start: Start, channel: Channel, period: float
    ) -> None:
        self._observer, self._value, self._channel = observer, np.concatenate(start.values), channel
        self._form = ArcForm.of(observer)
        self._correction = np.zeros_like(self._value)
        self._alone = False
        self._lag = int(np.ceil(channel.delay / period - _SNAP))
        self._past: deque[FloatArray] = deque(maxlen=self._lag + 1)
        self._drive = np.concatenate(
            [
                np.zeros(node.n_states) if told is None or node.B is None else node.B @ told
                for node, told in zip(observer.nodes, world.inputs, strict=True)
            ]
        )
        self._age = self._lag * period
        fresh = channel.old == "drop" or channel.stale is None or self._age <= channel.stale * (1.0 + _SNAP)
        self._silent = not fresh
        self._maps: dict[tuple[float, bool], _Maps] = {}
        self._count = 0

    def exchange(self, readings: Readings) -> None:
        """All corrections, from what has been heard by now."""
        form = self._form
        stacked = np.concatenate([np.zeros(0), *(readings[label] for label in sorted(readings))])
        self._past.append(self._rounded(self._value))
        self._alone = self._silent or len(self._past) <= self._lag
        innovation = form.reading @ stacked + form.own @ self._value
        if self._alone:
            innovation = np.where(form.hears > 0.0, 0.0, innovation)
        else:
            innovation = innovation + form.other @ self._moved(self._past[0])
        self._correction = form.gain @ innovation

    def after(self, duration: float) -> FloatArray:
        """All values later."""
        if duration == 0.0:
            return self._value
        transition, drive, phi = self._known(duration)
        value = np.asarray(transition @ self._value + drive + phi @ self._correction)
        rho = self._observer.nodes[0].acceleration
        return value if rho is None else self._accelerated(value, chebyshev_factor(self._count, rho))

    def settle(self, duration: float, known: FloatArray | float) -> None:
        """Go on; what a given motion adds is ``known``."""
        self._value = self.after(duration) + known
        self._count += 1

    def _rounded(self, value: FloatArray) -> FloatArray:
        span, quantum = self._channel.span, self._channel.quantum
        value = value if span is None else np.clip(value, -span, span)
        return quantum * np.round(value / quantum) if quantum else value

    def _moved(self, past: FloatArray) -> FloatArray:
        """The neighbours' old values as the policy takes them."""
        if self._channel.old != "propagate" or self._lag == 0 or self._observer.is_discrete:
            return past
        if not hasattr(self, "_ageing"):
            maps = [transition_and_integral(node.A, self._age) for node in self._observer.nodes]
            drive = np.asarray(diagonal_of(each[1] for each in maps) @ self._drive)
            self._ageing = (diagonal_of(each[0] for each in maps), drive)
        return np.asarray(self._ageing[0] @ past + self._ageing[1])

    def _accelerated(self, value: FloatArray, omega: float) -> FloatArray:
        cuts = self._observer.states.starts[1:-1]
        pairs = zip(np.split(value, cuts), np.split(self._value, cuts), strict=True)
        return np.concatenate([accelerated(after, before, omega) for after, before in pairs])

    def _known(self, duration: float) -> _Maps:
        key = (duration, self._alone)
        if key not in self._maps:
            if len(self._maps) > 64:
                self._maps.clear()
            maps = [node.maps(duration, alone=self._alone) for node in self._observer.nodes]
            transition, drive, phi = (diagonal_of(each[k] for each in maps) for k in range(3))
            self._maps[key] = (transition, np.asarray(drive @ self._drive), phi)
        return self._maps[key]
