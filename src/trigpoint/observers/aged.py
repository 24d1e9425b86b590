"""The decay rate that is left when messages and readings have an age that is compensated by the agents' models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, eigs

from trigpoint.arrays import FloatArray, expm
from trigpoint.errors import ArgumentError
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalObserver

_DENSE = 600
_OLDEST = 64
_LARGEST, _NORMS = 1500, 20_000_000
_SMALLEST = 100.0  # beyond this exponent powers are rounding, then nothing


def aged_error_map(observer: AssembledObserver, period: float, age: float, reading_age: float = 0.0) -> sp.csr_array:
    """M of ``(e_k+1, e_k, ..., e_k+1-q) = M (e_k, ..., e_k-q)`` where each node hears its neighbours' past.

    With ``T = e^{A h}`` and the nodes' own maps Phi, a step of ``period`` h is

        e_k+1 = T e_k + Phi (H_own e_k + H_other m_k),  m_k = (1 - w) T^i e_k-i + w T^{i+1} e_k-i-1,

    ``H_own`` and ``H_other`` the corrections by the own and by the neighbours' values. A message that is ``age`` =
    (i + w) h old tells what its sender knew then, moved to now: the corrections since are missing, and between two
    exchanges they grow linearly. A reading that is ``reading_age`` = b old has the innovation of its own instant, from
    values moved back by the models: ``C e^{-A b}`` stands for C in both corrections.

    We assume:
        * all messages are equally old; their average age where they are not (the effect is linear in short ages).

    Args:
        observer: programs that exchange every ``period`` seconds.
        period: seconds, positive.
        age: seconds, at least 0 and at most 64 periods.
        reading_age: seconds, in the same range.

    Raises:
        ArgumentError: a period or an age out of range.
    """
    if not (np.isfinite(period) and period > 0.0):
        raise ArgumentError(f"period must be a positive number of seconds; got {period}")
    for name, value in (("age", age), ("reading_age", reading_age)):
        if not (np.isfinite(value) and 0.0 <= value <= _OLDEST * period):
            raise ArgumentError(f"{name} must be a number of seconds from 0 to {_OLDEST} periods; got {value}")
    maps = [node.maps(period) for node in observer.nodes]
    T, phi = diagonal_of(one[0] for one in maps), diagonal_of(one[2] for one in maps)
    own, other = _corrections(observer, reading_age)
    other = phi @ other
    whole = int(age / period)
    share = age / period - whole
    blocks: list[sp.csr_array] = [sp.csr_array(T + phi @ own)] + [sp.csr_array(T.shape)] * (whole + 1)
    moved = sp.csr_array(sp.eye_array(T.shape[0]))
    for _ in range(whole):
        moved = sp.csr_array(T @ moved)
    blocks[whole] = sp.csr_array(blocks[whole] + (1.0 - share) * (other @ moved))
    blocks[whole + 1] = sp.csr_array(share * (other @ (T @ moved)))
    if whole == 0 and share == 0.0:
        return blocks[0]
    count = whole + 2
    rows = [blocks] + [
        [sp.csr_array(sp.eye_array(T.shape[0])) if column == row else sp.csr_array(T.shape) for column in range(count)]
        for row in range(count - 1)
    ]
    return sp.csr_array(sp.block_array(rows))


def _corrections(observer: AssembledObserver, reading_age: float) -> tuple[sp.csr_array, sp.csr_array]:
    """``H_own`` (block diagonal) and ``H_other``, for readings of an age."""
    aged = replace(observer, nodes=tuple(_read_late(observer, node, reading_age) for node in observer.nodes))
    own = diagonal_of(-sum((arc.gain @ arc.output for arc in node.arcs), np.zeros_like(node.A)) for node in aged.nodes)
    return own, sp.csr_array(aged.error_matrix() - diagonal_of(node.A for node in aged.nodes) - own)


def _read_late(observer: AssembledObserver, node: LocalObserver, age: float) -> LocalObserver:
    """The program with ``C e^{-A age}`` for C on every arc that has a reading."""
    if age == 0.0:
        return node

    def back(name: str) -> FloatArray:
        return expm(-age * observer.nodes[observer.names.index(name)].A)

    arcs = tuple(
        arc
        if arc.label is None
        else replace(
            arc,
            output=arc.output @ back(node.name),
            neighbour_output=None if arc.neighbour_output is None else arc.neighbour_output @ back(str(arc.neighbour)),
            more=tuple((name, rows @ back(name)) for name, rows in arc.more),
        )
        for arc in node.arcs
    )
    return replace(node, arcs=arcs, _memo={})


def aged_decay_rate(observer: AssembledObserver, period: float, age: float, reading_age: float = 0.0) -> float | None:
    """Predicted rate s of ``|e(t)| ~ e^{-s t}``: ``s = -log(spectral radius of aged_error_map) / period``, 1/s.

    For agents with constant scalar states the slowest mode v of L = D - Adj has, to first order,
    ``s (1 + g tau v' Adj v) = g lambda_min`` with ``tau = age + period / 2``: a value that is held for a period is half
    a period old on average.

    Args:
        observer, period, age, reading_age: as in ``aged_error_map``.

    Returns None where the eigenvalue iteration does not converge.
    """
    matrix = aged_error_map(observer, period, age, reading_age)
    if matrix.shape[0] <= _DENSE:
        radius = float(np.abs(np.linalg.eigvals(matrix.toarray())).max())
    else:
        try:
            first = np.random.default_rng(0).standard_normal(matrix.shape[0])
            radius = float(np.abs(eigs(matrix, k=4, v0=first, tol=1e-8, return_eigenvectors=False)).max())
        except ArpackNoConvergence:
            return None
    return float(-np.log(max(radius, np.finfo(float).tiny)) / period)


def aged_error_norms(
    observer: AssembledObserver, period: float, age: float, reading_age: float, error: FloatArray, steps: int
) -> FloatArray:
    """(steps + 1,) norms of the errors that follow from ``error`` (N, n), exchange by exchange, by ``aged_error_map``.

    Modes that decay almost alike take long to part, so that a run of some time constants falls faster than
    ``aged_decay_rate``, which is that of the last one left; how fast, is the slope of these norms.

    Args:
        observer, period, age, reading_age: as in ``aged_error_map``.
        error: of every node at the start, a row each, filled up where states differ in number; all messages known then
            are taken to have the same error, moved back.
        steps: how many exchanges follow.
    """
    matrix = aged_error_map(observer, period, age, reading_age)
    sizes = [node.n_states for node in observer.nodes]
    now = np.concatenate([row[:size] for row, size in zip(error, sizes, strict=True)])
    free = diagonal_of(expm(-period * node.A) for node in observer.nodes)
    parts = [now]
    while len(parts) * now.shape[0] < matrix.shape[0]:
        parts.append(free @ parts[-1])
    state, norms = np.concatenate(parts), np.empty(steps + 1)
    for k in range(steps + 1):
        norms[k] = np.linalg.norm(state[: now.shape[0]])
        state = matrix @ state
    return norms


def settling(
    observer: AssembledObserver, period: float, age: float, reading_age: float, most: float
) -> tuple[float, float]:
    """``(rate, K)`` of a curve ``K exp(-rate t)`` that errors stay below: ``min(most, 0.9 aged_decay_rate)``.

    A tenth below the rate itself, since a bound that falls as fast as the slowest mode need not exist, and is far off
    where it does.

    Args:
        observer, period, age, reading_age: as in ``aged_error_map``.
        most: 1/s, what is guaranteed.

    Returns (0, 1) where ``aged_overshoot`` finds no K: then nothing is known.
    """
    if (int(age / period) + 2) * sum(node.n_states for node in observer.nodes) > _LARGEST:
        return 0.0, 1.0
    aged = aged_decay_rate(observer, period, age, reading_age)
    rate = 0.0 if aged is None else min(most, 0.9 * aged)
    factor = aged_overshoot(observer, period, age, reading_age, rate) if rate > 0.0 else None
    return (0.0, 1.0) if factor is None else (rate, factor)


def aged_overshoot(
    observer: AssembledObserver, period: float, age: float, reading_age: float, rate: float
) -> float | None:
    """Smallest K found with ``|e_i(k h)| / sqrt(n_i) <= K s exp(-rate k h)`` for every node i, step k, and start.

    Every start whose errors have a root mean square of at most s a state: ``|e_j(0)| <= sqrt(n_j) s``. Let X_k be the
    errors of step k as a function of those of step 0, by ``aged_error_map`` M, all messages known at the start being
    the same errors moved back. Then ``K = max over k < m of exp(rate k h) max_i sum_j |X_k,ij| sqrt(n_j / n_i)``, in
    spectral norms, where ``|M^m| <= exp(-rate (m + q) h)`` in the norm that goes with it and q the steps that M looks
    back: X_m+j = M^m X_j is then below the same curve, and so on for ever.

    Args:
        observer, period, age, reading_age: as in ``aged_error_map``.
        rate: 1/s, positive, less than ``aged_decay_rate``.

    Returns None where no such m is found (the ``rate`` is too near to the network's, or that takes too long: beyond
    1500 unknowns, or twenty million norms).

    Cost: O(D^3 log m + m D nnz) for D unknowns.
    """
    matrix = aged_error_map(observer, period, age, reading_age)
    sizes = [node.n_states for node in observer.nodes]
    unknowns = sum(sizes)
    back = matrix.shape[0] // unknowns - 1
    if matrix.shape[0] > _LARGEST or not rate > 0.0:
        return None
    power, steps = matrix.toarray(), 1
    while _reach(power, sizes * (back + 1)) > np.exp(-rate * (steps + back) * period):
        steps *= 2
        if steps * len(sizes) ** 2 > _NORMS or rate * (steps + back) * period > _SMALLEST:
            return None
        power = power @ power
    free = diagonal_of(expm(-period * node.A) for node in observer.nodes)
    starts = [np.eye(unknowns)]
    for _ in range(back):
        starts.append(free @ starts[-1])
    largest = max(_reach(start, sizes) * np.exp(-rate * k * period) for k, start in enumerate(starts))
    now = np.concatenate(starts)
    for k in range(1, steps):
        now = matrix @ now
        largest = max(largest, _reach(now[:unknowns], sizes) * np.exp(rate * k * period))
    return float(largest)


def _reach(matrix: FloatArray, sizes: Sequence[int]) -> float:
    """``max_i sum_j |M_ij| sqrt(n_j / n_i)``, spectral norms of the blocks of these ``sizes``."""
    count, largest = len(sizes), max(sizes)
    places = np.concatenate([k * largest + np.arange(size) for k, size in enumerate(sizes)])
    padded = np.zeros((count * largest, count * largest))
    padded[np.ix_(places, places)] = matrix
    blocks = padded.reshape(count, largest, count, largest).swapaxes(1, 2)
    weights = np.sqrt(np.asarray(sizes, dtype=np.float64))
    return float(((_norms(blocks) @ weights) / weights).max())


def _norms(blocks: FloatArray) -> FloatArray:
    """Spectral norm of each block; for small ones from ``sigma^2 = (F + sqrt(F^2 - 4 det^2)) / 2``, F the squares."""
    size = blocks.shape[-1]
    if size > 2:
        return np.asarray(np.linalg.norm(blocks, 2, axis=(2, 3)))
    squares = np.einsum("ijkl,ijkl->ij", blocks, blocks)
    if size == 1:
        return np.asarray(np.sqrt(squares))
    det = blocks[..., 0, 0] * blocks[..., 1, 1] - blocks[..., 0, 1] * blocks[..., 1, 0]
    return np.asarray(np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * det**2, 0.0)))))
