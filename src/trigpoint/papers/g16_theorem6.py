"""G16, Theorems 4, 6, 7 and Proposition 6: one gain for every network of a family."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers import g16_riccati
from trigpoint.papers.base import Cell, Reproduction, Series, cell, expected, holds, unspecified
from trigpoint.simulation import Topology

_PROCESS = np.diag([0.0, 0.0, 1.0, 1.0])
_NETWORKS = 200


def family(nodes: int) -> tuple[tp.MeasurementGraph, tp.MeasurementGraph]:
    """A chain anchored at its end, and the same nodes each with its own anchor."""
    return tp.graphs.chain(nodes), tp.graphs.chain(nodes, anchors=range(nodes))


def run(nodes: int = 4, margin: float = 1.01, seed: int = 0) -> Reproduction:
    """The gain (23) with its minimum and with a maximum, and the gain (24) of Theorem 7.

    Args:
        nodes: of the two networks that are switched.
        margin: factor on the gain of (23) with the maximum and on (24).
        seed: of the drawn networks and of the switching.
    """
    graphs = family(nodes)
    bounds = [1.0 / tp.smallest_eigenvalue(graph).value for graph in graphs]
    scalar = tp.LinearAgent([[1.0]], [[1.0]])
    P = [[2.0 / (2.0 * 1.0 + 1e-6)]]  # (8) with a hair of slack: A'P + PA - 2 C'C < 0 for P < 1
    cells = []
    for word, gain, erratum in (("minimum", 1.05 * min(bounds), True), ("maximum", margin * max(bounds), False)):
        for name, graph in zip(("chain", "all anchored"), graphs, strict=True):
            problem = tp.NetworkedAgents(graph, scalar)
            observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.Fixed(gain), P=P))
            abscissa = observer.spectral_abscissa
            note = "E-000-1: the maximum is meant" if erratum else ""
            stable = abscissa is not None and abscissa < 0.0
            cells.append(holds(f"(23) with the {word}: {name} stable", stable, note, erratum=erratum))
            cells.append(unspecified(f"(23) with the {word}: {name}, abscissa", abscissa or 0.0, "A = C = 1"))
    levels, times = _switched(graphs, scalar, P, margin * max(bounds), seed)
    rises = float(np.diff(levels).max())
    cells.append(holds("V = e'Pe falls under switching (maximum)", rises < 0.0, "the common function of Theorem 6"))
    cells += _every_network(margin, seed)
    cells += _conservative()
    text = (
        "The gain for a family needs the maximum of 1/lambda_min where (23) prints a minimum (E-000-1). Theorem 7 "
        "needs the number of nodes only; for a filter from the Riccati equation half of Theorem 4 suffices (E-000-12)."
    )
    series = (Series("Switching between the two networks", "time [s]", "e'Pe", times, {"V": levels}, log_y=True),)
    return Reproduction("g16-theorem6", "G16, Theorems 4, 6, 7, Proposition 6", text, tuple(cells), series)


def _switched(
    graphs: tuple[tp.MeasurementGraph, tp.MeasurementGraph],
    agent: tp.LinearAgent,
    P: list[list[float]],
    gain: float,
    seed: int,
) -> tuple[FloatArray, FloatArray]:
    """``e' P e`` at 401 times while the topology jumps at random instants."""
    union = graphs[1]
    problem = tp.NetworkedAgents(union, agent)
    observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.Fixed(gain), P=P))
    rng = np.random.default_rng(seed)
    instants = np.concatenate([[0.0], np.cumsum(rng.exponential(0.2, 60))])
    active = np.ones((instants.shape[0], union.n_arcs), dtype=bool)
    external = np.flatnonzero(union.is_external)
    whole = np.less(rng.random((instants.shape[0], 1)), 0.5)
    active[:, external[1:]] = whole
    times = np.linspace(0.0, 6.0, 401)
    start = rng.standard_normal(union.n_nodes)
    run = tp.simulate(problem, observer, tp.Scenario(times, start, topology=Topology(instants, active)))
    return np.asarray((run.error**2).sum(axis=(1, 2)) * P[0][0]), times


def _every_network(margin: float, seed: int) -> list[Cell]:
    """Theorem 7 on drawn networks of 8 nodes and the chain, with a = c = 1 and the tightest filter of (8), Q = 1."""
    gain, rng = margin * tp.worst_case_gain(8), np.random.default_rng(seed)
    drawn = [tp.graphs.random_connected(8, float(rng.uniform(0.29, 0.6)), rng) for _ in range(_NETWORKS)]
    lowest = [float(np.linalg.eigvalsh(g.laplacian().toarray())[0]) for g in (*drawn, tp.graphs.chain(8))]
    return [
        cell("(24) for N = 8", 29.37, gain / margin, 5e-3),
        holds(f"stable on {_NETWORKS} drawn networks of 8 nodes", 1.0 - gain * min(lowest[:-1]) < 0.0, "Theorem 7"),
        holds("stable on the chain, the worst of all", 1.0 - gain * lowest[-1] < 0.0, "Theorem 7"),
        expected("abscissa on the chain", 1.0 - margin, 1.0 - gain * lowest[-1], 1e-9, "the bound is tight"),
        unspecified("largest abscissa on the drawn networks", 1.0 - gain * min(lowest[:-1]), "A = C = 1"),
    ]


def _conservative() -> list[Cell]:
    """How far below 1/lambda_min the gain may go when the filter solves the Riccati equation (17)."""
    graph = tp.graphs.chain(3)
    lowest = tp.smallest_eigenvalue(graph).value
    found = []
    for agent, process in (
        (g16_riccati.agent(), _PROCESS),
        (tp.LinearAgent([[0.5, 1.0], [-1.0, 0.5]], [[1.0, 0.0]]), np.eye(2)),
        (tp.LinearAgent([[1.0]], [[1.0]]), np.eye(1)),
    ):
        observer = tp.design(tp.NetworkedAgents(graph, agent), tp.methods.LocalKalman(process=process))
        facts = observer.facts
        found.append((facts["gain_bound_for_this_filter"] * lowest, facts["gain_threshold_exact"] * lowest))
    names = ("double integrator", "unstable oscillator", "a = 1")
    known = ((0.5, 0.0), (0.4518, 0.3718), (0.4142, 0.4142))
    cells = []
    for name, (sure, exact), (first, second) in zip(names, found, known, strict=True):
        note = "known (E-000-12; Theorem 4 asks for 1)"
        cells.append(expected(f"{name}: gain lambda_min that the filter's inequality needs", first, sure, 5e-4, note))
        cells.append(expected(f"{name}: gain lambda_min where stability ends", second, exact, 5e-4, note))
    return cells
