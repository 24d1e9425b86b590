"""A counterexample to a rate: a quadratic function that must grow along some error (Chetaev's argument)."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.eigenvalue import EigenvalueBound, couplings
from trigpoint.analysis.modes import mode_matrices
from trigpoint.arrays import FloatArray
from trigpoint.certificates import base
from trigpoint.certificates.decrease import gain_range, mode_decreases
from trigpoint.certificates.smallest_eigenvalue import proved_floor
from trigpoint.linalg.balls import is_negative_along
from trigpoint.linalg.equations import near_singular_allowed
from trigpoint.linalg.verified import collatz_wielandt_upper, rayleigh_upper
from trigpoint.observers.certificate import ClaimRecord
from trigpoint.observers.network import DiffusiveObserver


def witness(observer: DiffusiveObserver, rate: float, bound: EigenvalueBound) -> dict[str, FloatArray] | None:
    """P, a direction in which it is negative, and the vectors that enclose ``lambda_min``; None where there are none.

    With ``P (F + rate I) + (F + rate I)' P < 0`` and ``v' P v < 0`` the matrix ``F + rate I`` has an eigenvalue with a
    positive real part: by Lyapunov's inertia theorem their number is that of P's negative eigenvalues.
    """
    if observer.graph.dimension > 1 or bound.witness.size == 0 or not np.isfinite(rate):
        return None
    gains = observer.gain * np.array([bound.value])
    F = mode_matrices(observer.agent.A, observer.injection, observer.agent.C, gains)[0]
    F = F + rate * np.eye(F.shape[0])
    if not np.isfinite(F).all() or float(np.linalg.eigvals(F).real.max()) <= 0.0:
        return None
    try:
        with near_singular_allowed():
            P = la.solve_continuous_lyapunov(F.T, -np.eye(F.shape[0]))
    except (np.linalg.LinAlgError, ValueError):
        return None
    P = 0.5 * (P + P.T)
    if not np.isfinite(P).all():
        return None
    direction = np.linalg.eigh(P)[1][:, 0]
    return {"P": P / np.abs(P).max(), "growing": direction, "x": bound.witness, "slowest": bound.vector}


def proves(record: ClaimRecord, observer: DiffusiveObserver, rate: float, floor: float) -> bool:
    """Check the inequality on the whole enclosure of ``lambda_min``, and the sign of P along the direction."""
    n, graph = observer.agent.n_states, observer.graph
    if graph.dimension > 1 or not graph.is_externally_connected or not rate >= 0.0:
        return False
    P, v = base.witness(record, "P", (n, n)), base.witness(record, "growing", (n,))
    slowest, matrix = base.witness(record, "slowest", (graph.n_nodes,)), couplings(graph)
    ceiling = min(rayleigh_upper(matrix, slowest), collatz_wielandt_upper(matrix, slowest))
    if not (0.0 < floor <= proved_floor(record, graph) and np.isfinite(ceiling) and np.array_equal(P, P.T)):
        return False
    if not is_negative_along(P, v):
        return False
    ends = gain_range(observer, floor, ceiling)
    return all(mode_decreases(observer, P, rate, g) for g in ends)
