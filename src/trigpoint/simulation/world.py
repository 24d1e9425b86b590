"""The truth and the readings of any problem: what nature does while assembled observers run."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from trigpoint.arrays import FloatArray, IntArray, transition_and_integral
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.linalg.blocks import Ranges
from trigpoint.model import LinearAgent, SharedPlant
from trigpoint.observers.assembled import AssembledObserver, Channels
from trigpoint.simulation.plant import noise_factor
from trigpoint.simulation.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Part:
    """An independent part of the state: one agent, or the whole shared plant.

    Attributes:
        place: its positions in the state.
        A: its dynamics.
        drive: ``B u``.
        entry: E of its process noise ``E v``.
    """

    place: slice
    A: FloatArray
    drive: FloatArray
    entry: FloatArray


@dataclass(frozen=True, eq=False)
class _Group:
    """Parts with equal dynamics: positions (k n,), a slice where they follow each other, and drive (k, n)."""

    A: FloatArray
    places: IntArray | slice
    drive: FloatArray


@dataclass(frozen=True, eq=False)
class World:
    """One linear system with constant known inputs and numbered readings.

    Attributes:
        channels: dynamics, readings, and what each node estimates.
        parts: the independent parts of the state.
        inputs: what each node is told of the known inputs, or None.
        recorded: all readings, stacked, where recorded ones replace the simulated; or None.
        is_map: the truth moves by ``x+ = A x + B u`` from one exchange to the next.
    """

    channels: Channels
    parts: tuple[Part, ...]
    inputs: tuple[FloatArray | None, ...]
    recorded: FloatArray | None
    is_map: bool

    @staticmethod
    def of(observer: AssembledObserver, scenario: Scenario) -> World:
        """Check the scenario against the observer's own problem."""
        problem, channels = observer.problem, observer.channels
        recorded = _recorded(observer, scenario)
        if isinstance(problem, SharedPlant):
            told = _shared_input(problem, scenario)
            drive = np.zeros(problem.n_states) if told is None or problem.B is None else problem.B @ told
            whole = (Part(slice(0, problem.n_states), problem.A, drive, np.eye(problem.n_states)),)
            return World(channels, whole, (told,) * problem.n_agents, recorded, _is_map(observer))
        inputs = _agent_inputs(problem.agents, scenario)
        states = Ranges.of(agent.n_states for agent in problem.agents)
        parts = []
        for node, agent in enumerate(problem.agents):
            given = inputs[node]
            drive = np.zeros(agent.n_states) if given is None or agent.B is None else agent.B @ given
            entry = np.eye(agent.n_states) if agent.E is None else agent.E
            parts.append(Part(states.slice(node), agent.A, drive, entry))
        return World(channels, tuple(parts), inputs, recorded, _is_map(observer))

    def advance(self, state: FloatArray, duration: float, noise: FloatArray | None = None) -> FloatArray:
        """Truth (n,) ``duration`` seconds later, exactly, plus a drawn disturbance; for a map, of one exchange."""
        if duration == 0.0 and noise is None:
            return state
        moved = np.empty_like(state)
        for group, (transition, gained) in zip(self._groups, self._maps_of(duration), strict=True):
            moved[group.places] = (state[group.places].reshape(gained.shape) @ transition.T + gained).ravel()
        return moved if noise is None else moved + noise

    @cached_property
    def _groups(self) -> list[_Group]:
        """The parts, all that have equal dynamics together."""
        together: dict[tuple[int, bytes], list[Part]] = {}
        for part in self.parts:
            together.setdefault((part.A.shape[0], part.A.tobytes()), []).append(part)
        return [
            _Group(parts[0].A, _places_of(parts), np.array([part.drive for part in parts]))
            for parts in together.values()
        ]

    def _maps_of(self, duration: float) -> list[tuple[FloatArray, FloatArray]]:
        """Of each group the transition (n, n), and what the drive adds (k, n)."""
        if duration not in self._maps:
            if len(self._maps) > 64:
                self._maps.clear()
            self._maps[duration] = [self._map(group, duration) for group in self._groups]
        return self._maps[duration]

    def _map(self, group: _Group, duration: float) -> tuple[FloatArray, FloatArray]:
        if self.is_map:
            return group.A, group.drive
        transition, integral = transition_and_integral(group.A, duration)
        return transition, group.drive @ integral.T

    @cached_property
    def _maps(self) -> dict[float, list[tuple[FloatArray, FloatArray]]]:
        return {}  # a memo: it depends on nothing but the frozen fields

    def noise_factors(self, scale: float, period: float) -> list[FloatArray]:
        """F of each part with ``F F'`` the covariance of ``scale`` times its process noise over one period."""
        known: dict[bytes, FloatArray] = {}
        for part in self.parts:
            key = part.A.tobytes() + part.entry.tobytes()
            if key not in known:
                known[key] = scale * part.entry if self.is_map else noise_factor(part.A, scale * part.entry, period)
        return [known[part.A.tobytes() + part.entry.tobytes()] for part in self.parts]

    def read(
        self, state: FloatArray, noise: FloatArray | None = None, labels: Collection[int] | None = None
    ) -> dict[int, FloatArray]:
        """Readings by label: all, or the ``labels`` that are asked for."""
        if labels is not None and 8 * len(labels) < len(self._places) and noise is None and self.recorded is None:
            return {label: self._reading(state, self._places[label]) for label in labels}
        values = self.channels.C @ state if self.recorded is None else self.recorded
        values = values if noise is None else values + noise
        if labels is None:
            return {label: values[place] for label, place in enumerate(self._places)}
        return {label: values[self._places[label]] for label in labels}

    def _reading(self, state: FloatArray, place: slice) -> FloatArray:
        """Rows of ``C x``, entry after entry as the sparse product does."""
        ends, columns, entries = self._rows
        found = []
        for row in range(place.start, place.stop):
            total = 0.0
            for k in range(ends[row], ends[row + 1]):
                total += entries[k] * float(state[columns[k]])
            found.append(total)
        return np.array(found)

    @cached_property
    def _rows(self) -> tuple[list[int], list[int], list[float]]:
        C = self.channels.C
        return C.indptr.tolist(), C.indices.tolist(), C.data.tolist()

    @cached_property
    def _places(self) -> list[slice]:
        ranges = self.channels.readings
        return [ranges.slice(label) for label in range(ranges.count)]

    def shown(self, state: FloatArray) -> list[FloatArray]:
        """What each node should estimate, of this truth."""
        everything, cuts = self._targets
        return np.split(everything @ state, cuts)

    @cached_property
    def _targets(self) -> tuple[sp.csr_array, IntArray]:
        sizes = [target.shape[0] for target in self.channels.targets]
        return sp.csr_array(sp.vstack(self.channels.targets)), np.cumsum(sizes)[:-1]


def _places_of(parts: list[Part]) -> IntArray | slice:
    places = np.concatenate([np.arange(part.place.start, part.place.stop) for part in parts])
    first, count = int(places[0]), places.shape[0]
    return slice(first, first + count) if (np.diff(places) == 1).all() else places


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


def drawn_from(factors: list[FloatArray], rng: np.random.Generator) -> FloatArray:
    """One draw of noise with each of the ``factors``, stacked: part after part, from one call of ``rng``."""
    widths = Ranges.of(factor.shape[1] for factor in factors)
    numbers = rng.standard_normal(widths.total)
    if len({factor.shape for factor in factors}) == 1:
        return (np.stack(factors) @ numbers.reshape(len(factors), -1, 1)).ravel()
    parts = np.split(numbers, widths.starts[1:-1])
    return np.concatenate([factor @ part for factor, part in zip(factors, parts, strict=True)])


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


def _recorded(observer: AssembledObserver, scenario: Scenario) -> FloatArray | None:
    if scenario.measurements is None:
        return None
    if observer.channels.A.nnz:
        raise ArgumentError("recorded measurements are constant, so they belong to static agents (A = 0)")
    expected = observer.channels.C.shape[0]
    if scenario.measurements.size != expected:
        raise ShapeError(f"measurements must hold the {expected} readings; got shape {scenario.measurements.shape}")
    return scenario.measurements.reshape(expected)


def _shared_input(problem: SharedPlant, scenario: Scenario) -> FloatArray | None:
    if scenario.inputs is None:
        return None
    if scenario.inputs.size != problem.n_inputs:
        raise ShapeError(f"inputs must have shape ({problem.n_inputs},), as B has columns; got {scenario.inputs.shape}")
    return scenario.inputs.reshape(problem.n_inputs)


def _agent_inputs(agents: Sequence[LinearAgent], scenario: Scenario) -> tuple[FloatArray | None, ...]:
    if scenario.inputs is None:
        return (None,) * len(agents)
    widths = sorted({agent.n_inputs for agent in agents})
    if len(widths) != 1 or scenario.inputs.shape != (len(agents), widths[0]):
        raise ShapeError(
            f"inputs need agents with equally many inputs, shape (N, m); got {widths} and {scenario.inputs.shape}"
        )
    return tuple(scenario.inputs) if widths[0] else (None,) * len(agents)
