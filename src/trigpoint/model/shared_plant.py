"""One process seen by many: each agent senses a part of it, hears its neighbours, and estimates the whole (W17)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats, as_matrix, frozen
from trigpoint.errors import ArgumentError, ShapeError


@dataclass(frozen=True, eq=False)
class SharedPlant:
    """A plant ``x' = A x + B u`` whose outputs ``y_i = C_i x`` belong to agents that hear some of the others.

    Every agent estimates the whole state x from its own output and from what the agents it hears tell it.

    Args:
        A: (n, n) dynamics of the plant, 1/s.
        outputs: m matrices ``C_i`` of shape (s_i, n), one an agent; None or no rows for an agent that senses nothing.
        neighbours: ``{i: [agents that i hears]}``, where an agent that is left out hears nobody; or a
            ``networkx.DiGraph`` on 0..m-1 with an arc j -> i where i hears j. An agent always hears itself: saying so
            or not makes no difference.
        B: (n, q) input known to all agents; None for none.

    We assume:
        * the agents know A and B, and each knows its own ``C_i``; ``C_i`` may be zero (E-002-8).

    Raises:
        ShapeError: A not square, an output without one column a state, B without one row a state.
        ArgumentError: no agent, NaN or infinity, a neighbour or an agent that does not exist.

    Source: W17, equations (1), (2); 002-01.
    """

    A: FloatArray
    outputs: tuple[FloatArray, ...]
    hears: tuple[tuple[int, ...], ...]
    B: FloatArray | None

    def __init__(
        self,
        A: ArrayLike,
        outputs: Sequence[ArrayLike | None],
        neighbours: Mapping[int, Iterable[int]] | nx.DiGraph,
        B: ArrayLike | None = None,
    ) -> None:
        a = as_matrix("A", A)
        if a.shape[0] != a.shape[1] or a.shape[0] == 0:
            raise ShapeError(f"A must be square with at least one row; got shape {a.shape}")
        each = tuple(_output(agent, value, a) for agent, value in enumerate(outputs))
        if not each:
            raise ArgumentError("outputs must hold one matrix an agent, for at least one agent; got none")
        b = None if B is None else as_matrix("B", B)
        if b is not None and b.shape[0] != a.shape[0]:
            raise ShapeError(f"B must have one row a state of A {a.shape}; got shape {b.shape}")
        object.__setattr__(self, "A", a)
        object.__setattr__(self, "outputs", each)
        object.__setattr__(self, "hears", _hears(neighbours, len(each)))
        object.__setattr__(self, "B", b)

    @property
    def n_agents(self) -> int:
        """Number m of agents."""
        return len(self.outputs)

    @property
    def n_states(self) -> int:
        """Number n of states of the plant, and of each agent's estimate."""
        return int(self.A.shape[0])

    @property
    def n_inputs(self) -> int:
        """Number q of known inputs; 0 without B."""
        return 0 if self.B is None else int(self.B.shape[1])

    def stacked_output(self) -> FloatArray:
        """All outputs, agent after agent: (sum s_i, n), read-only."""
        return frozen(np.vstack(self.outputs))

    def digraph(self) -> nx.DiGraph:
        """The neighbour graph: agents 0..m-1, an arc j -> i where i hears j, no arc from an agent to itself."""
        graph = nx.DiGraph()
        graph.add_nodes_from(range(self.n_agents))
        graph.add_edges_from((heard, agent) for agent, others in enumerate(self.hears) for heard in others)
        return graph

    def __repr__(self) -> str:
        arcs = sum(len(others) for others in self.hears)
        return f"SharedPlant({self.n_states} states, {self.n_agents} agents, {arcs} arcs)"


def _output(agent: int, value: ArrayLike | None, a: FloatArray) -> FloatArray:
    """``C_i`` as (s_i, n); nothing sensed gives no rows."""
    n = a.shape[0]
    given = as_floats(f"outputs[{agent}]", np.zeros((0, n)) if value is None else value)
    if given.ndim == 0:
        given = given.reshape(1, 1)
    if given.ndim == 1 and given.size == 0:
        given = given.reshape(0, n)
    if given.ndim != 2 or given.shape[1] != n:
        raise ShapeError(
            f"the output of agent {agent}, outputs[{agent}], must be a matrix with one column a state of A {a.shape}: "
            f"shape (any, {n}); got {given.shape}"
        )
    return frozen(given)


def _hears(neighbours: Mapping[int, Iterable[int]] | nx.DiGraph, n_agents: int) -> tuple[tuple[int, ...], ...]:
    """Whom each agent hears, ascending, without itself."""
    heard: list[set[int]] = [set() for _ in range(n_agents)]
    for agent, other in _arcs(neighbours, n_agents):
        if agent != other:
            heard[agent].add(other)
    return tuple(tuple(sorted(others)) for others in heard)


def _arcs(neighbours: Mapping[int, Iterable[int]] | nx.DiGraph, n_agents: int) -> list[tuple[int, int]]:
    """Pairs (who hears, whom), each checked."""
    if isinstance(neighbours, nx.Graph):
        if not neighbours.is_directed():
            raise ArgumentError(
                "neighbours is an undirected graph; expected a networkx.DiGraph with arcs j -> i where i hears j "
                "(graph.to_directed() lets each hear the other)"
            )
        for node in neighbours.nodes:
            _agent("neighbours has the node", node, n_agents)
        return [(int(hearing), int(heard)) for heard, hearing in neighbours.edges]
    if not isinstance(neighbours, Mapping):
        raise ArgumentError(
            f"neighbours must be {{agent: [agents it hears]}} or a networkx.DiGraph; got {type(neighbours).__name__}"
        )
    pairs = []
    for key, others in neighbours.items():
        agent = _agent("neighbours has the key", key, n_agents)
        if isinstance(others, str) or not isinstance(others, Iterable):
            raise ArgumentError(f"neighbours[{agent}] must list the agents that agent {agent} hears; got {others!r}")
        pairs += [(agent, _agent(f"agent {agent} hears", other, n_agents)) for other in others]
    return pairs


def _agent(where: str, value: Any, n_agents: int) -> int:
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not 0 <= value < n_agents:
        raise ArgumentError(f"{where} {value!r}, which is no agent; outputs gives agents 0 to {n_agents - 1}")
    return int(value)
