"""``CouplingGain``: every agent observes what it sees, and one gain on what it hears carries the rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from trigpoint.analysis.observability_split import ObservabilitySplit, observability_split
from trigpoint.analysis.shared_plant import agent_knowledge, diagnose_shared_plant
from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.linalg.injection import rate_injection
from trigpoint.methods.base import Method
from trigpoint.methods.coupling import CoupledPart
from trigpoint.model import SharedPlant
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver

_NAME = "CouplingGain"
_LOCAL = 1.5  # what an agent sees itself decays so much faster than what it is asked to reach
_LEAK = 1e-9
_DENSE = 1500


@dataclass(frozen=True)
class CouplingGain(Method):
    """Local observers for what each agent sees, one coupling gain for what it does not.

    ``z_i' = A z_i + B u + K_i (y_i - C_i z_i) + gamma U_i U_i' sum_j (z_j - z_i)``, the sum over the agents that i
    hears, U_i an orthonormal basis of what agent i does not see. With r > 0 a left null vector of the Laplacian L,
    ``mu = max_i lam_max(sym(U_i' A U_i))`` and ``lam = lam_min(U' ((R L + L' R) (x) I) U)``, the gain
    ``gamma >= 2 max(r) (mu + rate) / lam`` guarantees the ``rate``: the error is block triangular, the seen parts decay
    at 1.5 times the rate or faster by their own gains, and ``V = sum_i r_i |b_i|^2`` of the unseen parts falls.

    Args:
        rate: wanted decay, 1/s, positive.
        margin: factor on the least gain that the guarantee needs, at least 1.
        gain: gamma itself, instead of ``margin`` times the least one; the guarantee is then what this gain gives.
        tolerance: relative size of a singular value below which a direction counts as not seen by an agent. Raise it
            where agents see something weakly, which would ask for large gains.

    We assume:
        * each agent is reached by agents that together (with it) see the whole state, or all but motions that die out
          faster than ``rate``. This is also necessary, so that every digraph is served for which it is possible; one
          that is not strongly connected is taken component by component, each with its own r and lam;
        * A, B and who hears whom are known where the design is made; an agent is told its own gains only.

    Guarantee: ``|e(t)| <= c e^{-decay_rate t}``; ``decay_rate`` is ``rate``, or with ``gain`` given the smaller of it
    and what V proves. The bound concerns the programs in continuous time. With ``margin = 1`` exactly and more than one
    component the bound holds up to powers of t. Where a raised ``tolerance`` makes the decomposition inexact (``leak``
    above 1e-9) V proves nothing, and the rate rests on the computed spectrum; then it is refused where m n > 1500.

    Raises:
        ArgumentError: a rate, margin, gain or tolerance that makes no sense.
        MethodError: another kind of problem, agents that cannot know the state (named, with what they lack), or a rank
            that rounding decides.

    Cost: O(n^3) an agent, O(m^3) for r, one sparse smallest eigenvalue of order at most m n.
    Source: theory 4b-B1 (keys KimShimCho2016 and HanTrentelmanWangShen2019), theory 4.5; W17, equation (10).
    """

    label: ClassVar[str] = "coupling-gain"

    rate: float
    margin: float = 1.05
    gain: float | None = None
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (np.isfinite(self.rate) and self.rate > 0.0):
            raise ArgumentError(f"rate must be a positive number of 1/s; got {self.rate!r}")
        if not (np.isfinite(self.margin) and self.margin >= 1.0):
            raise ArgumentError(
                f"margin must be at least 1 (it multiplies the least sufficient gain); got {self.margin!r}"
            )
        if self.gain is not None and not (np.isfinite(self.gain) and self.gain >= 0.0):
            raise ArgumentError(f"gain must not be negative; got {self.gain!r}")
        if not 0.0 < self.tolerance < 1.0:
            raise ArgumentError(f"tolerance must lie between 0 and 1; got {self.tolerance!r}")

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer of ``problem``, or raise ``MethodError``."""
        if not isinstance(problem, SharedPlant):
            raise MethodError(
                _NAME, "a SharedPlant", type(problem).__name__, "Write SharedPlant(A, outputs, neighbours)."
            )
        basis, _ = _shown(problem, self.rate)
        splits = _splits(problem, basis, self.tolerance)
        injections = [self._injection(problem, basis, agent, split) for agent, split in enumerate(splits)]
        part = CoupledPart(basis.T @ problem.A @ basis, tuple(split.unseen for split in splits), problem.hears)
        gain = self._chosen(part)
        pulls = [gain * (basis @ split.unseen) @ (basis @ split.unseen).T for split in splits]
        nodes = tuple(_program(problem, agent, basis @ K, pulls[agent]) for agent, (K, _) in enumerate(injections))
        own = min(rate for _, rate in injections)
        decay = self.rate if self.gain is None else min(self.rate, part.rate(gain))
        facts = {
            "gain": gain,
            "least_gain": part.least_gain(self.rate) if self.gain is None else None,
            "tolerance": self.tolerance,
            "seen_rate": _finite(own),
            **_facts(part, splits, gain),
        }
        observer = AssembledObserver(self.label, problem, nodes, decay, None, facts)
        worst = max(splits, key=lambda split: split.leak)
        if problem.n_agents * problem.n_states <= _DENSE:
            observer = replace(observer, spectral_abscissa=spectral_abscissa(observer.error_matrix().toarray()))
        if worst.leak > _LEAK and not (observer.spectral_abscissa or 0.0) < -decay:
            raise _no_gap(splits.index(worst), worst)
        return observer

    def _chosen(self, part: CoupledPart) -> float:
        if self.gain is not None:
            return float(self.gain)
        gain = self.margin * part.needed_gain(self.rate)
        if not np.isfinite(gain):
            raise MethodError(
                _NAME,
                "agents that can learn from each other what they do not see (lam > 0)",
                f"lam = {part.strength:.3g}, zero to rounding",
                "Let more agents hear each other, or sense more.",
            )
        return gain

    def _injection(
        self, problem: SharedPlant, basis: FloatArray, agent: int, split: ObservabilitySplit
    ) -> tuple[FloatArray, float]:
        """``K_i = seen L_i`` in the coordinates of ``basis``, and the decay that it gives what the agent sees."""
        A = split.seen.T @ basis.T @ problem.A @ basis @ split.seen
        C = problem.outputs[agent] @ basis @ split.seen
        if not A.size:
            return np.zeros((basis.shape[1], C.shape[0])), np.inf
        try:
            L = rate_injection(A, C, _LOCAL * self.rate)
        except np.linalg.LinAlgError as error:
            raise self._too_weak(agent, split, str(error)) from error
        return np.asarray(split.seen @ L), -spectral_abscissa(A - L @ C)

    def _too_weak(self, agent: int, split: ObservabilitySplit, text: str) -> MethodError:
        return MethodError(
            _NAME,
            "directions that an agent sees clearly enough for its own observer",
            f"agent {agent} with a smallest relative singular value of {split.kept:.1e}: {text.removesuffix('.')}",
            "Raise the tolerance, so that others tell this agent of them, or rescale the states.",
        )


def coupling_margin(
    problem: SharedPlant, observer: AssembledObserver, hears: Mapping[int, Iterable[int]] | None = None
) -> float:
    """The rate that a ``CouplingGain`` observer still guarantees when another digraph says who hears whom.

    The gains stay; ``V = sum_i r_i |b_i|^2`` is taken with the left null vectors of the new digraph, component by
    component, and the exact extreme eigenvalue instead of the bound that chose the gain.

    Args:
        problem: the plant.
        observer: its observer, from ``CouplingGain``.
        hears: ``{i: [agents that i hears]}`` from now on; None for the problem's own.

    Returns:
        Guaranteed decay, 1/s, and 0 where nothing is guaranteed (nor with a leak above 1e-9, see ``CouplingGain``).

    We assume:
        * the digraph stays as it is then (a digraph that keeps changing needs one V for all).

    Raises ``ArgumentError`` for an observer of another method. Cost: one extreme eigenvalue of order at most m n.
    Source: theory 4b-B1.
    """
    if not isinstance(observer, AssembledObserver) or observer.method != CouplingGain.label:
        raise ArgumentError(f"observer must come from CouplingGain; got {observer!r}")
    heard = problem.hears if hears is None else SharedPlant(problem.A, problem.outputs, hears).hears
    gain, own = observer.facts["gain"], observer.facts["seen_rate"]
    basis, dying = _shown(problem, 0.0)
    splits = _splits(problem, basis, observer.facts["tolerance"])
    part = CoupledPart(basis.T @ problem.A @ basis, tuple(split.unseen for split in splits), heard)
    if max(split.leak for split in splits) > _LEAK:
        return 0.0
    return max(0.0, min(np.inf if own is None else own, dying, part.rate(gain)))


def link_loss_rates(problem: SharedPlant, observer: AssembledObserver) -> dict[tuple[int, int], float]:
    """What ``coupling_margin`` is when one single link is lost: ``{(hearing, heard): rate}`` for every link.

    Args:
        problem: the plant.
        observer: its observer, from ``CouplingGain``.

    Cost: one ``coupling_margin`` a link. Source: theory 4b-B1.
    """
    rates = {}
    for agent, others in enumerate(problem.hears):
        for lost in others:
            left = dict(enumerate(problem.hears)) | {agent: tuple(other for other in others if other != lost)}
            rates[agent, lost] = coupling_margin(problem, observer, left)
    return rates


def _shown(problem: SharedPlant, rate: float) -> tuple[FloatArray, float]:
    """Basis of what all agents can know, and the rate at which the rest dies out (inf without a rest); or refuse."""
    known = agent_knowledge(problem)
    if any(each.observable is None for each in known):
        raise _refusal(problem, "a state that the agents see clearly, or clearly do not", 0.0)
    n = problem.n_states
    lost = np.hstack([each.unobservable for each in known if each.unobservable.shape[1]] or [np.zeros((n, 0))])
    if not lost.shape[1]:
        return np.eye(n), np.inf
    left, values, _ = np.linalg.svd(lost)
    rank = int(np.sum(values > 1e-7))
    hidden, basis = left[:, :rank], left[:, rank:]
    dying = -spectral_abscissa(hidden.T @ problem.A @ hidden)
    if not dying > rate:
        raise _refusal(problem, "agents that are reached by others which together see the whole state", dying)
    return basis, dying


def _refusal(problem: SharedPlant, requirement: str, dying: float) -> MethodError:
    findings = diagnose_shared_plant(problem).findings[:4]
    got, remedy = (" ".join(getattr(finding, part) for finding in findings) for part in ("text", "remedy"))
    if dying > 0.0:
        got += f" It dies out at {dying:.4g} 1/s"
        remedy += f" Or ask for a rate below {dying:.4g} 1/s."
    return MethodError(_NAME, requirement, got.removesuffix("."), remedy)


def _splits(problem: SharedPlant, basis: FloatArray, tolerance: float) -> list[ObservabilitySplit]:
    A = basis.T @ problem.A @ basis
    return [observability_split(A, C @ basis, tolerance) for C in problem.outputs]


def _no_gap(agent: int, split: ObservabilitySplit) -> MethodError:
    return MethodError(
        _NAME,
        f"a clear gap between what an agent sees and what it does not (a leak below {_LEAK:g})",
        f"agent {agent} with relative singular values {split.kept:.1e} seen, {split.dropped:.1e} not seen, and a leak "
        f"of {split.leak:.1e} with which the computed spectrum misses the rate",
        "Choose a tolerance inside a wider gap, or rescale the states.",
    )


def _facts(part: CoupledPart, splits: list[ObservabilitySplit], gain: float) -> dict[str, Any]:
    return {
        "lam": _finite(part.strength),
        "mu": _finite(part.growth),
        "r": part.weights,
        "coupled_rate": _finite(part.rate(gain)),
        "stiffness": gain * part.spread,
        "components": len(part.components),
        "smallest_seen": _finite(min(split.kept for split in splits)),
        "largest_unseen": max(split.dropped for split in splits),
        "leak": max(split.leak for split in splits),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _program(problem: SharedPlant, agent: int, K: FloatArray, pull: FloatArray) -> LocalObserver:
    C, identity = problem.outputs[agent], np.eye(problem.n_states)
    arcs = [LocalArc(agent, None, 1.0, K, C, None)] if K.any() else []
    if pull.any():
        arcs += [LocalArc(None, str(other), 1.0, pull, identity, identity) for other in problem.hears[agent]]
    return LocalObserver(str(agent), problem.A, problem.B, tuple(arcs))
