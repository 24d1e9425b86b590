"""Proposition 1 of W17 on a given plant: generic gains make every channel enough, with controllability index m."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
import scipy.linalg as la

from trigpoint.analysis.pairs import pair_margin
from trigpoint.arrays import FloatArray
from trigpoint.model import SharedPlant


@dataclass(frozen=True)
class Proposition1:
    """What was found for one draw of the gains.

    Attributes:
        controllability_index: fewest steps after which every ``(H, B_p)`` has full rank; None where that is not m.
        rank_margin: smallest singular value of all ``[B_p, H B_p, ..., H^{m-1} B_p]`` relative to the largest.
        observable: True where ``(C_pq, H)`` was found observable for every p and every q that p hears (or p itself with
            an output that is not zero); None where rounding leaves it open for some.
        unobservable_channels: channels (p, q) found unobservable.
    """

    controllability_index: int | None
    rank_margin: float
    observable: bool | None
    unobservable_channels: tuple[tuple[int, int], ...]


def check_prop1(problem: SharedPlant, seed: int = 0) -> Proposition1:
    """Draw the gains ``F_ij`` and ``K_i`` (``seed``) and test W17, Proposition 1, on the assembled H of ``problem``.

    We assume:
        * a strongly connected digraph and a plant that all agents together see; ``C_i = 0`` is allowed (E-002-8).

    For small problems: ranks of (m n) x (m n) matrices decide, up to about m n = 20.
    Source: W17, Proposition 1; 002-06.
    """
    m, n = problem.n_agents, problem.n_states
    H = generic_error_matrix(problem, np.random.default_rng(seed))
    H = H / np.linalg.norm(H, 2)
    margins, verdicts, bad = [], [], []
    for p in range(m):
        B = np.kron(np.eye(m)[:, [p]], np.eye(n))
        blocks = [B]
        for _ in range(m - 1):
            blocks.append(H @ blocks[-1])
        values = la.svdvals(np.hstack(blocks))
        margins.append(float(values[-1] / values[0]))
        for q, C in channels(problem, p):
            verdict = pair_margin(H, C).verdict
            verdicts.append(verdict)
            bad += [(p, q)] if verdict is False else []
    observable = False if bad else None if None in verdicts else True
    full = min(margins) > m * n * 2.0**-50
    return Proposition1(m if full else None, min(margins), observable, tuple(bad))


def krylov_factor(A: FloatArray, m: int) -> FloatArray:
    """T (m n, m n), block triangular, with ``[G, H G, ..., H^{m-1} G] = [g (x) I, ..., (F^{m-1} g) (x) I] T``.

    For ``H = I (x) A + F (x) I`` and ``G = g (x) I``, whatever F (m, m) and g: block (i, k) is ``C(k, i) A^{k-i}``.
    Args: ``A`` (n, n) and ``m``. Source: W17, Lemma 3, equation (26); 002-13.
    """
    n = A.shape[0]
    T = np.zeros((m, n, m, n))
    powers = [np.linalg.matrix_power(A, k) for k in range(m)]
    for k in range(m):
        for i in range(k + 1):
            T[i, :, k, :] = comb(k, i) * powers[k - i]
    return T.reshape(m * n, m * n)


def generic_error_matrix(problem: SharedPlant, rng: np.random.Generator) -> FloatArray:
    """H of W17 (11) with drawn gains: block (i, i) ``A - K_i C_i - sum F_ij``, block (i, j) ``F_ij``."""
    m, n = problem.n_agents, problem.n_states
    H = np.zeros((m, n, m, n))
    for i, (C, heard) in enumerate(zip(problem.outputs, problem.hears, strict=True)):
        H[i, :, i, :] += problem.A - rng.normal(size=(n, C.shape[0])) @ C
        for j in heard:
            F = rng.normal(size=(n, n))
            H[i, :, j, :] += F
            H[i, :, i, :] -= F
    return H.reshape(m * n, m * n)


def channels(problem: SharedPlant, p: int) -> list[tuple[int, FloatArray]]:
    """Channels (q, C_pq) of agent p: differences to those it hears, and its own output where that is not zero."""
    m, n = problem.n_agents, problem.n_states
    eye = np.eye(m)
    found = [(q, np.kron(eye[q] - eye[p], np.eye(n)).reshape(n, m * n)) for q in problem.hears[p]]
    if problem.outputs[p].any():
        found.append((p, np.kron(eye[[p]], problem.outputs[p])))
    return found
