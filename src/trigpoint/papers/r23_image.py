"""R23, Section VIII: every pixel of a grey picture is an agent, and the lower right one is the anchor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers.base import Cell, Field, Reproduction, Series, cell, expected, found, unspecified
from trigpoint.papers.pictures import SIZE, WHITE, night_scene, read_picture

FRAMES = (0.0, 0.01, 0.1, 1.0, 10.0, 100.0)
GAIN = 1000.0
SLOWEST, TIME_CONSTANT, CONSTANT_ERROR = 0.0291974, 34.25, 157.7
_PICTURE = "picture, instants, first estimates are ours"


def run(
    gain: float = GAIN, seed: int = 0, rows: int = SIZE[0], columns: int = SIZE[1], image: str | Path | None = None
) -> Reproduction:
    """Frames, rate, and the time to 1 % predicted from the slow mode's share beside the measured one.

    Args:
        gain: W and K, 1/s.
        seed: of the first estimates, uniform on [0, 255].
        rows: of the picture.
        columns: of the picture.
        image: .pgm, .png or .npy file to use; the program's own picture unless given.
    """
    picture = night_scene(rows, columns) if image is None else read_picture(image, (rows, columns))
    n = rows * columns
    problem = tp.NetworkedAgents(tp.graphs.grid(rows, columns, anchors=(n - 1,)), tp.LinearAgent.static())
    observer = tp.design(problem, tp.methods.IntegratorObserver(weights=gain, anchor_gain=gain))
    graph = problem.graph.with_weight(np.full(problem.graph.n_arcs, gain))
    slow = tp.smallest_eigenvalue(graph)
    truth = picture.ravel()
    first = np.random.default_rng(seed).uniform(0.0, WHITE, n) - truth
    share = abs(float(slow.vector @ first)) / float(np.linalg.norm(slow.vector) * np.linalg.norm(first))
    times = np.unique(np.concatenate([FRAMES, np.geomspace(1e-3, 220.0, 60), np.linspace(1.0, 220.0, 60)]))
    run_ = tp.simulate(problem, observer, tp.Scenario(times, first, truth))
    constant = tp.simulate(problem, observer, tp.Scenario([0.0, *np.linspace(140.0, 180.0, 21)], 100.0, truth))
    cells = _facts(n, gain, slow, graph)
    cells += _times(run_, constant, slow, share, gain)
    shares = run_.error_norm / run_.error_norm[0]
    for frame in FRAMES[1:]:
        cells.append(unspecified(f"error left at {frame:g} s", shares[int(np.searchsorted(times, frame))], _PICTURE))
    shown = [("truth", picture)]
    shown += [(f"{t:g} s", _frame(run_, int(np.searchsorted(times, t)), picture.shape)) for t in FRAMES]
    fields = tuple(Field(title, table, 0.0, WHITE) for title, table in shown)
    slowest = share * np.exp(-slow.value * times)
    lines = {"error": shares, "slow mode": slowest, "1 %": np.full(times.shape[0], 0.01)}
    series = (Series("Error over its first value", "time [s]", "share", times, lines, log_y=True),)
    text = (
        "Edges appear within a second, the common grey level takes minutes: convergence is exponential, not in finite "
        "time (E-001-10). Only the slow mode is left then: the time to 1 % is ln(100 |c_1| / |e_0|) / lambda_1."
    )
    return Reproduction("r23-image", "R23, Section VIII, Fig. 3", text, tuple(cells), series, fields)


def _frame(run_: tp.Run, place: int, shape: tuple[int, ...]) -> FloatArray:
    return np.asarray(np.clip(run_.estimate[place, :, 0], 0.0, WHITE).reshape(shape))


def _facts(n: int, gain: float, slow: tp.EigenvalueBound, graph: tp.MeasurementGraph) -> list[Cell]:
    narrow = (slow.upper - slow.lower) / slow.value
    ceiling = float(graph.arc_weights[graph.is_external].sum()) / n
    edges = int((~graph.is_external).sum())
    return [
        cell("agents", 8960, n, 0.0),
        cell("arcs between pixels", 70 * 127 + 69 * 128, edges, 0.0, note="neighbours up, down, left, right"),
        cell("weights W and anchor gain K", GAIN, gain, 0.0),
        expected("slowest rate, 1/s", SLOWEST, slow.value, 5e-8, "reference value of this network"),
        found(
            "the slowest rate is proved to 9 digits",
            narrow <= 1e-9,
            f"rigorous bounds lie {narrow:.1e} of its value apart",
        ),
        expected("time constant, s", TIME_CONSTANT, 1.0 / slow.value, 5e-3, "reference value of this network"),
        found("the rate is at most K/n", slow.value <= ceiling, "E-001-10"),
        unspecified("K/n, which no graph exceeds with one anchor", ceiling, "E-001-10"),
    ]


def _times(run_: tp.Run, constant: tp.Run, slow: tp.EigenvalueBound, share: float, gain: float) -> list[Cell]:
    predicted = float(np.log(100.0 * share)) / slow.value if share > 0.0 else 0.0
    reached = run_.time_to(0.01 * float(run_.error_norm[0])) or np.nan
    of_constant = constant.time_to(0.01 * float(constant.error_norm[0])) or np.nan
    n = run_.truth.shape[1]
    same = float(abs(slow.vector.sum()) / (np.linalg.norm(slow.vector) * np.sqrt(n)))
    bound = float(np.log(100.0)) / slow.value
    return [
        unspecified("share of the slow mode in the first error", share, _PICTURE),
        _measured(predicted, reached, n, gain),
        expected("time to 1 % that no start exceeds, s", CONSTANT_ERROR, bound, 0.05, "ln(100)/lambda_1"),
        expected(
            "time to 1 % of a constant error, measured, s",
            float(np.log(100.0 * same)) / slow.value,
            of_constant,
            0.01 * bound,
            "predicted, within 1 %",
        ),
        cell(
            "error left at the end (220 s), share",
            0.0,
            float(run_.error_norm[-1] / run_.error_norm[0]),
            0.0,
            erratum=True,
            note="E-001-10: not in finite time",
        ),
        unspecified(
            "error estimate of the run, share", float(run_.attributes.get("error_estimate", 0.0)), "modal path"
        ),
    ]


def _measured(predicted: float, reached: float, n: int, gain: float) -> Cell:
    """The prediction is for pictures whose slow mode is what is left at 1 %; a mean grey of 127 hides it."""
    settled = 15.0 * (GAIN / gain) * n / (SIZE[0] * SIZE[1])
    at = "time to 1 %, measured, s"
    if predicted < settled:
        return unspecified(at, reached, "the slow mode's share is too small to decide it")
    return expected(at, predicted, reached, 0.01 * predicted, "predicted, within 1 %")
