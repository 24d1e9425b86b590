"""``ProjectedConsensusObserver``: continuous local observers, and rounds of projected averaging at events."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats, frozen, transition_and_integral
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.linalg.blocks import Ranges, diagonal_of, expand
from trigpoint.model import SharedPlant
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalObserver, LocalState
from trigpoint.observers.network import DesignResiduals, GeneralForm, NetworkObserver
from trigpoint.observers.projection import ProjectionProgram
from trigpoint.observers.run import Run

Heard = Mapping[int, Iterable[int]]


@dataclass(frozen=True, eq=False)
class ProjectedConsensusObserver(NetworkObserver):
    """A hybrid observer: between events each node flows by itself, at events it makes ``rounds`` rounds with others.

    The stacked error of ``(w_i, x_i)``, node after node, obeys ``e' = H e`` between events (``error_matrix``), jumps by
    ``J^rounds`` at an event (``jump_matrix``), and so moves by ``e^{H period} J^rounds`` from just before one event to
    just before the next (``period_matrix``).

    Args:
        method: name of the method that designed it.
        problem: the plant with its agents.
        nodes: one program an agent.
        period: seconds between two events.
        rounds: exchanges at each event.
        decay_rate: guaranteed rate at events, 1/s (not positive: none).
        spectral_abscissa: logarithm of the spectral radius of ``period_matrix()`` over the period, 1/s, or None.
        facts: further numbers of the design.

    Source: theory 4b-B3.
    """

    method: str
    problem: SharedPlant
    nodes: tuple[ProjectionProgram, ...]
    period: float
    rounds: int
    decay_rate: float
    spectral_abscissa: float | None
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """The agents' names."""
        return tuple(node.name for node in self.nodes)

    @cached_property
    def states(self) -> Ranges:
        """Index ranges of the agents' ``(w_i, x_i)`` in the stacked error."""
        return Ranges.of(node.flow.n_states for node in self.nodes)

    @cached_property
    def between_events(self) -> AssembledObserver:
        """What runs between events, as an observer by itself: nobody hears anybody."""
        flows = tuple(node.flow for node in self.nodes)
        targets = tuple(frozen(np.vstack([node.seen.T, np.eye(self.problem.n_states)])) for node in self.nodes)
        return AssembledObserver(self.method, self.problem, flows, 0.0, None, {}, targets)

    def error_matrix(self) -> sp.csr_array:
        """Sparse H of ``e' = H e`` between events."""
        return self.between_events.error_matrix()

    def local(self, node: int) -> LocalObserver:
        """What one ``node`` runs between events; ``nodes[node]`` is the whole program."""
        return self.between_events.local(node)

    def general_form(self) -> GeneralForm:
        """H, K, G, M, N of W17 (3)-(4) between events."""
        return self.between_events.general_form()

    def verify_design_equations(self) -> DesignResiduals:
        """Residuals of W17 (5) and (8) between events; the larger of (8) and of ``J V = V`` at events.

        V stacks ``[seen_i'; I]``: nodes that agree with the truth keep agreeing with it at an event.
        """
        flow = self.between_events.verify_design_equations()
        V = self.between_events.target_matrix()
        kept = np.abs((self.jump_matrix() @ V - V).toarray()).max(initial=0.0)
        return DesignResiduals(flow.dynamics, max(flow.output, float(kept)))

    def jump_matrix(self, hears: Heard | None = None) -> sp.csr_array:
        """Sparse J of one round, ``e <- J e``: w stays, ``x_i <- (I - seen_i seen_i') average + seen_i w_i``.

        Args:
            hears: ``{i: [agents that i hears]}`` in this round; None for the problem's own.
        """
        n = self.problem.n_states
        own = diagonal_of(np.eye(node.n_seen, node.flow.n_states) for node in self.nodes)
        whole = diagonal_of(np.eye(n, node.flow.n_states, node.n_seen) for node in self.nodes)
        seen = diagonal_of(node.seen for node in self.nodes)
        average = expand(averaging_matrix(self._heard(hears)), n) @ whole
        return sp.csr_array(own.T @ own + whole.T @ (average - seen @ (seen.T @ average) + seen @ own))

    def flow_matrix(self) -> sp.csr_array:
        """Sparse ``e^{H period}``: the error from just after one event to just before the next."""
        H = self.error_matrix()
        parts = [self.states.slice(agent) for agent in range(len(self.nodes))]
        return diagonal_of(la.expm(H[part, part].toarray() * self.period) for part in parts)

    def period_matrix(self, hears: Heard | None = None) -> FloatArray:
        """``e^{H period} J^rounds``, dense: the error from just before one event to just before the next.

        Args:
            hears: who hears whom at that event; None for the problem's own.
        """
        jump, error = self.jump_matrix(hears), np.eye(self.states.total)
        for _ in range(self.rounds):
            error = jump @ error
        return np.asarray(self.flow_matrix() @ error)

    def run(
        self,
        initial_error: ArrayLike,
        initial_state: ArrayLike,
        events: int,
        *,
        hears_at: Callable[[int], Heard] | None = None,
        inputs: ArrayLike | None = None,
    ) -> Run:
        """Run the nodes' own programs on the plant, without noise, and record just before every event.

        Args:
            initial_error: (m, n) or a scalar: estimate minus truth at time 0; w begins as the estimate shows it.
            initial_state: (n,) truth at time 0.
            events: how many events; the first is at time 0, the last record one period after the last event.
            hears_at: who hears whom at event k = 0, 1, ...; None for the problem's own every time.
            inputs: (q,) constant known input; None for zero.

        The truth, x and the local observers move exactly between events: w under the true, continuous readings.

        Raises:
            ShapeError, ArgumentError: a start, an input or a number of events that does not fit.

        Cost: ``events * rounds`` rounds of every node. Source: theory 4b-B3.
        """
        truth, estimates = self._start(initial_error, initial_state)
        if type(events) is not int or events < 1:
            raise ArgumentError(f"events must be a whole number of at least 1; got {events!r}")
        drift = self._drift(inputs)
        move, flow = la.expm(self.problem.A * self.period), self.flow_matrix()
        closed = [flow[part, part].toarray() for part in map(self.states.slice, range(len(self.nodes)))]
        states = [node.init(guess) for node, guess in zip(self.nodes, estimates, strict=True)]
        truths, believed = [truth], [estimates]
        for k in range(events):
            heard = self._heard(None if hears_at is None else hears_at(k))
            for _ in range(self.rounds):
                states = self._exchange(states, heard)
            ahead = move @ truth + drift
            states = [
                self._flowed(agent, state, matrix, truth, ahead)
                for agent, (state, matrix) in enumerate(zip(states, closed, strict=True))
            ]
            truth = ahead
            truths.append(truth)
            believed.append(np.array([node.estimate(state) for node, state in zip(self.nodes, states, strict=True)]))
        return self._recorded(np.array(truths), np.array(believed))

    def _start(self, initial_error: ArrayLike, initial_state: ArrayLike) -> tuple[FloatArray, FloatArray]:
        count, n = len(self.nodes), self.problem.n_states
        truth, error = as_floats("initial_state", initial_state), as_floats("initial_error", initial_error)
        if truth.shape != (n,):
            raise ShapeError(f"initial_state must have shape ({n},); got {truth.shape}")
        if error.shape not in ((), (count, n)):
            raise ShapeError(f"initial_error must be a scalar or have shape ({count}, {n}); got {error.shape}")
        return truth, truth + np.broadcast_to(error, (count, n))

    def _drift(self, inputs: ArrayLike | None) -> FloatArray:
        """What the known input adds to the state over one period."""
        if inputs is None:
            return np.zeros(self.problem.n_states)
        u = as_floats("inputs", inputs)
        if self.problem.B is None or u.shape != (self.problem.n_inputs,):
            raise ShapeError(f"inputs must have shape ({self.problem.n_inputs},), one a column of B; got {u.shape}")
        return np.asarray(transition_and_integral(self.problem.A, self.period)[1] @ self.problem.B @ u)

    def _exchange(self, states: list[LocalState], heard: tuple[tuple[int, ...], ...]) -> list[LocalState]:
        messages = [node.emit(state) for node, state in zip(self.nodes, states, strict=True)]
        return [
            node.round(state, {messages[other].sender: messages[other] for other in others})
            for node, state, others in zip(self.nodes, states, heard, strict=True)
        ]

    def _flowed(
        self, agent: int, state: LocalState, closed: FloatArray, truth: FloatArray, ahead: FloatArray
    ) -> LocalState:
        """``(w, x)`` one period later: the error moves by ``closed`` whatever the truth and the known input do."""
        seen = self.nodes[agent].seen
        before, after = (np.concatenate([seen.T @ x, x]) for x in (truth, ahead))
        value = after + closed @ (state.estimate - before)
        return LocalState(state.time + self.period, state.sequence, frozen(value))

    def _recorded(self, truths: FloatArray, believed: FloatArray) -> Run:
        count = truths.shape[0]
        times = frozen(self.period * np.arange(count))
        messages = np.repeat(self.rounds * np.arange(count)[:, None], len(self.nodes), axis=1)
        facts = {
            "method": self.method,
            "period": self.period,
            "rounds": self.rounds,
            "guaranteed_rate": self.decay_rate,
        }
        return Run(
            times,
            np.repeat(truths[:, None, :], len(self.nodes), axis=1),
            believed,
            messages,
            np.full(messages.shape, "anchored"),
            self.names,
            "events",
            facts,
        )

    def _heard(self, hears: Heard | None) -> tuple[tuple[int, ...], ...]:
        if hears is None:
            return self.problem.hears
        return SharedPlant(self.problem.A, self.problem.outputs, hears).hears

    def __repr__(self) -> str:
        return (
            f"ProjectedConsensusObserver({len(self.nodes)} agents, {self.problem.n_states} states, "
            f"{self.rounds} rounds every {self.period:g} s)"
        )


def averaging_matrix(hears: Sequence[Sequence[int]]) -> sp.csr_array:
    """Sparse (m, m) S with ``S[i, j] = 1 / (1 + number heard)`` for j = i and for each j in ``hears[i]``."""
    rows = [agent for agent, others in enumerate(hears) for _ in (agent, *others)]
    columns = [other for agent, others in enumerate(hears) for other in (agent, *others)]
    shares = [1.0 / (1 + len(others)) for others in hears for _ in range(1 + len(others))]
    return sp.csr_array(sp.coo_array((shares, (rows, columns)), shape=(len(hears), len(hears))))
