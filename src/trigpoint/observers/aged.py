"""The decay rate that is left when messages and readings have an age that is compensated by the agents' models."""

from __future__ import annotations

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
