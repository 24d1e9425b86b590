"""R23, Section VIII: integrators on a ring follow a sine, and the distributed observer follows them."""

from __future__ import annotations

import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers.base import Cell, Reproduction, Series, cell, expected, found, holds, unspecified
from trigpoint.simulation import Trajectory

GAIN, FREQUENCY, AMPLITUDE, CONTROL = 100.0, 5.0, 2.0, 30.0
_RINGS = ((5, 1.0), (5, 100.0), (10, 1.0), (10, 100.0))
_FREE = "number of nodes and weights are not printed"


def steady() -> tuple[float, float]:
    """Amplitude and lag [degrees] of ``x' = -30 (x - 2 sin 5 t)`` after its transient."""
    return AMPLITUDE * CONTROL / np.hypot(CONTROL, FREQUENCY), np.degrees(np.arctan2(FREQUENCY, CONTROL))


def truth(start: FloatArray, times: FloatArray) -> FloatArray:
    """(T, N) exact states."""
    amplitude, lag = steady()
    wave = amplitude * np.sin(FREQUENCY * times - np.radians(lag))
    return np.asarray(wave[:, None] + np.exp(-CONTROL * times)[:, None] * (start - wave[0]))


def run(gain: float = GAIN, nodes: int = 5, weight: float = 1.0, seed: int = 0) -> Reproduction:
    """Rates of rings with the anchor ``gain`` K of the paper, and the run that Fig. 4 draws.

    Args:
        gain: K.
        nodes: of the ring that is simulated.
        weight: of its edges.
        seed: of the first states.
    """
    cells = _rates(gain)
    times = np.linspace(0.0, 6.0, 601)
    start = np.random.default_rng(seed).uniform(-3.0, 3.0, nodes)
    states = truth(start, times)
    problem = tp.NetworkedAgents(tp.graphs.cycle(nodes, anchors=(0,)), tp.LinearAgent([[0.0]], [[1.0]], [[1.0]]))
    observer = tp.design(problem, tp.methods.IntegratorObserver(weights=weight, anchor_gain=gain))
    motion = Trajectory(times, states[:, :, None])
    result = tp.simulate(problem, observer, tp.Scenario(times, -start, motion=motion))
    cells += _plant(states, times)
    slowest = float(np.linalg.eigvalsh(-observer.error_matrix().toarray())[0])
    share = _slow_share(observer, -start)
    measured, predicted = result.measured_decay_rate() or 0.0, slowest
    cells += [
        expected("decay of the run", predicted, measured, 0.01 * predicted, "smallest eigenvalue of (9)"),
        expected(
            "error left at 6 s over the slow mode's share",
            1.0,
            float(result.error_norm[-1] / (share * np.exp(-slowest * 6.0))),
            0.01,
            "exact solution",
        ),
    ]
    complete = _rate(10, 100.0, gain, "complete")
    note = "E-001-10: with one anchor the rate is at most K/n, however dense the graph"
    cells.append(found("complete graph of 10: the rate is at most K/n", complete <= GAIN / 10.0, note))
    cells.append(unspecified("rate, complete graph of 10, w = 100", complete, note))
    reference = AMPLITUDE * np.sin(FREQUENCY * times)
    shown = {f"agent {k + 1}": result.estimate[:, k, 0] for k in range(min(nodes, 6))}
    series = (
        Series("Fig. 4, top: states", "time [s]", "x", times, {"reference": reference, **_lines(states)}),
        Series("Fig. 4, bottom: estimates", "time [s]", "estimate", times, {"reference": reference, **shown}),
        Series("Error", "time [s]", "error norm", times, {"error": result.error_norm}, log_y=True),
    )
    text = (
        "The text means Fig. 4 where it refers to Fig. 3 (E-001-11); the number of nodes and the weights are not "
        "given. The plant follows its reference with a slightly smaller amplitude and a lag."
    )
    return Reproduction("r23-tracking", "R23, Section VIII, Fig. 4", text, tuple(cells), series)


def _lines(states: FloatArray) -> dict[str, FloatArray]:
    return {f"agent {k + 1}": states[:, k] for k in range(min(states.shape[1], 6))}


def _rate(nodes: int, weight: float, gain: float, kind: str = "cycle") -> float:
    """Smallest eigenvalue of ``Lambda = D W D' + K Delta``, equation (9)."""
    graph = (tp.graphs.cycle if kind == "cycle" else tp.graphs.complete)(nodes, anchors=(0,))
    return tp.smallest_eigenvalue(graph.with_weight(np.where(graph.is_external, gain, weight))).value


def _rates(gain: float) -> list[Cell]:
    cells = []
    for nodes, weight in _RINGS:
        rate = _rate(nodes, weight, gain)
        at = f"ring of {nodes}, w = {weight:g}"
        cells.append(unspecified(f"{at}: rate of the observer", rate, _FREE))
        cells.append(holds(f"{at}: the plant (rate 30) is faster", rate < CONTROL))
        cells.append(found(f"{at}: the rate is at most K/n", rate <= GAIN / nodes, "Rayleigh quotient of 1"))
    return cells


def _plant(states: FloatArray, times: FloatArray) -> list[Cell]:
    """What the states do, by a fit of sine and cosine to the later part."""
    later = times > 2.0
    columns = np.stack([np.sin(FREQUENCY * times[later]), np.cos(FREQUENCY * times[later])], axis=1)
    (a, b), *_ = np.linalg.lstsq(columns, states[later, 0], rcond=None)
    note = "E-001-11: the reference is not reached"
    lag = float(np.degrees(np.arctan2(-b, a)))
    return [
        cell("amplitude of the states", AMPLITUDE, np.hypot(a, b), 1e-3, erratum=True, note=note),
        cell("lag of the states, degrees", 0.0, lag, 1e-3, erratum=True, note=note),
        expected("amplitude", steady()[0], float(np.hypot(a, b)), 1e-6, "2 * 30 / sqrt(925)"),
        expected("lag", steady()[1], lag, 1e-6, "atan(1/6)"),
    ]


def _slow_share(observer: tp.NetworkObserver, error: FloatArray) -> float:
    values, vectors = np.linalg.eigh(-observer.error_matrix().toarray())
    return float(abs(vectors[:, int(np.argmin(values))] @ error))
