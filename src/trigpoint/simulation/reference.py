"""The reference path: every ``LocalObserver`` by itself, with messages in between. Slow, readable, the oracle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from trigpoint.arrays import FloatArray
from trigpoint.observers.local import LocalObserver, LocalState, Message
from trigpoint.observers.network import NetworkObserver
from trigpoint.simulation.clockwork import ticks
from trigpoint.simulation.plant import Disturbances, Plant
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Progress, Series

_TOLERANCE = 1e-12


def locals_of(observer: NetworkObserver) -> dict[str, LocalObserver]:
    """All nodes' programs by name, in the network's order."""
    return {name: observer.local(node) for node, name in enumerate(observer.names)}


def readings_of(node: LocalObserver, readings: FloatArray) -> dict[int, FloatArray]:
    """The readings of the node's own arcs, and no others."""
    return {label: readings[label] for label in node.reads}


def inbox_of(node: LocalObserver, messages: dict[str, Message], lost: set[tuple[str, str]]) -> dict[str, Message]:
    """The messages of the node's neighbours that were not lost on the way, and no others."""
    return {name: messages[name] for name in node.hears if (name, node.name) not in lost}


@dataclass(frozen=True, eq=False)
class _Exchange:
    """One exchange: everybody's message, what was lost of them, and all readings."""

    messages: dict[str, Message]
    lost: set[tuple[str, str]]
    readings: FloatArray


@dataclass(frozen=True, eq=False)
class _Nodes:
    """All local programs, and the known inputs of each."""

    programs: dict[str, LocalObserver]
    inputs: FloatArray | None

    def after(self, states: dict[str, LocalState], exchange: _Exchange, duration: float) -> dict[str, LocalState]:
        """Every node's state ``duration`` seconds after an exchange."""
        return {
            name: node.step(
                states[name],
                inbox_of(node, exchange.messages, exchange.lost),
                readings_of(node, exchange.readings),
                duration,
                None if self.inputs is None else self.inputs[position],
            )
            for position, (name, node) in enumerate(self.programs.items())
        }

    def estimates(self, states: dict[str, LocalState]) -> FloatArray:
        """All nodes' estimates (N, n)."""
        return np.stack([node.estimate(states[name]) for name, node in self.programs.items()])


def sampled(
    observer: NetworkObserver,
    plant: Plant,
    scenario: Scenario,
    truth: FloatArray,
    estimate: FloatArray,
    progress: Progress,
) -> Series:
    """Exchange every ``period``, node by node."""
    period, loss = scenario.period or 0.0, 0.0 if scenario.channel is None else scenario.channel.loss
    disturbances = Disturbances.of(plant.problem, scenario)
    nodes = _Nodes(locals_of(observer), plant.inputs)
    states = {name: node.init(value) for (name, node), value in zip(nodes.programs.items(), estimate, strict=True)}
    links = [(sender, node.name) for node in nodes.programs.values() for sender in node.hears]
    sent = np.array([sum(sender == name for sender, _ in links) for name in nodes.programs])
    truths, estimates, messages_sent = [], [], []
    for tick in progress(ticks(scenario.times, period)):
        exchange = _Exchange(
            {name: node.emit(states[name]) for name, node in nodes.programs.items()},
            _lost(links, loss, disturbances.rng),
            plant.read(truth, disturbances.of_readings()),
        )
        for _, late in tick.outputs:
            shown = states if late == 0.0 else nodes.after(states, exchange, late)
            truths.append(plant.advance(truth, late))
            estimates.append(nodes.estimates(shown))
            messages_sent.append((tick.number + (late > 0.0)) * sent)
        states = nodes.after(states, exchange, period)
        truth = plant.advance(truth, period, disturbances.of_process())
    return np.stack(truths), np.stack(estimates), np.stack(messages_sent)


def _lost(links: list[tuple[str, str]], loss: float, rng: np.random.Generator) -> set[tuple[str, str]]:
    if loss == 0.0:
        return set()
    return {link for link, chance in zip(links, rng.random(len(links)), strict=True) if chance < loss}


def continuous(
    observer: NetworkObserver, plant: Plant, scenario: Scenario, truth: FloatArray, estimate: FloatArray
) -> Series:
    """Continuous exchange: an explicit Runge-Kutta method (order 8, tolerance 1e-12) over the nodes' derivatives."""
    nodes = locals_of(observer)
    shape = truth.shape

    def slope(time: float, stacked: FloatArray) -> FloatArray:
        values = stacked.reshape(shape)
        readings = plant.read(plant.advance(truth, time))
        states = {name: LocalState(time, 0, value) for name, value in zip(nodes, values, strict=True)}
        messages = {name: node.emit(states[name]) for name, node in nodes.items()}
        rows = [
            node.derivative(
                states[name],
                inbox_of(node, messages, set()),
                readings_of(node, readings),
                None if plant.inputs is None else plant.inputs[position],
            )
            for position, (name, node) in enumerate(nodes.items())
        ]
        return np.concatenate(rows)

    horizon = float(scenario.times[-1])
    scale = max(float(np.abs(estimate).max(initial=0.0)), float(np.abs(truth).max(initial=0.0)), 1e-300)
    solution = solve_ivp(
        slope,
        (0.0, horizon or 1.0),
        estimate.ravel(),
        method="DOP853",
        t_eval=scenario.times,
        rtol=_TOLERANCE,
        atol=_TOLERANCE * scale,
    )
    truths = np.stack([plant.advance(truth, time) for time in scenario.times.tolist()])
    estimates = solution.y.T.reshape(-1, *shape)
    return truths, estimates, np.zeros(estimates.shape[:2], dtype=np.int64)
