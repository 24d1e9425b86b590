"""Gains of a distributed observer of a shared plant, and its programs."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray, frozen
from trigpoint.linalg.injection import assigned_injection, spectrum_error
from trigpoint.methods.cascade.targets import matrix_with
from trigpoint.model import SharedPlant
from trigpoint.observers.local import Exchange, LocalArc, LocalObserver


@dataclass(frozen=True, eq=False)
class Gains:
    """``z_i' = A z_i + B u + K_i (y_i - C_i z_i) + sum_j F_ij (z_j - z_i)``.

    Attributes:
        couplings: {(i, j): F_ij (n, n)} for the heard agents that are used.
        injections: {i: K_i (n, s_i)} for the agents whose reading is used.
    """

    couplings: Mapping[tuple[int, int], FloatArray]
    injections: Mapping[int, FloatArray]

    @property
    def largest(self) -> float:
        """Largest 2-norm of all gains."""
        parts = [*self.couplings.values(), *self.injections.values()]
        return max((float(np.linalg.norm(part, 2)) for part in parts), default=0.0)

    def programs(self, problem: SharedPlant, exchange: Exchange = "held") -> tuple[LocalObserver, ...]:
        """One program an agent; what is not needed is not there."""
        eye = np.eye(problem.n_states)
        nodes = []
        for agent, (C, heard) in enumerate(zip(problem.outputs, problem.hears, strict=True)):
            arcs = [
                LocalArc(None, str(other), 1.0, frozen(self.couplings[agent, other]), eye, eye)
                for other in heard
                if (agent, other) in self.couplings
            ]
            if agent in self.injections:
                arcs.append(LocalArc(agent, None, 1.0, frozen(self.injections[agent]), C, None))
            nodes.append(LocalObserver(str(agent), problem.A, problem.B, tuple(arcs), exchange=exchange))
        return tuple(nodes)


def root_injection(A: FloatArray, C: FloatArray, targets: list[complex], seed: int = 0) -> FloatArray:
    """L (n_k, s) with the spectrum of ``A - L C`` as given, repeated targets included; the smallest found.

    Distinct targets by robust placement; always also by ``X A - F X = G C``, ``L = X^-1 G`` with F non-derogatory and
    drawn G (any observable pair, any list). Raises ``numpy.linalg.LinAlgError`` where nothing places them.
    """
    size = max(float(np.linalg.norm(A, 2)), max(abs(v) for v in targets), 1e-300)
    found = []
    with suppress(ValueError, np.linalg.LinAlgError):  # too many equal ones: the equation below takes them
        found.append(assigned_injection(A, C, np.array(targets)))
    F, rng = matrix_with(targets, joined=_repeats(targets)), np.random.default_rng(seed)
    for _ in range(12):
        G = rng.normal(size=(A.shape[0], C.shape[0]))
        try:
            X = la.solve_sylvester(-F, A, G @ C)
            found.append(np.linalg.solve(X, G))
        except (np.linalg.LinAlgError, ValueError):
            continue
    errors = [(spectrum_error(A - L @ C, np.array(targets)), float(np.linalg.norm(L, 2)), L) for L in found]
    good = [entry for entry in errors if np.isfinite(entry[1])]
    if not good:
        raise np.linalg.LinAlgError("no gain places these eigenvalues")
    least = min(entry[0] for entry in good)
    usable = [entry for entry in good if entry[0] <= max(10.0 * least, 1e-11 * size)]
    return np.asarray(min(usable, key=lambda entry: entry[1])[2])


def _repeats(targets: list[complex]) -> bool:
    values = np.array(targets)
    gaps = np.abs(values[:, None] - values[None, :]) + np.diag(np.full(len(targets), np.inf))
    return bool((gaps < 1e-6 * max(1.0, float(np.abs(values).max()))).any())
