"""What coupling does for the parts that agents do not see themselves: the numbers behind ``CouplingGain``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import networkx as nx
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from trigpoint.arrays import FloatArray, frozen
from trigpoint.linalg.blocks import diagonal_of, expand
from trigpoint.linalg.spectral import DENSE_LIMIT, smallest_eigenpair
from trigpoint.linalg.stationary import stationary_vector

Hears = Sequence[Sequence[int]]

_DENSE = 1000
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class CoupledPart:
    """The unseen parts ``b_i`` of the errors, under coupling: ``b_i' = U_i' A U_i b_i + gain U_i' sum_j (e_j - e_i)``.

    Component after component of the digraph the errors are block triangular, and for each component S the function
    ``V = sum_i r_i |b_i|^2`` with a positive left null vector r of its Laplacian falls at a rate that two eigenvalues
    bound. Arcs from outside S only add damping.

    Attributes:
        A: (n, n) dynamics.
        unseen: m orthonormal bases ``U_i``, (n, k_i), of subspaces that A maps into themselves.
        hears: whom each agent hears.

    Source: theory 4b-B1, with theory 4.5 for digraphs that are not strongly connected.
    """

    A: FloatArray
    unseen: tuple[FloatArray, ...]
    hears: Hears

    @cached_property
    def components(self) -> tuple[tuple[int, ...], ...]:
        """Strongly connected components, by their first agent."""
        graph = nx.DiGraph()
        graph.add_nodes_from(range(len(self.unseen)))
        graph.add_edges_from((heard, agent) for agent, others in enumerate(self.hears) for heard in others)
        return tuple(sorted(tuple(sorted(found)) for found in nx.strongly_connected_components(graph)))

    @cached_property
    def weights(self) -> FloatArray:
        """r (m,): positive, ``r' L = 0`` within each component, mean 1 there."""
        r = np.ones(len(self.unseen))
        for agents in self.components:
            place = {agent: k for k, agent in enumerate(agents)}
            rates = np.zeros((len(agents), len(agents)))
            for agent in agents:
                inside = [place[heard] for heard in self.hears[agent] if heard in place]
                rates[place[agent], inside] = 1.0
            r[list(agents)] = stationary_vector(rates)
        return frozen(r)

    @cached_property
    def growth(self) -> float:
        """``mu``: largest eigenvalue of the symmetric part of any ``U_i' A U_i``; -inf with nothing unseen."""
        return max((_top(self._drift(agent)) for agent in range(len(self.unseen))), default=-np.inf)

    @cached_property
    def strengths(self) -> FloatArray:
        """``lam`` of each component: smallest eigenvalue of ``U' ((R L + L' R) (x) I) U``; inf with nothing unseen.

        Positive exactly when the agents of the component, with what comes in from outside, can know everything.
        """
        return frozen([self._strength(agents) for agents in self.components])

    @property
    def strength(self) -> float:
        """The smallest ``lam``."""
        return float(self.strengths.min())

    def needed_gain(self, rate: float) -> float:
        """Least gain with ``gain >= 2 max(r) (mu + rate) / lam`` in every component; 0 where none is needed.

        Infinite where a ``lam`` is zero to rounding.
        """
        if self.growth + rate <= 0.0:
            return 0.0
        heaviest = np.array([self.weights[list(agents)].max() for agents in self.components])
        if (self.strengths <= _ROUNDING * heaviest).any():
            return np.inf
        return float((2.0 * heaviest * (self.growth + rate) / self.strengths).max())

    def rate(self, gain: float) -> float:
        """Largest s with ``V' <= -2 s V`` in every component for this ``gain``: no less than ``needed_gain`` promises.

        Infinite with nothing unseen; negative where V may grow. Cost: one extreme eigenvalue a component.
        """
        return min((self._rate(agents, gain) for agents in self.components), default=np.inf)

    def least_gain(self, rate: float) -> float:
        """Least gain for which V proves ``rate``: at most ``needed_gain``, and much less where r is uneven.

        The largest eigenvalue of a pencil in every component; 0 where no gain is needed.
        """
        return max((self._least(agents, rate) for agents in self.components), default=0.0)

    @cached_property
    def spread(self) -> float:
        """Largest eigenvalue of the Laplacian in size; above 1000 agents the bound twice the most agents heard."""
        count = len(self.unseen)
        if count > _DENSE:
            return 2.0 * max(len(others) for others in self.hears)
        laplacian = np.zeros((count, count))
        for agent, others in enumerate(self.hears):
            laplacian[agent, list(others)] = -1.0
            laplacian[agent, agent] = len(others)
        return float(np.abs(np.linalg.eigvals(laplacian)).max())

    def _drift(self, agent: int) -> FloatArray:
        basis = self.unseen[agent]
        moved = basis.T @ self.A @ basis
        return np.asarray(0.5 * (moved + moved.T))

    def _form(self, agents: tuple[int, ...]) -> sp.csr_array:
        """``U' ((R L + L' R) (x) I) U`` of one component, arcs from outside on the diagonal of L."""
        place = {agent: k for k, agent in enumerate(agents)}
        pairs = [(place[i], place[j]) for i in agents for j in self.hears[i] if j in place]
        rows, columns = ([pair[side] for pair in pairs] for side in (0, 1))
        degrees = np.array([float(len(self.hears[i])) for i in agents])
        shape = (len(agents), len(agents))
        laplacian = sp.diags_array(degrees) - sp.coo_array((np.ones(len(pairs)), (rows, columns)), shape=shape)
        weighted = sp.csr_array(sp.diags_array(self.weights[list(agents)]) @ laplacian)
        basis = diagonal_of(self.unseen[i] for i in agents)
        return sp.csr_array(basis.T @ expand(weighted + weighted.T, self.A.shape[0]) @ basis)

    def _strength(self, agents: tuple[int, ...]) -> float:
        return _smallest(self._form(agents), float(self.weights[list(agents)].max()))

    def _least(self, agents: tuple[int, ...], rate: float) -> float:
        wanted = diagonal_of(
            self.weights[i] * (self._drift(i) + rate * np.eye(self.unseen[i].shape[1])) for i in agents
        )  # fmt: skip
        if wanted.shape[0] == 0:
            return 0.0
        form = 0.5 * self._form(agents)
        if wanted.shape[0] <= DENSE_LIMIT:
            last = (wanted.shape[0] - 1,) * 2
            largest = la.eigh(wanted.toarray(), form.toarray(), eigvals_only=True, subset_by_index=last)
        else:
            start = np.ones(wanted.shape[0])
            largest = eigsh(
                sp.csc_array(wanted), 1, sp.csc_array(form), which="LA", v0=start, return_eigenvectors=False
            )
        return max(0.0, float(largest[0]))

    def _rate(self, agents: tuple[int, ...], gain: float) -> float:
        r = self.weights[list(agents)]
        half = diagonal_of(np.eye(self.unseen[i].shape[1]) / np.sqrt(self.weights[i]) for i in agents)
        drift = diagonal_of(self._drift(i) for i in agents)
        scaled = sp.csr_array(0.5 * gain * (half @ self._form(agents) @ half) - drift)
        return _smallest(scaled, float(r.max()) * gain + abs(self.growth) + float(np.linalg.norm(self.A, 2)))


def _top(matrix: FloatArray) -> float:
    return float(np.linalg.eigvalsh(matrix)[-1]) if matrix.size else -np.inf


def _smallest(matrix: sp.csr_array, size: float) -> float:
    """Smallest eigenvalue of a symmetric matrix above ``-size``; inf for an empty one."""
    if matrix.shape[0] == 0:
        return np.inf
    symmetric = 0.5 * (matrix + matrix.T)
    value, _ = smallest_eigenpair(sp.csr_array(symmetric + size * sp.eye_array(matrix.shape[0])))
    return value - size
