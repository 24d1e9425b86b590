"""Can every node know its state, and if not, which cannot, why, and what to add?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trigpoint.analysis.pairs import PairMargin, pair_margin
from trigpoint.arrays import IntArray
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.model import LinearAgent, Network, NetworkedAgents

_LISTED = 8


@dataclass(frozen=True)
class Finding:
    """One thing worth saying about a problem.

    Attributes:
        kind: short word for scripts (``island``, ``agent-unobservable``, ``agent-undetectable``, ``undecided``).
        nodes: indices of the nodes concerned.
        text: one sentence: what and why.
        remedy: what to add or change.
    """

    kind: str
    nodes: tuple[int, ...]
    text: str
    remedy: str


@dataclass(frozen=True)
class Diagnosis:
    """Verdicts on a problem: True, False, or None where floating point cannot decide.

    Attributes:
        observable: can every state be known from the measurements?
        detectable: does every part that cannot be known die out by itself (so that an observer exists)?
        findings: why not, and what to do.
        theorem: the result the verdict rests on.
        margin: relative distance of (A_1, C_1) from an unobservable pair.
    """

    observable: bool | None
    detectable: bool | None
    findings: tuple[Finding, ...]
    theorem: str
    margin: float

    def summary(self) -> str:
        """The verdict and the findings as text, a line each."""
        words = {True: "yes", False: "no", None: "cannot be decided at this precision"}
        lines = [f"observable: {words[self.observable]}; detectable: {words[self.detectable]} ({self.theorem})"]
        lines += [f"- {finding.text} {finding.remedy}" for finding in self.findings]
        return "\n".join(lines)


def diagnose(problem: NetworkedAgents | MeasurementGraph | Network) -> Diagnosis:
    """Tell whether every node can know its state, which nodes cannot, why, and what to add.

    A graph or a measured network stands for unknown constants: ``A_1 = 0_d``, ``C_1 = I_d``. For equal agents
    ``(I (x) A_1, G^T (x) C_1)`` is

    * observable exactly when every component has an external arc and (A_1, C_1) is observable,
    * detectable exactly when (A_1, C_1) is detectable and A_1 is Hurwitz or every component has an external arc.

    We assume:
        * homogeneous agents (G16, Assumption 1).

    Raises:
        ArgumentError: agents that differ.

    Cost O(N + M) and O(n^4) for one agent. Source: G16, Theorem 3, Corollary 2, Remark 4; R23, Theorem 6.
    """
    graph, agent = _as_homogeneous(problem)
    seen = pair_margin(agent.A, agent.C)
    unstable = pair_margin(agent.A, agent.C, unstable_only=True)
    dies_out = _is_clearly_hurwitz(agent)
    findings = [*_agent_findings(graph, seen, unstable), *_island_findings(graph, agent, dies_out)]
    anchored = graph.is_externally_connected
    observable = False if not anchored else seen.verdict
    detectable = unstable.verdict if anchored or dies_out else False
    return Diagnosis(observable, detectable, tuple(findings), "G16, Theorem 3 and Corollary 2", seen.margin)


def _as_homogeneous(problem: NetworkedAgents | MeasurementGraph | Network) -> tuple[MeasurementGraph, LinearAgent]:
    if isinstance(problem, MeasurementGraph):
        return problem, LinearAgent.static(problem.dimension)
    if isinstance(problem, Network):
        return problem.graph, LinearAgent.static(problem.dimension)
    if isinstance(problem, NetworkedAgents):
        return problem.graph, problem.agent
    raise ArgumentError(
        f"diagnose takes a NetworkedAgents, a MeasurementGraph or a Network; got {type(problem).__name__}"
    )


def _is_clearly_hurwitz(agent: LinearAgent) -> bool:
    """Real parts below zero by more than rounding: an oscillator's computed ones may be -1e-17."""
    size = float(np.linalg.norm(np.vstack([agent.A, agent.C]), 2))
    return bool(np.linalg.eigvals(agent.A).real.max() < -1e-9 * size)


def _agent_findings(graph: MeasurementGraph, seen: PairMargin, unstable: PairMargin) -> list[Finding]:
    everyone = tuple(range(graph.n_nodes))
    findings = []
    if seen.verdict is False:
        kind = "agent-undetectable" if unstable.verdict is False else "agent-unobservable"
        mode = unstable.mode if unstable.verdict is False else seen.mode
        findings.append(
            Finding(
                kind,
                everyone,
                f"the agent's mode s = {mode:.6g} never shows in its output C x, on any node.",
                "Measure something that this mode moves (another row of C).",
            )
        )
    if seen.verdict is None or unstable.verdict is None:
        findings.append(
            Finding(
                "undecided",
                everyone,
                f"(A, C) is within {seen.margin:.1e} (relative) of an unobservable pair: rounding decides there.",
                "Rescale the states, or give the model in more digits.",
            )
        )
    return findings


def _island_findings(graph: MeasurementGraph, agent: LinearAgent, dies_out: bool) -> list[Finding]:
    drift = "dies out by itself, but cannot be observed" if dies_out else "stays unknown"
    what = "common level" if agent.is_static else "common motion"
    findings = []
    for label in np.flatnonzero(~graph.component_is_anchored).tolist():
        nodes = graph.components[label]
        findings.append(
            Finding(
                "island",
                tuple(nodes.tolist()),
                f"{_listing(graph, nodes)} measure only differences among themselves: their {what} {drift}.",
                f"Add one absolute reading at any of them, or one measurement from {_listing(graph, nodes)} "
                "to an anchored node.",
            )
        )
    return findings


def _listing(graph: MeasurementGraph, nodes: IntArray) -> str:
    names = [graph.names[k] for k in nodes[:_LISTED].tolist()]
    more = nodes.shape[0] - len(names)
    word = "node" if nodes.shape[0] == 1 else "nodes"
    return f"{word} {', '.join(names)}" + (f" and {more} more" if more else "")
