"""G16, Section 5.2: sixteen agents find their altitudes from differences, one of them from an anchor."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers.base import Field, Reproduction, Series, cell, expected, found, holds, unspecified

FRAMES = (0.0, 0.01, 0.07, 0.48, 2.0)
_DRAWN = 4000
_SEED = "the altitudes are drawn and not printed"


def shares(values: FloatArray, vectors: FloatArray, gain: float, seed: int) -> FloatArray:
    """(F,) error norm at the frames over the first one, mean over altitudes drawn from [0, 1], estimates from 1/2."""
    drawn = np.random.default_rng(seed).uniform(-0.5, 0.5, (_DRAWN, values.shape[0]))
    modes = (drawn @ vectors) ** 2
    left = np.stack([modes @ np.exp(-2.0 * gain * values * frame) for frame in FRAMES])
    return np.asarray(np.sqrt(left / left[0]).mean(axis=1))


def run(gain: float = 5.0, seed: int = 2, rows: int = 4) -> Reproduction:
    """Frames of Fig. 4 with the paper's ``gain``, altitudes drawn from ``seed``, on a square grid of ``rows`` rows."""
    graph = tp.graphs.grid(rows, rows, anchors=(0,))
    problem = tp.NetworkedAgents(graph, tp.LinearAgent.static())
    observer = tp.design(problem, tp.methods.LocalKalman(gain=tp.Fixed(gain)))
    truth = np.random.default_rng(seed).uniform(0.0, 1.0, graph.n_nodes)
    times = np.unique(np.concatenate([np.geomspace(1e-3, 2.0, 100), FRAMES]))
    result = tp.simulate(problem, observer, tp.Scenario(times, 0.5 - truth, truth))
    places = [int(np.searchsorted(times, frame)) for frame in FRAMES]
    own = result.error_norm / result.error_norm[0]
    values, vectors = np.linalg.eigh(graph.laplacian().toarray())
    limit = tp.estimate(graph, graph.incidence().T @ truth).x
    modes = np.exp(-gain * np.outer(values, times)) * (vectors.T @ (0.5 - truth))[:, None]
    gap = float(np.abs(result.estimate[:, :, 0].T - truth[:, None] - vectors @ modes).max())
    cells = [
        cell("agents", 16, graph.n_nodes, 0.0),
        cell("arcs", 25, graph.n_arcs, 0.0),
        cell("columns of C", 25, graph.n_nodes, 0.0, erratum=True, note="C = G' has 25 rows, 16 columns (E-000-9)"),
        holds("stable at this gain", observer.decay_rate > 0.0, "Proposition 6: any positive gain"),
        holds("the limit is the least-squares answer", bool(np.abs(limit.ravel() - truth).max() < 1e-9)),
        expected("largest difference of the run from its modes", 0.0, gap, 1e-9, "exact solution"),
        unspecified("smallest eigenvalue", values[0], "not printed"),
        unspecified("what is left of the slowest mode after 2 s", np.exp(-2.0 * gain * values[0]), "not printed"),
        found(
            "not converged after 2 s (more than 1 % left)",
            bool(shares(values, vectors, gain, seed)[-1] > 0.01),
            f"the common altitude needs {1.0 / (gain * values[0]):.2g} s for a factor of e",
        ),
    ]
    for frame, place, mean in zip(FRAMES, places, shares(values, vectors, gain, seed), strict=True):
        if frame > 0.0:
            cells.append(unspecified(f"error left at {frame:g} s, mean over {_DRAWN} draws", mean, _SEED))
            cells.append(unspecified(f"error left at {frame:g} s, the draw that is shown", own[place], _SEED))
    shown = [("true altitude", truth)]
    shown += [(f"{FRAMES[k]:g} s", result.estimate[place, :, 0]) for k, place in enumerate(places)]
    fields = tuple(Field(title, np.reshape(table, (rows, rows)), 0.0, 1.0) for title, table in shown)
    series = (Series("Error", "time [s]", "share of the first error", times, {"error": own}, log_y=True),)
    text = (
        "The differences settle within half a second, the common altitude much later: the last frame is not converged."
    )
    return Reproduction("g16-altitude", "G16, Section 5.2, Figs. 3 and 4", text, tuple(cells), series, fields)
