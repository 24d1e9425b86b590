"""G16, Theorem 5: how much noise the network stands, on the graph of Example 1 with planar double integrators."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers import g16_example1, g16_riccati
from trigpoint.papers.base import Cell, Reproduction, Series, cell, expected, holds, unspecified

LEVELS = (0.2, 0.5, 0.66)
_PROCESS = np.diag([0.0, 0.0, 1.0, 1.0])
_PLACES = 400


def level(gain: FloatArray | float, eigenvalue: FloatArray | float) -> FloatArray:
    """The printed (19), without the cut at 1: ``sqrt((2 g l - 1) / (g^2 l))``."""
    return np.asarray(np.sqrt((2.0 * gain * eigenvalue - 1.0) / (gain**2 * eigenvalue)))


def roots(mu: float, eigenvalue: float) -> tuple[float, float]:
    """The printed (21)."""
    rest = np.sqrt(eigenvalue**2 - eigenvalue * mu**2)
    return float((eigenvalue - rest) / (eigenvalue * mu**2)), float((eigenvalue + rest) / (eigenvalue * mu**2))


def condition(gain: float, mu: float, weight: float = 1.0) -> float:
    """Largest eigenvalue of the left side of (18), all written out: not positive where (18) holds."""
    agent, G = g16_riccati.agent(), g16_example1.graph(weight)
    root = G.incidence().toarray() * np.sqrt(G.arc_weights)
    eye = np.eye(G.n_nodes)
    Q = np.kron(eye, g16_riccati.local_filter(_PROCESS))
    C = np.kron(root.T, agent.C)
    L = -gain * Q @ C.T
    closed = np.kron(eye, agent.A) + L @ C
    left = Q @ closed.T + closed @ Q + mu**2 * (L @ L.T + np.kron(eye, _PROCESS))
    return float(np.linalg.eigvalsh(left)[-1])


def run(weight: float = 1.0, seed: int = 0) -> Reproduction:
    """The level (19), its worst case (20), the gains (21), and the noise really there.

    Args: ``weight`` of one external arc of Example 1 (the paper's is 1); ``seed`` of drawn gains and eigenvalues.
    """
    graph = g16_example1.graph(weight)
    problem = tp.NetworkedAgents(graph, g16_riccati.agent())
    lowest = 0.5 * (5.0 - np.sqrt(17.0))
    cells = [cell("sqrt(lambda_min), the level at gain 1/lambda_min", np.sqrt(lowest), np.sqrt(_smallest(graph)), 1e-9)]
    for mu in LEVELS:
        low, high = roots(mu, lowest)
        for name, gain, sign in (("lower", low, 1.0), ("upper", high, -1.0)):
            inside, outside = (
                condition(gain * (1.0 + 0.01 * sign), mu, weight),
                condition(gain * (1.0 - 0.01 * sign), mu, weight),
            )
            cells.append(
                holds(f"mu = {mu:g}: (18) ends at the {name} root of (21), within 1 %", inside <= 1e-9 < outside)
            )
    cells += _budgets(problem)
    cells += _reversed(seed)
    cells += _uncut()
    gains = np.geomspace(0.6 / lowest, 12.0 / lowest, _PLACES)
    lines = {"mu* of (19)": level(gains, lowest), "sqrt(lambda_min)": np.full(_PLACES, np.sqrt(lowest))}
    series = (Series("Noise level that keeps N J_1", "gain", "mu", gains, lines),)
    text = (
        "The level of (19) is greatest at gain 1/lambda_min: sqrt(lambda_min) is the best level over all gains, not "
        "the worst (E-000-2), and it must be cut at 1 (E-000-3). The bound N J_1 is far from what is reached."
    )
    return Reproduction("g16-theorem5", "G16, Theorem 5", text, tuple(cells), series)


def _smallest(graph: tp.MeasurementGraph) -> float:
    return tp.smallest_eigenvalue(graph).value


def _budgets(problem: tp.NetworkedAgents) -> list[Cell]:
    """The guarantee and the covariance really reached at both ends of (21), mu = .66."""
    bound = problem.graph.n_nodes * float(np.trace(g16_riccati.local_filter(_PROCESS)))
    low, high = roots(0.66, 0.5 * (5.0 - np.sqrt(17.0)))
    cells = [unspecified("N J_1", bound, "graph and agent are ours: Example 1, Section 5.3")]
    for name, gain in (("lower", low), ("upper", high)):
        total = tp.noise_budget(problem, gain, mu=0.66, process=_PROCESS).total
        cells.append(holds(f"mu = 0.66, {name} end: E[e'e] is at most N J_1", total <= bound))
        cells.append(unspecified(f"mu = 0.66, {name} end: E[e'e]", total, "true steady covariance"))
    return cells


def _reversed(seed: int) -> list[Cell]:
    """(20) says that the level never falls below sqrt(lambda_min); it never exceeds it."""
    rng = np.random.default_rng(seed)
    eigenvalue = rng.uniform(0.01, 4.0, 10000)
    gain = rng.uniform(1.0, 20.0, 10000) / eigenvalue
    above = level(gain, eigenvalue) > np.sqrt(eigenvalue) * (1.0 + 1e-12)
    below = level(gain, eigenvalue) < np.sqrt(eigenvalue) * (1.0 + 1e-12)
    note = "E-000-2: the inequality points the other way"
    return [
        cell(
            "share of 10000 draws with level (19) at least sqrt(lambda)",
            1.0,
            above.mean(),
            0.0,
            erratum=True,
            note=note,
        ),
        expected("share of them with at most sqrt(lambda)", 1.0, below.mean(), 0.0, "(gamma lambda - 1)^2 >= 0"),
    ]


def _uncut() -> list[Cell]:
    """One agent with four anchors, A = 0: the printed level is 2 and breaks the bound, 1 keeps it."""
    node = tp.MeasurementGraph(1, [tp.EXTERNAL] * 4, [0] * 4)
    printed = float(level(0.25, 4.0))
    bound = 1.0  # N J_1 with A = 0, C = E = 1
    totals = [tp.noise_budget(node, 0.25, mu=mu, process=np.eye(1)).total for mu in (printed, 1.0)]
    note = "E-000-3: cut at 1"
    return [
        cell(
            "one agent, four anchors: mu* of (19)",
            printed,
            tp.noise_budget(node, 0.25).mu_star,
            0.0,
            erratum=True,
            note=note,
        ),
        holds("at that level E[e'e] is at most N J_1 = 1", totals[0] <= bound, note, erratum=True),
        expected("E[e'e] at mu = 2", 2.5, totals[0], 1e-9, "closed form"),
        expected("E[e'e] at mu = 1", 0.625, totals[1], 1e-9, "closed form"),
    ]
