"""Observers given by programs, for the tests: a shared plant and a network with a measurement on three nodes."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.model import HyperNetwork, SharedPlant
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver

A = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.1]])
OUTPUTS = [np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]), np.zeros((0, 3))]


def shared_plant(B: np.ndarray | None = None) -> SharedPlant:
    """Three agents on a ring; the last senses nothing."""
    return SharedPlant(A, OUTPUTS, {0: [1], 1: [0, 2], 2: [0]}, B)


def shared_observer(problem: SharedPlant | None = None, coupling: float = 2.0, **fields: object) -> AssembledObserver:
    """Innovation of the own output, and a common coupling to whomever an agent hears."""
    problem = shared_plant() if problem is None else problem
    n, eye = problem.n_states, np.eye(problem.n_states)
    nodes = []
    for agent, (C, heard) in enumerate(zip(problem.outputs, problem.hears, strict=True)):
        arcs = [LocalArc(None, str(other), 1.0, coupling * eye, eye, eye) for other in heard]
        if C.shape[0]:
            arcs.append(LocalArc(agent, None, 1.0, 3.0 * C.T, C, None))
        nodes.append(LocalObserver(str(agent), problem.A, problem.B, tuple(arcs)))
    assert n == A.shape[0]
    abscissa = None
    return AssembledObserver("given", problem, tuple(nodes), 0.0, abscissa, **fields)


def hyper_network() -> HyperNetwork:
    """An integrator, an oscillator and an unstable agent; one measurement joins all three."""
    agents = [
        tp.LinearAgent([[0.0]], [[1.0]], B=[[1.0]]),
        tp.LinearAgent([[0.0, 1.0], [-4.0, 0.0]], [[1.0, 0.0]], B=[[0.0], [1.0]]),
        tp.LinearAgent([[0.2]], [[1.0]], B=[[0.5]]),
    ]
    measurements = [
        {0: [[1.0]], 1: [[-1.0, 0.0]], 2: [[2.0]]},
        {0: [[1.0]]},
        {1: [[0.0, 1.0]], 2: [[-1.0]]},
        {2: [[1.0]]},
    ]
    return HyperNetwork(agents, measurements, ["a", "b", "c"])


def hyper_observer(gain: float = 1.5) -> AssembledObserver:
    """``L = -gain C'``: every node corrects itself by each measurement that names it."""
    problem = hyper_network()
    nodes = []
    for node, (name, agent) in enumerate(zip(problem.names, problem.agents, strict=True)):
        arcs = []
        for label, blocks in enumerate(problem.measurements):
            if node not in blocks:
                continue
            own = blocks[node]
            others = [(problem.names[k], -rows) for k, rows in blocks.items() if k != node]
            first = others[0] if others else (None, None)
            arcs.append(LocalArc(label, first[0], 1.0, gain * own.T, own, first[1], tuple(others[1:])))
        nodes.append(LocalObserver(name, agent.A, agent.B, tuple(arcs)))
    return AssembledObserver("given", problem, tuple(nodes), 0.0, None)
