"""The delay of agents that move: one output by frequencies, any outputs by functionals; roots that grow refute it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.arrays import FloatArray
from trigpoint.certificates import crossing, late, pairs
from trigpoint.certificates.base import number, witness
from trigpoint.certificates.decrease import gain_range, mode_ball
from trigpoint.certificates.smallest_eigenvalue import proved_floor
from trigpoint.certificates.statics import eigenvalue_near, largest_eigenvalue_upper
from trigpoint.errors import ProtocolError
from trigpoint.linalg.balls import decays
from trigpoint.linalg.characteristic import Polynomial, Stored
from trigpoint.linalg.verified import down, is_positive_definite, up
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver

_SLOWEST, _DENSE, _TRIED, _POINTS = 1e-300, 600, 8, 24
_RADII = (0.5, 1e-2, 1e-4, 1e-6, 1e-8)

Arrays = dict[str, FloatArray]


def proof(observer: DiffusiveObserver, delay: float | None) -> tuple[float, float, Arrays] | None:
    """The delay (where none is given, 80 % of the longest that can be proved), a proved floor of the eigenvalues, and
    the arrays that prove it; None where nothing is proved.
    """
    bound = smallest_eigenvalue(observer.graph)
    ends = (down(observer.gain * bound.lower), _highest(observer))
    if not (bound.lower > 0.0 and 0.0 < ends[0] <= ends[1] < np.inf):
        return None
    swept = _sweep(observer, ends) if crossing.is_single(observer) else None
    attempt, steps = (swept, 40) if swept is not None else (_functionals(observer, ends), 9)
    chosen = _longest(observer, ends, attempt, steps) if delay is None else delay
    arrays = attempt(chosen) if chosen is not None else None
    return None if chosen is None or arrays is None else (chosen, bound.lower, {**arrays, "x": bound.witness})


def _functionals(observer: DiffusiveObserver, ends: tuple[float, float]) -> Callable[[float], Arrays | None]:
    def attempt(delay: float) -> Arrays | None:
        pieces = late.prove(observer, delay, *ends)
        return None if pieces is None else {"edges": pieces.edges, "P": pieces.P, "R": pieces.R}

    return attempt


def _sweep(observer: DiffusiveObserver, ends: tuple[float, float]) -> Callable[[float], Arrays | None] | None:
    part, mode = crossing.plane(observer, *ends), mode_ball(observer, ends[0])
    P = pairs.lyapunov_solution(mode.middle, 0.0) if np.isfinite(mode.middle).all() else None
    if part is None or P is None or not (is_positive_definite(P) and decays(P, mode, 0.0)):
        return None

    def attempt(delay: float) -> Arrays | None:
        edges = crossing.covering(part, delay)
        return None if edges is None else {"frequencies": edges, "P": P}

    return attempt


def _longest(
    observer: DiffusiveObserver, ends: tuple[float, float], attempt: Callable[[float], Arrays | None], steps: int
) -> float | None:
    """80 % of the longest delay that can be proved, by bisection on its logarithm; None where even none cannot."""
    pull = observer.injection @ observer.agent.C
    size = float(np.linalg.norm(observer.agent.A, 2)) + ends[1] * float(np.linalg.norm(pull, 2))
    if not (np.isfinite(size) and size > _SLOWEST):
        return None
    low, high = 1e-4 / size, 4.0 / size
    if attempt(low) is None:
        return None
    while attempt(high) is not None and high < 1e6 * low:
        low, high = high, 4.0 * high
    for _ in range(steps):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if attempt(middle) is None else (middle, high)
        if high < (1.0 + 1e-6) * low:
            break
    return 0.8 * low


def verify(record: ClaimRecord, observer: DiffusiveObserver, delay: float) -> Outcome:
    """Each proof again, from its arrays."""
    if "root" in record.witness:
        return "refuted" if _grows(record, observer, delay) else "inconclusive"
    name = "frequencies" if "frequencies" in record.witness else "edges"
    if name not in record.witness:
        return "inconclusive"
    edges, n, most = record.witness[name], observer.agent.n_states, crossing.MOST if name == "frequencies" else 1000
    count = edges.shape[0] if edges.ndim == 1 else 0
    if not 2 <= count <= most:
        raise ProtocolError(f"the witness {name!r} must hold 2 to {most} numbers; got the shape {edges.shape}")
    edges = witness(record, name, (count,))
    floor = number(record, "lambda_floor")
    if not (observer.graph.is_externally_connected and 0.0 < floor <= proved_floor(record, observer.graph)):
        return "inconclusive"
    ends = (down(observer.gain * floor), _highest(observer))
    if name == "frequencies":
        return "certified" if _avoids(observer, edges, witness(record, "P", (n, n)), delay, ends) else "inconclusive"
    pieces = late.Pieces(edges, witness(record, "P", (count - 1, n, n)), witness(record, "R", (count - 1, n, n)))
    return "certified" if late.covers(observer, pieces, delay, *ends) else "inconclusive"


def _avoids(
    observer: DiffusiveObserver, edges: FloatArray, P: FloatArray, delay: float, ends: tuple[float, float]
) -> bool:
    """Stable without delay at the lowest gain, and no root meets the axis for any gain and any delay up to this one."""
    if not (crossing.is_single(observer) and 0.0 < ends[0] <= ends[1] < np.inf):
        return False
    part = crossing.plane(observer, *ends)
    if part is None or not (edges[0] == 0.0 and (edges[1:] > edges[:-1]).all() and edges[-1] >= part.end):
        return False
    mode = mode_ball(observer, ends[0])
    return is_positive_definite(P) and decays(P, mode, 0.0) and bool(crossing.avoided(part, edges, delay).all())


def _highest(observer: DiffusiveObserver) -> float:
    return up(observer.gain * largest_eigenvalue_upper(observer.graph))


def growing(observer: DiffusiveObserver, delay: float) -> Arrays | None:
    """A root to the right of the axis, a circle around it that holds one, and the mode's eigenvector; or None."""
    if not crossing.is_single(observer) or observer.graph.n_nodes > _DENSE:
        return None
    laplacian, pair = observer.graph.laplacian().toarray(), crossing.polynomials(observer)
    if not np.isfinite(laplacian).all():
        return None
    values, vectors = np.linalg.eigh(laplacian)
    tried = np.unique(np.linspace(len(values) - 1, 0, _TRIED).astype(int))[::-1]
    for k in tried.tolist():
        near = eigenvalue_near(observer.graph, vectors[:, k])
        gains = None if near is None else gain_range(observer, *near)
        for root in _roots(observer, pair, observer.gain * float(values[k]), delay):
            for share in _RADII if gains is not None else ():
                circle = (float(root.real), float(root.imag)), share * float(root.real)
                if gains is not None and crossing.has_a_growing_root(pair, gains, delay, *circle):
                    return {"v": vectors[:, k], "root": np.array(circle[0]), "radius": np.array([circle[1]])}
    return None


def _grows(record: ClaimRecord, observer: DiffusiveObserver, delay: float) -> bool:
    v = witness(record, "v", (observer.graph.n_nodes,))
    a, b = witness(record, "root", (2,)).tolist()
    radius = witness(record, "radius", (1,)).item()
    near = (
        eigenvalue_near(observer.graph, v)
        if crossing.is_single(observer) and "lambda_floor" not in record.numbers
        else None
    )
    if near is None:
        return False
    gains = gain_range(observer, *near)
    return crossing.has_a_growing_root(crossing.polynomials(observer), gains, delay, (a, b), radius)


def _roots(
    observer: DiffusiveObserver, pair: tuple[Polynomial, Polynomial], g: float, delay: float
) -> Iterator[complex]:
    """Computed roots to the right of the axis, polished: by collocation on the last ``delay`` seconds."""
    A, pull = observer.agent.A, g * (observer.injection @ observer.agent.C)
    n, k = A.shape[0], np.arange(_POINTS + 1)
    x = np.cos(np.pi * k / _POINTS)
    sides = np.where((k == 0) | (k == _POINTS), 2.0, 1.0) * (-1.0) ** k
    D = np.outer(sides, 1.0 / sides) / (x[:, None] - x[None, :] + np.eye(_POINTS + 1))
    D = (D - np.diag(D.sum(axis=1))) * 2.0 / (delay or 1e-12)
    M = np.kron(D, np.eye(n))
    M[:n] = 0.0
    M[:n, :n], M[:n, -n:] = A, -pull
    stored = [Stored.of(p) for p in pair]
    if not np.isfinite(M).all() or stored[0] is None or stored[1] is None:
        return
    found = np.linalg.eigvals(M)
    d, numerator = stored[0].a[::-1], stored[1].a[::-1]
    slopes = np.polyder(d), np.polyder(numerator)
    for s in sorted(found[(found.real > 0.0) & (found.imag >= 0.0)], key=lambda s: -s.real)[:3]:
        for _ in range(20):
            turn = g * np.exp(-s * delay)
            top = np.polyval(d, s) + turn * np.polyval(numerator, s)
            steep = np.polyval(slopes[0], s) + turn * (np.polyval(slopes[1], s) - delay * np.polyval(numerator, s))
            s = s - top / steep
        if np.isfinite(s) and s.real > 0.0:
            yield complex(s)
