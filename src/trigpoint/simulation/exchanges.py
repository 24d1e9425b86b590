"""Sampled runs of assembled observers: all nodes at once, or each program by itself with messages in between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalObserver, LocalState, Message, accelerated, chebyshev_factor
from trigpoint.simulation.clockwork import ticks
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress, Series
from trigpoint.simulation.world import World, padded

Readings = dict[int, FloatArray]
_Maps = tuple[sp.csr_array, FloatArray, sp.csr_array]


@dataclass(frozen=True, eq=False)
class Start:
    """Truth (n,) and the nodes' values z at time 0."""

    truth: FloatArray
    values: list[FloatArray]


@dataclass(frozen=True, eq=False)
class Sampling:
    """An exchange every ``period`` seconds, all nodes ``at_once`` or one by one."""

    period: float
    at_once: bool
    progress: Progress


class _Engine(Protocol):
    """How all nodes take one exchange."""

    def exchange(self, readings: Readings, lost: set[tuple[str, str]]) -> None:
        """Send, read and correct."""
        ...

    def after(self, duration: float) -> FloatArray:
        """All values z, stacked, ``duration`` seconds after the exchange."""
        ...

    def settle(self, duration: float) -> None:
        """Go on from there."""
        ...


def sampled(observer: AssembledObserver, world: World, scenario: Scenario, how: Sampling, start: Start) -> Series:
    """One exchange after the other; noise and losses are drawn in one order whichever engine runs."""
    rng, truth = np.random.default_rng(scenario.seed), start.truth
    engine: _Engine = (AtOnce if how.at_once else OneByOne)(observer, world, start)
    deviation, process = (0.0, 0.0) if scenario.noise is None else (scenario.noise.measurement, scenario.noise.process)
    loss = 0.0 if scenario.channel is None else scenario.channel.loss
    links = [(sender, node.name) for node in observer.nodes for sender in node.hears]
    sent = np.array([sum(sender == name for sender, _ in links) for name in observer.names])
    factors = [] if process == 0.0 else world.noise_factors(process, how.period)
    truths, estimates, messages = [], [], []
    for tick in how.progress(ticks(scenario.times, how.period)):
        chances = rng.random(len(links)) if loss else np.ones(len(links))
        noise = deviation * rng.standard_normal(world.channels.C.shape[0]) if deviation else None
        readings = world.read(truth, noise)
        engine.exchange(readings, {link for link, chance in zip(links, chances, strict=True) if chance < loss})
        for _, late in tick.outputs:
            # A map says nothing about the time between two exchanges: there the last values stand.
            shown = 0.0 if observer.is_discrete else late
            now = world.advance(truth, 0.0 if world.is_map else late)
            truths.append(padded(world.shown(now)))
            estimates.append(estimates_of(observer, engine.after(shown), readings if late == 0.0 else world.read(now)))
            messages.append((tick.number + (late > 0.0)) * sent)
        engine.settle(how.period)
        drawn = [factor @ rng.standard_normal(factor.shape[1]) for factor in factors]
        truth = world.advance(truth, how.period, np.concatenate(drawn) if drawn else None)
    return np.stack(truths), np.stack(estimates), np.stack(messages)


def estimates_of(observer: AssembledObserver, stacked: FloatArray, readings: Readings) -> FloatArray:
    """What each node believes (N, longest), from all values z."""
    values = np.split(stacked, observer.states.starts[1:-1])
    pairs = zip(observer.nodes, values, strict=True)
    return padded([node.estimate(LocalState(0.0, 0, value), readings) for node, value in pairs])


def inbox_of(node: LocalObserver, messages: dict[str, Message], lost: set[tuple[str, str]]) -> dict[str, Message]:
    """The messages of the node's neighbours that were not lost on the way, and no others."""
    return {name: messages[name] for name in node.hears if (name, node.name) not in lost}


class AtOnce:
    """``z+ = T z + D B u + Phi (K y + (H - blockdiag A_i) z)``, sparse."""

    def __init__(self, observer: AssembledObserver, world: World, start: Start) -> None:
        form = observer.general_form()
        self._observer, self._value = observer, np.concatenate(start.values)
        self._injection, self._pull = form.K, form.H - diagonal_of(node.A for node in observer.nodes)
        self._correction = np.zeros_like(self._value)
        self._drive = np.concatenate(
            [
                np.zeros(node.n_states) if told is None or node.B is None else node.B @ told
                for node, told in zip(observer.nodes, world.inputs, strict=True)
            ]
        )
        self._maps: dict[float, _Maps] = {}
        self._count = 0

    def exchange(self, readings: Readings, lost: set[tuple[str, str]]) -> None:  # noqa: ARG002 (none is lost here)
        """All corrections."""
        stacked = np.concatenate([np.zeros(0), *(readings[label] for label in sorted(readings))])
        self._correction = self._injection @ stacked + self._pull @ self._value

    def after(self, duration: float) -> FloatArray:
        """All values later."""
        if duration == 0.0:
            return self._value
        transition, drive, phi = self._known(duration)
        value = np.asarray(transition @ self._value + drive + phi @ self._correction)
        rho = self._observer.nodes[0].acceleration
        return value if rho is None else self._accelerated(value, chebyshev_factor(self._count, rho))

    def settle(self, duration: float) -> None:
        """Go on."""
        self._value = self.after(duration)
        self._count += 1

    def _accelerated(self, value: FloatArray, omega: float) -> FloatArray:
        cuts = self._observer.states.starts[1:-1]
        pairs = zip(np.split(value, cuts), np.split(self._value, cuts), strict=True)
        return np.concatenate([accelerated(after, before, omega) for after, before in pairs])

    def _known(self, duration: float) -> _Maps:
        if duration not in self._maps:
            maps = [node.maps(duration) for node in self._observer.nodes]
            transition, drive, phi = (diagonal_of(each[k] for each in maps) for k in range(3))
            self._maps[duration] = (transition, np.asarray(drive @ self._drive), phi)
        return self._maps[duration]


class OneByOne:
    """Every program by itself: the oracle, and the only one that loses messages."""

    def __init__(self, observer: AssembledObserver, world: World, start: Start) -> None:
        pairs = zip(observer.nodes, start.values, strict=True)
        self._nodes, self._inputs = observer.nodes, world.inputs
        self._states = {node.name: node.init(value) for node, value in pairs}
        self._messages: dict[str, Message] = {}
        self._readings: Readings = {}
        self._lost: set[tuple[str, str]] = set()

    def exchange(self, readings: Readings, lost: set[tuple[str, str]]) -> None:
        """Everybody speaks; what is lost is lost."""
        self._messages = {node.name: node.emit(self._states[node.name]) for node in self._nodes}
        self._readings, self._lost = readings, lost

    def _later(self, duration: float) -> dict[str, LocalState]:
        if duration == 0.0:
            return self._states
        return {
            node.name: node.step(
                self._states[node.name],
                inbox_of(node, self._messages, self._lost),
                {label: self._readings[label] for label in node.reads},
                duration,
                told,
            )
            for node, told in zip(self._nodes, self._inputs, strict=True)
        }

    def after(self, duration: float) -> FloatArray:
        """All values later."""
        states = self._later(duration)
        return np.concatenate([states[node.name].estimate for node in self._nodes])

    def settle(self, duration: float) -> None:
        """Go on."""
        self._states = self._later(duration)
