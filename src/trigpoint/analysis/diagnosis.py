"""What a diagnosis is: verdicts, findings, and how nodes are listed in a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from trigpoint.arrays import IntArray
from trigpoint.graphs import MeasurementGraph

_LISTED = 8


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing worth saying about a problem.

    Attributes:
        kind: short word for scripts (``island``, ``agent-unobservable``, ``agent-undetectable``, ``undecided``).
        nodes: indices of the nodes concerned.
        text: one sentence: what and why.
        remedy: what to add or change.
        direction: (len(nodes), n) the null vector: how the states of ``nodes`` can move without any measurement
            noticing, scaled to unit length; complex where the mode is; None where no direction belongs to it. For a
            shared plant (n, k): k directions of the plant's state that these agents cannot know.
    """

    kind: str
    nodes: tuple[int, ...]
    text: str
    remedy: str
    direction: NDArray[Any] | None = None


@dataclass(frozen=True)
class Diagnosis:
    """Verdicts on a problem: True, False, or None where floating point cannot decide.

    Attributes:
        observable: can every state be known from the measurements?
        detectable: does every part that cannot be known die out by itself (so that an observer exists)?
        findings: why not, and what to do.
        theorem: the result the verdict rests on.
        margin: relative distance from an unobservable system: of (A_1, C_1) for equal agents, of the whole otherwise;
            NaN where structure alone decided.
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


def listing(graph: MeasurementGraph, nodes: IntArray) -> str:
    """``nodes a, b and 3 more``: the nodes' names for a sentence."""
    names = [graph.names[k] for k in nodes[:_LISTED].tolist()]
    more = nodes.shape[0] - len(names)
    word = "node" if nodes.shape[0] == 1 else "nodes"
    return f"{word} {', '.join(names)}" + (f" and {more} more" if more else "")
