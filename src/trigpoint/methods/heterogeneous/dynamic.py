"""Step 5: a stabiliser with states of its own at one agent, beside static gains at the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import BoolArray, FloatArray
from trigpoint.linalg.blocks import Ranges
from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.methods.heterogeneous.proof import lyapunov_solution

_DRAWS = 6


@dataclass(frozen=True, eq=False)
class Compensator:
    """``w' = D w + G C e`` at one agent, whose correction gains ``F w``: with L, ``e_k' = ... + L_k C e + F w``.

    Attributes:
        agent: position k of the agent in its part.
        D: (n, n) own dynamics.
        G: (n, p) what the measurements put in; zero columns for those that the agent does not read.
        F: (m_k, n) what it adds to the agent's correction.
    """

    agent: int
    D: FloatArray
    G: FloatArray
    F: FloatArray


def dynamic_stabiliser(
    A: FloatArray, C: FloatArray, mask: BoolArray, states: Ranges, start: FloatArray, seed: int
) -> tuple[FloatArray, Compensator] | None:
    """A structured L and a ``Compensator`` for (A, C) that make the error decay, or None.

    Static gains L at all agents make everything reachable and visible through one of them, which then stabilises it by
    a filter and a regulator (both with unit weights) for all n states. Tried: L = ``start``, -C' and seeded draws
    (``seed``) with zeros outside ``mask``, each agent of ``states`` in turn. The one with the least energy wins: the
    trace of X with ``H' X + X H = -I`` for the whole H, the integral of the squared error over all unit errors.

    A detectable part has no unstable decentralized fixed mode, so that a stabiliser exists in principle.

    Cost O(n^3) for each of eight L and each agent. Source: WangDavison1973, CorfmatMorse1976; theory 000-21.
    """
    best: tuple[float, FloatArray, Compensator] | None = None
    for gain in _static_gains(C, mask, start, seed):
        H = A + gain @ C
        for agent in range(states.count):
            made = _through(H, C, mask, states, agent)
            if made is None:
                continue
            X = lyapunov_solution(closed_loop(H, C, states, made))
            if X is not None and la.eigvalsh(X)[0] > 0.0 and (best is None or np.trace(X) < best[0]):
                best = (float(np.trace(X)), gain, made)
    return None if best is None else best[1:]


def _static_gains(C: FloatArray, mask: BoolArray, start: FloatArray, seed: int) -> Iterator[FloatArray]:
    rng = np.random.default_rng(seed)
    yield start
    yield np.where(mask, -C.T, 0.0)
    for _ in range(_DRAWS):
        yield np.where(mask, rng.normal(size=mask.shape) * 2.0 ** rng.uniform(-2.0, 1.0), 0.0)


def _through(H: FloatArray, C: FloatArray, mask: BoolArray, states: Ranges, agent: int) -> Compensator | None:
    own = states.slice(agent)
    n = H.shape[0]
    B = np.eye(n)[:, own]
    read = np.asarray(mask[own].any(axis=0))
    seen = np.where(read[:, None], C, 0.0)
    try:
        X = la.solve_continuous_are(H, B, np.eye(n), np.eye(B.shape[1]))
        Q = la.solve_continuous_are(H.T, seen.T, np.eye(n), np.eye(C.shape[0]))
    except (np.linalg.LinAlgError, ValueError):
        return None
    F, G = -B.T @ X, np.where(read, Q @ seen.T, 0.0)
    D = H + B @ F - G @ seen
    if not (np.isfinite(F).all() and np.isfinite(G).all()):
        return None
    made = Compensator(agent, D, G, F)
    return made if spectral_abscissa(closed_loop(H, C, states, made)) < 0.0 else None


def closed_loop(H: FloatArray, C: FloatArray, states: Ranges, made: Compensator) -> FloatArray:
    """Dynamics of (e, w): ``[[H, B F], [G C, D]]``, for the part with dynamics H = A + L C and agents ``states``."""
    B = np.eye(H.shape[0])[:, states.slice(made.agent)]
    return np.block([[H, B @ made.F], [made.G @ C, made.D]])
