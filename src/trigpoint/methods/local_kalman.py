"""``LocalKalman``: a local filter on each node, coupled with one gain (G16, Steps 1 and 2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.analysis.eigenvalue import EigenvalueBound
from trigpoint.analysis.modes import computed_abscissa, guaranteed_rate
from trigpoint.analysis.pairs import pair_margin
from trigpoint.analysis.thresholds import lmi_threshold, stable_gains
from trigpoint.arrays import FloatArray, as_matrix, frozen
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.equations import filter_riccati, filter_riccati_residual
from trigpoint.methods.base import Method
from trigpoint.methods.gains import FromGraph, GainChoice, GainRule
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers.network import DiffusiveObserver

_NAME = "LocalKalman"
_EXACT_STATES = 8


@dataclass(frozen=True, eq=False)
class LocalKalman(Method):
    """Network-decentralized observer: the local Kalman gain of one agent, times one coupling gain.

    Step 1: ``A Q + Q A' - Q C' R^{-1} C Q + S = 0``, local gain ``Q C' R^{-1}``. Step 2:
    ``z_i' = A z_i + B u_i + gamma Q C' R^{-1} (sum of the node's arc innovations)``.

    Args:
        gain: rule for gamma; ``FromGraph(1.05)`` unless given.
        process: (n, n) process noise covariance S; ``E E'`` unless given, the identity where the agent has no E.
        measurement: (p, p) measurement covariance R; the identity unless given.
        P: (n, n) matrix with ``A' P + P A - 2 C' R^{-1} C < 0`` (G16, (8)) instead of the Riccati solution.

    We assume:
        * equal agents (G16, Assumption 1) and (A, C) detectable (Assumption 2);
        * every node has a path to an external arc, or A is Hurwitz (Theorem 3: otherwise no observer exists).

    Raises:
        MethodError: one of these does not hold.

    Guarantee: the error decays at least at ``decay_rate`` for every network whose ``lambda_min`` is at least the one
    the gain was chosen for. ``gamma > 1 / lambda_min`` always suffices (Theorem 4); ``A = 0`` needs only gamma > 0
    (Proposition 6). Cost: one smallest eigenvalue and O(n^3).

    Source: G16, equations (8)-(10), Theorems 3, 4, 6, 7, Proposition 6.
    """

    label: ClassVar[str] = "local-kalman"

    gain: GainRule = FromGraph()  # noqa: RUF009 (a frozen value)
    process: FloatArray | None = None
    measurement: FloatArray | None = None
    P: FloatArray | None = None

    def __init__(
        self,
        gain: GainRule | None = None,
        process: ArrayLike | None = None,
        measurement: ArrayLike | None = None,
        P: ArrayLike | None = None,
    ) -> None:
        if gain is not None and not isinstance(gain, GainRule):
            hint = f"write Fixed({gain})" if isinstance(gain, (int, float)) else "write FromGraph(), with parentheses"
            raise ArgumentError(
                f"gain must be FromGraph(), WorstCase(max_nodes), Family(graphs) or Fixed(gamma); got {gain!r}; {hint}"
            )
        object.__setattr__(self, "gain", FromGraph() if gain is None else gain)
        object.__setattr__(self, "process", None if process is None else as_matrix("process", process))
        object.__setattr__(self, "measurement", None if measurement is None else as_matrix("measurement", measurement))
        object.__setattr__(self, "P", None if P is None else as_matrix("P", P))

    def build(self, problem: Any) -> DiffusiveObserver:
        """Return the observer, or raise ``MethodError``."""
        agent = self._accepted(problem)
        measurement = self._covariance("measurement", self.measurement, np.eye(agent.n_outputs), definite=True)
        information = agent.C.T @ la.solve(measurement, agent.C, assume_a="pos")
        Q, facts = self._local_filter(agent, measurement, information)
        injection = la.solve(measurement, agent.C @ Q, assume_a="pos").T
        bound = smallest_eigenvalue(problem.graph)
        self._check_anchored(problem, agent, bound)
        choice = self.gain.choose(problem.graph, bound)
        return DiffusiveObserver(
            method=self.label,
            problem=problem,
            injection=frozen(injection),
            gain=choice.gain,
            decay_rate=guaranteed_rate(agent.A, Q, information, choice.gain * bound.lower),
            spectral_abscissa=computed_abscissa(
                problem.graph, agent.A, injection, agent.C, choice.gain, bound.value
            ),
            facts={
                **facts,
                **_gain_facts(agent, Q, information, choice, bound),
                **_thresholds(agent, Q, information, injection, bound),
            },
        )  # fmt: skip

    def _accepted(self, problem: Any) -> LinearAgent:
        if not isinstance(problem, NetworkedAgents):
            raise MethodError(
                _NAME, "a NetworkedAgents problem", type(problem).__name__, "Write NetworkedAgents(graph, agent)."
            )
        if not problem.is_homogeneous:
            raise MethodError(
                _NAME, "equal agents (G16, Assumption 1)", "agents with different A or C", "Give all nodes one agent."
            )
        agent = problem.agent
        unstable = pair_margin(agent.A, agent.C, unstable_only=True)
        if unstable.verdict is not True:
            state = "not" if unstable.verdict is False else f"within {unstable.margin:.1e} (relative) of not"
            raise MethodError(
                _NAME,
                "(A, C) detectable (G16, Assumption 2)",
                f"a pair that is {state} detectable at s = {unstable.mode:.6g}",
                "Measure something that this mode moves.",
            )
        if problem.graph.dimension > 1 and self.measurement is not None:
            raise MethodError(
                _NAME,
                "either weight blocks or a measurement covariance",
                "both",
                "The blocks are the inverse covariances already: leave measurement out.",
            )
        return agent

    def _covariance(self, name: str, given: FloatArray | None, default: FloatArray, *, definite: bool) -> FloatArray:
        matrix = default if given is None else given
        symmetric = matrix.shape == default.shape and np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0)
        least = float(np.linalg.eigvalsh(matrix)[0]) if symmetric else -np.inf
        size = float(np.abs(matrix).max(initial=0.0))
        if not symmetric or (least <= 0.0 if definite else least < -1e-12 * size):
            kind = "positive definite" if definite else "positive semidefinite"
            raise MethodError(
                _NAME,
                f"{name} symmetric {kind} of shape {default.shape}",
                f"{np.array2string(matrix, precision=4, threshold=9)}",
                "Check the units and the order of the states.",
            )
        return matrix

    def _local_filter(
        self, agent: LinearAgent, measurement: FloatArray, information: FloatArray
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Step 1: Q, and the residual of the equation that it solves."""
        if self.P is not None:
            P = self._covariance("P", self.P, np.eye(agent.n_states), definite=True)
            margin = float(np.linalg.eigvalsh(2.0 * information - agent.A.T @ P - P @ agent.A)[0])
            if not margin > 0.0:
                raise MethodError(
                    _NAME,
                    "A' P + P A - 2 C' R^-1 C < 0 (G16, equation (8))",
                    f"a matrix whose largest eigenvalue is {-margin:.3g}",
                    "Leave P out to use the Riccati solution.",
                )
            return la.cho_solve(la.cho_factor(P), np.eye(agent.n_states)), {"local_filter": "given P (8)"}
        entry = np.eye(agent.n_states) if agent.E is None else agent.E
        process = self._covariance("process", self.process, entry @ entry.T, definite=False)
        try:
            Q = filter_riccati(agent.A, agent.C, process, measurement)
            la.cholesky(Q)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise MethodError(
                _NAME,
                "process noise that reaches every mode, so that the Riccati solution is positive definite",
                f"{error}",
                "Give a positive definite process covariance.",
            ) from error
        residual = filter_riccati_residual(agent.A, agent.C, process, measurement, Q)
        return Q, {"local_filter": "Riccati (17)", "riccati_residual": residual}

    def _check_anchored(self, problem: NetworkedAgents, agent: LinearAgent, bound: EigenvalueBound) -> None:
        """Theorem 3: without a path to an anchor there is no observer unless A is Hurwitz."""
        if bound.unanchored.size and not _is_clearly_hurwitz(agent):
            names = [problem.graph.names[k] for k in bound.unanchored[:8].tolist()]
            more = f" and {bound.unanchored.size - 8} more" if bound.unanchored.size > 8 else ""
            raise MethodError(
                _NAME,
                "a path from every node to an external arc, since A is not Hurwitz (G16, Theorem 3)",
                f"no such path from {', '.join(names)}{more}",
                "Add an absolute reading there; diagnose() lists the islands.",
            )


def _is_clearly_hurwitz(agent: LinearAgent) -> bool:
    """Real parts below zero by more than rounding, as in ``diagnose``: an oscillator's computed ones may be -1e-17."""
    size = float(np.linalg.norm(np.vstack([agent.A, agent.C]), 2))
    return bool(np.linalg.eigvals(agent.A).real.max() < -1e-9 * size)


def _thresholds(
    agent: LinearAgent, Q: FloatArray, information: FloatArray, injection: FloatArray, bound: EigenvalueBound
) -> Mapping[str, Any]:
    """How much smaller the gain could be (E-000-12): the bound for this very Q, and the exact one for a fixed graph."""
    if bound.lower <= 0.0:
        return {}
    exact = stable_gains(agent.A, injection, agent.C).threshold if agent.n_states <= _EXACT_STATES else None
    return {
        "gain_bound_for_this_filter": lmi_threshold(agent.A, Q, information) / bound.lower,
        "gain_threshold_exact": None if exact is None else exact / bound.value,
    }


def _gain_facts(
    agent: LinearAgent, Q: FloatArray, information: FloatArray, choice: GainChoice, bound: EigenvalueBound
) -> Mapping[str, Any]:
    floor = choice.lambda_floor
    return {
        "gain_rule": choice.text,
        "gain_bound": None if bound.lower <= 0.0 else 1.0 / bound.lower,
        "lambda_min": bound.value,
        "lambda_min_lower": bound.lower,
        "lambda_min_upper": bound.upper,
        "lambda_floor": floor,
        "decay_rate_at_floor": guaranteed_rate(agent.A, Q, information, choice.gain * floor),
        "driftless": agent.is_static,
        "Q": frozen(Q),
    }
