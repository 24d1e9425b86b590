"""``ProjectedConsensus``: local observers, and at every event some rounds of projected averaging."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import networkx as nx
import numpy as np
import scipy.linalg as la

from trigpoint.analysis.observability_split import ObservabilitySplit, observability_split
from trigpoint.analysis.shared_plant import agent_knowledge, diagnose_shared_plant
from trigpoint.arrays import frozen
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.injection import rate_injection
from trigpoint.methods.base import Method
from trigpoint.methods.contraction import Contraction
from trigpoint.model import SharedPlant
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.observers.projected import ProjectedConsensusObserver, averaging_matrix
from trigpoint.observers.projection import ProjectionProgram

_NAME = "ProjectedConsensus"
_LEAK = 1e-9
_DENSE = 1500
_MOST_ROUNDS = 1 << 20
_MOST_DECAY = 500.0


@dataclass(frozen=True)
class ProjectedConsensus(Method):
    """A hybrid observer: what an agent sees it observes continuously; the rest comes by rounds of averaging.

    ``w_i' = (seen' A seen - L_i C_i seen) w_i + L_i y_i`` and ``x_i' = A x_i`` between events; every ``period`` seconds
    ``rounds`` times ``x_i <- P_i (average of x over i and those it hears) + seen_i w_i``, ``P_i = I - seen_i seen_i'``.
    With S the averaging matrix, the unseen parts of the error move by ``E (P (S (x) I) P)^rounds`` from event to event,
    ``E = I (x) e^{A period}``; its norm N gives the rate ``-ln(N) / period``.

    Args:
        rate: wanted decay, 1/s, positive.
        period: seconds between two events.
        rounds: rounds at each event; None for the fewest that reach the rate by the norm condition.
        graphs: further digraphs, each ``{i: [agents that i hears]}``, that may be in force instead of the problem's
            own: any of them at any event, the same during the rounds of one event.
        local_rate: decay of the local observers, 1/s; 1.5 times ``rate`` unless given.

    We assume:
        * all agents together see the whole state, and each of the digraphs is strongly connected;
        * events and rounds are made by all agents together.

    Guarantee: at events ``|e| <= c e^{-decay_rate t}`` whatever order the digraphs come in, since one norm serves them
    all: the largest row sum of the blocks' 2-norms, or, where they share a left null vector r of ``S - I``, the 2-norm
    weighted by r, whichever gives more. ``decay_rate`` is the smallest of ``rate``, ``local_rate`` and what the norm
    gives; not positive where given ``rounds`` do not suffice.

    Raises:
        ArgumentError: a rate, period or number of rounds that makes no sense.
        MethodError: another kind of problem, agents that cannot know the state (named, with what they lack), a digraph
            that is not strongly connected, a rank that rounding decides, or more than 1e6 rounds.

    Cost: O((m n)^3 log(rounds)) a digraph. Source: theory 4b-B3.
    """

    label: ClassVar[str] = "projected-consensus"

    rate: float
    period: float
    rounds: int | None = None
    graphs: tuple[Mapping[int, Iterable[int]], ...] = ()
    local_rate: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name, value in (("rate", self.rate), ("period", self.period), ("local_rate", self.own_rate)):
            if not (np.isfinite(value) and value > 0.0):
                raise ArgumentError(f"{name} must be positive and finite; got {value!r}")
        if self.rate * self.period > _MOST_DECAY:
            raise ArgumentError(
                f"rate * period = {self.rate * self.period:.4g} asks the error to fall below what a number can hold "
                f"within one period; expected at most {_MOST_DECAY:g}: shorten the period"
            )
        if self.rounds is not None and (type(self.rounds) is not int or self.rounds < 1):
            raise ArgumentError(f"rounds must be a whole number of at least 1; got {self.rounds!r}")

    @property
    def own_rate(self) -> float:
        """Decay asked of the local observers, 1/s."""
        return 1.5 * self.rate if self.local_rate is None else self.local_rate

    def build(self, problem: Any) -> ProjectedConsensusObserver:
        """Return the observer of ``problem``, or raise ``MethodError``."""
        family = self._accepted(problem)
        splits = _splits(problem)
        nodes = tuple(self._program(problem, agent, split) for agent, split in enumerate(splits))
        projections = [split.unseen @ split.unseen.T for split in splits]
        shrink = Contraction(
            la.expm(problem.A * self.period), projections, [averaging_matrix(graph).toarray() for graph in family]
        )
        rounds = self._chosen(shrink)
        coupled = shrink.rate(rounds, self.period)
        facts = {
            "rounds": rounds,
            "period": self.period,
            "local_rate": self.own_rate,
            "contraction": shrink.one_round,
            "spectral_radius": shrink.spectral_radius,
            "coupled_rate": coupled if np.isfinite(coupled) else None,
            "predicted_rate": min(self.own_rate, coupled),
            "norm": shrink.norm(rounds),
            "digraphs": len(family),
        }
        decay = min(self.rate, self.own_rate, coupled)
        observer = ProjectedConsensusObserver(self.label, problem, nodes, self.period, rounds, decay, None, facts)
        if observer.states.total > _DENSE:
            return observer
        radius = float(np.abs(la.eigvals(observer.period_matrix())).max())
        abscissa = float(np.log(max(radius, np.finfo(np.float64).tiny)) / self.period)
        return ProjectedConsensusObserver(self.label, problem, nodes, self.period, rounds, decay, abscissa, facts)

    def _accepted(self, problem: Any) -> list[tuple[tuple[int, ...], ...]]:
        """The digraphs, the problem's own first."""
        if not isinstance(problem, SharedPlant):
            raise MethodError(
                _NAME, "a SharedPlant", type(problem).__name__, "Write SharedPlant(A, outputs, neighbours)."
            )
        known = agent_knowledge(problem)
        if not all(each.observable for each in known):
            findings = diagnose_shared_plant(problem).findings[:4]
            raise MethodError(
                _NAME,
                "agents that together see the whole state and all hear of each other",
                " ".join(finding.text for finding in findings).removesuffix("."),
                " ".join(finding.remedy for finding in findings),
            )
        plants = [problem, *(SharedPlant(problem.A, problem.outputs, graph) for graph in self.graphs)]
        for k, plant in enumerate(plants):
            components = sorted(sorted(found) for found in nx.strongly_connected_components(plant.digraph()))
            if len(components) > 1:
                which = "the problem's digraph" if k == 0 else f"graphs[{k - 1}]"
                raise MethodError(
                    _NAME,
                    "strongly connected digraphs",
                    f"{which} with {len(components)} components, one of them the agents {components[0][:8]}",
                    "Add links back, or take CouplingGain, which serves such digraphs.",
                )
        return [plant.hears for plant in plants]

    def _chosen(self, shrink: Contraction) -> int:
        if self.rounds is not None:
            return self.rounds
        rounds = shrink.rounds_for(self.rate, self.period, _MOST_ROUNDS)
        if rounds is None:
            raise MethodError(
                _NAME,
                f"a rate that {_MOST_ROUNDS} rounds a period reach",
                f"{self.rate:g} 1/s with a contraction of {shrink.one_round:.6g} a round",
                "Ask for a lower rate, or let agents hear more of each other.",
            )
        return rounds

    def _program(self, problem: SharedPlant, agent: int, split: ObservabilitySplit) -> ProjectionProgram:
        A, seen = problem.A, split.seen
        own, C = seen.T @ A @ seen, problem.outputs[agent] @ seen
        try:
            L = rate_injection(own, C, self.own_rate)
        except np.linalg.LinAlgError as error:
            raise MethodError(
                _NAME,
                "directions that an agent sees clearly enough for its own observer",
                f"agent {agent} with a smallest relative singular value of {split.kept:.1e}: {error}",
                "Rescale the states, or let this agent sense less.",
            ) from error
        k, n = own.shape[0], A.shape[0]
        gain, output = np.vstack([L, np.zeros((n, L.shape[1]))]), np.hstack([C, np.zeros((C.shape[0], n))])
        arcs = (LocalArc(agent, None, 1.0, frozen(gain), frozen(output), None),) if L.any() else ()
        B = None if problem.B is None else frozen(np.vstack([seen.T @ problem.B, problem.B]))
        flow = LocalObserver(str(agent), frozen(la.block_diag(own, A)), B, arcs, frozen(np.eye(n, k + n, k)))
        return ProjectionProgram(flow, frozen(seen))


def _splits(problem: SharedPlant) -> list[ObservabilitySplit]:
    splits = [observability_split(problem.A, C) for C in problem.outputs]
    agent, worst = max(enumerate(splits), key=lambda pair: pair[1].leak)
    if worst.leak > _LEAK:
        raise MethodError(
            _NAME,
            f"a clear gap between what an agent sees and what it does not (leak below {_LEAK:g})",
            f"agent {agent} with singular values {worst.kept:.1e} seen and {worst.dropped:.1e} not seen",
            "Rescale the states.",
        )
    return splits
