"""What sampling, delay and loss do to the error of a network: limits in closed form or as one small eigenproblem.

All of them concern ``e' = -gamma L e`` (constants) unless they take an agent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import lambertw

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.linalg.balls import Ball, transition_and_integral
from trigpoint.linalg.interval_stability import IntervalVerdict, contraction_on_interval

_LARGEST_OPERATOR = 50


def euler_limit(gain: float, lambda_max: float) -> float:
    """Largest period h of ``e+ = (I - h gain L) e``: ``2 / (gain lambda_max)``; stable below, unstable above.

    Source: theory 6-F1.
    """
    return 2.0 / (gain * lambda_max)


def best_euler(gain: float, lambda_min: float, lambda_max: float) -> tuple[float, float]:
    """The period with the smallest spectral radius, and that radius ``(kappa - 1) / (kappa + 1)``.

    Args: ``gain``, and the ends ``lambda_min``, ``lambda_max`` of the spectrum. Source: theory 6-F1.
    """
    return 2.0 / (gain * (lambda_min + lambda_max)), (lambda_max - lambda_min) / (lambda_max + lambda_min)


def delay_margin(gain: float, lambda_max: float) -> float:
    """Largest uniform delay tau of ``e' = -gain L e(t - tau)``: ``pi / (2 gain lambda_max)``.

    Source: Olfati-Saber and Murray 2004; theory 6-F3.
    """
    return float(np.pi / (2.0 * gain * lambda_max))


def delayed_abscissa(rates: FloatArray, delay: float) -> float:
    """Largest real part of the roots of ``s = -r e^{-s delay}`` over the ``rates`` r: ``max Re W_0(-r delay) / delay``.

    Source: theory 6-F3.
    """
    rates = np.asarray(rates, dtype=np.float64)
    return float(-rates.min()) if delay == 0.0 else float((lambertw(-rates * delay, 0).real / delay).max())


def mean_square_radius(graph: MeasurementGraph, step: float, arrival: float) -> float:
    """Spectral radius of the second moment under independent losses: each arc arrives with probability ``arrival``.

    ``S = M (x) M + step^2 p (1 - p) sum_k (g_k g_k') (x) (g_k g_k')`` with ``M = I - step p L`` and ``step = h gain``;
    the error's mean square contracts by this factor an exchange. Exact for up to 50 nodes (the operator is applied
    without forming it); larger graphs are an ArgumentError: ``mean_square_limit`` is sufficient there.

    Source: theory 6-F4.
    """
    if graph.n_nodes > _LARGEST_OPERATOR:
        raise ArgumentError(f"the exact operator is for up to {_LARGEST_OPERATOR} nodes; got {graph.n_nodes}")
    _check_share(arrival)
    weight = graph.arc_weights
    G = graph.incidence().toarray()
    M = np.eye(graph.n_nodes) - step * arrival * (G * weight) @ G.T
    spread = step**2 * arrival * (1.0 - arrival) * weight**2
    # The dominant eigenmatrix of a positive map is positive semidefinite: plain power iteration finds it.
    X, radius = np.eye(graph.n_nodes) / graph.n_nodes, 0.0
    for _ in range(200_000):
        moved = M @ X @ M.T + (G * (spread * np.einsum("ik,ij,jk->k", G, X, G, optimize=True))) @ G.T
        size = float(np.trace(moved))
        if size == 0.0:
            return 0.0
        if abs(size - radius) <= 1e-14 * size:
            return size
        X, radius = moved / size, size
    return radius


def mean_square_limit(gain: float, lambda_max: float, arrival: float) -> float:
    """A period below which the mean square contracts: ``2 / (gain (p lambda_max + 2 (1 - p)))``, p = ``arrival``.

    Sufficient, unit weights. Source: theory 6-F4.
    """
    _check_share(arrival)
    return 2.0 / (gain * (arrival * lambda_max + 2.0 * (1.0 - arrival)))


def gossip_rate(lambda_min: float, energy: float) -> float:
    """Bound of the mean-square contraction of one random projection: ``1 - lambda_min / |G|_F^2`` (``energy``).

    Source: Strohmer and Vershynin 2009; theory 6-F5.
    """
    return 1.0 - lambda_min / energy


@dataclass(frozen=True, eq=False)
class SampledMode:
    """One exchange of a mode: ``e+ = (start + gain lambda pull) e``, both matrices with their rounding errors."""

    start: Ball
    pull: Ball


def sampled_mode(form: str, A: FloatArray, K: FloatArray, C: FloatArray, period: float) -> SampledMode:
    """The map of ``form`` ``"euler"``, ``"innovation-held"`` or ``"discrete"`` over one ``period``.

    euler: ``I + h (A - g K C)``; innovation-held: ``e^{A h} - g int e^{A s} ds K C``; discrete: ``A - g K C``. A, K, C
    as in ``mode_matrices``. Source: theory 6-F1, 6-F7, 6-F8.
    """
    own, output = Ball.exact(A), Ball.exact(K) @ Ball.exact(C)
    if form == "euler":
        return SampledMode(Ball.exact(np.eye(A.shape[0])) + own.times(period), output.times(-period))
    if form == "innovation-held":
        transition, integral = transition_and_integral(own, period)
        return SampledMode(transition, (integral @ output).times(-1.0))
    if form == "discrete":
        return SampledMode(own, output.times(-1.0))
    raise ArgumentError(f"form must be 'euler', 'innovation-held' or 'discrete'; got {form!r}")


def sampled_stability(mode: SampledMode, gain: float, low: float, high: float) -> IntervalVerdict:
    """Whether every mode with ``low <= lambda <= high`` contracts, over the whole interval (``gain`` times lambda).

    True is proved (convexity of the Lyapunov inequality piece by piece), None undecided. Source: theory 6-F7.
    """
    return contraction_on_interval(mode.start, mode.pull.times(gain), low, high)


def period_limit(
    form: str, A: FloatArray, K: FloatArray, C: FloatArray, gain: float, ends: tuple[float, float]
) -> float:
    """Largest period up to which every mode between the ``ends`` of the spectrum was found stable; inf for none found.

    By doubling from a thousandth of the fastest time scale and bisection to 1e-10, on the ends and 33 points between.
    Args: ``form``, A, K, C as in ``sampled_mode``; ``gain``. Source: theory 6-F7.
    """
    values = gain * np.linspace(ends[0], ends[1], 35)

    def stable(period: float) -> bool:
        mode = sampled_mode(form, A, K, C, period)
        maps = mode.start.middle + values[:, None, None] * mode.pull.middle
        return bool(np.abs(np.linalg.eigvals(maps)).max() < 1.0)

    low = 1e-3 / max(float(np.linalg.norm(A - values[-1] * K @ C, 2)), 1e-300)
    if not stable(low):
        return 0.0
    high = low
    for _ in range(80):
        low, high = high, 2.0 * high
        if not stable(high):
            break
    else:
        return float("inf")
    while high - low > 1e-10 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _check_share(arrival: float) -> None:
    if not 0.0 < arrival <= 1.0:
        raise ArgumentError(f"arrival must be a probability, 0 < arrival <= 1; got {arrival}")
