"""Many networks of equal agents in one call: continuous exchange mode by mode, networks of one size stacked."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from trigpoint.analysis.modes import mode_matrices
from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import ArgumentError
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.exponentials import exponentials
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation.plant import node_table
from trigpoint.simulation.rule import changes
from trigpoint.simulation.scenario import Scenario

_STACK = 64
_LARGEST = 1200


@dataclass(frozen=True, eq=False)
class FamilyRun:
    """Errors of many networks.

    Attributes:
        times: (T,) seconds.
        error_norm: (K, T) Euclidean norm of each network's error.
        lambda_min: (K,) smallest eigenvalue of each network.
        slowest: (K,) largest real part of each network's error spectrum.
        errors: for each network its (T, N_k, n) errors.
    """

    times: FloatArray
    error_norm: FloatArray
    lambda_min: FloatArray
    slowest: FloatArray
    errors: tuple[FloatArray, ...]


def simulate_family(
    observers: Sequence[DiffusiveObserver], scenario: Scenario, *, workers: int | None = None
) -> FamilyRun:
    """Run one scenario on many networks: what ``simulate`` gives for each, through stacked eigenproblems.

    Args:
        observers: one a network, of equal agents with one gain and scalar weights, at most 1200 nodes each; sizes and
            agents may differ from network to network.
        scenario: times and initial error (a scalar where sizes differ); continuous exchange, nothing else set.
        workers: threads; all cores unless given. The result does not depend on it.

    Cost: one symmetric eigenproblem a network, stacked by size, and one small exponential a mode and time.

    Raises:
        ArgumentError: no network, or what does not split into modes.
    """
    _check(observers, scenario)
    groups: dict[tuple[int, int], list[int]] = {}
    for k, observer in enumerate(observers):
        groups.setdefault((observer.graph.n_nodes, observer.agent.n_states), []).append(k)
    jobs = [rows[first : first + _STACK] for rows in groups.values() for first in range(0, len(rows), _STACK)]
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        parts = list(pool.map(lambda rows: _stack([observers[k] for k in rows], scenario), jobs))
    place: IntArray = np.argsort(np.concatenate([np.array(rows) for rows in jobs]))
    errors = [error for part in parts for error in part[0]]
    low, slowest = (np.concatenate([part[k] for part in parts])[place] for k in (1, 2))
    ordered = tuple(errors[k] for k in place.tolist())
    norms = np.array([np.sqrt((error**2).sum(axis=(1, 2))) for error in ordered])
    return FamilyRun(scenario.times, norms, low, slowest, ordered)


def _check(observers: Sequence[DiffusiveObserver], scenario: Scenario) -> None:
    if not observers:
        raise ArgumentError("a family needs at least one network's observer")
    for k, observer in enumerate(observers):
        fits = isinstance(observer, DiffusiveObserver) and observer.graph.dimension == 1
        if not fits or observer.graph.n_nodes > _LARGEST:
            raise ArgumentError(
                f"observer {k} of the family must be of equal agents with one gain and scalar weights, at most "
                f"{_LARGEST} nodes; got {observer!r}"
            )
    if scenario.period is not None or changes(scenario) or scenario.measurements is not None:
        raise ArgumentError("a family takes times and an initial error under continuous exchange, and nothing else")


def _stack(
    observers: list[DiffusiveObserver], scenario: Scenario
) -> tuple[list[FloatArray], FloatArray, FloatArray]:  # fmt: skip
    """Errors (T, N, n), smallest eigenvalues and slowest modes of networks of one size."""
    laplacians = np.stack([observer.graph.laplacian().toarray() for observer in observers])
    values, vectors = np.linalg.eigh(laplacians)
    size, n = laplacians.shape[1], observers[0].agent.n_states
    first = node_table("initial_error", scenario.initial_error, Blocks(size, n))
    modes = np.stack(
        [
            mode_matrices(one.agent.A, one.injection, one.agent.C, one.gain * value)
            for one, value in zip(observers, values, strict=True)
        ]
    )
    coordinates = (vectors.transpose(0, 2, 1) @ first)[..., None]
    rows = []
    for time in scenario.times.tolist():
        maps = np.exp(modes * time) if n == 1 else exponentials(modes * time)
        rows.append(vectors @ (maps @ coordinates)[..., 0])
    slowest = np.linalg.eigvals(modes).real.max(axis=(1, 2))
    return list(np.stack(rows, axis=1)), np.maximum(values[:, 0], 0.0), slowest
