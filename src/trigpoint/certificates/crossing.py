"""Moving agents of one output whose innovations are late: no root on the imaginary axis, or one to the right of it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.linalg.balls import Ball, transition_and_integral
from trigpoint.linalg.characteristic import Polynomial, Stored, on_the_axis, plus, times, transfer, turned
from trigpoint.linalg.verified import up
from trigpoint.observers.network import DiffusiveObserver

MOST = 20_000
_LARGEST_AGENT, _FIRST, _FINEST = 10, 64, 1e-12
_TURN, _QUARTER, _HALF = 6.28, 1.57, 3.14
"""Below 2 pi, pi / 2 and pi."""


@dataclass(frozen=True, eq=False)
class Plane:
    """What decides whether ``d(i w) + g e^(-i x) n(i w) = 0`` can hold with ``low <= g <= high`` and ``0 <= x <= w h``.

    ``w = -d conj(n)`` would lie in the direction ``e^(-i x)``, and ``|d| = g |n|``.

    Attributes:
        real, imaginary: of ``w``, in the frequency.
        above: ``|d|^2 - high^2 |n|^2``.
        below: ``low^2 |n|^2 - |d|^2``.
        end: a frequency above which no root can be.
    """

    real: Stored
    imaginary: Stored
    above: Stored
    below: Stored
    end: float


def is_single(observer: DiffusiveObserver) -> bool:
    """One output, and an agent small enough for fractions."""
    return observer.agent.n_outputs == 1 and observer.agent.n_states <= _LARGEST_AGENT


def polynomials(observer: DiffusiveObserver) -> tuple[Polynomial, Polynomial]:
    """d and n with ``det(s I - A + g z K C) = d(s) + g z n(s)``."""
    return transfer(observer.agent.A, observer.injection[:, 0], observer.agent.C[0])


def plane(observer: DiffusiveObserver, low: float, high: float) -> Plane | None:
    """The polynomials of the gains from ``low`` to ``high``; None where floats cannot hold them."""
    d, n = polynomials(observer)
    (d_r, d_i), (n_r, n_i) = on_the_axis(d), on_the_axis(n)
    minus = Fraction(-1)
    inner = plus(times(d_r, n_r), times(d_i, n_i), Fraction(1))
    outer = plus(times(d_i, n_r), times(d_r, n_i), minus)
    d_size = plus(times(d_r, d_r), times(d_i, d_i), Fraction(1))
    n_size = plus(times(n_r, n_r), times(n_i, n_i), Fraction(1))
    parts = [
        Stored.of([minus * v for v in inner]),
        Stored.of([minus * v for v in outer]),
        Stored.of(plus(d_size, n_size, minus * Fraction(high) ** 2)),
        Stored.of(plus([minus * v for v in d_size], n_size, Fraction(low) ** 2)),
    ]
    sizes = [float(np.abs(matrix).sum()) for matrix in (observer.agent.A, observer.injection, observer.agent.C)]
    end = up((sizes[0] + high * sizes[1] * sizes[2]) * (1.0 + 1e-9))
    real, imaginary, above, below = parts
    if real is None or imaginary is None or above is None or below is None or not np.isfinite(end):
        return None
    return Plane(real, imaginary, above, below, end)


@np.errstate(over="ignore", invalid="ignore")
def avoided(part: Plane, edges: FloatArray, delay: float) -> np.ndarray:
    """(m,) truth values: on each interval between ``edges`` (m + 1,) no root is possible for any delay up to this."""
    left, right = edges[:-1], edges[1:]
    middle = 0.5 * (left + right)
    radius = 0.5 * (right - left) * (1.0 + 1e-12) + 1e-15 * right
    angle = right * delay * (1.0 + 1e-15)
    cosine, sine, error = turned(np.minimum(angle, 6.5))
    (r, r_slope, r_off), (i, i_slope, i_off) = (p.around(middle, radius) for p in (part.real, part.imaginary))
    r_off, i_off = (off + 1e-15 * np.abs(value) for off, value in ((r_off, r), (i_off, i)))
    size = (np.abs(r) + np.abs(i) + radius * (np.abs(r_slope) + np.abs(i_slope)) + r_off + i_off) * (error + 1e-15)
    value, slope = r * sine + i * cosine, r_slope * sine + i_slope * cosine
    beyond = value + (radius * np.abs(slope) + r_off + i_off) * (1.0 + 1e-12) + size < 0.0
    ahead = i - (radius * np.abs(i_slope) + i_off) * (1.0 + 1e-12) > 0.0
    behind = (r + (radius * np.abs(r_slope) + r_off) * (1.0 + 1e-12) < 0.0) & (angle < _QUARTER)
    outside = np.where(angle < _HALF, ahead | beyond | behind, ahead & beyond & (angle < _TURN))
    return np.asarray(outside | _is_positive(part.above, middle, radius) | _is_positive(part.below, middle, radius))


def _is_positive(p: Stored, middle: FloatArray, radius: FloatArray) -> np.ndarray:
    value, slope, off = p.around(middle, radius)
    return np.asarray(value - (radius * np.abs(slope) + off) * (1.0 + 1e-12) > 0.0)


def covering(part: Plane, delay: float) -> FloatArray | None:
    """Edges from 0 to the end between which no root is possible; None where an interval of the finest size is left."""
    edges = np.concatenate([[0.0], np.geomspace(1e-6, 1.0, _FIRST)]) * part.end
    proved = avoided(part, edges, delay)
    while not proved.all():
        left, right = edges[:-1][~proved], edges[1:][~proved]
        middles = 0.5 * (left + right)
        finest = (right - left < _FINEST * right) | (right < _FINEST * part.end)
        if edges.shape[0] + middles.shape[0] > MOST or finest.any():
            return None
        edges = np.unique(np.concatenate([edges, middles]))
        proved = avoided(part, edges, delay)
    return edges


def has_a_growing_root(
    pair: tuple[Polynomial, Polynomial],
    gains: tuple[float, float],
    delay: float,
    root: tuple[float, float],
    radius: float,
) -> bool:
    """Prove that for every gain between both a root of ``d(s) + g e^(-s delay) n(s)`` is within ``radius`` of ``root``.

    On the circle the linear part at the ``root`` outweighs the value there and the curvature, so that each encloses as
    many roots: one (Rouche). The circle lies to the right of the imaginary axis. In fractions; only the exponential is
    enclosed by floats.

    Args: ``pair`` d and n, ``gains`` the ends of an interval, ``root`` real and imaginary part of the centre.
    """
    a, b = root
    if not (0.0 < radius < a and delay >= 0.0 and gains[0] <= gains[1] and np.isfinite(gains).all()):
        return False
    turn, _ = transition_and_integral(Ball.exact(np.array([[-a, b], [-b, -a]])), delay)
    if not (np.isfinite(turn.middle).all() and np.isfinite(turn.radius).all()):
        return False
    d, n = pair
    h, low, high = Fraction(delay), Fraction(gains[0]), Fraction(gains[1])
    late = (Fraction(float(turn.middle[0, 0])), Fraction(float(-turn.middle[0, 1])))
    unsure = Fraction(float(turn.radius[0, 0])) + Fraction(float(turn.radius[0, 1]))
    s = (Fraction(a), Fraction(b))
    lagged = plus(_derivative(n), n, -h)
    value, value_unsure = _with_late(_at(d, s), _at(n, s), late, unsure, (low, high))
    slope, slope_unsure = _with_late(_at(_derivative(d), s), _at(lagged, s), late, unsure, (low, high))
    most = abs(s[0]) + abs(s[1]) + Fraction(radius)
    largest = max(abs(low), abs(high))
    bend = _size(_derivative(_derivative(d)), most) + largest * (
        _size(_derivative(_derivative(n)), most) + 2 * h * _size(_derivative(n), most) + h * h * _size(n, most)
    )
    r = Fraction(radius)
    steep = max(abs(slope[0]), abs(slope[1])) - slope_unsure
    return bool(abs(value[0]) + abs(value[1]) + value_unsure + bend * r * r / 2 < steep * r)


Complex = tuple[Fraction, Fraction]


def _with_late(
    plain: Complex, factor: Complex, late: Complex, unsure: Fraction, gains: tuple[Fraction, Fraction]
) -> tuple[Complex, Fraction]:
    """``plain + g late factor`` at the middle gain, and how far it is off for all others and all late within unsure."""
    middle, half = (gains[0] + gains[1]) / 2, (gains[1] - gains[0]) / 2
    product = _times(late, factor)
    size = abs(factor[0]) + abs(factor[1])
    off = half * (abs(product[0]) + abs(product[1])) + (abs(middle) + half) * unsure * size
    return (plain[0] + middle * product[0], plain[1] + middle * product[1]), off


def _times(x: Complex, y: Complex) -> Complex:
    return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]


def _at(p: Polynomial, s: Complex) -> Complex:
    total = (Fraction(0), Fraction(0))
    for coefficient in reversed(p):
        total = _times(total, s)
        total = (total[0] + coefficient, total[1])
    return total


def _derivative(p: Polynomial) -> Polynomial:
    return [k * a for k, a in enumerate(p)][1:] or [Fraction(0)]


def _size(p: Polynomial, most: Fraction) -> Fraction:
    return sum((abs(a) * most**k for k, a in enumerate(p)), Fraction(0))
