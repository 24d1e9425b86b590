"""Agents that differ: observability and detectability mode by mode, so that thousands of small agents are decided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from trigpoint.analysis.diagnosis import Diagnosis, Finding
from trigpoint.analysis.invariant import NEAR, Piece, candidate_modes, invariant_pieces, shared_unstable
from trigpoint.analysis.large_pairs import large_pair_margin
from trigpoint.analysis.pairs import PairMargin, pair_margin
from trigpoint.analysis.staircase import unobservable_basis
from trigpoint.arrays import IntArray
from trigpoint.linalg.blocks import diagonal_of
from trigpoint.model.hyper_network import HyperNetwork

_SMALL, _WHOLE = 24, 400
_LISTED = 8


_Matrix = Any  # a dense array for small parts, a scipy.sparse.csc_array for large ones


@dataclass(frozen=True, eq=False)
class _Group:
    """Pieces of one cluster that measurements join: their dynamics T and what is measured of them."""

    pieces: tuple[Piece, ...]
    T: _Matrix
    C: _Matrix


@dataclass(frozen=True, eq=False)
class _Verdict:
    group: _Group
    seen: PairMargin
    lasting: PairMargin | None  # None: nothing to decide, the group is seen or dies out


def diagnose_heterogeneous(problem: HyperNetwork) -> Diagnosis:
    """Verdicts on ``(blockdiag(A_i), [C_jk])``, decided for one cluster of eigenvalues at a time.

    An unseen mode s has ``(s I - A_i) x_i = 0`` for every i and ``sum_k C_jk x_k = 0`` for every j, so that only agents
    with the eigenvalue s take part. For each cluster of eigenvalues these agents are restricted to their invariant
    subspaces, the measurements split the restricted problem further, and each part is a small pair for the refined PBH
    margin (sparse inverse iteration where it is not small).

    If no two agents share an unstable eigenvalue, detectability is also sufficient for an observer with the structure
    of the network (G16, Theorem 2); ``theorem`` says whether this applies. Shared ones that lie on the imaginary axis
    and are semisimple, as all other unstable ones, do no harm either; for others the finding ``shared-unstable-modes``
    says that the theorem is silent.

    Findings: ``undetectable-mode``, ``unobservable-mode`` (``direction``: row i belongs to the i-th of ``nodes``, short
    agents padded with zeros), ``undecided``, ``shared-unstable-modes``. ``margin`` is the smallest over all parts,
    relative to each part's own size.

    Args:
        problem: the agents and the measurements that join them.

    We assume:
        * eigenvalues nearer than 1e-4 (relative to the norm of their agent) belong together;
        * units of measurements do not matter: each is first scaled to the size of the largest ``A_i``;
        * real parts above -1e-9, relative, count as unstable.

    Up to 400 states the whole pair is decided as well; where that contradicts, the verdict is None.
    Cost: about a millisecond for each small part; a sparse factorization for each mode of a large one.
    Source: G16, Theorem 2; R23, Theorem 6; 000-21, E-000-7, E-000-13, theory 001-05.
    """
    C = _scaled_output(problem)
    pieces = invariant_pieces([agent.A for agent in problem.agents])
    verdicts = [_decided(problem, group) for group in _joined(problem, pieces, C)]
    observable = _all_of([v.seen.verdict for v in verdicts])
    detectable = _all_of([v.lasting.verdict if v.lasting else True for v in verdicts])
    whole = _whole_pair(problem, C, pieces)
    if {whole, observable} == {True, False}:
        observable, detectable = None, None
    shared = shared_unstable(pieces)
    marginal = all(piece.is_marginal for piece in pieces)
    findings = [finding for v in verdicts for finding in _findings(problem, v)]
    if observable is None and not any(f.kind == "undecided" for f in findings):
        findings.append(_undecided(problem, tuple(range(problem.n_nodes)), min(v.seen.margin for v in verdicts)))
    if shared and not marginal and detectable is not False:
        findings.append(_shared_finding(problem, shared))
    margin = min(v.seen.margin for v in verdicts)
    return Diagnosis(observable, detectable, tuple(findings), _theorem(bool(shared), marginal), margin)


def _all_of(verdicts: list[bool | None]) -> bool | None:
    if any(verdict is False for verdict in verdicts):
        return False
    return None if any(verdict is None for verdict in verdicts) else True


def _theorem(shared: bool, marginal: bool) -> str:
    if not shared:
        return "G16, Theorem 2 (no shared unstable eigenvalue), with R23, Theorem 6 mode by mode"
    if marginal:
        return "R23, Theorem 6 mode by mode; shared unstable modes on the axis are semisimple, which suffices"
    return "R23, Theorem 6 mode by mode; G16, Theorem 2 does not cover shared unstable eigenvalues"


# -- splitting ---------------------------------------------------------------------------------------------------------
def _scaled_output(problem: HyperNetwork) -> sp.csc_array:
    """C with each measurement scaled to the size of the largest A_i."""
    C = problem.stacked_output()
    size = max(float(np.linalg.norm(agent.A)) for agent in problem.agents) or 1.0
    norms = [float(np.sqrt(sum(float((b**2).sum()) for b in blocks.values()))) for blocks in problem.measurements]
    rows = [next(iter(blocks.values())).shape[0] for blocks in problem.measurements]
    factors = np.repeat([size / norm if norm else 0.0 for norm in norms], rows)
    return sp.csc_array(sp.diags_array(factors) @ C) if rows else sp.csc_array(C)


def _joined(problem: HyperNetwork, pieces: list[Piece], C: sp.csc_array) -> list[_Group]:
    """Parts that can be decided by themselves: pieces of one cluster that are joined by measurements."""
    widths = np.array([piece.T.shape[0] for piece in pieces])
    starts = np.concatenate([[0], np.cumsum(widths)])
    entries = sp.coo_array(C @ _basis(problem, pieces, starts))
    owner = np.repeat(np.arange(len(pieces)), widths)[entries.coords[1]]
    labels = _labels(entries.coords[0], owner, np.array([piece.cluster for piece in pieces]))
    order = np.argsort(labels, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    by_label = np.argsort(labels[owner], kind="stable")
    bounds = np.searchsorted(labels[owner][by_label], np.arange(len(members) + 1))
    local = np.empty(int(starts[-1]), dtype=np.int64)
    groups = []
    for label, own in enumerate(members):
        width = int(widths[own].sum())
        local[np.concatenate([np.arange(starts[k], starts[k + 1]) for k in own.tolist()])] = np.arange(width)
        inside = by_label[bounds[label] : bounds[label + 1]]
        used, rows = np.unique(entries.coords[0][inside], return_inverse=True)
        triplets = (entries.data[inside], (rows.ravel(), local[entries.coords[1][inside]]))
        groups.append(_group([pieces[k] for k in own.tolist()], triplets, (used.shape[0], width)))
    return groups


def _group(pieces: list[Piece], triplets: Any, shape: tuple[int, int]) -> _Group:
    T = [piece.T for piece in pieces]
    if shape[1] > _SMALL:
        return _Group(tuple(pieces), sp.csc_array(diagonal_of(T)), sp.csc_array(triplets, shape=shape))
    C = np.zeros(shape)
    C[triplets[1]] = triplets[0]
    return _Group(tuple(pieces), la.block_diag(*T), C)


def _basis(problem: HyperNetwork, pieces: list[Piece], starts: IntArray) -> sp.csc_array:
    """The columns Q of all pieces, each at its agent's states."""
    rows = np.concatenate([np.repeat(_range(problem.states(p.node)), p.Q.shape[1]) for p in pieces])
    columns = np.concatenate(
        [np.tile(np.arange(a, b), p.Q.shape[0]) for p, a, b in zip(pieces, starts, starts[1:], strict=False)]
    )
    values = np.concatenate([piece.Q.ravel() for piece in pieces])
    return sp.csc_array((values, (rows, columns)), shape=(problem.n_states, int(starts[-1])))


def _range(positions: slice) -> IntArray:
    return np.arange(positions.start, positions.stop)


def _labels(rows: IntArray, owner: IntArray, cluster: IntArray) -> IntArray:
    """Number of the part for each piece, from the rows in which it (``owner``) has an entry."""
    key = rows.astype(np.int64) * (int(cluster.max()) + 1) + cluster[owner]
    joints = np.unique(key, return_inverse=True)[1].ravel() + cluster.shape[0]
    total = cluster.shape[0] + rows.shape[0]
    links = sp.coo_array((np.ones(rows.shape[0]), (joints, owner)), shape=(total, total))
    found = connected_components(links, directed=False)[1][: cluster.shape[0]]
    return np.asarray(np.unique(found, return_inverse=True)[1].ravel())


# -- one part ----------------------------------------------------------------------------------------------------------
def _decided(problem: HyperNetwork, group: _Group) -> _Verdict:
    size = max(float(np.linalg.norm(problem.agents[piece.node].A, 2)) for piece in group.pieces)
    seen = _margin(group.T, group.C, group.pieces, unstable_only=False, size=size)
    if seen.verdict is True or not any(piece.is_unstable for piece in group.pieces):
        return _Verdict(group, seen, None)
    return _Verdict(group, seen, _margin(group.T, group.C, group.pieces, unstable_only=True, size=size))


def _margin(A: _Matrix, C: _Matrix, pieces: Sequence[Piece], *, unstable_only: bool, size: float = 0.0) -> PairMargin:
    if A.shape[0] > _SMALL:
        return large_pair_margin(A, C, candidate_modes(pieces), unstable_only=unstable_only)
    rows = np.asarray(np.linalg.qr(C, mode="r")) if C.shape[0] > C.shape[1] else C
    return pair_margin(A, rows, unstable_only=unstable_only, size=size)


def _whole_pair(problem: HyperNetwork, C: sp.csc_array, pieces: list[Piece]) -> bool | None:
    """The verdict on everything at once, a check of the parts; None above 400 states."""
    if problem.n_states > _WHOLE:
        return None
    A = sp.csc_array(problem.stacked_dynamics())
    if problem.n_states <= _SMALL:
        return _margin(A.toarray(), C.toarray(), pieces, unstable_only=False).verdict
    return _margin(A, C, pieces, unstable_only=False).verdict


# -- sentences ---------------------------------------------------------------------------------------------------------
def _shared_finding(problem: HyperNetwork, shared: list[Piece]) -> Finding:
    nodes = tuple(sorted({piece.node for piece in shared}))
    named = sorted({_mode(piece.values[np.argmax(piece.values.real)]) for piece in shared})
    modes = ", ".join(named[:_LISTED]) + (" and more" if len(named) > _LISTED else "")
    return Finding(
        "shared-unstable-modes",
        nodes,
        f"{_who(problem, nodes)} share unstable modes (s = {modes}): Theorem 2 of G16 does not say whether "
        "an observer with the network's structure exists.",
        "Look for one numerically, or let the agents exchange their estimates (a distributed observer of all states).",
    )


def _findings(problem: HyperNetwork, verdict: _Verdict) -> list[Finding]:
    lasting = verdict.lasting
    nodes = tuple(sorted({piece.node for piece in verdict.group.pieces}))
    if lasting is not None and lasting.verdict is False:
        return [_unseen(problem, verdict.group, lasting, "undetectable-mode", "stays unknown")]
    if verdict.seen.verdict is False:
        found = [_unseen(problem, verdict.group, verdict.seen, "unobservable-mode", "is never seen, but dies out")]
        return found if lasting is None or lasting.verdict else [*found, _undecided(problem, nodes, lasting.margin)]
    return [] if verdict.seen.verdict else [_undecided(problem, nodes, verdict.seen.margin)]


def _unseen(problem: HyperNetwork, group: _Group, least: PairMargin, kind: str, fate: str) -> Finding:
    """The finding with the direction in the agents' own states, node by node."""
    states: dict[int, NDArray[Any]] = {}
    motion, start = _sharpened(group, least), 0
    for piece in group.pieces:
        width = piece.T.shape[0]
        states[piece.node] = piece.Q @ motion[start : start + width]
        start += width
    largest = max(float(np.abs(x).max()) for x in states.values())
    nodes = tuple(sorted(node for node, x in states.items() if np.abs(x).max() > 1e-6 * largest))
    direction = np.zeros((len(nodes), max(problem.agents[node].n_states for node in nodes)), dtype=complex)
    for row, node in enumerate(nodes):
        direction[row, : states[node].shape[0]] = states[node]
    peak = direction.ravel()[np.argmax(np.abs(direction))]
    direction *= abs(peak) / peak / np.linalg.norm(direction)
    is_real = np.abs(direction.imag).max() < 1e-9
    what = "a motion" if len(nodes) == 1 else "a common motion"
    return Finding(
        kind,
        nodes,
        f"{what} of {_who(problem, nodes)} with the mode s = {_mode(least.mode)} leaves every measurement at zero: "
        f"it {fate}.",
        f"Measure {'it' if len(nodes) == 1 else 'one of them'} absolutely, where this mode moves the output.",
        direction.real if is_real else direction,
    )


def _sharpened(group: _Group, least: PairMargin) -> NDArray[Any]:
    """The motion from the unobservable subspace: inside a Jordan block the margin's is as far off as the eigenvalue.

    There the mean of the eigenvalues near the mode is accurate, and so is the eigenvector that belongs to it.
    """
    if least.direction.shape[0] > _WHOLE:
        return least.direction
    T, C = (m.toarray() if sp.issparse(m) else m for m in (group.T, group.C))
    basis = unobservable_basis(T, C)
    size = float(np.linalg.norm(T)) or 1.0
    values = la.eigvals(basis.T @ T @ basis) if basis.shape[1] else np.zeros(0)
    near = values[np.abs(values - least.mode) <= NEAR * size]
    if not near.size:
        return least.direction
    _, sigma, right = la.svd(near.mean() * np.eye(basis.shape[1]) - basis.T @ T @ basis)
    return np.asarray(basis @ (right[-1].conj() if sigma[-1] <= 1e-12 * size else basis.T @ least.direction))


def _undecided(problem: HyperNetwork, nodes: tuple[int, ...], margin: float) -> Finding:
    return Finding(
        "undecided",
        nodes,
        f"{_who(problem, nodes)}: within {margin:.1e} (relative) of an unobservable pair; rounding decides there.",
        "Rescale the states, or give the model in more digits.",
    )


def _mode(s: complex) -> str:
    return f"{s.real:.6g}" if abs(s.imag) <= 1e-9 * abs(s) else f"{s.real:.6g} +- {abs(s.imag):.6g}i"


def _who(problem: HyperNetwork, nodes: tuple[int, ...]) -> str:
    more = f" and {len(nodes) - _LISTED} more" if len(nodes) > _LISTED else ""
    return f"node{'' if len(nodes) == 1 else 's'} {', '.join(problem.names[k] for k in nodes[:_LISTED])}{more}"
