"""A truth in memory for nodes to estimate: what it must do, and the linear one that their own programs describe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trigpoint.arrays import FloatArray, transition_and_integral
from trigpoint.errors import ArgumentError
from trigpoint.observers.local import LocalObserver

_KEPT = 64


class Plant(Protocol):
    """Moves by itself and is read. One object, changed by ``move`` alone."""

    def move(self, time: float) -> None:
        """Go on to ``time`` [s], which is not before the last one."""
        ...

    def truth(self) -> Sequence[FloatArray]:
        """What each node should estimate now, in the order of the nodes."""
        ...

    def readings(self) -> Mapping[int, FloatArray]:
        """The reading of every arc now, by label."""
        ...


@dataclass(frozen=True, eq=False)
class Term:
    """One part of a reading: ``rows`` (p, n) times the state of the agent at this ``place``."""

    place: int
    rows: FloatArray


class LinearPlant:
    """Agents ``x' = A x + b``, moved exactly, and readings that are sums of rows times states.

    Args:
        dynamics: A (n, n) of each agent.
        start: (n,) of each agent at time 0.
        arcs: terms of each reading, by label.
        drives: b (n,) of each agent, constant; None for none.
        deviations: standard deviation of each reading, by label; exact where not given.
        seed: of the readings' errors.
    """

    def __init__(
        self,
        dynamics: Sequence[FloatArray],
        start: Sequence[FloatArray],
        arcs: Mapping[int, Sequence[Term]],
        *,
        drives: Sequence[FloatArray] | None = None,
        deviations: Mapping[int, float] | None = None,
        seed: int = 0,
    ) -> None:
        shapes = [np.shape(x) for x in start]
        if shapes != [(A.shape[0],) for A in dynamics]:
            raise ArgumentError(f"start must hold one state of each agent's length; got the shapes {shapes}")
        self._dynamics = tuple(dynamics)
        self._state = [np.array(x, dtype=np.float64) for x in start]
        self._drives = tuple(np.zeros(A.shape[0]) for A in dynamics) if drives is None else tuple(drives)
        self._arcs = {label: tuple(terms) for label, terms in arcs.items()}
        self._deviations = dict(deviations or {})
        self._rng = np.random.default_rng(seed)
        self._maps: dict[tuple[bytes, float], tuple[FloatArray, FloatArray]] = {}
        self._groups: dict[bytes, list[int]] = {}
        for place, A in enumerate(self._dynamics):
            self._groups.setdefault(A.tobytes(), []).append(place)
        self._now = 0.0

    @staticmethod
    def of(
        programs: Sequence[LocalObserver],
        start: Sequence[FloatArray],
        *,
        inputs: Mapping[str, FloatArray] | None = None,
        deviations: Mapping[int, float] | None = None,
        seed: int = 0,
    ) -> LinearPlant:
        """The plant that these ``programs`` believe in: each node's own agent, readings as their arcs use them.

        Args: ``start``, ``deviations`` and ``seed`` as for the plant; ``inputs`` u of the nodes that have one, by name.
        """
        places = {program.name: k for k, program in enumerate(programs)}
        arcs: dict[int, list[Term]] = {}
        for program in programs:
            for arc in program.arcs:
                if arc.label is None or arc.label in arcs:
                    continue
                terms = [Term(places[program.name], arc.sign * arc.output)]
                terms += [Term(places[name], -arc.sign * rows) for name, rows in arc.heard]
                arcs[arc.label] = terms
        given = inputs or {}
        drives = [
            np.zeros(program.n_states) if program.B is None or program.name not in given
            else program.B @ given[program.name]
            for program in programs
        ]  # fmt: skip
        return LinearPlant(
            [program.A for program in programs], start, arcs, drives=drives, deviations=deviations, seed=seed
        )

    def move(self, time: float) -> None:
        """Go on to ``time`` [s]."""
        if time <= self._now:
            return
        duration = float(f"{time - self._now:.12g}")  # equal steps of a time axis differ in their last digits only
        for known, places in self._groups.items():
            key = (known, duration)
            if key not in self._maps:
                if len(self._maps) > _KEPT:
                    self._maps.clear()
                self._maps[key] = transition_and_integral(self._dynamics[places[0]], duration)
            transition, integral = self._maps[key]
            states, drives = (np.array([rows[k] for k in places]) for rows in (self._state, self._drives))
            for k, moved in zip(places, states @ transition.T + drives @ integral.T, strict=True):
                self._state[k] = moved
        self._now = time

    def truth(self) -> list[FloatArray]:
        """State of each agent."""
        return [state.copy() for state in self._state]

    def readings(self) -> dict[int, FloatArray]:
        """All readings now, with errors drawn anew."""
        return {label: self._read(label, terms) for label, terms in self._arcs.items()}

    def _read(self, label: int, terms: Sequence[Term]) -> FloatArray:
        value = np.asarray(sum(term.rows @ self._state[term.place] for term in terms), dtype=np.float64)
        deviation = self._deviations.get(label, 0.0)
        if not deviation:
            return value
        noisy: FloatArray = value + deviation * self._rng.standard_normal(value.shape[0])
        return noisy
