"""``Weighted``: arcs count by their precision, so that the network settles on the best linear unbiased estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_floats
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.methods.base import Method
from trigpoint.methods.gains import FromGraph, GainRule
from trigpoint.methods.local_kalman import LocalKalman
from trigpoint.model import NetworkedAgents
from trigpoint.observers.network import DiffusiveObserver

_NAME = "Weighted"


@dataclass(frozen=True, eq=False)
class Weighted(Method):
    """Network-decentralized observer whose arcs have the weights ``W_k = R_k^{-1}``.

    For constants ``z_i' = gain sum of R_k^{-1} (innovation)`` settles at ``(G R^{-1} G')^{-1} G R^{-1} y``, the
    weighted least-squares answer, whose covariance ``(G R^{-1} G')^{-1}`` no other weights undercut (Gauss-Markov).

    Args:
        covariance: (M,) variances or (M, d, d) covariances of the arcs' readings.
        gain: rule for the coupling gain; ``FromGraph(1.05)`` of the weighted graph unless given.

    We assume:
        * equal agents, as ``LocalKalman``, which does the rest with the weighted graph; readings independent of each
          other; d the number of outputs.

    Raises:
        MethodError: covariances that are not one an arc, or what ``LocalKalman`` refuses.

    Source: theory 7-H3 (BLUE); G16, Section 5.1 for unit weights.
    """

    label: ClassVar[str] = "weighted"

    covariance: FloatArray | None = None
    gain: GainRule = FromGraph()  # noqa: RUF009 (a frozen value)

    def __init__(self, covariance: ArrayLike, gain: GainRule | None = None) -> None:
        given = as_floats("covariance", covariance)
        if given.ndim not in (1, 3) or (given.ndim == 3 and given.shape[1] != given.shape[2]):
            raise ArgumentError(f"covariance must be (M,) variances or (M, d, d) blocks; got shape {given.shape}")
        blocks = given.reshape(-1, 1, 1) if given.ndim == 1 else given
        symmetric = np.allclose(blocks, np.swapaxes(blocks, 1, 2), rtol=1e-12, atol=0.0)
        if not symmetric or (np.linalg.eigvalsh(blocks) <= 0).any():
            raise ArgumentError("every covariance must be symmetric positive definite (exact readings are known marks)")
        object.__setattr__(self, "covariance", given)
        object.__setattr__(self, "gain", FromGraph() if gain is None else gain)

    def build(self, problem: Any) -> DiffusiveObserver:
        """Return the observer, or raise ``MethodError``."""
        if not isinstance(problem, NetworkedAgents):
            raise MethodError(
                _NAME, "a NetworkedAgents problem", type(problem).__name__, "Write NetworkedAgents(graph, agent)."
            )
        covariance = np.asarray(self.covariance)
        shapes = ((problem.graph.n_arcs,), (problem.graph.n_arcs, problem.n_outputs, problem.n_outputs))
        if covariance.shape not in shapes:
            raise MethodError(
                _NAME, f"one covariance an arc, shape {shapes[0]} or {shapes[1]}", f"{covariance.shape}", "See C."
            )
        weight = 1.0 / covariance if covariance.ndim == 1 else _inverses(covariance)
        observer = LocalKalman(gain=self.gain).build(
            NetworkedAgents(problem.graph.with_weight(weight), problem.agents)
        )  # fmt: skip
        return DiffusiveObserver(
            self.label, observer.problem, observer.injection, observer.gain, observer.decay_rate,
            observer.spectral_abscissa, observer.facts,
        )  # fmt: skip


def _inverses(blocks: FloatArray) -> FloatArray:
    inverse = np.linalg.inv(blocks)
    return np.asarray(0.5 * (inverse + np.swapaxes(inverse, 1, 2)))
