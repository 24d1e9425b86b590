"""The verbs ``certify`` and ``verify``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trigpoint.arrays import at_least, at_most, digest_of, exactly
from trigpoint.certificates.base import Claim
from trigpoint.certificates.convergence import Convergence
from trigpoint.certificates.covariance import CovarianceBound
from trigpoint.certificates.delay import DelayMargin
from trigpoint.certificates.locality import Locality
from trigpoint.certificates.mean_square import MeanSquareStability
from trigpoint.certificates.noise import NoiseBudget
from trigpoint.certificates.observable import Observable
from trigpoint.certificates.sampled import SampledStability
from trigpoint.certificates.smallest_eigenvalue import SmallestEigenvalue
from trigpoint.certificates.switching import SwitchingStability
from trigpoint.errors import ArgumentError, ProtocolError
from trigpoint.model import NetworkedAgents
from trigpoint.model.documents import problem_document
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import Certificate, ClaimRecord, Outcome
from trigpoint.observers.documents import observer_document
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

CLAIMS: tuple[type[Claim], ...] = (
    SmallestEigenvalue,
    Convergence,
    Locality,
    SwitchingStability,
    SampledStability,
    DelayMargin,
    MeanSquareStability,
    NoiseBudget,
    CovarianceBound,
    Observable,
)

_LOWER = {"lower", "rate", "lambda_floor", "delay", "mu", "process", "measurement", "ceiling"}
_UPPER = {"upper", "factor", "per_node", "worst", "total", "floor"}
_USED = {"lambda_floor"}  # a proved fact, whatever becomes of the claim


@dataclass(frozen=True)
class Verdict:
    """The outcome of checking a certificate again: the worst of its claims, and each claim's own outcome.

    Attributes:
        outcome: refuted before inconclusive before certified.
        claims: name and outcome of each claim.
        numbers: the numbers that each outcome is about; the sentences of the file say what its author liked.
    """

    outcome: Outcome
    claims: tuple[tuple[str, Outcome], ...]
    numbers: tuple[Mapping[str, float], ...] = ()

    def summary(self) -> str:
        """One line a claim, with the numbers that were checked, bounds rounded to the safe side."""
        numbers = [*self.numbers, *({},) * (len(self.claims) - len(self.numbers))]
        stated = [
            ", ".join(f"{key} {_bound(key, value, outcome)}" for key, value in known.items())
            for (_, outcome), known in zip(self.claims, numbers, strict=True)
        ]
        lines = zip(self.claims, stated, strict=True)
        return "\n".join(f"{outcome}: {name}{f' ({text})' if text else ''}" for (name, outcome), text in lines)


def _bound(key: str, value: float, outcome: Outcome) -> str:
    """A number as text: of what is proved the weaker side, of what is refuted the stronger one, any other exactly."""
    if key not in _LOWER | _UPPER:
        return exactly(value)
    return at_most(value) if (key in _UPPER) != (outcome == "refuted" and key not in _USED) else at_least(value)


def certify(problem: Problem, observer: NetworkObserver, claims: Sequence[Claim] | None = None) -> Certificate:
    """Prove claims about ``observer``; those of ``CLAIMS`` that concern it unless ``claims`` names some.

    Args:
        problem: what is estimated.
        observer: the design to judge; nothing of the design's own conclusions is trusted.
        claims: claims with their numbers, for example ``[Convergence(rate=0.5)]``.

    Raises:
        ArgumentError: the observer belongs to another problem.
    """
    problem_text, observer_text = _digests(problem, observer)
    chosen = [kind() for kind in CLAIMS if kind.concerns(observer)] if claims is None else list(claims)
    if not chosen:
        raise ArgumentError("claims must hold at least one claim")
    return Certificate(problem_text, observer_text, tuple(claim.check(problem, observer) for claim in chosen))


def verify(certificate: Certificate, problem: Problem, observer: NetworkObserver) -> Verdict:
    """Check every claim of ``certificate`` again, from its witness alone.

    Args:
        certificate: what somebody handed out.
        problem: the problem it names by digest.
        observer: the observer it names by digest.

    Raises:
        ProtocolError: a digest does not match, a claim is unknown or states other assumptions than it has, a witness is
            missing or has the wrong shape.
    """
    problem_text, observer_text = _digests(problem, observer)
    for what, ours, theirs in (
        ("problem", problem_text, certificate.problem_digest),
        ("observer", observer_text, certificate.observer_digest),
    ):
        if ours != theirs:
            raise ProtocolError(f"the certificate is for another {what}: digest {theirs[:12]}..., not {ours[:12]}...")
    known = {kind.name: kind for kind in CLAIMS}
    outcomes = []
    for record in certificate.records:
        if record.claim not in known:
            raise ProtocolError(f"unknown claim {record.claim!r}; known are {', '.join(sorted(known))}")
        if record.assumptions != known[record.claim].assumptions:
            raise ProtocolError(f"the claim {record.claim!r} states other assumptions than it has")
        _speaks_of_its_own(record, known[record.claim])
        outcomes.append((record.claim, known[record.claim].verify(record, problem, observer)))
    found = {outcome for _, outcome in outcomes}
    worst: Outcome = "refuted" if "refuted" in found else "inconclusive" if "inconclusive" in found else "certified"
    return Verdict(worst, tuple(outcomes), tuple(record.numbers for record in certificate.records))


def _speaks_of_its_own(record: ClaimRecord, kind: type[Claim]) -> None:
    """What is not checked must not be shown beside what is."""
    strange = sorted(set(record.numbers) - set(kind.quantities))
    if strange:
        allowed = ", ".join(kind.quantities) or "none"
        raise ProtocolError(f"the claim {record.claim!r} has no number {strange[0]!r}; its numbers are: {allowed}")


def _digests(problem: Problem, observer: NetworkObserver) -> tuple[str, str]:
    document = observer_document(observer)
    judged = problem_document(_with_the_observers_weights(problem, observer))
    if digest_of(document["problem"]) != digest_of(judged):
        raise ArgumentError("the observer was designed for another problem")
    return digest_of(problem_document(problem)), digest_of(document)


def _with_the_observers_weights(problem: Problem, observer: NetworkObserver) -> Problem:
    """Arc weights are the observer's choice (precisions, optimal weights), not the problem's."""
    if not isinstance(observer, DiffusiveObserver) or not isinstance(problem, NetworkedAgents):
        return problem
    graph, weight = problem.graph, observer.graph.weight
    if weight is None or weight.shape[0] != graph.n_arcs or weight is graph.weight:
        return problem
    return NetworkedAgents(graph.with_weight(weight), problem.agents)
