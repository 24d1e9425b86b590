"""W17, Sections III to IV-A, worked: a strongly connected network on a published plant, and the literal compensator."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.analysis import check_prop1
from trigpoint.arrays import FloatArray
from trigpoint.papers import plants
from trigpoint.papers.base import Cell, Reproduction, Series, cell, expected, found, holds, unspecified
from trigpoint.papers.r23_cycles import observability_rank

EIGENVALUES = (-4.146, -1.0, -1.0, -0.7333 + 0.8410j, -0.7333 - 0.8410j, -0.3875)
RANKS = (2, 5, 1, 5)
LEFT = (0.8, 1.6, 0.8, 0.8)
_PLANT = "W17 has no example; the plant is published elsewhere (HanTrentelmanWangShen2019)"


def run(scale: float = 1.0, rate: float = 1.0, seed: int = 0) -> Reproduction:
    """Four agents on a plant with six states: what each sees, and observers of order n an agent and of Theorem 1.

    Args:
        scale: factor on the plant's A (the published one is 1).
        rate: wanted decay, 1/s.
        seed: of the gains drawn for Proposition 1.
    """
    problem = plants.han(scale)
    cells = _plant(problem)
    m, n = problem.n_agents, problem.n_states
    wanted = np.linspace(-2.5 * rate, -rate, m * n)
    static = tp.design(problem, tp.methods.SpectrumAssignment(wanted.tolist()))
    extra = np.linspace(-3.0 * rate, -2.6 * rate, m - 1)
    larger = tp.design(problem, tp.methods.SpectrumAssignment([*wanted, *extra], order="theorem-1"))
    note = "E-002-10: not needed for these eigenvalues"
    order = m * n + m - 1
    cells += [
        cell("eigenvalues that are placed, m n + m - 1", 27, _states(larger), 0.0, note="Theorem 1"),
        expected("largest error of a block's eigenvalue, order m n + m - 1", 0.0, _error(larger), 1e-8, "Theorem 1"),
        cell("states needed", order, _states(static), 0.0, erratum=True, note=note),
        expected("largest error of a block's eigenvalue, order m n", 0.0, _error(static), 1e-8, "multi-tree cascade"),
        expected("residual of the design equations (5), (8)", 0.0, _residual(static), 1e-8, "W17 (5), (8)"),
    ]
    coupled = tp.design(problem, tp.methods.CouplingGain(rate))
    reached = (coupled.spectral_abscissa or 0.0) <= -rate + 1e-9
    cells.append(found("one coupling gain reaches the rate, too", reached, "theory 4b-B1"))
    cells.append(unspecified("that gain", float(coupled.facts["gain"]), "theory 4b-B1"))
    cells += _literal(seed)
    times = np.linspace(0.0, 12.0 / rate, 201)
    start = -np.tile(plants.HAN_START, m)
    runs = {
        name: tp.simulate(problem, one, tp.Scenario(times, start, plants.HAN_START))
        for name, one in (("chosen spectrum", static), ("coupling gain", coupled))
    }
    left = max(float(r.error_norm[-1] / r.error_norm[0]) for r in runs.values())
    cells.append(expected("error left at the end, share", 0.0, left, 1e-2, "both observers"))
    series = (_errors("Error of all agents", times, runs),)
    text = (
        "No agent sees the whole plant, together they do; every eigenvalue of the error is chosen. The extra states of "
        "Theorem 1 are not needed here (E-002-10), and its literal construction works for the smallest problems only."
    )
    return Reproduction("w17-strong", "W17, Sections III, IV-A, Theorem 1, Proposition 1", text, tuple(cells), series)


def _errors(title: str, times: FloatArray, runs: dict[str, tp.Run]) -> Series:
    lines = {name: run_.error_norm for name, run_ in runs.items()}
    return Series(title, "time [s]", "error norm", times, lines, log_y=True)


def _plant(problem: tp.SharedPlant) -> list[Cell]:
    gap = plants.distance(np.linalg.eigvals(problem.A), EIGENVALUES)
    cells = [cell("largest distance of eig A from the printed list", 0.0, gap, 6e-4, note=_PLANT)]
    for agent, (printed, C) in enumerate(zip(RANKS, problem.outputs, strict=True)):
        rank = observability_rank(problem.A, C)
        cells.append(cell(f"observability rank, agent {agent + 1}", printed, rank, 0.0, note=_PLANT))
    joint = observability_rank(problem.A, problem.stacked_output())
    cells.append(cell("observability rank, all together", 6, joint, 0.0, note=_PLANT))
    for agent, (entry, own) in enumerate(zip(LEFT, plants.left_vector(plants.HAN_HEARS), strict=True)):
        cells.append(cell(f"left null vector of the Laplacian, entry {agent + 1}", entry, own, 1e-9, note=_PLANT))
    cells.append(holds("every agent can know the whole state", tp.diagnose(problem).observable is True))
    return cells


def _literal(seed: int) -> list[Cell]:
    """Two agents, one state each of a diagonal plant (key KimShimCho2016): the paper's own compensator."""
    toy = tp.SharedPlant(np.diag([-2.0, -3.0]), [[[1.0, 0.0]], [[0.0, 1.0]]], {0: [1], 1: [0]})
    wanted = (-1.0, -1.5, -2.0, -2.5, -3.5)
    observer = tp.design(toy, tp.methods.BraschPearson(wanted))
    gap = plants.distance(np.linalg.eigvals(observer.error_matrix().toarray()), wanted)
    times = np.linspace(0.0, 8.0, 81)
    moving = tp.simulate(toy, observer, tp.Scenario(times, 0.0, [1.0, 2.0], path="reference"))
    driven = float(np.abs(moving.error).max())
    found = check_prop1(toy, seed=seed)
    return [
        cell("controllability index, two agents (Proposition 1)", 2, found.controllability_index or 0, 0.0),
        holds("every channel observes the error", found.observable is True, "Proposition 1"),
        expected(
            "two agents: largest error of the five eigenvalues", 0.0, gap, 1e-5, "Theorem 1 as printed, corrected"
        ),
        expected("error from a right start, whatever the plant does", 0.0, driven, 1e-8, "E-002-1: innovation"),
    ]


def _states(observer: tp.NetworkObserver) -> int:
    return int(observer.error_matrix().shape[0])


def _error(observer: tp.NetworkObserver) -> float:
    return float(observer.facts["block_spectrum_error"])


def _residual(observer: tp.NetworkObserver) -> float:
    residuals = observer.verify_design_equations()
    return max(abs(float(value)) for value in vars(residuals).values())
