"""W17, Section IV-B, worked: several strongly connected components, two of them sources."""

from __future__ import annotations

import networkx as nx
import numpy as np
import scipy.linalg as la

import trigpoint as tp
from trigpoint.errors import MethodError
from trigpoint.papers.base import Cell, Reproduction, Series, cell, expected, holds, unspecified

HEARS = {0: [1], 1: [0], 2: [3], 3: [2], 4: [1, 5], 5: [4, 3], 6: [5, 7], 7: [8], 8: [6]}
_OURS = "W17 has no example: the plant is ours"


def plant(frequency: float = 1.0, *, whole: bool = True) -> tp.SharedPlant:
    """Nine agents on two undamped rotations; agents 1, 3 see the first, 2, 4 the second, the others nothing.

    Args:
        frequency: of the first rotation, rad/s.
        whole: False: agent 4 sees nothing, so that one source component lacks the second rotation.
    """
    A = la.block_diag([[0.0, frequency], [-frequency, 0.0]], [[0.0, 2.0], [-2.0, 0.0]])
    one, other, nothing = [[1.0, 0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0, 0.0]], None
    outputs = [one, other, one, other if whole else nothing, *[nothing] * 5]
    return tp.SharedPlant(A, outputs, HEARS)


def run(rate: float = 1.0, frequency: float = 1.0) -> Reproduction:
    """Sources design for themselves, the others follow strictly faster.

    Args:
        rate: wanted decay, 1/s.
        frequency: of the first rotation, rad/s; 2 makes both equal, and what agents see of each still suffices.
    """
    problem = plant(frequency)
    parts = list(nx.strongly_connected_components(problem.digraph()))
    sources = [p for p in parts if all(other in p for agent in p for other in problem.digraph().predecessors(agent))]
    observer = tp.design(problem, tp.methods.SccCascade(rate))
    abscissa = observer.spectral_abscissa or 0.0
    cells = [
        expected("strongly connected components", 4, len(parts), 0.0, _OURS),
        expected("sources among them", 2, len(sources), 0.0, _OURS),
        holds(
            "every source sees the plant: an observer exists", tp.diagnose(problem).observable is True, "Corollary 1"
        ),
        cell("spectral abscissa of the error, 1/s", -1.0, abscissa, 1e-6, note="the rate that was asked for is 1"),
        unspecified("largest error of a block's eigenvalue", float(observer.facts["block_spectrum_error"]), _OURS),
    ]
    cells += _blind()
    cells += _equal_eigenvalues()
    times = np.linspace(0.0, 20.0 / rate, 201)
    truth = np.array([1.0, 0.0, 0.0, 1.0])
    start = -np.tile(truth, problem.n_agents)
    result = tp.simulate(problem, observer, tp.Scenario(times, start, truth))
    each = np.sqrt((result.error**2).sum(axis=2))
    left = float(result.error_norm[-1] / result.error_norm[0])
    cells.append(expected("error left at the end, share", 0.0, left, 1e-3, "20 time constants"))
    lines = {f"agent {k + 1}": each[:, k] for k in (0, 2, 4, 6, 8)}
    series = (Series("Error of some agents", "time [s]", "error norm", times, lines, log_y=True),)
    text = (
        "Agents that hear nobody outside their component must see the plant together; everybody else follows. Equal "
        "eigenvalues downstream cost powers of time, so they are placed strictly faster (E-002-7)."
    )
    return Reproduction("w17-components", "W17, Section IV-B, Corollary 1", text, tuple(cells), series)


def _blind() -> list[Cell]:
    """One source component that does not see everything: no observer for its agents."""
    problem = plant(whole=False)
    try:
        tp.design(problem, tp.methods.SccCascade(1.0))
        refused = False
    except MethodError:
        refused = True
    knows = [one.dimension for one in tp.agent_knowledge(problem)]
    return [
        holds("a source that misses a rotation: observable", tp.diagnose(problem).observable is False, "necessary"),
        holds("and the design is refused", refused),
        expected("dimension that its agents can know", 2, knows[2], 0.0, "one rotation of two"),
        expected("dimension that agents below both sources can know", 4, knows[4], 0.0, "they hear the other source"),
    ]


def _equal_eigenvalues() -> list[Cell]:
    """``||e^(M t)|| e^t`` of two coupled states: equal rates grow with t, unequal ones stay bounded."""

    def peak(second: float, t: float) -> float:
        M = np.array([[-1.0, 0.0], [1.0, second]])
        return float(np.linalg.norm(la.expm(M * t), 2) * np.exp(t))

    note = "E-002-7: not the same rate"
    return [
        holds(
            "equal eigenvalues keep the rate: growth at t = 100 below 10", peak(-1.0, 100.0) < 10.0, note, erratum=True
        ),
        expected("growth with equal eigenvalues, t = 10", 10.1, peak(-1.0, 10.0), 0.05, "norm times e^t"),
        expected("growth with equal eigenvalues, t = 100", 100.0, peak(-1.0, 100.0), 0.05, "norm times e^t"),
        expected("growth with eigenvalues 1/2 apart, t = 100", np.sqrt(5.0), peak(-1.5, 100.0), 1e-6, "bounded"),
    ]
