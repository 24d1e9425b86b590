"""``AssembledObserver``: an observer that is nothing but its nodes' programs, for problems of any kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import expm

from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import ArgumentError
from trigpoint.linalg.blocks import Ranges, diagonal_of
from trigpoint.model import HyperNetwork, NetworkedAgents, SharedPlant
from trigpoint.observers.local import LocalObserver
from trigpoint.observers.network import DesignResiduals, GeneralForm, NetworkObserver

Problem = NetworkedAgents | HyperNetwork | SharedPlant


@dataclass(frozen=True, eq=False)
class Channels:
    """A problem as one linear system with numbered readings.

    ``x' = A x``, reading k is ``y_k = C_k x``, and ``targets[i] x`` is what node i estimates.

    Attributes:
        A: sparse (n, n) dynamics of the whole.
        C: sparse (sum p_k, n) outputs, reading after reading.
        readings: index ranges of the readings in the stacked output.
        targets: one sparse (n_i, n) matrix a node.
        names: the nodes' names.
    """

    A: sp.csr_array
    C: sp.csr_array
    readings: Ranges
    targets: tuple[sp.csr_array, ...]
    names: tuple[str, ...]


def channels_of(problem: Problem) -> Channels:
    """The linear system behind a ``problem``; a shared plant's reading i belongs to agent i and may be empty."""
    if isinstance(problem, SharedPlant):
        identity = sp.csr_array(sp.eye_array(problem.n_states))
        names = tuple(str(agent) for agent in range(problem.n_agents))
        outputs = sp.csr_array(problem.stacked_output())
        sizes = Ranges.of(output.shape[0] for output in problem.outputs)
        return Channels(sp.csr_array(problem.A), outputs, sizes, (identity,) * problem.n_agents, names)
    network = problem if isinstance(problem, HyperNetwork) else HyperNetwork.of_networked(problem)
    states = Ranges.of(agent.n_states for agent in network.agents)
    everything = sp.csr_array(sp.eye_array(states.total))
    sizes = Ranges.of(next(iter(blocks.values())).shape[0] for blocks in network.measurements)
    targets = tuple(everything[states.slice(node), :] for node in range(network.n_nodes))
    return Channels(network.stacked_dynamics(), network.stacked_output(), sizes, targets, network.names)


@dataclass(frozen=True, eq=False)
class AssembledObserver(NetworkObserver):
    """An observer given by its nodes' programs: ``z_i' = A_i z_i + B_i u + sum of gain (innovation)``.

    Its error is ``e_i = z_i - V_i x_i``, x_i what node i estimates: ``e' = H e`` when the design equations hold.

    Args:
        method: name of the method that designed it.
        problem: what is estimated.
        nodes: one program a node, in the problem's order and with its names.
        decay_rate: guaranteed rate, 1/s (not positive: none).
        spectral_abscissa: computed largest real part of the spectrum of H, or None.
        facts: further numbers and sentences of the design.
        targets: one (n_z, n_i) matrix ``V_i`` a node; None where each z is the estimate itself.
        period: seconds between two exchanges that the programs were designed for; None for any. ``discrete`` programs
            without a period take the problem's A for the map ``x+ = A x`` from one exchange to the next.

    Raises:
        ArgumentError: not one program a node, or another node's name; a reading or a neighbour that the problem does
            not have, or a matrix that does not fit it.

    Source: W17, equations (3)-(9); G16, equation (4).
    """

    method: str
    problem: Problem
    nodes: tuple[LocalObserver, ...]
    decay_rate: float
    spectral_abscissa: float | None
    facts: Mapping[str, Any] = field(default_factory=dict)
    targets: tuple[FloatArray, ...] | None = None
    period: float | None = None

    def __post_init__(self) -> None:
        """Check names and shapes once, so that no reader has to."""
        names = self.channels.names
        if tuple(node.name for node in self.nodes) != names:
            raise ArgumentError(f"nodes must be one program a node, named {names[:8]} ...; got {len(self.nodes)}")
        for node, own in zip(self.nodes, self.channels.targets, strict=True):
            target = self.target(names.index(node.name)) if self.targets is not None else np.eye(own.shape[0])
            if target.shape != (node.n_states, own.shape[0]):
                raise ArgumentError(
                    f"node {node.name!r} has {node.n_states} states for {own.shape[0]} of the problem; its target "
                    f"must have the shape {(node.n_states, own.shape[0])}, got {target.shape}"
                )
        sizes = {node.name: node.n_states for node in self.nodes}
        for node in self.nodes:
            self._check_arcs(node, sizes)

    def _check_arcs(self, node: LocalObserver, sizes: Mapping[str, int]) -> None:
        readings = self.channels.readings
        for label in node.reads:
            if not 0 <= label < readings.count:
                raise ArgumentError(f"node {node.name!r} uses reading {label}; the problem has {readings.count}")
        for arc in node.arcs:
            p = arc.gain.shape[1]
            rows = [(node.name, arc.output), *arc.heard]
            if arc.label is not None and readings.size(arc.label) != p:
                raise ArgumentError(
                    f"node {node.name!r} multiplies reading {arc.label}, which has {readings.size(arc.label)} numbers, "
                    f"by a gain of shape {arc.gain.shape}"
                )
            for name, matrix in rows:
                if name not in sizes:
                    raise ArgumentError(f"node {node.name!r} hears {name!r}, which is no node of the problem")
                if matrix.shape != (p, sizes[name]):
                    raise ArgumentError(
                        f"node {node.name!r} multiplies what node {name!r} says by a matrix of shape {matrix.shape}; "
                        f"expected {(p, sizes[name])}"
                    )

    @cached_property
    def channels(self) -> Channels:
        """The problem as one linear system."""
        return channels_of(self.problem)

    @cached_property
    def states(self) -> Ranges:
        """Index ranges of the nodes' values in the stacked z."""
        return Ranges.of(node.n_states for node in self.nodes)

    @property
    def names(self) -> tuple[str, ...]:
        """The nodes' names."""
        return self.channels.names

    @property
    def is_discrete(self) -> bool:
        """True where the programs are maps from one exchange to the next, not differential equations."""
        return any(node.exchange == "discrete" for node in self.nodes)

    def target(self, node: int) -> FloatArray:
        """``V_i`` of one node, (n_z, n_i)."""
        return np.eye(self.nodes[node].n_states) if self.targets is None else self.targets[node]

    def target_matrix(self) -> sp.csr_array:
        """V with ``z = V x`` in agreement: sparse (sum n_z, n)."""
        rows = [sp.csr_array(self.target(k)) @ own for k, own in enumerate(self.channels.targets)]
        return sp.csr_array(sp.vstack(rows))

    def error_matrix(self) -> sp.csr_array:
        """Sparse H of ``e' = H e`` (``e+ = H e`` for discrete programs), node after node."""
        return self._coupling_matrix

    @cached_property
    def _coupling_matrix(self) -> sp.csr_array:
        position = {name: k for k, name in enumerate(self.names)}
        blocks = _Entries()
        for k, node in enumerate(self.nodes):
            own = self.states.start(k)
            pull = sum((arc.gain @ arc.output for arc in node.arcs), np.zeros_like(node.A))
            blocks.add(own, own, node.A - pull)
            for arc in node.arcs:
                for name, rows in arc.heard:
                    blocks.add(own, self.states.start(position[name]), arc.gain @ rows)
        return blocks.matrix(self.states.total, self.states.total)

    def local(self, node: int) -> LocalObserver:
        """The program of one node."""
        if not 0 <= node < len(self.nodes):
            raise ArgumentError(f"node must be an index from 0 to {len(self.nodes) - 1}; got {node}")
        return self.nodes[node]

    def general_form(self) -> GeneralForm:
        """H, K, G, M, N of W17 (3)-(4), sparse."""
        readings = self.channels.readings
        K, N = _Entries(), _Entries()
        outputs = Ranges.of(own.shape[0] for own in self.channels.targets)
        for k, node in enumerate(self.nodes):
            for arc in node.arcs:
                if arc.label is not None:
                    K.add(self.states.start(k), readings.start(arc.label), arc.sign * arc.gain)
            for label, matrix in node.feedthrough:
                N.add(outputs.start(k), readings.start(label), matrix)
        M = diagonal_of(np.eye(node.n_states) if node.readout is None else node.readout for node in self.nodes)
        return GeneralForm(
            self.error_matrix(),
            K.matrix(self.states.total, readings.total),
            self._input_matrix(),
            M,
            N.matrix(outputs.total, readings.total),
        )

    def _input_matrix(self) -> sp.csr_array | None:
        inputs = [np.zeros((node.n_states, 0)) if node.B is None else node.B for node in self.nodes]
        if not any(B.shape[1] for B in inputs):
            return None
        # One plant's input is the same for all agents; a network's agents have one each.
        return sp.csr_array(np.vstack(inputs)) if isinstance(self.problem, SharedPlant) else diagonal_of(inputs)

    def verify_design_equations(self) -> DesignResiduals:
        """Residuals of ``V A = H V + K C`` and ``T = M V + N C``, T stacking what each node estimates.

        Source: W17, equations (5) and (8).
        """
        return self.residuals_of(self.general_form())

    def residuals_of(self, form: GeneralForm) -> DesignResiduals:
        """The same for a ``form`` that somebody else assembled."""
        V, A, C = self.target_matrix(), self._moved(), self.channels.C
        wanted = sp.csr_array(sp.vstack(self.channels.targets))
        size = max(_largest(A), _largest(form.H)) or 1.0
        return DesignResiduals(
            _largest(V @ A - form.H @ V - form.K @ C) / size, _largest(wanted - form.M @ V - form.N @ C)
        )

    def _moved(self) -> sp.csr_array:
        """What the truth does: A, or for ``discrete`` programs its map over one period."""
        if not self.is_discrete or self.period is None:
            return self.channels.A
        return sp.csr_array(expm(self.channels.A.toarray() * self.period))

    def error_map(self, period: float) -> sp.csr_array:
        """M of ``e+ = M e`` from one exchange to the next, ``period`` seconds later: sparse (sum n_z, sum n_z).

        ``M = T + Phi (H - blockdiag(A_i))`` with the nodes' own maps T and Phi.
        We assume: every message and reading arrives.
        """
        maps = [node.maps(period) for node in self.nodes]
        own = diagonal_of(node.A for node in self.nodes)
        transition, phi = diagonal_of(each[0] for each in maps), diagonal_of(each[2] for each in maps)
        return sp.csr_array(transition + phi @ (self.error_matrix() - own))

    def __repr__(self) -> str:
        return f"AssembledObserver({self.method}, {len(self.nodes)} nodes, {self.states.total} states)"


class _Entries:
    """Blocks of a sparse matrix, collected; blocks that overlap add up."""

    def __init__(self) -> None:
        self._parts: list[tuple[IntArray, IntArray, FloatArray]] = []

    def add(self, row: int, column: int, block: FloatArray) -> None:
        """Add a dense block with its first entry at (row, column)."""
        i, j = np.nonzero(block)
        self._parts.append((i + row, j + column, np.asarray(block)[i, j]))

    def matrix(self, rows: int, columns: int) -> sp.csr_array:
        """The sum of all blocks."""
        if not self._parts:
            return sp.csr_array((rows, columns))
        i, j, entries = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        return sp.csr_array(sp.coo_array((entries, (i, j)), shape=(rows, columns)))


def _largest(matrix: sp.sparray) -> float:
    entries = sp.csr_array(matrix)
    return float(np.abs(entries.data).max(initial=0.0))
