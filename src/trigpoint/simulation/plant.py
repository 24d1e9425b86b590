"""The truth and the readings: what nature does in a run, the same for both paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from trigpoint.arrays import FloatArray, transition_and_integral
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.linalg.blocks import Blocks
from trigpoint.model import NetworkedAgents
from trigpoint.simulation.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Plant:
    """A homogeneous network with known constant inputs, and the readings it gives.

    Attributes:
        problem: the network.
        drive: (N, n) ``B_i u_i``.
        inputs: (N, m) known inputs, or None.
        output: sparse (M p, N n) ``G^T (x) C_1``.
        recorded: (M, p) readings that replace the simulated ones, or None.
    """

    problem: NetworkedAgents
    drive: FloatArray
    inputs: FloatArray | None
    output: sp.csr_array
    recorded: FloatArray | None

    @staticmethod
    def of(problem: NetworkedAgents, scenario: Scenario) -> Plant:
        """Check the scenario against the problem."""
        return Plant(
            problem,
            _drive(problem, scenario),
            scenario.inputs if problem.agents[0].n_inputs else None,
            problem.stacked_output(),
            _recorded(problem, scenario),
        )

    @property
    def readings_shape(self) -> tuple[int, int]:
        """(M, p)."""
        return self.problem.graph.n_arcs, self.problem.n_outputs

    def advance(self, state: FloatArray, duration: float, noise: FloatArray | None = None) -> FloatArray:
        """Truth (N, n) ``duration`` seconds later, exactly, plus a drawn disturbance."""
        if duration == 0.0 and noise is None:  # to the last bit
            return state
        transition, integral = transition_and_integral(self.problem.agent.A, duration)
        moved = state @ transition.T + self.drive @ integral.T
        return moved if noise is None else moved + noise

    def read(self, state: FloatArray, noise: FloatArray | None = None) -> FloatArray:
        """Readings (M, p) of all arcs."""
        if self.recorded is not None:
            values = self.recorded
        else:
            values = (self.output @ state.ravel()).reshape(self.readings_shape)
        return values if noise is None else values + noise


@dataclass(frozen=True, eq=False)
class Disturbances:
    """Seeded noise, drawn at each exchange in one order whatever the path: losses, readings, process noise."""

    rng: np.random.Generator
    process: FloatArray | None
    measurement: float
    shape: tuple[int, int]
    readings: tuple[int, int]

    @staticmethod
    def of(problem: NetworkedAgents, scenario: Scenario) -> Disturbances:
        """Prepare the factor of the exactly discretized process noise."""
        noise, agent = scenario.noise, problem.agent
        factor = None
        if noise is not None and noise.process > 0.0 and scenario.period is not None:
            entry = np.eye(agent.n_states) if agent.E is None else agent.E
            factor = noise_factor(agent.A, noise.process * entry, scenario.period)
        return Disturbances(
            np.random.default_rng(scenario.seed),
            factor,
            0.0 if noise is None else noise.measurement,
            (problem.graph.n_nodes, agent.n_states),
            (problem.graph.n_arcs, problem.n_outputs),
        )

    def of_process(self) -> FloatArray | None:
        """One period's process noise (N, n), or None."""
        return None if self.process is None else self.rng.standard_normal(self.shape) @ self.process.T

    def of_readings(self) -> FloatArray | None:
        """One exchange's reading errors (M, p), or None."""
        return None if self.measurement == 0.0 else self.measurement * self.rng.standard_normal(self.readings)


def node_table(name: str, value: FloatArray, states: Blocks) -> FloatArray:
    """Return a scalar, (N n,) or (N, n) as (N, n)."""
    if value.ndim == 0:
        return np.full((states.count, states.size), float(value))
    if value.shape == (states.total,) or value.shape == (states.count, states.size):
        return np.array(value.reshape(states.count, states.size))
    raise ShapeError(
        f"{name} must be a scalar, ({states.total},) or ({states.count}, {states.size}); got shape {value.shape}"
    )


def _drive(problem: NetworkedAgents, scenario: Scenario) -> FloatArray:
    states = problem.states
    drive = np.zeros((states.count, states.size))
    if scenario.inputs is None:
        return drive
    width = sorted({agent.n_inputs for agent in problem.agents})
    if len(width) != 1:
        raise ArgumentError(f"inputs need agents with equally many inputs; got {width}: fill B up with zero columns")
    if scenario.inputs.shape != (states.count, *width):
        raise ShapeError(f"inputs must have shape (N, m) = ({states.count}, {width[0]}); got {scenario.inputs.shape}")
    for node, agent in enumerate(problem.agents):
        drive[node] = 0.0 if agent.B is None else agent.B @ scenario.inputs[node]
    return drive


def _recorded(problem: NetworkedAgents, scenario: Scenario) -> FloatArray | None:
    if scenario.measurements is None:
        return None
    if not problem.agent.is_static:
        raise ArgumentError("recorded measurements are constant, so they belong to static agents (A = 0)")
    expected = (problem.graph.n_arcs, problem.n_outputs)
    if scenario.measurements.size != expected[0] * expected[1]:
        raise ShapeError(f"measurements must have shape (M, p) = {expected}; got {scenario.measurements.shape}")
    return scenario.measurements.reshape(expected)


def noise_factor(A: FloatArray, entry: FloatArray, period: float) -> FloatArray:
    """F with ``F F' = Q(h) = int_0^h e^{A s} E E' e^{A' s} ds``.

    Van Loan's block exponential over a short time, where its e^{-A s} is harmless, then the doubling
    ``Q(2 s) = Q(s) + e^{A s} Q(s) e^{A' s}``: a fast stable agent over a long period would overflow otherwise.
    """
    n = A.shape[0]
    doublings = max(0, int(np.ceil(np.log2(max(float(np.linalg.norm(A, 1)) * period, 1.0)))))
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -A, entry @ entry.T, A.T
    exponential = la.expm(block * (period / 2.0**doublings))
    transition = exponential[n:, n:].T
    covariance = transition @ exponential[:n, n:]
    for _ in range(doublings):
        covariance = covariance + transition @ covariance @ transition.T
        transition = transition @ transition
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    factor: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return factor
