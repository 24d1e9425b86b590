"""The modal path: equal agents mode by mode, ``e(t) = sum_k u_k (x) exp((A - gain lambda_k K C) t) c_k``."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.modes import largest_eigenvalue_bound, mode_matrices
from trigpoint.arrays import FloatArray
from trigpoint.linalg.krylov import RationalKrylov, RitzPairs
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation.plant import Plant
from trigpoint.simulation.scenario import Scenario
from trigpoint.simulation.stacked import Series, constant_error

_ALL_MODES = 1200
_GOAL = 1e-8
_ROUNDS = 6
_STEPS = 5


def continuous(
    observer: DiffusiveObserver, plant: Plant, scenario: Scenario, truth: FloatArray, estimate: FloatArray
) -> tuple[Series, float]:
    """Continuous exchange through the modes of the generalized Laplacian; and the error estimate of doing so.

    Up to 1200 nodes through all eigenpairs; above through Ritz pairs of a rational Krylov space that carries the first
    error, grown until the answer changes by less than 1e-8 of it (the change is the estimate returned, relative to the
    first error).

    We assume: equal agents, scalar weights. Cost: N^3, or a few factorizations and some 50 solves for each state.
    Source: G16, proof of Theorem 4; theory 1 (``f(L)`` with n x n values).
    """
    start = estimate - truth
    drive = constant_error(observer, plant, truth).reshape(start.shape)
    if observer.graph.n_nodes <= _ALL_MODES:
        values, vectors = la.eigh(observer.graph.laplacian().toarray())
        errors, estimate_of_error = _evolved(observer, RitzPairs(values, vectors), start, drive, scenario.times), 1e-12
    else:
        errors, estimate_of_error = _through_krylov(observer, start, drive, scenario.times)
    states = np.stack([plant.advance(truth, time) for time in scenario.times.tolist()])
    return (states, states + errors, np.zeros(errors.shape[:2], dtype=np.int64)), estimate_of_error


def _evolved(
    observer: DiffusiveObserver, pairs: RitzPairs, start: FloatArray, drive: FloatArray, times: FloatArray
) -> FloatArray:
    """(T, N, n): every mode by the exponential of its own n x n (with a constant drive: n + 1) matrix."""
    n = start.shape[1]
    modes = np.zeros((pairs.values.shape[0], n + 1, n + 1))
    modes[:, :n, :n] = mode_matrices(
        observer.agent.A, observer.injection, observer.agent.C, observer.gain * pairs.values
    )
    modes[:, :n, n] = pairs.vectors.T @ drive
    first = np.concatenate([pairs.vectors.T @ start, np.ones((pairs.values.shape[0], 1))], axis=1)
    rows = [(la.expm(modes * time) @ first[:, :, None])[:, :n, 0] for time in times.tolist()]
    return np.stack([pairs.vectors @ row for row in rows])


def _through_krylov(
    observer: DiffusiveObserver, start: FloatArray, drive: FloatArray, times: FloatArray
) -> tuple[FloatArray, float]:
    columns = np.concatenate([start, drive], axis=1) if drive.any() else start
    space = RationalKrylov(observer.graph.laplacian(), columns)
    scale = float(np.linalg.norm(start)) + float(np.linalg.norm(drive)) or 1.0
    poles, last, change = _poles(observer, times), None, np.inf
    errors = np.zeros((times.shape[0], *start.shape))
    for round_ in range(_ROUNDS):
        for pole in poles:
            space.grow(pole, _STEPS if round_ else 2 * _STEPS)
        errors = _evolved(observer, space.pairs(), start, drive, times)
        if last is not None:
            change = max(float(np.linalg.norm(now - before)) for now, before in zip(errors, last, strict=True)) / scale
            if change < _GOAL:
                break
        last = errors
    return errors, change


def _poles(observer: DiffusiveObserver, times: FloatArray) -> list[float]:
    """Three shifts of L that belong to the fastest, the slowest and the middle time scale asked for."""
    pull = float(np.linalg.norm(observer.injection @ observer.agent.C, 2)) * observer.gain
    later = times[times > 0.0]
    if not later.size or pull == 0.0:
        return [1.0]
    ceiling = largest_eigenvalue_bound(observer.graph)
    ends = [min(1.0 / (pull * float(time)), ceiling) for time in (later[-1], later[0])]
    return sorted({ends[0], float(np.sqrt(ends[0] * ends[1])), ends[1]})
