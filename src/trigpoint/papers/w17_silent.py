"""W17's assumption that no output is zero, dropped: agents that sense nothing know the plant all the same."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.analysis import check_prop1
from trigpoint.papers import plants
from trigpoint.papers.base import Cell, Reproduction, Series, cell, expected, holds

EIGENVALUES = (-1.25489, -1.07476, -0.86082, -0.79133, -0.44381, -0.36200, -0.18002, -0.13238, 0.0)
_PLANT = "W17 has no example; the plant is published elsewhere (YangBarboniRezaeeParisini2022)"
_SIZES = ((4, 3), (5, 4))


def problem_of(exchange: float, silent: int) -> tp.SharedPlant:
    """Nine rooms, four sensing agents on a ring, ``silent`` further ones; ``exchange`` scales the plant's rates."""
    eye = np.eye(9)
    outputs: list[np.ndarray | None] = [eye[np.array(rooms) - 1] for rooms in plants.ROOM_SENSORS]
    ring = len(outputs) + silent
    return tp.SharedPlant(
        plants.rooms(exchange),
        [*outputs, *[None] * silent],
        {k: [(k - 1) % ring, (k + 1) % ring] for k in range(ring)},
    )


def run(exchange: float = 0.05, silent: int = 2, rate: float = 0.5, seed: int = 0) -> Reproduction:
    """Temperatures of nine rooms, known to agents without a thermometer.

    Args:
        exchange: scale of the rooms' rates (published: .05).
        silent: agents that sense nothing.
        rate: wanted decay, 1/s.
        seed: of the drawn plants for Proposition 1.
    """
    problem = problem_of(exchange, silent)
    m, n = problem.n_agents, problem.n_states
    gap = plants.distance(np.linalg.eigvals(problem.A), EIGENVALUES)
    wanted = np.linspace(-2.0 * rate, -rate, m * n)
    observer = tp.design(problem, tp.methods.SpectrumAssignment(wanted.tolist()))
    error = float(observer.facts["block_spectrum_error"])
    cells = [
        cell("largest distance of eig A from the printed list", 0.0, gap, 6e-6, note=_PLANT),
        holds("every agent can know every temperature", tp.diagnose(problem).observable is True),
        holds("every output must differ from zero", not (silent and error < 1e-8), "E-002-8: not needed", erratum=True),
        expected("largest error of a block's eigenvalue", 0.0, error, 1e-8, "multi-tree cascade"),
        *_generic(seed),
    ]
    times = np.linspace(0.0, 20.0 / rate, 201)
    start = -np.tile(plants.ROOM_START, m)
    result = tp.simulate(problem, observer, tp.Scenario(times, start, plants.ROOM_START))
    each = np.sqrt((result.error**2).sum(axis=2))
    names = [f"agent {k + 1}" + (" (senses nothing)" if not problem.outputs[k].size else "") for k in range(m)]
    left = float(each[-1].max() / each[0].max())
    cells.append(expected("largest error left at the end, share", 0.0, left, 1e-2, "silent agents included"))
    lines = dict(zip(names, each.T, strict=True))
    series = (Series("Error of each agent", "time [s]", "error norm [degrees]", times, lines, log_y=True),)
    text = (
        "The construction needs no output from every agent: channels of agents that sense nothing are left out "
        "(E-002-8). Here two agents without a thermometer know the temperatures of nine rooms."
    )
    return Reproduction("w17-silent", "W17, Section IV, outputs that are zero", text, tuple(cells), series)


def _generic(seed: int) -> list[Cell]:
    """Proposition 1 where agents sense nothing, on drawn plants."""
    cells = []
    for m, n in _SIZES:
        for silent in (1, 2):
            rng = np.random.default_rng([seed, m, n, silent])
            outputs = [None if k < silent else rng.standard_normal((1, n)) for k in range(m)]
            drawn = tp.SharedPlant(rng.standard_normal((n, n)), outputs, {k: [(k + 1) % m] for k in range(m)})
            found = check_prop1(drawn, seed=seed)
            at = f"{m} agents, {n} states, {silent} silent"
            cells.append(cell(f"{at}: controllability index", m, found.controllability_index or 0, 0.0))
            cells.append(holds(f"{at}: every channel observes the error", found.observable is True))
    return cells
