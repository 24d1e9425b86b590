"""The truth and the readings of any problem: what nature does while assembled observers run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray, transition_and_integral
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.model import HyperNetwork, SharedPlant
from trigpoint.observers.assembled import AssembledObserver, Channels
from trigpoint.simulation.scenario import Scenario


@dataclass(frozen=True, eq=False)
class World:
    """One linear system with constant known inputs and numbered readings.

    Attributes:
        channels: dynamics, readings, and what each node estimates.
        parts: (slice, A, drive) of each independent part of the state: one an agent, or one for a shared plant.
        inputs: what each node is told of the known inputs, or None.
        is_map: the truth moves by ``x+ = A x + B u`` from one exchange to the next.
    """

    channels: Channels
    parts: tuple[tuple[slice, FloatArray, FloatArray], ...]
    inputs: tuple[FloatArray | None, ...]
    is_map: bool

    @staticmethod
    def of(observer: AssembledObserver, scenario: Scenario) -> World:
        """Check the scenario against the observer's own problem."""
        if scenario.measurements is not None:
            raise ArgumentError("recorded measurements belong to equal static agents; leave them out here")
        problem, channels = observer.problem, observer.channels
        if isinstance(problem, SharedPlant):
            told = _shared_input(problem, scenario)
            drive = np.zeros(problem.n_states) if told is None or problem.B is None else problem.B @ told
            whole = ((slice(0, problem.n_states), problem.A, drive),)
            return World(channels, whole, (told,) * problem.n_agents, _is_map(observer))
        network = problem if isinstance(problem, HyperNetwork) else HyperNetwork.of_networked(problem)
        inputs = _agent_inputs(network, scenario)
        parts = []
        for node, agent in enumerate(network.agents):
            given = inputs[node]
            drive = np.zeros(agent.n_states) if given is None or agent.B is None else agent.B @ given
            parts.append((network.states(node), agent.A, drive))
        return World(channels, tuple(parts), inputs, _is_map(observer))

    def advance(self, state: FloatArray, duration: float) -> FloatArray:
        """Truth (n,) ``duration`` seconds later, exactly; for a map, of one exchange."""
        if duration == 0.0:
            return state
        moved = np.empty_like(state)
        known: dict[bytes, tuple[FloatArray, FloatArray]] = {}
        for place, A, drive in self.parts:
            key = A.tobytes()
            if key not in known:
                one = (A, np.eye(A.shape[0]))
                known[key] = one if self.is_map else transition_and_integral(A, duration)
            transition, integral = known[key]
            moved[place] = transition @ state[place] + integral @ drive
        return moved

    def read(self, state: FloatArray, noise: FloatArray | None = None) -> dict[int, FloatArray]:
        """All readings by label."""
        values = self.channels.C @ state
        values = values if noise is None else values + noise
        ranges = self.channels.readings
        return {label: values[ranges.slice(label)] for label in range(ranges.count)}

    def shown(self, state: FloatArray) -> list[FloatArray]:
        """What each node should estimate, of this truth."""
        return [target @ state for target in self.channels.targets]


def start_of(world: World, name: str, value: FloatArray) -> list[FloatArray]:
    """A scalar, one row a node, or everything stacked, as one vector a node."""
    sizes = [target.shape[0] for target in world.channels.targets]
    if value.ndim == 0:
        return [np.full(size, float(value)) for size in sizes]
    if value.ndim == 2 and value.shape == (len(sizes), max(sizes)) and len(set(sizes)) == 1:
        return list(value)
    if value.shape == (sum(sizes),):
        return np.split(value, np.cumsum(sizes)[:-1])
    raise ShapeError(f"{name} must be a scalar, ({sum(sizes)},) or one row a node; got shape {value.shape}")


def truth_of(world: World, value: FloatArray) -> FloatArray:
    """The true state (n,) at time 0, from a scalar or (n,)."""
    n = world.channels.A.shape[0]
    if value.ndim == 0:
        return np.full(n, float(value))
    if value.size != n:
        raise ShapeError(f"initial_state must be a scalar or hold the {n} states of the problem; got {value.shape}")
    return np.array(value.reshape(n))


def padded(rows: list[FloatArray]) -> FloatArray:
    """Vectors of different length as one table, filled up with zeros: (N, longest)."""
    table = np.zeros((len(rows), max(row.shape[0] for row in rows)))
    for k, row in enumerate(rows):
        table[k, : row.shape[0]] = row
    return table


def _is_map(observer: AssembledObserver) -> bool:
    return observer.is_discrete and observer.period is None


def _shared_input(problem: SharedPlant, scenario: Scenario) -> FloatArray | None:
    if scenario.inputs is None:
        return None
    if scenario.inputs.size != problem.n_inputs:
        raise ShapeError(f"inputs must have shape ({problem.n_inputs},), as B has columns; got {scenario.inputs.shape}")
    return scenario.inputs.reshape(problem.n_inputs)


def _agent_inputs(network: HyperNetwork, scenario: Scenario) -> tuple[FloatArray | None, ...]:
    if scenario.inputs is None:
        return (None,) * network.n_nodes
    widths = sorted({agent.n_inputs for agent in network.agents})
    if len(widths) != 1 or scenario.inputs.shape != (network.n_nodes, widths[0]):
        raise ShapeError(
            f"inputs need agents with equally many inputs, shape (N, m); got {widths} and {scenario.inputs.shape}"
        )
    return tuple(scenario.inputs) if widths[0] else (None,) * network.n_nodes
