"""An orthogonal split of the plant's state: block k belongs to one agent that sees it, once the earlier are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trigpoint.analysis.observability_split import observability_split
from trigpoint.arrays import FloatArray, frozen
from trigpoint.linalg.blocks import Ranges


@dataclass(frozen=True, eq=False)
class Split:
    """``T = [T_1 ... T_c]`` orthogonal, with ``T' A T`` block lower triangular and ``C_{a_k} T_j = 0`` for j > k.

    Attributes:
        T: (n, n).
        blocks: index ranges of the blocks among the columns of T.
        roots: a_k, the agent that each block belongs to.
        residual: largest entry of T' A T and of the roots' C T that should vanish, relative to A and C.
    """

    T: FloatArray
    blocks: Ranges
    roots: tuple[int, ...]
    residual: float

    def basis(self, block: int) -> FloatArray:
        """``T_k``, (n, n_k)."""
        return np.asarray(self.T[:, self.blocks.slice(block)])


def split_by_agents(
    A: FloatArray, outputs: Sequence[FloatArray], order: Sequence[int], tolerance: float
) -> Split | None:
    """Let the agents in ``order`` take the directions that they see beyond the earlier ones; None if some are left.

    Args:
        A: (n, n).
        outputs: C_i of all agents.
        order: agents that may be roots.
        tolerance: directions seen more weakly than this (relative singular values of the staircase) are left to others.

    Each step takes the agent that sees most of what is left. Cost O(m n^3) a block. Source: 002-10; theory 4.1, step 1.
    """
    n = A.shape[0]
    rest, columns, roots = np.eye(n), [], []
    while rest.shape[1]:
        inner = rest.T @ A @ rest
        best, seen = -1, np.zeros((rest.shape[1], 0))
        for agent in order:
            if outputs[agent].shape[0] == 0 or agent in roots:
                continue
            found = observability_split(inner, _relevant(outputs[agent], rest, tolerance), tolerance).seen
            if found.shape[1] > seen.shape[1]:
                best, seen = agent, found
        if best < 0:
            return None
        columns.append(rest @ seen)
        roots.append(best)
        rest = rest @ np.linalg.svd(seen)[0][:, seen.shape[1] :]
    T = np.linalg.qr(np.hstack(columns))[0]
    blocks = Ranges.of(column.shape[1] for column in columns)
    return Split(frozen(T), blocks, tuple(roots), _residual(A, outputs, T, blocks, roots))


def _relevant(C: FloatArray, rest: FloatArray, tolerance: float) -> FloatArray:
    """C on what is left; nothing where all of it is weak against C itself."""
    left = C @ rest
    weak = np.linalg.norm(left, 2) <= tolerance * np.linalg.norm(C, 2)
    return np.zeros((0, rest.shape[1])) if weak else np.asarray(left)


def _residual(
    A: FloatArray, outputs: Sequence[FloatArray], T: FloatArray, blocks: Ranges, roots: Sequence[int]
) -> float:
    inner, size = T.T @ A @ T, float(np.abs(A).max(initial=0.0)) or 1.0
    worst = 0.0
    for k, root in enumerate(roots):
        later = slice(blocks.starts[k + 1], T.shape[1])
        worst = max(worst, float(np.abs(inner[blocks.slice(k), later]).max(initial=0.0)) / size)
        C = outputs[root]
        seen = float(np.abs(C @ T[:, later]).max(initial=0.0))
        worst = max(worst, seen / (float(np.abs(C).max(initial=0.0)) or 1.0))
    return worst
