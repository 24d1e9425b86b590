"""Networks of agents that differ, drawn: marginal ones, unstable ones, and with stable parts."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from trigpoint.analysis.heterogeneous import diagnose_heterogeneous
from trigpoint.graphs import cycle
from trigpoint.model import HyperNetwork, LinearAgent, NetworkedAgents

TWO = HyperNetwork([[[0.3]], [[0.8]]], [{0: [[1.0]], 1: [[1.0]]}], ["slow", "fast"])


def rotation(frequency: float) -> np.ndarray:
    return np.array([[0.0, frequency], [-frequency, 0.0]])


def ring_without_anchor() -> NetworkedAgents:
    """An integrator and three oscillators (theory, section 5)."""
    oscillators = [LinearAgent(rotation(w), [[1.0, 0.0]]) for w in (1.0, 2.0, 3.5)]
    return NetworkedAgents(cycle(4), [LinearAgent(0.0, 1.0), *oscillators])


def arcs_of(kind: str, count: int, rng: np.random.Generator) -> list[tuple[int, ...]]:
    """Pairs of nodes: a ring, a path, a random tree, or a random tree with one external arc."""
    if kind == "ring":
        return [(k, (k + 1) % count) for k in range(count)]
    if kind == "path":
        return [(k, k + 1) for k in range(count - 1)]
    tree: list[tuple[int, ...]] = [(int(rng.integers(0, k)), k) for k in range(1, count)]
    return [*tree, (int(rng.integers(0, count)),)] if kind == "external" else tree


def unstable_network(kind: str, rng: np.random.Generator) -> HyperNetwork:
    """Unstable agents with one or two states, 3 to 5 of them, and scalar measurements with blocks of their own."""
    agents = []
    for size in rng.integers(1, 3, size=int(rng.integers(3, 6))).tolist():
        A = rng.normal(size=(size, size))
        while np.linalg.eigvals(A).real.max() < 0.05:
            A = rng.normal(size=(size, size))
        agents.append(A)
    arcs = arcs_of(kind, len(agents), rng)
    return HyperNetwork(agents, [{k: rng.normal(size=(1, agents[k].shape[0])) for k in arc} for arc in arcs])


def with_stable_parts(rng: np.random.Generator, rates: tuple[float, ...]) -> HyperNetwork:
    """Agents with three states each, one of them unstable at the given rate, in skew coordinates; on a path."""
    agents = []
    for rate in rates:
        stable = np.diag([-2.0, -3.0]) + rotation(1.0)
        T = np.zeros((3, 3))
        T[0, 0], T[1:, 1:], T[1, 0] = rate, stable, 2.0
        basis = rng.normal(size=(3, 3)) + 3.0 * np.eye(3)
        agents.append(LinearAgent(basis @ T @ np.linalg.inv(basis), rng.normal(size=(1, 3)), rng.normal(size=(3, 1))))
    measurements = [{k: rng.normal(size=(1, 3)), k + 1: rng.normal(size=(1, 3))} for k in range(len(rates) - 1)]
    return HyperNetwork(agents, measurements)


@st.composite
def marginal_networks(draw) -> HyperNetwork:
    """Integrators and oscillators in skew coordinates, hyper-arcs of any size; clearly detectable."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    agents = []
    for kind in draw(st.lists(st.sampled_from(["constant", "slow", "fast", "both"]), min_size=1, max_size=4)):
        T = {
            "constant": np.zeros((1, 1)),
            "slow": rotation(0.5),
            "fast": rotation(float(rng.uniform(1.0, 3.0))),
            "both": np.block([[np.zeros((2, 2)), np.zeros((2, 2))], [np.zeros((2, 2)), rotation(2.0)]]),
        }[kind]
        basis = np.linalg.qr(rng.normal(size=T.shape))[0] * rng.uniform(0.5, 2.0, size=T.shape[0])
        agents.append(basis @ T @ np.linalg.inv(basis))
    measurements = []
    for _ in range(draw(st.integers(1, 4))):
        nodes = draw(st.sets(st.integers(0, len(agents) - 1), min_size=1))
        rows = draw(st.integers(1, 2))
        measurements.append({k: rng.normal(size=(rows, agents[k].shape[0])) for k in nodes})
    return HyperNetwork(agents, measurements)


def is_clearly_detectable(network: HyperNetwork, margin: float = 1e-2) -> bool:
    diagnosis = diagnose_heterogeneous(network)
    return diagnosis.detectable is True and diagnosis.margin > margin
