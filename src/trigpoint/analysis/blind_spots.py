"""Which mode of the agreement dynamics the measured nodes see least (R23, Lemma 17, with a margin)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import minimize_scalar

from trigpoint.arrays import FloatArray, IntArray

_UNOBSERVABLE = 1e-12
_OBSERVABLE = 1e-9
_CANDIDATES = 6
_NEIGHBOURS = 12
_WINDOW = 7


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues and eigenvectors of a Laplacian ``L = U diag(values) U'``, divided by its norm.

    Attributes:
        values: (N,) ascending eigenvalues of ``L / size``.
        vectors: (N, N) orthonormal eigenvectors U, one a column.
        size: the norm of L (1 where L = 0).
        starts: first positions of the clusters of equal eigenvalues (gaps up to ``10 N eps``), and N at the end.
    """

    values: FloatArray
    vectors: FloatArray
    size: float
    starts: IntArray

    def cluster(self, mode: int) -> tuple[int, int]:
        """First position and end of the cluster in which ``mode`` lies."""
        at = int(np.searchsorted(self.starts, mode, side="right")) - 1
        return int(self.starts[at]), int(self.starts[at + 1])

    @property
    def multiplicity(self) -> int:
        """Size of the largest cluster: so many nodes must be measured at least (R23, Theorem 18)."""
        return int(np.diff(self.starts).max())


@dataclass(frozen=True, eq=False)
class BlindSpot:
    """What the measured nodes see least.

    Attributes:
        margin: ``min_s sigma_min([s I + L / ||L||; E'])`` over real s.
        mode: s of the unscaled dynamics, where it is attained.
        direction: (N,) unit vector that attains it.
    """

    margin: float
    mode: float
    direction: FloatArray

    @property
    def verdict(self) -> bool | None:
        """False up to 1e-12, True from 1e-9, None between."""
        if self.margin <= _UNOBSERVABLE:
            return False
        return True if self.margin >= _OBSERVABLE else None


def spectrum_of(L: sp.sparray) -> Spectrum:
    """Eigenvalues in clusters, and eigenvectors, of the sparse Laplacian ``L`` (N, N). Cost O(N^3).

    Source: R23, Section VI.
    """
    values, vectors = la.eigh(L.toarray())
    size = float(values[-1]) if values[-1] > 0.0 else 1.0
    scaled = values / size
    tolerance = 10.0 * values.shape[0] * np.finfo(np.float64).eps
    breaks = np.flatnonzero(np.diff(scaled) > tolerance) + 1
    return Spectrum(scaled, vectors, size, np.concatenate([[0], breaks, [values.shape[0]]]).astype(np.int64))


def blind_spot(spectrum: Spectrum, measured: IntArray) -> BlindSpot:
    """Mode seen least from the nodes ``measured``: ``min_s sigma_min([s I + L / ||L||; E'])``.

    In the eigenbasis the pencil is ``[s I + diag(values); U[measured, :]]``. All modes are tried in windows of seven
    neighbours, the worst six refined over s in windows of their cluster and twelve neighbours at either side. The
    value is attained, so it is never less than the true minimum; it may be more where a mode left out is worse.

    Args:
        spectrum: of the whole component.
        measured: indices of the measured nodes, at least one.

    Cost O(N k) for k measured nodes, and O(m^3) for a cluster of m equal eigenvalues.
    Source: R23, Lemma 17 and Theorems 6, 18 (E-001-1: real s suffices, L being symmetric).
    """
    V = spectrum.vectors[measured]
    scores = _scores(spectrum, V)
    worst = np.argsort(scores, kind="stable")[:_CANDIDATES]
    best = _refined(spectrum, V, int(worst[0]))
    for mode in worst[1:].tolist():
        if best.verdict is False:
            break
        best = min(best, _refined(spectrum, V, mode), key=lambda spot: spot.margin)
    return best


def unseen_in_cluster(spectrum: Spectrum, measured: IntArray, start: int, end: int) -> FloatArray:
    """(N,) unit eigenvector of the cluster ``start:end`` of ``spectrum`` that is smallest on ``measured``.

    Source: R23, proof of Theorem 18.
    """
    basis = spectrum.vectors[:, start:end]
    direction: FloatArray = basis @ la.svd(basis[measured])[2][-1]
    return direction


def _scores(spectrum: Spectrum, V: FloatArray) -> FloatArray:
    """Upper bounds of the value near each mode: seven neighbouring modes, or the mode's whole cluster."""
    n = spectrum.values.shape[0]
    width = min(_WINDOW, n)
    first = np.clip(np.arange(n) - _WINDOW // 2, 0, n - width)
    window = first[:, None] + np.arange(width)
    pencils = np.zeros((n, width + min(V.shape[0], width), width))
    pencils[:, np.arange(width), np.arange(width)] = spectrum.values[window] - spectrum.values[:, None]
    outputs = V[:, window].transpose(1, 0, 2)
    pencils[:, width:] = np.linalg.qr(outputs, mode="r") if V.shape[0] > width else outputs
    scores: FloatArray = np.linalg.svd(pencils, compute_uv=False)[:, -1]
    for start, end in zip(spectrum.starts[:-1].tolist(), spectrum.starts[1:].tolist(), strict=True):
        if end - start > V.shape[0]:
            scores[start] = 0.0
        elif end - start > 1:
            scores[start] = min(scores[start], float(la.svdvals(V[:, start:end])[-1]))
    return scores


def _repeated(spectrum: Spectrum, V: FloatArray, start: int, end: int) -> BlindSpot:
    """A mode repeated more often than nodes are measured: a combination vanishes on them (R23, Theorem 18)."""
    spread = spectrum.values[start:end] - spectrum.values[start:end].mean()
    combination = la.svd(V[:, start:end])[2][-1]
    direction = spectrum.vectors[:, start:end] @ combination
    s = -float(spectrum.values[start:end].mean()) * spectrum.size
    return BlindSpot(float(np.linalg.norm([*(spread * combination), *(V[:, start:end] @ combination)])), s, direction)


def _refined(spectrum: Spectrum, V: FloatArray, mode: int) -> BlindSpot:
    start, end = spectrum.cluster(mode)
    if end - start > V.shape[0]:
        return _repeated(spectrum, V, start, end)
    n = spectrum.values.shape[0]
    low, high = max(0, start - _NEIGHBOURS), min(n, end + _NEIGHBOURS)
    values, seen = spectrum.values[low:high], V[:, low:high]
    if seen.shape[0] > seen.shape[1]:
        seen = np.asarray(np.linalg.qr(seen, mode="r"))
    centre = float(spectrum.values[start:end].mean())
    below = centre if start == 0 else 0.5 * (centre + float(spectrum.values[start - 1]))
    above = centre if end == n else 0.5 * (centre + float(spectrum.values[end]))

    def pencil(at: float) -> FloatArray:
        return np.vstack([np.diag(values - at), seen])

    at, margin = centre, float(np.linalg.svd(pencil(centre), compute_uv=False)[-1])
    if margin > _UNOBSERVABLE and above > below:
        better = minimize_scalar(
            lambda point: float(np.linalg.svd(pencil(point), compute_uv=False)[-1]),
            bounds=(below, above),
            method="bounded",
            options={"xatol": 1e-3 * (above - below)},
        )
        if better.fun < margin:
            at, margin = float(better.x), float(better.fun)
    vector = la.svd(pencil(at), full_matrices=False)[2][-1]
    return BlindSpot(margin, -at * spectrum.size, spectrum.vectors[:, low:high] @ vector)
