"""Equal agents on a graph: the verdict separates into the graph and one agent (G16, Theorem 3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from trigpoint.analysis.diagnosis import Diagnosis, Finding, listing
from trigpoint.analysis.pairs import PairMargin, pair_margin
from trigpoint.graphs import MeasurementGraph
from trigpoint.model import LinearAgent

_MODES_NAMED = 6


def diagnose_homogeneous(graph: MeasurementGraph, agent: LinearAgent) -> Diagnosis:
    """Verdicts on ``(I (x) A_1, G^T (x) C_1)``.

    * observable exactly when every component has an external arc and (A_1, C_1) is observable;
    * detectable exactly when (A_1, C_1) is detectable and A_1 is Hurwitz or every component has an external arc.

    Cost O(N + M) and O(n^4) for one agent. Source: G16, Theorem 3, Corollary 2, Remark 4; R23, Theorem 6.
    """
    seen = pair_margin(agent.A, agent.C)
    unstable = pair_margin(agent.A, agent.C, unstable_only=True)
    dies_out = _is_clearly_hurwitz(agent)
    findings = [*_agent_findings(graph, seen, unstable), *_island_findings(graph, agent, dies_out)]
    anchored = graph.is_externally_connected
    observable = False if not anchored else seen.verdict
    detectable = unstable.verdict if anchored or dies_out else False
    return Diagnosis(observable, detectable, tuple(findings), "G16, Theorem 3 and Corollary 2", seen.margin)


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
    what, motion = _common_motion(agent, dies_out)
    findings = []
    for label in np.flatnonzero(~graph.component_is_anchored).tolist():
        nodes = graph.components[label]
        who = listing(graph, nodes)
        verb = "has" if nodes.shape[0] == 1 else "have"
        direction = np.tile(motion / np.sqrt(nodes.shape[0]), (nodes.shape[0], 1))
        findings.append(
            Finding(
                "island",
                tuple(nodes.tolist()),
                f"{who} {verb} no path to an absolute reading: only differences are measured there, so the common "
                f"{what} {drift}.",
                f"Add one absolute reading at any of them, or one measurement from {who} to an anchored node.",
                direction,
            )
        )
    return findings


def _common_motion(agent: LinearAgent, dies_out: bool) -> tuple[str, NDArray[Any]]:
    """What an island shares, in words with its lasting modes, and one such motion of an agent (n,), unit length."""
    if agent.is_static:
        return "level", np.eye(agent.n_states)[0]
    values, vectors = la.eig(agent.A)
    lasting = np.flatnonzero(values.real >= -1e-9 * float(np.linalg.norm(agent.A, 2)))
    chosen = lasting if lasting.size and not dies_out else np.arange(values.shape[0])
    modes = sorted(
        {f"{complex(round(values[k].real, 9) + 0.0, round(values[k].imag, 9) + 0.0):.6g}" for k in chosen.tolist()}
    )
    named = ", ".join(modes[:_MODES_NAMED]) + (" and more" if len(modes) > _MODES_NAMED else "")
    slowest = vectors[:, int(np.argmax(values.real))]
    motion = slowest.real if not slowest.imag.any() else slowest
    return f"motion (modes s = {named})", motion / np.linalg.norm(motion)
