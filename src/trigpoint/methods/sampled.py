"""``Sampled`` and ``DiscreteKalman``: exchange at instants, with the period's limit checked over the whole spectrum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.analysis.modes import largest_eigenvalue_bound
from trigpoint.analysis.sampling import SampledMode, period_limit, sampled_mode, sampled_stability
from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.interval_stability import IntervalVerdict
from trigpoint.methods.base import Method
from trigpoint.methods.local_kalman import LocalKalman
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.network import DiffusiveObserver

Form = Literal["held", "euler", "innovation-held"]
_NAME = "Sampled"
_WHOLE_LIMIT = 1500


@dataclass(frozen=True, eq=False)
class Sampled(Method):
    """A design for continuous exchange, run with one exchange every ``period`` seconds.

    Args:
        period: h, seconds.
        form: ``held`` (neighbours' values held, the own one exact: for constants stable for every h, 6-F2),
            ``euler`` (``e+ = (I + h H) e``) or ``innovation-held`` (``e^{A h} - gain lambda int e^{A s} ds K C``).
        base: the design for continuous exchange; ``LocalKalman()`` unless given.

    We assume:
        * what ``base`` assumes; every message arrives; scalar arc weights for ``euler`` and ``innovation-held``.

    Raises:
        MethodError: the period is beyond the limit for some eigenvalue between the bounds of ``lambda_min`` and
            ``lambda_max``; the message names the limit. Undecided cases are refused, too, and say so.

    Guarantee: ``decay_rate`` is proved for every eigenvalue of the interval (``euler``, ``innovation-held``); the form
    ``held`` is proved stable for constants only, and its rate is computed, not guaranteed.
    Source: theory 6-F1, 6-F2, 6-F7.
    """

    label: ClassVar[str] = "sampled"

    period: float = 1.0
    form: Form = "held"
    base: Method = LocalKalman()  # noqa: RUF009 (a frozen value)

    def __post_init__(self) -> None:
        """Check period and form."""
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise ArgumentError(f"period must be a positive number of seconds; got {self.period}")
        if self.form not in get_args(Form):
            raise ArgumentError(f"form must be one of {', '.join(get_args(Form))}; got {self.form!r}")

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer, or raise ``MethodError``."""
        designed = self.base.build(problem)
        if not isinstance(designed, DiffusiveObserver):
            raise MethodError(
                _NAME, "a base method for equal agents", type(designed).__name__, "Give LocalKalman(), Weighted(...)."
            )
        programs = designed.as_programs()
        nodes = tuple(replace(node, exchange=self.form, _memo={}) for node in programs.nodes)
        sampled = replace(programs, method=self.label, nodes=nodes, period=self.period)
        rate, facts = _held(sampled, designed) if self.form == "held" else self._interval(designed)
        abscissa = facts.pop("abscissa")
        return replace(sampled, decay_rate=rate, spectral_abscissa=abscissa, facts={**designed.facts, **facts})

    def _interval(self, designed: DiffusiveObserver) -> tuple[float, dict[str, Any]]:
        if designed.graph.dimension > 1:
            raise MethodError(_NAME, "scalar arc weights for this form", "weight blocks", "Use form='held'.")
        agent, ends = designed.agent, ends_of(designed)
        mode = sampled_mode(self.form, agent.A, designed.injection, agent.C, self.period)
        verdict = sampled_stability(mode, designed.gain, *ends)
        limit = period_limit(self.form, agent.A, designed.injection, agent.C, designed.gain, ends)
        if verdict.stable is not True:
            state = "unstable" if verdict.stable is False else "undecided (too close to the limit)"
            raise MethodError(
                _NAME,
                f"a period below {limit:.6g} s, where every eigenvalue in [{ends[0]:.6g}, {ends[1]:.6g}] is stable",
                f"{self.period:g} s, {state} at lambda = {verdict.at:.6g}",
                "Shorten the period, lower the gain, or use form='held' for constants.",
            )
        return _proved(mode, designed.gain, ends, self.period, verdict, {"form": self.form, "period_limit": limit})


def ends_of(observer: DiffusiveObserver) -> tuple[float, float]:
    """Rigorous bounds of the spectrum of the observer's generalized Laplacian."""
    return smallest_eigenvalue(observer.graph).lower, largest_eigenvalue_bound(observer.graph)


def _proved(
    mode: SampledMode,
    gain: float,
    ends: tuple[float, float],
    period: float,
    verdict: IntervalVerdict,
    facts: Mapping[str, Any],
) -> tuple[float, dict[str, Any]]:
    """The rate that the interval's proof carries: the computed one, less a thousandth or more where needed."""
    computed = -float(np.log(verdict.radius)) / period if verdict.radius > 0.0 else 0.0
    rate = 0.0
    for share in (0.999, 0.99, 0.9, 0.5):
        lift = float(np.exp(share * computed * period))
        if sampled_stability(SampledMode(mode.start.times(lift), mode.pull.times(lift)), gain, *ends).stable is True:
            rate = share * computed
            break
    return rate, {**facts, "spectral_radius": verdict.radius, "pieces": verdict.pieces, "abscissa": -computed}


def _held(sampled: AssembledObserver, designed: DiffusiveObserver) -> tuple[float, dict[str, Any]]:
    static = designed.agent.is_static and designed.graph.is_externally_connected
    radius = None
    if sampled.states.total <= _WHOLE_LIMIT:
        moved = sampled.error_map(sampled.period or 0.0).toarray()
        radius = float(np.abs(np.linalg.eigvals(moved)).max())
    if not static and (radius is None or radius >= 1.0):
        raise MethodError(
            _NAME,
            "a period for which the sampled error contracts",
            f"spectral radius {'not computed' if radius is None else format(radius, '.6g')} at {sampled.period:g} s",
            "Shorten the period.",
        )
    abscissa = None if radius is None else float(np.log(max(radius, 1e-300))) / (sampled.period or 1.0)
    stable = "for every period (theory 6-F2)" if static else "computed for this period"
    return 0.0, {"form": "held", "stable": stable, "spectral_radius": radius, "abscissa": abscissa}


@dataclass(frozen=True, eq=False)
class DiscreteKalman(Method):
    """Discrete-time agents ``x+ = A x``: one gain that is stable for every eigenvalue of the network.

    With the bounds l, u of the spectrum and ``delta = (u - l) / (u + l)`` the modified Riccati equation
    ``Q = A Q A' - (1 - delta^2) A Q C' (C Q C' + I)^{-1} C Q A' + S`` gives ``K = A Q C' (C Q C' + I)^{-1}``;
    the gain is ``2 / (l + u)``: ``A - gain lambda K C`` is Schur for all lambda in [l, u], which is then proved.

    Args:
        period: seconds between two exchanges (it only converts rates); A of the agents is the map over one period.
        process: (n, n) process noise covariance S; the identity unless given.

    We assume:
        * equal agents whose A is the discrete map; every node has a path to an anchor; scalar weights.

    Raises:
        MethodError: no such gain exists; for one output that is exactly ``prod |unstable eigenvalues| >= 1 / delta``.

    Source: You and Xie 2011, key YouXie2011; theory 6-F8.
    """

    label: ClassVar[str] = "discrete-kalman"

    period: float = 1.0
    process: FloatArray | None = None

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer, or raise ``MethodError``."""
        if not isinstance(problem, NetworkedAgents) or not problem.is_homogeneous or problem.graph.dimension > 1:
            raise MethodError(
                "DiscreteKalman",
                "equal agents and scalar weights",
                repr(problem),
                "Write NetworkedAgents(graph, agent).",
            )
        agent = problem.agent
        if not agent.A.any():
            raise MethodError(
                "DiscreteKalman",
                "an A that is the map over one period",
                "A = 0, after which every state is zero",
                "The map of constants is the identity: A = C = [[1.0]], in the [agent] table or in LinearAgent(A, C).",
            )
        bound = smallest_eigenvalue(problem.graph)
        ends = (bound.lower, largest_eigenvalue_bound(problem.graph))
        if ends[0] <= 0.0:
            raise MethodError(
                "DiscreteKalman", "a path from every node to an anchor", "an island", "Add an absolute reading there."
            )
        delta = (ends[1] - ends[0]) / (ends[1] + ends[0])
        growth = float(np.prod(np.maximum(np.abs(np.linalg.eigvals(agent.A)), 1.0)))
        K = _modified_riccati(agent.A, agent.C, np.eye(agent.n_states) if self.process is None else self.process, delta)
        gain = 2.0 / (ends[0] + ends[1])
        mode = sampled_mode("discrete", agent.A, np.zeros_like(agent.C.T) if K is None else K, agent.C, 1.0)
        verdict = sampled_stability(mode, gain, *ends)
        if K is None or verdict.stable is not True:
            raise MethodError(
                "DiscreteKalman",
                f"unstable eigenvalues whose product is below (kappa + 1) / (kappa - 1) = {1.0 / delta:.6g}",
                f"a product of {growth:.6g} with lambda in [{ends[0]:.6g}, {ends[1]:.6g}]",
                "Add anchors or arcs (a smaller kappa), or exchange more often.",
            )
        facts = {"existence": growth * delta, "gain_rule": "2 / (lambda_min + lambda_max) (theory 6-F8)"}
        rate, known = _proved(mode, gain, ends, self.period, verdict, facts)
        programs = DiffusiveObserver(self.label, problem, K, gain, rate, known.pop("abscissa"), known).as_programs()
        nodes = tuple(replace(node, exchange="discrete", _memo={}) for node in programs.nodes)
        return replace(programs, nodes=nodes)


def _modified_riccati(A: FloatArray, C: FloatArray, S: FloatArray, delta: float) -> FloatArray | None:
    """K of the modified Riccati equation by fixed-point iteration; None where it grows without bound."""
    Q, share = np.array(S), 1.0 - delta**2
    for _ in range(100_000):
        K = A @ Q @ C.T @ np.linalg.inv(C @ Q @ C.T + np.eye(C.shape[0]))
        after = A @ Q @ A.T - share * K @ C @ Q @ A.T + S
        after = 0.5 * (after + after.T)
        if not np.isfinite(after).all() or np.abs(after).max() > 1e15 * np.abs(S).max():
            return None
        if np.abs(after - Q).max() <= 1e-13 * np.abs(after).max():
            return np.asarray(A @ after @ C.T @ np.linalg.inv(C @ after @ C.T + np.eye(C.shape[0])))
        Q = after
    return None
