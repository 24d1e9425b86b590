"""What one output shows of a state and what it does not, as two orthonormal bases with the gap between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class ObservabilitySplit:
    """The observability decomposition of a pair (A, C): ``seen' A unseen = 0`` and ``C unseen = 0``.

    Attributes:
        seen: (n, k) orthonormal: the observable part is ``seen' x``.
        unseen: (n, n - k) orthonormal complement: the unobservable subspace, which A maps into itself.
        kept: smallest singular value that was counted as seen, relative; infinite where nothing is seen.
        dropped: largest one that was not, relative; 0 where none was left over.
        leak: how far the two equations above are from true: the larger of ``|seen' A unseen| / |A|`` and
            ``|C unseen| / |C|``.
    """

    seen: FloatArray
    unseen: FloatArray
    kept: float
    dropped: float
    leak: float


def observability_split(A: FloatArray, C: FloatArray, tolerance: float = 1e-8) -> ObservabilitySplit:
    """Split the state of (A, C) by a staircase of singular value decompositions.

    Args:
        A: (n, n).
        C: (p, n); p = 0 allowed, units do not matter.
        tolerance: singular values up to it (relative to C in the first stair, to A in the others) count as not seen.

    We assume:
        * n is small. Trust the split where ``dropped`` is far below ``kept``; ``leak`` says what it costs otherwise.

    Cost O(n^3 + p n^2). Source: theory 4b-B1; 002-10.
    """
    n = A.shape[0]
    size, reach = _norm(A) or 1.0, _norm(C)
    seen, stair = np.zeros((n, 0)), C.T / (reach or 1.0)
    kept, dropped = np.inf, 0.0
    while stair.shape[1] and seen.shape[1] < n:
        left, values, _ = la.svd(stair, full_matrices=False)
        clear = values > tolerance
        kept = min(kept, float(values[clear].min(initial=np.inf)))
        # A stair has more columns than there are directions left: what is over is rounding by construction.
        room = values[: n - seen.shape[1]]
        dropped = max(dropped, float(room[~clear[: room.shape[0]]].max(initial=0.0)))
        fresh = left[:, clear][:, : n - seen.shape[1]]
        seen = np.hstack([seen, fresh])
        stair = A.T @ fresh / size
        for _ in range(2):
            stair = stair - seen @ (seen.T @ stair)
    basis = la.qr(seen)[0] if seen.shape[1] else np.eye(n)
    unseen = basis[:, seen.shape[1] :]
    leak = max(_norm(seen.T @ A @ unseen) / size, _norm(C @ unseen) / (reach or 1.0))
    return ObservabilitySplit(seen, unseen, kept, dropped, leak)


def _norm(matrix: FloatArray) -> float:
    return float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0
