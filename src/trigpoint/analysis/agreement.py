"""Agreement dynamics: which modes of ``x' = -L x`` the measured nodes see (R23, Section VI)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trigpoint.analysis.blind_spots import BlindSpot, Spectrum, blind_spot, spectrum_of, unseen_in_cluster
from trigpoint.analysis.diagnosis import Diagnosis, Finding, listing
from trigpoint.analysis.symmetry import Symmetry, find_symmetry
from trigpoint.analysis.zero_forcing import is_zero_forcing
from trigpoint.arrays import FloatArray, IntArray
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.graphs import MeasurementGraph
from trigpoint.model.agreement import AgreementDynamics

DENSE_LIMIT = 2000
"""Components with more nodes are decided by their structure alone."""

_ALTERNATIVES = 50
_ADDED = 12
_SHOWN = 4


@dataclass(frozen=True)
class MeasurementNode:
    """A node from which alone the agreement dynamics is observable.

    Attributes:
        node: its index.
        margin: ``min_s sigma_min([s I + L / ||L||; e_i'])``: how far from unobservable.
    """

    node: int
    margin: float


@dataclass(frozen=True)
class _Part:
    """The verdict on one component, its findings in the component's own indices."""

    observable: bool | None
    margin: float
    theorem: str
    findings: tuple[Finding, ...] = ()


def diagnose_agreement(problem: AgreementDynamics) -> Diagnosis:
    """Verdicts on ``(-L, E')``: can all states be known from the measured nodes?

    Unobservable exactly when an eigenvector of L vanishes on the measured nodes (Lemma 17), as happens in every
    component without measured node, where an eigenvalue is repeated more often than nodes are measured (Theorem 18),
    and where a symmetry leaves the measured nodes in place (Theorem 21; the converse is false, E-001-9). Detectable
    exactly when every component has a measured node: all modes but s = 0 decay.

    Margin: ``min_s sigma_min([s I + L / ||L||; E'])``, the smallest over the components; unobservable up to 1e-12,
    observable from 1e-9. Between them, and for components of more than 2000 nodes (margin NaN: not computed), the
    structure decides where it can: a zero forcing set is observable, a symmetry is not; else None.

    Args:
        problem: the network and its measured nodes.

    Cost O(N^3) for the largest component up to 2000 nodes; above, O((N + M) log N) and the search for a symmetry.
    Source: R23, Lemma 17, Theorems 18 and 21, E-001-9.
    """
    graph, is_measured = problem.graph, np.zeros(problem.n_states, dtype=np.bool_)
    is_measured[problem.measured] = True
    parts: list[_Part] = []
    findings: list[Finding] = []
    for nodes in graph.components:
        part = _part(graph, nodes, np.flatnonzero(is_measured[nodes]))
        parts.append(part)
        findings += [_moved(finding, nodes) for finding in part.findings]
    verdicts = [part.observable for part in parts]
    observable = False if False in verdicts else None if None in verdicts else True
    theorem = next(part.theorem for part in parts if part.observable is observable)
    margins = [part.margin for part in parts if not math.isnan(part.margin)]
    detectable = all(is_measured[nodes].any() for nodes in graph.components)
    return Diagnosis(observable, detectable, tuple(findings), theorem, min(margins, default=math.nan))


def measurement_nodes(graph: MeasurementGraph) -> tuple[MeasurementNode, ...]:
    """All nodes from which alone ``x' = -L x`` is observable, the largest margin first; empty where there is none.

    None exists where ``graph`` is not connected or has a repeated eigenvalue (Theorem 18).

    Args:
        graph: internal arcs only are looked at; scalar weights.

    Raises:
        ArgumentError: more than 2000 nodes.
        ShapeError: weight blocks.

    Cost O(N^3), and about 10 ms a node. Source: R23, Lemma 17 and Theorem 18.
    """
    if graph.n_nodes > DENSE_LIMIT:
        raise ArgumentError(
            f"measurement_nodes takes up to {DENSE_LIMIT} nodes; got {graph.n_nodes}. "
            "Ask diagnose about the nodes in question"
        )
    laplacian = AgreementDynamics(graph, [0]).laplacian()
    return _single_nodes(graph, spectrum_of(laplacian)) if graph.is_internally_connected else ()


def _single_nodes(graph: MeasurementGraph, spectrum: Spectrum) -> tuple[MeasurementNode, ...]:
    if spectrum.multiplicity > 1:
        return ()
    spots = [blind_spot(spectrum, np.array([node])) for node in range(graph.n_nodes)]
    good = [
        MeasurementNode(node, spot.margin)
        for node, spot in enumerate(spots)
        if spot.verdict or is_zero_forcing(graph, [node])
    ]
    return tuple(sorted(good, key=lambda entry: (-float(f"{entry.margin:.9g}"), entry.node)))


def _moved(finding: Finding, nodes: IntArray) -> Finding:
    """A component's finding in the indices of the whole network."""
    return Finding(
        finding.kind,
        tuple(nodes[list(finding.nodes)].tolist()),
        finding.text,
        finding.remedy,
        finding.direction,
    )


def _part(whole: MeasurementGraph, nodes: IntArray, measured: IntArray) -> _Part:
    if not measured.size:
        return _unmeasured(whole, nodes)
    if nodes.shape[0] == 1:
        return _Part(True, 1.0, "R23, Lemma 17")
    graph = whole if nodes.shape[0] == whole.n_nodes else whole.subgraph(nodes)
    if graph.n_nodes > DENSE_LIMIT:
        return _by_structure(graph, measured)
    spectrum = spectrum_of(AgreementDynamics(graph, measured).laplacian())
    spot = blind_spot(spectrum, measured)
    if spot.verdict:
        return _Part(True, spot.margin, "R23, Lemma 17")
    if is_zero_forcing(graph, measured):
        return _Part(True, spot.margin, "zero forcing, R23, Lemma 17", (_weak(graph, spot),))
    symmetry, _ = _symmetry(graph, measured)
    if symmetry is None and spot.verdict is None:
        return _Part(None, spot.margin, "R23, Lemma 17", (_undecided(graph, spot),))
    return _unobservable(graph, measured, spectrum, spot, symmetry)


def _unmeasured(whole: MeasurementGraph, nodes: IntArray) -> _Part:
    who = listing(whole, nodes)
    count = nodes.shape[0]
    finding = Finding(
        "unmeasured",
        tuple(range(count)),
        f"no node of the component of {who} is measured: its level stays unknown.",
        f"Measure at least one of {who}.",
        np.full((count, 1), count**-0.5),
    )
    return _Part(False, 0.0, "R23, Lemma 17: a component without measured node", (finding,))


def _by_structure(graph: MeasurementGraph, measured: IntArray) -> _Part:
    if is_zero_forcing(graph, measured):
        return _Part(True, math.nan, "zero forcing, R23, Lemma 17")
    symmetry, missing = _symmetry(graph, measured)
    if symmetry is not None:
        a, b = symmetry.cycles[0][:2]
        direction = np.zeros(graph.n_nodes)
        direction[[a, b]] = 0.5**0.5, -(0.5**0.5)  # odd under the generator, hence never seen
        finding = _symmetric(graph, symmetry, direction, "Measure nodes on one side of the symmetry as well.")
        return _Part(False, 0.0, "R23, Theorem 21", (finding,))
    text = f"{listing(graph, np.arange(graph.n_nodes))}: not decided beyond {DENSE_LIMIT} nodes"
    text += ", since the measured nodes are no zero forcing set and " + (
        "symmetries were not searched for." if missing else "no symmetry leaves them in place."
    )
    remedy = f"{missing}." if missing else "Measure a zero forcing set (for a chain: one of its ends)."
    finding = Finding("undecided", tuple(range(graph.n_nodes)), text, remedy)
    return _Part(None, math.nan, "R23, Lemma 17", (finding,))


def _symmetry(graph: MeasurementGraph, measured: IntArray) -> tuple[Symmetry | None, str]:
    """A symmetry that leaves the measured nodes in place, or what is missing to look for it."""
    try:
        return find_symmetry(graph, measured), ""
    except MissingExtraError as error:
        return None, str(error)


def _unobservable(
    graph: MeasurementGraph, measured: IntArray, spectrum: Spectrum, spot: BlindSpot, symmetry: Symmetry | None
) -> _Part:
    remedy = _remedy(graph, measured, spectrum)
    findings = []
    if symmetry is not None:
        odd = spectrum.vectors - spectrum.vectors[np.argsort(symmetry.generator)]
        findings.append(_symmetric(graph, symmetry, odd[:, int(np.argmax(np.linalg.norm(odd, axis=0)))], remedy))
    if spectrum.multiplicity > measured.shape[0]:
        start, end = spectrum.cluster(int(spectrum.starts[int(np.argmax(np.diff(spectrum.starts)))]))
        text = (
            f"the mode s = {-spectrum.values[start] * spectrum.size:.6g} is {end - start}-fold, so {end - start} nodes "
            f"must be measured at least; {measured.shape[0]} "
            f"{'is' if measured.shape[0] == 1 else 'are'}."
        )
        direction = unseen_in_cluster(spectrum, measured, start, end)
        findings.append(_finding("repeated-mode", measured, direction, text, remedy))
    if not findings:
        text = f"the mode s = {spot.mode:.6g} vanishes on every measured node, though no symmetry makes it vanish."
        findings.append(_finding("unseen-mode", measured, spot.direction, text, remedy))
    kinds = {"symmetry": "R23, Theorem 21", "repeated-mode": "R23, Theorem 18", "unseen-mode": "R23, Lemma 17"}
    return _Part(False, spot.margin, kinds[findings[0].kind], tuple(findings))


def _symmetric(graph: MeasurementGraph, symmetry: Symmetry, direction: FloatArray, remedy: str) -> Finding:
    shown = symmetry.cycles[:_SHOWN]
    more = len(symmetry.cycles) - len(shown)
    if symmetry.is_mirror:
        what = "mirror symmetry exchanging " + ", ".join(f"{graph.names[a]} and {graph.names[b]}" for a, b in shown)
    else:
        what = "symmetry turning " + ", ".join(" -> ".join(graph.names[k] for k in cycle) for cycle in shown)
    what += f" and {more} more" if more else ""
    text = f"{what}: it leaves every measured node in place, so no measurement tells these nodes apart."
    fixed = np.flatnonzero(np.array(symmetry.generator) == np.arange(graph.n_nodes))
    return _finding("symmetry", fixed, direction, text, remedy)


def _finding(kind: str, unmoved: IntArray, direction: FloatArray, text: str, remedy: str) -> Finding:
    vector = direction.copy()
    vector[unmoved] = 0.0
    vector /= np.linalg.norm(vector)
    nodes = np.flatnonzero(np.abs(vector) > 1e-9)
    return Finding(kind, tuple(nodes.tolist()), text, remedy, vector[nodes][:, None])


def _weak(graph: MeasurementGraph, spot: BlindSpot) -> Finding:
    nodes = np.flatnonzero(np.abs(spot.direction) > 1e-9)
    return Finding(
        "weakly-observable",
        tuple(nodes.tolist()),
        f"{listing(graph, nodes)}: observable whatever the weights are, but with the margin {spot.margin:.1e}: in "
        "practice noise decides there.",
        "Measure a node nearer to them.",
        spot.direction[nodes][:, None],
    )


def _undecided(graph: MeasurementGraph, spot: BlindSpot) -> Finding:
    nodes = np.flatnonzero(np.abs(spot.direction) > 1e-9)
    return Finding(
        "undecided",
        tuple(nodes.tolist()),
        f"{listing(graph, nodes)}: the mode s = {spot.mode:.6g} shows on the measured nodes by a margin of "
        f"{spot.margin:.1e} only: rounding decides there.",
        "Measure a node nearer to them.",
    )


def _remedy(graph: MeasurementGraph, measured: IntArray, spectrum: Spectrum) -> str:
    """Which nodes to measure: one alone where that is enough, and which to add to those measured."""
    added: list[int] = []
    if spectrum.multiplicity > measured.shape[0] + _ADDED:
        return f"Measure more nodes: at least {spectrum.multiplicity}."
    for _ in range(_ADDED):
        spot = blind_spot(spectrum, np.array([*measured.tolist(), *added]))
        if spot.verdict:
            break
        added.append(int(np.argmax(np.abs(spot.direction))))
    else:
        return f"Measure more nodes: at least {spectrum.multiplicity}."
    parts = []
    if graph.n_nodes <= _ALTERNATIVES and (alone := _single_nodes(graph, spectrum)):
        parts.append(f"measure {listing(graph, np.array([alone[0].node]))} instead (alone it shows every mode)")
    if added:
        parts.append(f"measure {listing(graph, np.array(added))} as well")
    text = ", or ".join(parts)
    return f"{text[:1].upper()}{text[1:]}."
