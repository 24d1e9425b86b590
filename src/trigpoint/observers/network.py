"""``NetworkObserver``: the estimators of all nodes as one value."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from trigpoint.analysis.modes import mode_matrices
from trigpoint.arrays import FloatArray, IntArray, transition_and_integral
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.blocks import Blocks, block_diagonal, expand, repeat_diagonal
from trigpoint.linalg.transient import transient_peak
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers.local import LocalArc, LocalObserver

if TYPE_CHECKING:
    from trigpoint.observers.assembled import AssembledObserver

ComplexArray = NDArray[np.complex128]
_ALL_MODES = 2000


@dataclass(frozen=True, eq=False)
class GeneralForm:
    """Every observer in one form, W17 (3)-(4): ``z' = H z + K y + G u``, ``estimate = M z + N y``, all sparse.

    H is (sum n_i, sum n_i) with block (i, j) zero unless i hears j; K is (sum n_i, M p).
    """

    H: sp.csr_array
    K: sp.csr_array
    G: sp.csr_array | None
    M: sp.csr_array
    N: sp.csr_array


@dataclass(frozen=True)
class DesignResiduals:
    """Largest violation of the observer design equations, relative to the size of A (W17 (5)) and absolute (W17 (8)).

    Attributes:
        dynamics: ``max |A - (H + K C)| / max |A, H|``: estimates follow the truth when they agree with it.
        output: ``max |I - (M + N C)|``: the estimate is the state.
    """

    dynamics: float
    output: float


class NetworkObserver(ABC):
    """The estimators of all nodes: what each node runs, and the error dynamics that result.

    Attributes:
        method: name of the method that designed it.
        decay_rate: guaranteed rate a: ``|e(t)| <= c e^{-a t}``, 1/s. Not positive: no decay is
            guaranteed, only that the error grows no faster than that.
        spectral_abscissa: computed largest real part of the error spectrum, None where it was not computed.
        facts: further numbers and sentences of the design, for reports.
    """

    method: str
    decay_rate: float
    spectral_abscissa: float | None
    facts: Mapping[str, Any]

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """The nodes' names, in the order of their indices."""

    @abstractmethod
    def error_matrix(self) -> sp.csr_array:
        """Sparse H of ``e' = H e`` (node-major, error = estimate - truth)."""

    @abstractmethod
    def local(self, node: int) -> LocalObserver:
        """The program of one node, holding its row and its arcs and nothing else."""

    @abstractmethod
    def general_form(self) -> GeneralForm:
        """The observer as H, K, G, M, N of W17 (3)-(4)."""

    @abstractmethod
    def verify_design_equations(self) -> DesignResiduals:
        """Residuals of the observer design equations W17 (5) and (8)."""


@dataclass(frozen=True, eq=False)
class DiffusiveObserver(NetworkObserver):
    """Network-decentralized observer of equal agents, in compact form: one injection for every arc.

    ``z_i' = A_1 z_i + B_1 u_i + gain * injection * sum over arcs k at i of W_k (+-y_k + C_1 z_j - C_1 z_i)``, hence
    ``e' = (I (x) A_1 - gain (I (x) injection) (L (x) I_p) (I (x) C_1)) e`` with ``L = G W G^T``.

    Args:
        problem: the homogeneous network.
        injection: (n, p) ``Q_1 C_1^T R_1^{-1}``.
        gain: coupling gain gamma, positive.
        method, decay_rate, spectral_abscissa, facts: as in ``NetworkObserver``.

    Source: G16, equations (8)-(10); R23, equation (7).
    """

    method: str
    problem: NetworkedAgents
    injection: FloatArray
    gain: float
    decay_rate: float
    spectral_abscissa: float | None
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def graph(self) -> MeasurementGraph:
        """The measurement graph, with the weights that the observer uses."""
        return self.problem.graph

    @property
    def names(self) -> tuple[str, ...]:
        """The nodes' names."""
        return self.graph.names

    @property
    def agent(self) -> LinearAgent:
        """The agent on every node."""
        return self.problem.agent

    @property
    def states(self) -> Blocks:
        """Index ranges of the stacked estimate, node-major."""
        return self.problem.states

    def _coupling(self) -> sp.csr_array:
        """``L (x) I_p``, or L itself where the weights are p x p blocks."""
        laplacian = self.graph.laplacian()
        return (
            laplacian if self.graph.dimension == self.problem.n_outputs else expand(laplacian, self.problem.n_outputs)
        )

    def _weight_blocks(self) -> FloatArray:
        """Weights written out as (M, p, p); scalars, and blocks of size 1, are multiples of the identity."""
        weight = self.graph.arc_weights
        return weight if self.graph.dimension > 1 else weight.reshape(-1, 1, 1) * np.eye(self.problem.n_outputs)

    def error_matrix(self) -> sp.csr_array:
        """``I (x) A_1 - gain (I (x) injection) (L (x) I) (I (x) C_1)``, sparse (N n, N n)."""
        n_nodes = self.graph.n_nodes
        pull = repeat_diagonal(n_nodes, self.gain * self.injection) @ self._coupling()
        return sp.csr_array(repeat_diagonal(n_nodes, self.agent.A) - pull @ repeat_diagonal(n_nodes, self.agent.C))

    def error_operator(self) -> LinearOperator:
        """The error matrix as an operator on (N n,) vectors, without assembling it."""
        coupling, split, size = self.graph.laplacian(), self.states.split, self.states.total
        if self.graph.dimension > 1:
            return aslinearoperator(self.error_matrix())

        def move(e: FloatArray) -> FloatArray:
            table = split(np.asarray(e).reshape(size))
            pull = coupling @ (table @ self.agent.C.T)
            return np.asarray((table @ self.agent.A.T - self.gain * pull @ self.injection.T).reshape(size))

        return LinearOperator((size, size), matvec=move, dtype=np.float64)

    def mode_matrices(self) -> FloatArray:
        """``A - gain lambda_k K C`` for every eigenvalue lambda_k of L: (N, n, n); scalar weights, up to 2000 nodes."""
        if self.graph.dimension > 1 or self.graph.n_nodes > _ALL_MODES:
            raise ArgumentError(f"modes are for scalar weights and up to {_ALL_MODES} nodes; got {self.graph!r}")
        values = la.eigvalsh(self.graph.laplacian().toarray())
        return mode_matrices(self.agent.A, self.injection, self.agent.C, self.gain * values)

    def spectrum(self) -> ComplexArray:
        """All eigenvalues of the error matrix (N n,), mode by mode."""
        return np.asarray(np.linalg.eigvals(self.mode_matrices()), dtype=np.complex128).ravel()

    def transient_peak(self) -> float:
        """Largest ``||e^{H t}||_2`` over a grid of times: the error may first grow by this factor (inf: unstable)."""
        return transient_peak(self.mode_matrices())

    def reading_matrix(self) -> sp.csr_array:
        """K of ``z' = H z + K y``: ``gain (I (x) injection) (G W (x) I)``, sparse (N n, M p)."""
        p = self.problem.n_outputs
        weighted = expand(self.graph.incidence(), p) @ block_diagonal(self._weight_blocks())
        return sp.csr_array(repeat_diagonal(self.graph.n_nodes, self.gain * self.injection) @ weighted)

    def local(self, node: int) -> LocalObserver:
        """The program of one node: its model, and one ``LocalArc`` for each of its arcs, in the network's order."""
        if not 0 <= node < self.graph.n_nodes:
            raise ArgumentError(f"node must be an index from 0 to {self.graph.n_nodes - 1}; got {node}")
        arcs = tuple(self._local_arc(int(k), node) for k in self._arcs_at[node])
        return LocalObserver(self.graph.names[node], self.agent.A, self.problem.agents[node].B, arcs)

    def _local_arc(self, arc: int, node: int) -> LocalArc:
        graph, C = self.graph, self.agent.C
        weight = graph.arc_weights[arc]
        gain = self.gain * self.injection @ (weight if graph.dimension > 1 else weight.item() * np.eye(C.shape[0]))
        at_head = int(graph.head[arc]) == node
        if graph.is_external[arc]:
            return LocalArc(arc, None, 1.0, gain, C, None)
        other = graph.names[graph.tail[arc] if at_head else graph.head[arc]]
        return LocalArc(arc, other, 1.0 if at_head else -1.0, gain, C, C)

    @cached_property
    def _arcs_at(self) -> list[IntArray]:
        """Arc numbers at each node, ascending."""
        inner = np.flatnonzero(~self.graph.is_external)
        nodes = np.concatenate([self.graph.head, self.graph.tail[inner]])
        arcs = np.concatenate([np.arange(self.graph.n_arcs), inner])
        order = np.lexsort((arcs, nodes))
        ends = np.cumsum(np.bincount(nodes, minlength=self.graph.n_nodes))
        return np.split(arcs[order], ends[:-1])

    def as_programs(self) -> AssembledObserver:
        """The same observer as its nodes' programs and nothing else: not the stacked formula."""
        from trigpoint.observers.assembled import AssembledObserver

        nodes = tuple(self.local(node) for node in range(self.graph.n_nodes))
        return AssembledObserver(
            self.method, self.problem, nodes, self.decay_rate, self.spectral_abscissa, self.facts
        )  # fmt: skip

    def general_form(self) -> GeneralForm:
        """H, K, G, M, N, assembled row by row from the nodes' own programs (not from the stacked formula)."""
        return self.as_programs().general_form()

    def verify_design_equations(self) -> DesignResiduals:
        """Residuals of ``A = H + K C`` and ``I = M + N C``: each node estimates its own state, so ``V = I``."""
        return self.as_programs().residuals_of(self.general_form())

    def sampled_maps(self, duration: float) -> tuple[sp.csr_array, sp.csr_array]:
        """``(I (x) e^{A h}, Phi (I (x) gain injection))`` of one neighbour-held step for all nodes at once.

        ``z+ = transition z + drive + correction (sum of innovations)``; the second matrix takes the (N p,) stacked
        weighted innovations. Source: theory 6-F2; the same step as ``LocalObserver.step``, assembled independently.
        """
        transition, _ = transition_and_integral(self.agent.A, duration)
        K = self.gain * self.injection
        own = np.zeros((self.graph.n_nodes, self.problem.n_outputs, self.problem.n_outputs))
        blocks = self._weight_blocks()
        inner = ~self.graph.is_external
        np.add.at(own, self.graph.head, blocks)
        np.add.at(own, self.graph.tail[inner], blocks[inner])
        closed = self.agent.A - K @ own @ self.agent.C
        phi = np.stack([transition_and_integral(matrix, duration)[1] for matrix in closed])
        return repeat_diagonal(self.graph.n_nodes, transition), block_diagonal(phi @ K)

    def __repr__(self) -> str:
        return f"DiffusiveObserver({self.method}, {self.graph.n_nodes} nodes, gain {self.gain:.6g})"
