"""A rate proved mode by mode: one Lyapunov matrix for each piece of the spectrum, any number of nodes."""

from __future__ import annotations

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.certificates.base import number, witness
from trigpoint.certificates.decrease import gain_range, mode_decreases
from trigpoint.certificates.pairs import lyapunov_solution
from trigpoint.certificates.smallest_eigenvalue import proved_floor
from trigpoint.certificates.statics import largest_eigenvalue_upper
from trigpoint.errors import ProtocolError
from trigpoint.linalg.common_function import functions_at
from trigpoint.linalg.verified import is_positive_definite
from trigpoint.observers.certificate import ClaimRecord
from trigpoint.observers.network import DiffusiveObserver

_PIECES, _MOST = 200, 1000


def spectrum(observer: DiffusiveObserver, floor: float) -> tuple[float, float]:
    """The gains ``gain lambda`` of all eigenvalues from ``floor`` on."""
    return gain_range(observer, floor, largest_eigenvalue_upper(observer.graph))


def prove(observer: DiffusiveObserver, rate: float, ends: tuple[float, float]) -> dict[str, FloatArray] | None:
    """Adjoining pieces of the gains between ``ends``, each with a P that decreases at both of its ends; or None.

    ``P F + F' P + 2 rate P`` is affine in the gain, so that both ends prove the piece. A piece that cannot be proved is
    halved, at most 200 in all.
    """
    low, high = ends
    if not (0.0 < low <= high < np.inf):
        return None
    waiting, done, count = [(low, high)], [], 0
    while waiting:
        left, right = waiting.pop()
        count += 1
        middle = float(np.sqrt(left) * np.sqrt(right))
        found = (P for P in _functions(observer, rate, left, right) if _decreases(observer, P, rate, [left, right]))
        P = next(found, None)
        if P is not None:
            done.append((right, P))
            continue
        if count > _PIECES or not left < middle < right:
            return None
        waiting += [(middle, right), (left, middle)]
    return {"edges": np.array([low, *(right for right, _ in done)]), "P": np.stack([P for _, P in done])}


def _functions(observer: DiffusiveObserver, rate: float, left: float, right: float) -> list[FloatArray]:
    agent, K = observer.agent, observer.injection
    with np.errstate(over="ignore", invalid="ignore"):
        F, half = agent.A - 0.5 * (left + right) * (K @ agent.C), 0.5 * (right - left) * agent.C
    if not np.isfinite(F).all() or float(np.linalg.eigvals(F).real.max()) >= -rate:
        return []
    P = lyapunov_solution(F, rate)
    return [*([] if P is None else [P]), *functions_at(F, K, half, rate)]


def proves(record: ClaimRecord, observer: DiffusiveObserver, rate: float) -> bool:
    """The same again, piece by piece, over a spectrum whose floor the record's positive vector proves."""
    edges, n = record.witness["edges"], observer.agent.n_states
    count = edges.shape[0] if edges.ndim == 1 else 0
    if not 2 <= count <= _MOST:
        raise ProtocolError(f"the witness 'edges' must hold 2 to {_MOST} numbers; got the shape {edges.shape}")
    edges, matrices = witness(record, "edges", (count,)), witness(record, "P", (count - 1, n, n))
    floor = number(record, "lambda_floor")
    if not (rate > 0.0 and observer.graph.dimension == 1 and observer.graph.is_externally_connected):
        return False
    if not 0.0 < floor <= proved_floor(record, observer.graph):
        return False
    low, high = spectrum(observer, floor)
    if not (edges[0] <= low and high <= edges[-1] and (edges[1:] > edges[:-1]).all()):
        return False
    pieces = zip(edges[:-1].tolist(), edges[1:].tolist(), matrices, strict=True)
    return all(_decreases(observer, P, rate, ends) for *ends, P in pieces)


def _decreases(observer: DiffusiveObserver, P: FloatArray, rate: float, ends: list[float]) -> bool:
    return is_positive_definite(P) and all(mode_decreases(observer, P, rate, g) for g in ends)
