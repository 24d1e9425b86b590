"""Step 3: ``A' P + P A - 2 gamma C' C < 0`` with a block-diagonal P, or a proof that there is none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.linalg.blocks import Ranges
from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.methods.heterogeneous.semidefinite import minimise, symmetric_basis

LARGEST = 60
"""States of a part up to which the inequality is tried: the solver's work grows with their sixth power."""

MODERATE = 1e3
"""A gamma up to this (A and the measurements of norm 1, P >= I) is one that a node can use."""

_RATES = (0.5, 0.2, 0.05, 0.01, 0.002)
_LIMITS = (30.0, MODERATE)
_CLEAR = 1e-7


@dataclass(frozen=True, eq=False)
class BlockInequality:
    """Outcome for (A, C), A of norm 1.

    Attributes:
        gain: L with the structure of C', or None where there is no P (or none was found).
        P: the block-diagonal P of the gain ``L = -gamma P^{-1} C'``, or None.
        gamma: its gamma; NaN without one.
        Z: (n, n) the certificate that no P exists: ``0 != Z >= 0``, ``C Z = 0``, ``(A Z + Z A')_ii >= 0``; or None.
        margin: largest t with ``(A Z + Z A')_ii >= t I`` for all i over the Z of trace 1: a P exists where it is
            negative; -inf where C leaves no room for a Z.
    """

    gain: FloatArray | None
    P: FloatArray | None
    gamma: float
    Z: FloatArray | None
    margin: float


def block_inequality(module: Any, A: FloatArray, C: FloatArray, states: Ranges) -> BlockInequality:
    """Find a block-diagonal ``P > 0`` with ``A' P + P A - 2 gamma C' C < 0``, or the certificate Z.

    On ker C = range N the strict inequality reads ``N' (A' P + P A) N < 0`` (Finsler), which is the dual of the search
    for Z = N W N'; one program decides between the two. A second one then looks for a small gain: gamma is minimised
    over ``P >= I`` and ``(A + a I)' P + P (A + a I) <= 2 gamma C' C``, for the largest rate a with a moderate gain.

    Args:
        module: the semidefinite engine.
        A: (n, n) block diagonal, of norm 1.
        C: (p, n) with rows of about norm 1.
        states: the blocks.

    Source: G16, Lemma 2, equation (6), and Theorem 2; E-000-13.
    """
    Z, margin, P = _alternative(module, A, C, states)
    if margin >= -_CLEAR:
        return BlockInequality(None, None, np.nan, Z if margin > _CLEAR else None, margin)
    found = [trial for trial in (_small_gain(module, A, C, states, rate) for rate in _RATES) if trial is not None]
    metric, gamma = _fastest_moderate(found) if found else _plain_gain(A, C, P)
    gain = -gamma * la.solve(metric, C.T, assume_a="pos")
    return BlockInequality(np.where(_pattern(C, states), gain, 0.0), metric, gamma, None, margin)


def _fastest_moderate(found: list[tuple[FloatArray, float]]) -> tuple[FloatArray, float]:
    """The first, fastest one of those with the least order of gamma."""
    for limit in _LIMITS:
        for trial in found:
            if trial[1] <= limit:
                return trial
    return min(found, key=lambda trial: trial[1])


def _pattern(C: FloatArray, states: Ranges) -> FloatArray:
    """1 where the block of C' of a row and an agent is not zero: inverting a block-diagonal P leaves rounding only."""
    mask = np.zeros(C.T.shape)
    for k in range(states.count):
        mask[states.slice(k)] = C[:, states.slice(k)].any(axis=1)
    return mask


def _alternative(
    module: Any, A: FloatArray, C: FloatArray, states: Ranges
) -> tuple[FloatArray | None, float, FloatArray]:
    """Z with its margin, and the P of the dual: Z is a certificate where the margin is positive, else P serves."""
    N = la.null_space(C) if C.shape[0] else np.eye(A.shape[0])
    if not N.shape[1]:
        return None, -np.inf, np.eye(A.shape[0])
    basis = symmetric_basis(N.shape[1])
    candidates = N @ basis @ N.T
    motion = A @ candidates
    motion = motion + motion.transpose(0, 2, 1)
    free = np.append(np.trace(basis, axis1=1, axis2=2), 0.0)
    cones = [(np.zeros((N.shape[1],) * 2), np.concatenate([basis, np.zeros((1, *basis.shape[1:]))]))]
    for k in range(states.count):
        own, n = states.slice(k), states.size(k)
        cones.append((np.zeros((n, n)), np.concatenate([motion[:, own, own], -np.eye(n)[None]])))
    cost = np.append(np.zeros(basis.shape[0]), -1.0)
    solution = minimise(module, cost, cones, free)
    W = np.tensordot(solution.x[:-1], basis, axes=1)
    values, vectors = la.eigh(W)
    kept = N @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    Z = kept @ kept.T / max(float((kept**2).sum()), 1e-300)
    P = np.asarray(la.block_diag(*solution.duals[1:]))
    exact = certificate_margin(A, Z, states)
    upper = float(la.eigvalsh(N.T @ (A.T @ P + P @ A) @ N)[-1]) if solution.solved else np.inf
    return Z, upper if upper < -_CLEAR else max(exact, -_CLEAR), P


def certificate_margin(A: FloatArray, Z: FloatArray, states: Ranges) -> float:
    """Smallest eigenvalue of the blocks of ``A Z + Z A'`` that belong to the agents in ``states``."""
    motion = A @ Z + Z @ A.T
    return min(float(la.eigvalsh(motion[states.slice(k), states.slice(k)])[0]) for k in range(states.count))


def _small_gain(
    module: Any, A: FloatArray, C: FloatArray, states: Ranges, rate: float
) -> tuple[FloatArray, float] | None:
    """P >= I and the smallest gamma for a rate, or None; accepted only where half the rate is really there."""
    shifted = A + rate * np.eye(A.shape[0])
    slopes = []
    for k in range(states.count):
        for entry in symmetric_basis(states.size(k)):
            slope = np.zeros(A.shape)
            slope[states.slice(k), states.slice(k)] = entry
            slopes.append(slope)
    metric = np.array(slopes)
    product = metric @ shifted
    nothing = np.zeros((1, *A.shape))
    pull = (2.0 * C.T @ C)[None]
    cones = [
        (np.zeros(A.shape), np.concatenate([-(product + product.transpose(0, 2, 1)), pull])),
        *_at_least_one(metric, nothing, states),
    ]
    solution = minimise(module, np.append(np.zeros(metric.shape[0]), 1.0), cones)
    if not solution.solved:
        return None
    P, gamma = np.tensordot(solution.x[:-1], metric, axes=1), 1.05 * float(solution.x[-1])
    if not gamma > 0.0 or la.eigvalsh(P)[0] < 0.5 or _excess(A + 0.5 * rate * np.eye(A.shape[0]), C, P, gamma) >= 0.0:
        return None
    return P, gamma


def _at_least_one(metric: FloatArray, nothing: FloatArray, states: Ranges) -> list[tuple[FloatArray, FloatArray]]:
    cones = []
    for k in range(states.count):
        own = states.slice(k)
        cones.append((-np.eye(states.size(k)), np.concatenate([metric[:, own, own], nothing[:, own, own]])))
    return cones


def _excess(A: FloatArray, C: FloatArray, P: FloatArray, gamma: float) -> float:
    """Largest eigenvalue of ``A' P + P A - 2 gamma C' C``."""
    return float(la.eigvalsh(A.T @ P + P @ A - 2.0 * gamma * C.T @ C)[-1])


def _plain_gain(A: FloatArray, C: FloatArray, P: FloatArray) -> tuple[FloatArray, float]:
    """The dual's P, lifted off the boundary, with a gamma doubled until the inequality holds."""
    metric = P / float(np.trace(P)) + 1e-6 * np.eye(P.shape[0])
    metric = metric / float(la.eigvalsh(metric)[0])
    gamma = 1.0
    for _ in range(60):
        if spectral_abscissa(A - gamma * la.solve(metric, C.T @ C, assume_a="pos")) < 0.0:
            break
        gamma *= 2.0
    return metric, gamma
