"""A plant seen by many agents: what each of them can know from those that can reach it (W17)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import networkx as nx
import numpy as np
import scipy.linalg as la

from trigpoint.analysis.diagnosis import Diagnosis, Finding
from trigpoint.analysis.pairs import pair_margin
from trigpoint.analysis.staircase import unobservable_basis
from trigpoint.arrays import FloatArray
from trigpoint.model.shared_plant import SharedPlant

_LISTED = 8
_CANDIDATES = 20
_ANGLE = 1e-7  # sine below which a direction counts as common to two subspaces


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What one agent can know of the plant's state, however well the agents tell each other.

    Attributes:
        agent: the agent.
        sources: agents from which a directed path leads to it, itself included, ascending.
        dimension: dimension of the part of the state that their outputs show.
        unobservable: (n, n - dimension) orthonormal columns: motions of the plant that none of them sees.
        observable: do they see everything? None where floating point cannot decide.
        detectable: does what they do not see die out?
        margin: relative distance of their pair from an unobservable one.
    """

    agent: int
    sources: tuple[int, ...]
    dimension: int
    unobservable: FloatArray
    observable: bool | None
    detectable: bool | None
    margin: float


@dataclass(frozen=True, eq=False)
class _Part:
    """A strongly connected component, and what all its agents know."""

    agents: tuple[int, ...]
    is_source: bool
    known: Knowledge


def agent_knowledge(problem: SharedPlant) -> tuple[Knowledge, ...]:
    """Tell for each agent what it can know: the state, or all of it but a subspace.

    With R(i) the agents that can reach agent i (itself included), agent i can estimate the whole state at any wanted
    rate exactly when ``(A, stacked C_j for j in R(i))`` is observable, and asymptotically exactly when that pair is
    detectable. A dimension is counted by a staircase of singular value decompositions (tolerance 1e-8), a verdict needs
    the refined PBH margin to agree with it.

    Args:
        problem: the plant with its agents; m agents, n states.

    Returns:
        One ``Knowledge`` an agent, in the agents' order.

    We assume:
        * n is small (a hundred): the margins cost O(n^4) for each strongly connected component that sees more;
        * units of outputs do not matter: each ``C_i`` is first scaled to the size of A.

    Source: theory 4.5 (sharper than W17, Corollary 1); 002-10, E-002-8.
    """
    by_agent = {agent: part.known for part in _parts(problem, _viewer(problem)) for agent in part.agents}
    return tuple(replace(by_agent[agent], agent=agent) for agent in range(problem.n_agents))


def diagnose_shared_plant(problem: SharedPlant) -> Diagnosis:
    """Verdicts on a plant with many observers: ``observable`` means that every agent can know the whole state.

    Necessary and sufficient, agent by agent: those that can reach it (with itself) see the whole state jointly. On a
    strongly connected graph this is joint observability (W17, Theorem 1); in general it implies that each source
    component, which hears nobody else, is jointly observable (W17, Corollary 1).

    Findings (``direction`` is an (n, k) orthonormal basis of what the nodes of the finding cannot know):
        * ``unobservable-plant``: all agents together do not see it; remedy: states to sense;
        * ``source-component``: a source component sees less than all agents together; remedy: arcs to add;
        * ``lacks``: another component, though it hears others, can know less than all agents together; remedy: arcs;
        * ``undecided``: rounding decides there.

    Args:
        problem: the plant with its agents; m agents, n states.

    We assume:
        * as ``agent_knowledge`` does: n is small, units of outputs do not matter.

    Cost: one staircase, O(n^3), and one or two margins, O(n^4), for each component that sees more than another.
    Source: W17, Theorem 1 and Corollary 1; 002-10, theory 4.5.
    """
    view = _viewer(problem)
    parts = _parts(problem, view)
    whole = view(frozenset(range(problem.n_agents)))
    findings = []
    if whole.dimension < problem.n_states:
        findings.append(_plant_finding(problem, whole))
    findings += [_part_finding(problem, parts, part, whole) for part in parts if part.known.dimension < whole.dimension]
    unclear = [part for part in parts if part.known.observable is None or part.known.detectable is None]
    if unclear:
        findings.append(_undecided(unclear))
    return Diagnosis(
        _all_of([part.known.observable for part in parts]),
        _all_of([part.known.detectable for part in parts]),
        tuple(findings),
        "W17, Theorem 1 and Corollary 1, for each agent by those that can reach it",
        min(part.known.margin for part in parts),
    )


_Viewer = Callable[[frozenset[int]], Knowledge]


def _viewer(problem: SharedPlant) -> _Viewer:
    """Knowledge of any set of agents, each set of sensing agents computed once (the field ``agent`` is -1 in it)."""
    A = problem.A
    size = float(np.linalg.norm(A, 2)) or 1.0
    scaled = [_scaled(C, size) for C in problem.outputs]

    @cache
    def sensed(sensing: frozenset[int]) -> Knowledge:
        C = _triangle([scaled[agent] for agent in sorted(sensing)], problem.n_states)
        basis = unobservable_basis(A, C)
        pair = pair_margin(A, C)
        observable = pair.verdict if pair.verdict is (basis.shape[1] == 0) else None
        detectable = True if observable else pair_margin(A, C, unstable_only=True).verdict
        return Knowledge(-1, (), A.shape[0] - basis.shape[1], basis, observable, detectable, pair.margin)

    def view(agents: frozenset[int]) -> Knowledge:
        known = sensed(frozenset(agent for agent in agents if scaled[agent].size))
        return replace(known, sources=tuple(sorted(agents)))

    return view


def _scaled(C: FloatArray, size: float) -> FloatArray:
    """C in the units of A, as at most n rows that see the same; no rows where it sees nothing."""
    norm = float(np.linalg.norm(C, 2)) if C.size else 0.0
    if norm == 0.0:
        return np.zeros((0, C.shape[1]))
    return _triangle([C * (size / norm)], C.shape[1])


def _triangle(blocks: list[FloatArray], n: int) -> FloatArray:
    """At most n rows with the same ``C'C`` as the stacked blocks."""
    stacked = np.vstack([np.zeros((0, n)), *blocks])
    return stacked if stacked.shape[0] <= n else np.asarray(np.linalg.qr(stacked, mode="r"))


def _parts(problem: SharedPlant, view: _Viewer) -> list[_Part]:
    """Strongly connected components, by their first agent."""
    graph = problem.digraph()
    components = sorted((sorted(found) for found in nx.strongly_connected_components(graph)), key=lambda c: c[0])
    condensed = nx.condensation(graph, scc=[set(component) for component in components])
    parts = []
    for label, agents in enumerate(components):
        upstream = nx.ancestors(condensed, label)
        sources = frozenset(agents).union(*(components[k] for k in upstream))
        parts.append(_Part(tuple(agents), not upstream, view(sources)))
    return parts


def _all_of(verdicts: list[bool | None]) -> bool | None:
    if any(verdict is False for verdict in verdicts):
        return False
    return None if any(verdict is None for verdict in verdicts) else True


def _plant_finding(problem: SharedPlant, whole: Knowledge) -> Finding:
    states = " and ".join(f"x[{k}]" for k in _states_to_sense(problem, whole))
    return Finding(
        "unobservable-plant",
        whole.sources,
        f"all agents together do not see {_described(problem, whole)}.",
        f"Sense {states} as well, at an agent whose word reaches all others.",
        whole.unobservable,
    )


def _part_finding(problem: SharedPlant, parts: list[_Part], part: _Part, whole: Knowledge) -> Finding:
    arcs = _arcs_to_add(problem, parts, part, whole)
    s = "s" if len(part.agents) == 1 else ""
    upstream = set(part.known.sources) - set(part.agents)
    whom = "nobody else" if part.is_source else f"of what {_who(upstream)} sense{'s' if len(upstream) == 1 else ''}"
    return Finding(
        "source-component" if part.is_source else "lacks",
        part.agents,
        f"{_who(set(part.agents))} hear{s} {whom} and cannot know {_described(problem, part.known)}.",
        f"Let {' and '.join(f'agent {hearing} hear agent {heard}' for heard, hearing in arcs)}.",
        part.known.unobservable,
    )


def _undecided(unclear: list[_Part]) -> Finding:
    agents = {agent for part in unclear for agent in part.agents}
    margin = min(part.known.margin for part in unclear)
    return Finding(
        "undecided",
        tuple(sorted(agents)),
        f"what reaches {_who(agents)} is within {margin:.1e} (relative) of an unobservable pair: rounding decides.",
        "Rescale the states, or give the model in more digits.",
    )


def _arcs_to_add(problem: SharedPlant, parts: list[_Part], part: _Part, whole: Knowledge) -> list[tuple[int, int]]:
    """Arcs (heard, hearing) after which ``part`` knows what all agents know: one where one does, else greedily.

    What a union of agents does not see is the intersection of what each does not see. Among equally good components
    the one is heard that brings the fewest agents upstream.
    """
    unseen, arcs = part.known.unobservable, []
    ranked = sorted((p for p in parts if p is not part), key=lambda p: (-p.known.dimension, len(p.known.sources)))
    while unseen.shape[1] > whole.unobservable.shape[1]:
        met = [(_meet(unseen, p.known.unobservable), p) for p in ranked[:_CANDIDATES]]
        if all(left.shape[1] == unseen.shape[1] for left, _ in met):
            met += [(_meet(unseen, p.known.unobservable), p) for p in ranked[_CANDIDATES:]]
        left, best = min(met, key=lambda pair: (pair[0].shape[1], len(pair[1].known.sources)))
        if left.shape[1] == unseen.shape[1]:
            break  # rounding: the tolerances of sum and parts differ
        heard = next((agent for agent in best.agents if problem.outputs[agent].any()), best.agents[0])
        arcs.append((heard, part.agents[0]))
        unseen = left
    return arcs or [(ranked[0].agents[0], part.agents[0])]


def _meet(one: FloatArray, other: FloatArray) -> FloatArray:
    """Orthonormal basis of the intersection of two subspaces, each given by one."""
    _, values, right = np.linalg.svd(one - other @ (other.T @ one))
    return np.asarray(one @ right[int(np.sum(values > _ANGLE)) :].T)


def _states_to_sense(problem: SharedPlant, whole: Knowledge) -> list[int]:
    """Coordinates that, sensed as well, make the plant observable: greedily, those that the unseen motions move."""
    C, basis, chosen = problem.stacked_output(), whole.unobservable, []
    C = _triangle([_scaled(rows[None, :], 1.0) for rows in C], problem.n_states)
    while basis.shape[1]:
        moved = np.argsort(-np.linalg.norm(basis, axis=1), kind="stable")[:_CANDIDATES]
        trials = [np.vstack([C, np.eye(problem.n_states)[k][None, :]]) for k in moved.tolist()]
        bases = [unobservable_basis(problem.A, trial) for trial in trials]
        best = int(np.argmin([found.shape[1] for found in bases]))
        if bases[best].shape[1] == basis.shape[1]:
            break
        C, basis = trials[best], bases[best]
        chosen.append(int(moved[best]))
    return chosen


def _described(problem: SharedPlant, known: Knowledge) -> str:
    """The unseen subspace in readable form: vectors with a 1 where they are largest, and the modes in it."""
    basis = known.unobservable
    pivots = la.qr(basis.T, pivoting=True, mode="r")[1][: basis.shape[1]]
    vectors = la.solve(basis[np.sort(pivots)].T, basis.T)
    spelled = [_combination(vector) for vector in vectors[:_LISTED]]
    more = f" and {basis.shape[1] - _LISTED} more" if basis.shape[1] > _LISTED else ""
    modes = la.eigvals(basis.T @ problem.A @ basis)[:_LISTED]
    named = ", ".join(sorted({_mode(s) for s in modes.tolist()}))
    return (
        f"{basis.shape[1]} of the {problem.n_states} dimensions of the state: motions along "
        f"{', '.join(spelled)}{more} (modes s = {named})"
    )


def _mode(s: complex) -> str:
    """One of a conjugate pair, without digits that are rounding."""
    real, imaginary = round(s.real, 6) + 0.0, abs(round(s.imag, 6))
    return f"{real:.4g} +- {imaginary:.4g}i" if imaginary else f"{real:.4g}"


def _combination(vector: FloatArray) -> str:
    terms = [(value, k) for k, value in enumerate(vector.tolist()) if abs(value) > 1e-6]
    words = [f"{value:+.4g} x[{k}]".replace("+1 ", "+").replace("-1 ", "-") for value, k in terms[:_LISTED]]
    return f"({' '.join(words)}{' ...' if len(terms) > _LISTED else ''})"


def _who(agents: set[int]) -> str:
    listed = sorted(agents)
    more = f" and {len(listed) - _LISTED} more" if len(listed) > _LISTED else ""
    return f"agent{'' if len(listed) == 1 else 's'} {', '.join(map(str, listed[:_LISTED]))}{more}"
