"""Networks for the tests of the runtime: settings of all nodes, the plant, the links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.observers import DiffusiveObserver
from trigpoint.observers.local import LocalObserver
from trigpoint.runtime import LinearPlant, MemoryNetwork, NodeSettings
from trigpoint.runtime.virtual import SENSOR

OSCILLATOR = tp.LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]], B=[[0.0], [1.0]])
DOUBLE = tp.LinearAgent([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]], B=[[0.0], [1.0]])
STATIC = tp.LinearAgent.static(2)
PERIOD = 0.02


@dataclass(frozen=True, eq=False)
class Case:
    """A designed network with a drawn start."""

    observer: DiffusiveObserver
    programs: tuple[LocalObserver, ...]
    truth: FloatArray
    error: FloatArray
    inputs: FloatArray | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(program.name for program in self.programs)

    def settings(self, **options: object) -> list[NodeSettings]:
        """One a node."""
        found = []
        for k, program in enumerate(self.programs):
            given: dict[str, object] = {
                "start": self.truth[k] + self.error[k],
                "guests": {SENSOR: "sensor", "boss": "supervisor"},
                "period": PERIOD,
                **options,
            }
            if self.inputs is not None:
                given["input"] = self.inputs[k]
                given["drives"] = {
                    name: self.programs[self.names.index(name)].B @ self.inputs[self.names.index(name)]
                    for name in program.hears
                }
            found.append(NodeSettings("net", program, **given))  # type: ignore[arg-type]
        return found

    def plant(self, deviations: Mapping[int, float] | None = None, seed: int = 0) -> LinearPlant:
        inputs = None if self.inputs is None else dict(zip(self.names, self.inputs, strict=True))
        return LinearPlant.of(self.programs, list(self.truth), inputs=inputs, deviations=deviations, seed=seed)

    def links(self) -> list[tuple[str, str]]:
        between = [(name, program.name) for program in self.programs for name in program.hears]
        return between + [(SENSOR, name) for name in self.names]

    def network(self, *, attacker: str | None = None, **options: object) -> MemoryNetwork:
        """All links; an attacker hears everybody and reaches everybody."""
        further = [] if attacker is None else [pair for n in self.names for pair in ((attacker, n), (n, attacker))]
        calm = [SENSOR] if attacker is None else [SENSOR, attacker]
        return MemoryNetwork([*self.links(), *further], calm=calm, **options)  # type: ignore[arg-type]


def case(agent=OSCILLATOR, graph=None, gain=None, seed: int = 0, *, told: bool = False) -> Case:
    """A network with a drawn start; the 3 x 3 grid with one anchor unless given."""
    graph = tp.graphs.grid(3, 3, anchors=[0]) if graph is None else graph
    problem = tp.NetworkedAgents(graph, agent)
    observer = tp.design(problem, tp.methods.LocalKalman(gain or tp.methods.FromGraph(margin=1.05)))
    rng = np.random.default_rng(seed)
    shape = (graph.n_nodes, agent.n_states)
    truth, error = rng.normal(size=shape), rng.normal(size=shape)
    inputs = rng.normal(size=(graph.n_nodes, agent.n_inputs)) if told else None
    programs = tuple(observer.local(k) for k in range(graph.n_nodes))
    return Case(observer, programs, truth, error, inputs)
