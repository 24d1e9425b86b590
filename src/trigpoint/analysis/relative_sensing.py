"""A linear system seen through relative measurements: only the floating components can hide a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from trigpoint.analysis.diagnosis import Diagnosis, Finding, listing
from trigpoint.analysis.gain import worst_case_eigenvalue
from trigpoint.analysis.pairs import PairMargin, pair_margin
from trigpoint.arrays import FloatArray, IntArray
from trigpoint.graphs import MeasurementGraph
from trigpoint.model.relative_sensing import RelativeSensing

_UNOBSERVABLE = 1e-12
_OBSERVABLE = 1e-9
_REAL = 1e-10
_STABLE = -1e-9
_WHOLE_PAIR = 60
_DENSE = 500
_PAIRS = 40
_FULL_RANK = 1000
_ROWS = 65536
_NAMED = 8


@dataclass(frozen=True, eq=False)
class _Blind:
    """The system on ker C = span K, K the c unit indicators of the floating components; A has norm ``size``.

    ``X = K' A K / size`` (c, c) and R (at most c, c) with ``R' R = E' E``, ``E = A K / size - K X``.
    """

    K: sp.csc_array
    X: FloatArray
    R: FloatArray
    size: float


@dataclass(frozen=True)
class _Verdicts:
    observable: bool | None
    detectable: bool | None
    margin: float


def diagnose_relative_sensing(problem: RelativeSensing) -> Diagnosis:
    """Verdicts on ``(A, G^T)`` of any system, one state a node, under relative and anchor measurements.

    With an external arc in every component ``G^T`` has full column rank: observable whatever A is (Lemma 14).
    Otherwise ``ker G^T = span K``, K (n, c) the unit indicators of the c floating components, and the pair is
    unobservable exactly when A has an eigenvector in span K over the complex numbers, that is when the small pair
    ``(X, R)``, ``X = K' A K``, ``R = A K - K X``, is unobservable (one component: A 1 is parallel to 1).
    Detectable: the same over the modes that do not decay.

    The margin is relative, with A and ``G^T`` each divided by its norm (the unit of time plays no part): up to 60 nodes
    ``min_s sigma_min`` of the whole pair; above, that of the pair on span K, which is never smaller (anchored: a lower
    bound, from the worst case over all graphs of the size). Unobservable up to 1e-12, observable from 1e-9, else None.
    Up to 60 nodes the whole pair must agree, up to 500 a lower bound of its margin must exceed 1e-9; else None.

    Args:
        problem: the system and its graph.

    We assume:
        * up to 40 floating components; above, each is tried alone (False), then the rank of R (True); else None.

    Cost O(nnz(A) + M) where every component is anchored, else O(nnz(A) c + n c^2 + c^4), and O(n^4) up to 60 nodes.
    Source: R23, Lemmas 12 and 14, Theorems 6, 9 and 13 for c components and complex modes (E-001-1).
    """
    floating = np.flatnonzero(~problem.graph.component_is_anchored)
    if not floating.size:
        return Diagnosis(True, True, (), "R23, Lemma 14", _anchored_margin(problem))
    if floating.size > _PAIRS:
        return _one_by_one(problem, floating)
    blind = _blind(problem, floating)
    seen = pair_margin(*_padded(blind.X, blind.R))
    lasting = pair_margin(*_padded(blind.X, blind.R), unstable_only=True)
    verdicts = _cross_checked(problem, blind.size, seen, lasting)
    findings = _motions(problem.graph, blind) if verdicts.observable is False else []
    if verdicts.observable is None or verdicts.detectable is None:
        findings.append(_undecided(problem.graph, floating, verdicts.margin))
    theorem = "R23, Theorem 13" + ("" if floating.size == 1 else f" for {floating.size} floating components")
    return Diagnosis(verdicts.observable, verdicts.detectable, tuple(findings), theorem, verdicts.margin)


def _blind(problem: RelativeSensing, floating: IntArray) -> _Blind:
    K = _indicators(problem.graph, floating)
    size = _norm(problem.A) or 1.0
    image = problem.A @ (K if problem.is_sparse else K.toarray()) / size
    X = np.asarray((K.T @ image).toarray() if sp.issparse(image) else K.T @ image)
    return _Blind(K, X, _residual(image, K, X), size)


def _indicators(graph: MeasurementGraph, floating: IntArray) -> sp.csc_array:
    """Unit indicator vectors of the floating components: sparse (n, c), orthonormal."""
    groups = [graph.components[k] for k in floating.tolist()]
    entries = np.concatenate([np.full(nodes.shape[0], nodes.shape[0] ** -0.5) for nodes in groups])
    starts = np.cumsum([0, *(nodes.shape[0] for nodes in groups)])
    return sp.csc_array((entries, np.concatenate(groups), starts), shape=(graph.n_nodes, len(groups)))


def _residual(image: Any, K: sp.csc_array, X: FloatArray) -> FloatArray:
    """Triangular factor of ``image - K X``, row block by row block: at most c rows are kept."""
    rows, image_rows = sp.csr_array(K), sp.csr_array(image) if sp.issparse(image) else image
    R: FloatArray = np.zeros((0, X.shape[0]))
    for start in range(0, K.shape[0], _ROWS):
        part = image_rows[start : start + _ROWS]
        R = np.asarray(np.linalg.qr(np.vstack([R, _dense(part) - rows[start : start + _ROWS] @ X]), mode="r"))
    return R


def _norm(matrix: Any) -> float:
    """The 2-norm, or above 500 rows the smaller of two upper bounds of it."""
    if max(matrix.shape) <= _DENSE:
        return float(np.linalg.norm(_dense(matrix), 2))
    entries = abs(matrix)
    sums = float(entries.sum(axis=0).max()) * float(entries.sum(axis=1).max())
    return float(min(sums, (entries * entries).sum()) ** 0.5)  # csr_array: entry by entry, as for dense ones


def _dense(matrix: Any) -> FloatArray:
    dense: FloatArray = matrix.toarray() if sp.issparse(matrix) else matrix
    return dense


def _padded(X: NDArray[Any], R: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The pair beside one state that is plainly seen: ``pair_margin`` then measures against 1, not against noise."""
    return la.block_diag(X, 0.0), la.block_diag(R, 1.0)


def _cross_checked(problem: RelativeSensing, size: float, seen: PairMargin, lasting: PairMargin) -> _Verdicts:
    """The verdicts of the pair on span K, held against the whole pair where that can be afforded."""
    n = problem.graph.n_nodes
    if n > _WHOLE_PAIR:
        holds = n > _DENSE or seen.verdict is not True or _lower_bound(problem, seen.margin) >= _OBSERVABLE
        observable = seen.verdict if holds else None
        return _Verdicts(observable, observable or lasting.verdict, seen.margin)
    A = _dense(problem.A) / size
    C = _compressed_output(problem)
    margin = _whole_margin(A, C, seen, unstable_only=False)
    lasting_margin = _whole_margin(A, C, lasting, unstable_only=True)
    observable = seen.verdict if seen.verdict is _verdict(margin) else None
    detectable = lasting.verdict if lasting.verdict is _verdict(lasting_margin) else None
    return _Verdicts(observable, observable or detectable, margin)


def _whole_margin(A: FloatArray, C: FloatArray, small: PairMargin, *, unstable_only: bool) -> float:
    """Margin of the whole pair, the mode found on span K tried as well."""
    found = pair_margin(A, C, unstable_only=unstable_only).margin
    if not np.isfinite(small.margin):
        return found
    pencil = np.vstack([small.mode * np.eye(A.shape[0]) - A, C])
    size = float(np.linalg.norm(np.vstack([A, C]), 2)) or 1.0
    return min(found, float(la.svdvals(pencil)[-1]) / size)


def _lower_bound(problem: RelativeSensing, margin: float) -> float:
    """Least margin the whole pair can have: on span K ``margin``, across it the smallest nonzero singular value of C.

    For |s| <= 2 (A has norm one) the pencil is bounded below by ``[[margin, -3], [0, g]]``; beyond, by 1.
    """
    gap = _output_gap(problem)
    return float(la.svdvals(np.array([[margin, -3.0], [0.0, gap]]))[-1])


def _output_gap(problem: RelativeSensing) -> float:
    """Lower bound of the smallest nonzero singular value of ``G^T``, relative to its norm (G16, Theorem 1)."""
    largest = max(nodes.shape[0] for nodes in problem.graph.components)
    return float(np.sqrt(worst_case_eigenvalue(largest))) / (_norm(problem.output()) or 1.0)


def _anchored_margin(problem: RelativeSensing) -> float:
    if problem.graph.n_nodes > _WHOLE_PAIR:
        return _output_gap(problem)
    A = _dense(problem.A)
    return pair_margin(A / (_norm(A) or 1.0), _compressed_output(problem)).margin


def _compressed_output(problem: RelativeSensing) -> FloatArray:
    """Triangular factor of ``G^T``, at most n rows, with norm one (or zero)."""
    C: FloatArray = np.asarray(np.linalg.qr(problem.output().toarray(), mode="r"))
    return C / (_norm(C) or 1.0)


def _verdict(margin: float) -> bool | None:
    if margin <= _UNOBSERVABLE:
        return False
    return True if margin >= _OBSERVABLE else None


def _motions(graph: MeasurementGraph, blind: _Blind) -> list[Finding]:
    """The motions on span K that no output shows, one after the other; found ones are divided out."""
    X, R, basis = blind.X, blind.R, np.eye(blind.X.shape[0])
    findings: list[Finding] = []
    while X.shape[0] and len(findings) < _NAMED:
        found = pair_margin(*_padded(X, R))
        if found.verdict is not False:
            break
        mode, vector = _real_where_possible(X, R, found)
        findings.append(_motion(graph, blind.K @ (basis @ vector), mode * blind.size, mode.real >= _STABLE))
        plane = vector[:, None] if np.isrealobj(vector) else np.column_stack([vector.real, vector.imag])
        rest = la.qr(plane)[0][:, plane.shape[1] :]
        X, R, basis = rest.T @ X @ rest, R @ rest, basis @ rest
    return findings


def _real_where_possible(X: FloatArray, R: FloatArray, found: PairMargin) -> tuple[complex, NDArray[Any]]:
    """The mode and its vector without the padding; of a conjugate pair the one with positive imaginary part.

    A real mode inside a Jordan block may be computed as a complex one; the real part serves as well if it, too, makes
    the pencil all but singular (1e-10).
    """
    mode, vector = found.mode, found.direction[:-1]
    values, right = la.svd(np.vstack([mode.real * np.eye(X.shape[0]) - X, R]), full_matrices=False)[1:]
    if values[-1] <= _REAL:
        return complex(mode.real), right[-1]
    return (mode, vector) if mode.imag > 0 else (mode.conjugate(), vector.conj())


def _motion(graph: MeasurementGraph, direction: NDArray[Any], mode: complex, lasts: bool) -> Finding:
    nodes = np.flatnonzero(np.abs(direction) > 1e-9 * np.abs(direction).max())
    who = listing(graph, nodes)
    together = np.unique(graph.component_labels[nodes]).shape[0] == 1
    what = "move by equal amounts" if together else "move component by component, by equal amounts inside each,"
    value = f"{mode.real:.6g}" if mode.imag == 0 else f"{mode:.6g}"
    fate = "does not die out" if lasts else "dies out by itself"
    return Finding(
        "blind-motion",
        tuple(nodes.tolist()),
        f"{who} can {what} with no measurement noticing: the system has the mode s = {value} there, which {fate}.",
        "Add one absolute reading at any of them" + ("." if together else ", best one in every floating component."),
        direction[nodes][:, None],
    )


def _undecided(graph: MeasurementGraph, floating: IntArray, margin: float) -> Finding:
    nodes = np.sort(np.concatenate([graph.components[k] for k in floating.tolist()]))
    return Finding(
        "undecided",
        tuple(nodes.tolist()),
        f"{listing(graph, nodes)}: the common motion is within {margin:.1e} (relative) of one that no measurement "
        "notices: rounding decides there.",
        "Add an absolute reading in every floating component (then A plays no part), or give A in more digits.",
    )


def _one_by_one(problem: RelativeSensing, floating: IntArray) -> Diagnosis:
    """Too many floating components for the small pair: does one alone hide a motion?"""
    graph = problem.graph
    K = _indicators(graph, floating)
    size = _norm(problem.A) or 1.0
    image = sp.csc_array(problem.A @ K) / size
    modes = np.asarray((K * image).sum(axis=0)).ravel()
    rest = sp.csc_array(image - K * modes)
    values = np.sqrt(np.asarray((rest * rest).sum(axis=0)).ravel())
    hidden = np.flatnonzero(values <= _UNOBSERVABLE)
    lasts = modes[hidden] >= _STABLE
    margin = float(values.min())
    findings = [
        _motion(graph, K[:, [k]].toarray().ravel(), complex(modes[k] * size), bool(modes[k] >= _STABLE))
        for k in hidden[np.argsort(~lasts, kind="stable")][:_NAMED].tolist()
    ]
    if not hidden.size and floating.size <= _FULL_RANK:
        full = float(la.svdvals(_blind(problem, floating).R)[-1])
        if full >= _OBSERVABLE:
            return Diagnosis(True, True, (), "R23, Theorem 13: no motion of the floating components is invariant", full)
    if not lasts.any():
        findings.append(_undecided(graph, floating, margin))
    theorem = f"R23, Theorem 13, each of {floating.size} floating components alone"
    return Diagnosis(False if hidden.size else None, False if lasts.any() else None, tuple(findings), theorem, margin)
