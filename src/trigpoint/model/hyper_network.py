"""Agents that differ, seen through measurements that may join any number of them (G16, equation (3))."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, IntArray, as_floats, as_matrix, frozen
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.model.agents import LinearAgent
from trigpoint.model.networked import NetworkedAgents


@dataclass(frozen=True, eq=False)
class HyperNetwork:
    """Agents ``x_i' = A_i x_i + B_i u_i`` and measurements ``y_j = sum_k C_jk x_k`` on any number of nodes.

    ``x = (x_1, ..., x_N)`` node-major, with agents of different sizes; ``A = blockdiag(A_i)``, and C has the block
    ``C_jk`` in block row j and block column k.

    Args:
        agents: one a node, each a ``LinearAgent`` (its own output C is not used: ``measurements`` says what is
            measured) or just its matrix ``A_i`` (n_i, n_i).
        measurements: one mapping ``{k: C_jk}`` a measurement, ``C_jk`` of shape (p_j, n_k), with one entry for an
            absolute reading, two for an arc, more for a hyper-arc.
        names: N different texts; None gives "0", "1", ...

    Raises:
        ShapeError: an ``A_i`` that is not square, a ``C_jk`` that does not fit its agent or the other blocks of its
            row; the message names measurement, node and both shapes.
        ArgumentError: no agent, an empty measurement, a node that does not exist, NaN or infinity, names that repeat.

    Source: G16, Section 3, equations (3), (4); 000-16.
    """

    agents: tuple[LinearAgent, ...]
    measurements: tuple[Mapping[int, FloatArray], ...]
    names: tuple[str, ...]

    def __init__(
        self,
        agents: Sequence[LinearAgent | ArrayLike],
        measurements: Sequence[Mapping[int, ArrayLike]],
        names: Sequence[str] | None = None,
    ) -> None:
        each = tuple(_agent(node, value) for node, value in enumerate(agents))
        if not each:
            raise ArgumentError("agents must hold one agent a node, for at least one node; got none")
        labels = tuple(str(k) for k in range(len(each))) if names is None else tuple(str(name) for name in names)
        if len(labels) != len(each) or len(set(labels)) != len(labels):
            raise ArgumentError(f"names must be {len(each)} different texts, one an agent; got {list(labels)[:8]}")
        object.__setattr__(self, "agents", each)
        object.__setattr__(self, "measurements", tuple(_measurement(j, m, each) for j, m in enumerate(measurements)))
        object.__setattr__(self, "names", labels)

    @property
    def n_nodes(self) -> int:
        """Number N of agents."""
        return len(self.agents)

    @cached_property
    def offsets(self) -> IntArray:
        """(N + 1,) where each agent's states begin in the stacked state, and their total number at the end."""
        sizes = np.array([agent.n_states for agent in self.agents], dtype=np.int64)
        starts: IntArray = frozen(np.concatenate([[0], np.cumsum(sizes)]), np.int64)
        return starts

    @property
    def n_states(self) -> int:
        """Number of states of all agents together."""
        return int(self.offsets[-1])

    def states(self, node: int) -> slice:
        """Positions of the states of ``node`` in the stacked state."""
        return slice(int(self.offsets[node]), int(self.offsets[node + 1]))

    def stacked_dynamics(self) -> sp.csr_array:
        """``A = blockdiag(A_i)``: sparse (sum n_i, sum n_i)."""
        return diagonal_of(agent.A for agent in self.agents)

    def stacked_output(self) -> sp.csr_array:
        """C with the block ``C_jk`` in block row j and block column k: sparse (sum p_j, sum n_i)."""
        rows, columns, entries = [], [], []
        start = 0
        for blocks in self.measurements:
            for node, block in blocks.items():
                row, column = np.nonzero(block)
                rows.append(row + start)
                columns.append(column + self.offsets[node])
                entries.append(block[row, column])
            start += next(iter(blocks.values())).shape[0]
        if not entries:
            return sp.csr_array((start, self.n_states))
        places = (np.concatenate(rows), np.concatenate(columns))
        return sp.csr_array((np.concatenate(entries), places), shape=(start, self.n_states))

    @staticmethod
    def of_networked(problem: NetworkedAgents) -> HyperNetwork:
        """The same network, each arc a measurement ``{head: C_h, tail: -C_t}`` and each external one ``{head: C_h}``.

        The nodes keep their names; ``problem`` may have agents that differ. Weights of arcs do not matter here.
        """
        return HyperNetwork(problem.agents, list(_arc_measurements(problem)), problem.graph.names)

    def __repr__(self) -> str:
        return f"HyperNetwork({self.n_nodes} agents, {self.n_states} states, {len(self.measurements)} measurements)"


def _arc_measurements(problem: NetworkedAgents) -> Iterator[dict[int, FloatArray]]:
    graph = problem.graph
    ends = zip(graph.head.tolist(), graph.tail.tolist(), graph.is_external.tolist(), strict=True)
    for head, tail, is_external in ends:
        blocks: dict[int, FloatArray] = {head: problem.agents[head].C}
        if not is_external:
            blocks[tail] = -problem.agents[tail].C
        yield blocks


def _agent(node: int, value: LinearAgent | ArrayLike) -> LinearAgent:
    if isinstance(value, LinearAgent):
        return value
    a = as_matrix(f"agents[{node}]", value)
    if a.shape[0] != a.shape[1] or a.shape[0] == 0:
        raise ShapeError(f"agents[{node}] must be a LinearAgent or a square matrix A_i; got shape {a.shape}")
    return LinearAgent(a, np.eye(a.shape[0]))


def _measurement(j: int, blocks: Mapping[int, ArrayLike], agents: tuple[LinearAgent, ...]) -> dict[int, FloatArray]:
    """One measurement with its blocks as read-only matrices, ascending by node."""
    if not isinstance(blocks, Mapping) or not blocks:
        raise ArgumentError(f"measurements[{j}] must map nodes to blocks C_jk, at least one; got {blocks!r}")
    for node in blocks:
        whole = isinstance(node, int | np.integer) and not isinstance(node, bool)
        if not whole or not 0 <= node < len(agents):
            raise ArgumentError(f"measurements[{j}] names node {node!r}; expected 0 to {len(agents) - 1}")
    checked: dict[int, FloatArray] = {}
    for node in sorted(blocks):
        block = as_floats(f"measurements[{j}][{node}]", blocks[node])
        block = block.reshape(1, 1) if block.ndim == 0 else block
        expected = agents[node].A.shape
        if block.ndim != 2 or block.shape[1] != expected[0] or block.shape[0] == 0:
            raise ShapeError(
                f"measurements[{j}] at node {node} must be a matrix with one column a state of the agent's A "
                f"{expected} and at least one row; got shape {block.shape}"
            )
        first = next(iter(checked.values()), block)
        if block.shape[0] != first.shape[0]:
            raise ShapeError(
                f"all blocks of measurements[{j}] must have equally many rows; got {first.shape} at node "
                f"{next(iter(checked))} and {block.shape} at node {node}"
            )
        checked[int(node)] = block
    return checked
