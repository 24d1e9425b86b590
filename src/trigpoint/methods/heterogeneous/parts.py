"""Step 1: the unstable part of every agent, and the measurements that join these parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from trigpoint.analysis.invariant import Piece, invariant_pieces
from trigpoint.arrays import BoolArray, FloatArray
from trigpoint.linalg.blocks import Ranges
from trigpoint.model import HyperNetwork

_AXIS = 1e-9  # relative to the agent's A: real parts above minus this count as unstable
_UNSEEN = 1e-12  # relative: what a measurement sees of the unstable parts is rounding below it


@dataclass(frozen=True, eq=False)
class Unstable:
    """One agent's unstable invariant subspace: ``A_i Q = Q T``, its pieces, and ``scale``, the norm of A_i."""

    node: int
    Q: FloatArray
    T: FloatArray
    pieces: tuple[Piece, ...]
    scale: float


@dataclass(frozen=True, eq=False)
class Part:
    """Unstable parts that measurements join, with nothing shared with the others: ``e' = (A + L C) e``.

    Attributes:
        agents: the unstable parts.
        labels: the measurements that see one of them.
        A: (m, m) their dynamics, blockdiag of the T.
        C: (p, m) what the measurements see of them.
        mask: (m, p) where L may have entries: the blocks that ``C'`` has in the whole network.
        states: index ranges of the agents in A.
        readings: index ranges of the measurements in C.
    """

    agents: tuple[Unstable, ...]
    labels: tuple[int, ...]
    A: FloatArray
    C: FloatArray
    mask: BoolArray
    states: Ranges
    readings: Ranges

    @cached_property
    def size(self) -> float:
        """Norm of A, the unit of rates; 1 where nothing moves by itself."""
        return float(np.linalg.norm(self.A, 2)) or 1.0

    @cached_property
    def units(self) -> FloatArray:
        """(p,) one over the size of each measurement, for its rows of C."""
        norms = [float(np.linalg.norm(self.C[self.readings.slice(j)])) for j in range(self.readings.count)]
        rows = [self.readings.size(j) for j in range(self.readings.count)]
        return np.repeat(1.0 / np.array(norms), rows) if norms else np.zeros(0)

    @property
    def nodes(self) -> tuple[int, ...]:
        """The agents' nodes."""
        return tuple(agent.node for agent in self.agents)

    def scaled(self) -> tuple[FloatArray, FloatArray]:
        """A and C without units: A of norm 1 and each measurement of norm 1."""
        return self.A / self.size, self.units[:, None] * self.C

    def unscaled(self, gain: FloatArray) -> FloatArray:
        """The L for A and C from the ``gain`` for ``scaled``."""
        return np.asarray(self.size * gain * self.units)

    def block_diagonal(self, blocks: Sequence[FloatArray]) -> FloatArray:
        """One block an agent."""
        return np.asarray(la.block_diag(*blocks), dtype=np.float64)


def unstable_parts(problem: HyperNetwork, rate: float) -> list[Part]:
    """Split each ``A_i + rate I`` into its unstable and its stable part and join the unstable ones by measurement.

    An L with zero rows on the stable coordinates of an ordered Schur form leaves the error block triangular: the
    stable parts ride along with their own spectra. In ``problem`` a node may use all measurements whose block for it
    is not zero.

    Source: G16, Definition 4; theory 000-21. Cost O(n_i^3) for each different agent.
    """
    agents = _unstable_agents(problem, rate)
    named = {
        label: [k for k, agent in enumerate(agents) if agent.node in blocks and blocks[agent.node].any()]
        for label, blocks in enumerate(problem.measurements)
        if _sees(blocks, agents)
    }
    pairs = [(k, joined[0]) for joined in named.values() for k in joined]
    rows, columns = zip(*pairs, strict=True) if pairs else ((), ())
    links = sp.coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(agents), len(agents)))
    count, belongs = connected_components(links, directed=False) if agents else (0, np.zeros(0))
    return [
        _part(
            problem,
            [agent for k, agent in enumerate(agents) if belongs[k] == number],
            [label for label, joined in named.items() if belongs[joined[0]] == number],
        )
        for number in range(count)
    ]


def _unstable_agents(problem: HyperNetwork, rate: float) -> list[Unstable]:
    shifted = [agent.A + rate * np.eye(agent.n_states) for agent in problem.agents]
    pieces: dict[int, list[Piece]] = {}
    for piece in invariant_pieces(shifted):
        pieces.setdefault(piece.node, []).append(piece)
    found: list[Unstable] = []
    memo: dict[bytes, tuple[FloatArray, FloatArray]] = {}
    for node, A in enumerate(shifted):
        # A part's own norm is no measure: on modes at zero it is all rounding.
        scale = max(float(np.linalg.norm(A)), float(np.linalg.norm(problem.agents[node].A)))
        lasting = [float(piece.values.real.max()) >= -_AXIS * scale for piece in pieces[node]]
        if not any(lasting):
            continue
        key = A.tobytes()
        if key not in memo:
            memo[key] = _leading(A, pieces[node], lasting)
        own = tuple(piece for piece, lasts in zip(pieces[node], lasting, strict=True) if lasts)
        found.append(Unstable(node, *memo[key], own, scale))
    return found


def _leading(A: FloatArray, pieces: Sequence[Piece], lasting: Sequence[bool]) -> tuple[FloatArray, FloatArray]:
    """Q and T of the unstable subspace by an ordered real Schur form; A itself where nothing is stable."""
    if all(lasting):
        return np.eye(A.shape[0]), A
    values = np.concatenate([piece.values for piece in pieces])
    wanted = np.repeat(lasting, [piece.values.shape[0] for piece in pieces])

    def chosen(real: complex, imaginary: float = 0.0) -> bool:
        return bool(wanted[np.argmin(np.abs(values - (complex(real) + 1j * imaginary)))])

    T, Q, count = la.schur(A, output="real", sort=chosen)
    return Q[:, :count], T[:count, :count]


def _sees(blocks: Mapping[int, FloatArray], agents: Sequence[Unstable]) -> bool:
    """Does a measurement's value depend on an unstable part by more than rounding?"""
    size = float(np.sqrt(sum(float((block**2).sum()) for block in blocks.values())))
    seen = [float(np.linalg.norm(blocks[agent.node] @ agent.Q)) for agent in agents if agent.node in blocks]
    return max(seen, default=0.0) > _UNSEEN * size


def _part(problem: HyperNetwork, agents: Sequence[Unstable], labels: Sequence[int]) -> Part:
    states = Ranges.of(agent.T.shape[0] for agent in agents)
    readings = Ranges.of(next(iter(problem.measurements[label].values())).shape[0] for label in labels)
    C, mask = np.zeros((readings.total, states.total)), np.zeros((states.total, readings.total), dtype=bool)
    for j, label in enumerate(labels):
        blocks = problem.measurements[label]
        for k, agent in enumerate(agents):
            if agent.node in blocks and blocks[agent.node].any():
                C[readings.slice(j), states.slice(k)] = blocks[agent.node] @ agent.Q
                mask[states.slice(k), readings.slice(j)] = True
    A = np.asarray(la.block_diag(*[agent.T for agent in agents]), dtype=np.float64)
    return Part(tuple(agents), tuple(labels), A, C, mask, states, readings)
