"""The cascade itself: split, trees, dealt targets, gains; and what holds exactly about the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import MethodError
from trigpoint.linalg.injection import spectrum_error
from trigpoint.methods.cascade.gains import Gains, root_injection
from trigpoint.methods.cascade.splitting import Split
from trigpoint.methods.cascade.targets import deal, matrix_with, nearest_list
from trigpoint.model import SharedPlant


@dataclass(frozen=True, eq=False)
class Cascade:
    """A designed cascade.

    Attributes:
        gains: of all agents.
        split: the blocks and their roots.
        depth: {(block, agent): distance from the block's root}.
        block_error: largest distance between the eigenvalues of a diagonal block and its targets.
    """

    gains: Gains
    split: Split
    depth: dict[tuple[int, int], int]
    block_error: float


def cascade(problem: SharedPlant, split: Split, reals: Sequence[float], pairs: Sequence[complex]) -> Cascade:
    """Design the cascade on ``split`` with the eigenvalues ``reals`` and ``pairs`` (upper halves).

    Every agent but the root copies block k from its parent in a tree: ``F_{i,par} += T_k (A_kk - S_ki) T_k'``; the root
    corrects it by its own reading: ``K += T_k L_k``. Ordered by (block, depth) the error is block lower triangular.
    Source: 002-10; theory 4.1, steps 2 and 3.
    """
    graph = problem.digraph()
    trees = [nx.bfs_tree(graph, root) for root in split.roots]
    levels = [nx.single_source_shortest_path_length(graph, root) for root in split.roots]
    slots = sorted(
        ((k, agent) for k in range(split.blocks.count) for agent in range(problem.n_agents)),
        key=lambda slot: (levels[slot[0]][slot[1]], slot),
    )
    dealt = deal([split.blocks.size(k) for k, _ in slots], reals, pairs)
    if dealt is None:
        raise _too_few_reals(problem, split, reals, pairs)
    inner = split.T.T @ problem.A @ split.T
    couplings: dict[tuple[int, int], FloatArray] = {}
    injections: dict[int, FloatArray] = {}
    worst = 0.0
    for (k, agent), targets in zip(slots, dealt, strict=True):
        T, own = split.basis(k), split.blocks.slice(k)
        A_kk = inner[own, own]
        if agent == split.roots[k]:
            C = problem.outputs[agent] @ T
            L = root_injection(A_kk, C, targets)
            injections[agent] = injections.get(agent, 0.0) + T @ L
            worst = max(worst, spectrum_error(A_kk - L @ C, np.array(targets)))
        else:
            parent = next(iter(trees[k].predecessors(agent)))
            S = matrix_with(targets, joined=False)
            couplings[agent, parent] = couplings.get((agent, parent), 0.0) + T @ (A_kk - S) @ T.T
            worst = max(worst, spectrum_error(S, np.array(targets)))
    depth = {(k, agent): levels[k][agent] for k, agent in slots}
    return Cascade(Gains(couplings, injections), split, depth, worst)


def _too_few_reals(problem: SharedPlant, split: Split, reals: Sequence[float], pairs: Sequence[complex]) -> MethodError:
    sizes = [split.blocks.size(k) for k in range(split.blocks.count)]
    needed = problem.n_agents * sum(size % 2 for size in sizes)
    offered = nearest_list(reals, pairs, needed)
    listed = ", ".join(f"{v.real:.6g}" + (f"{v.imag:+.6g}j" if v.imag else "") for v in offered[:12])
    more = f", ... ({len(offered)} in all)" if len(offered) > 12 else ""
    return MethodError(
        "SpectrumAssignment",
        f"at least {needed} real eigenvalues: each of the {problem.n_agents} agents has one odd block of sizes {sizes}",
        f"{len(reals)}",
        f"The nearest list that can be dealt is {listed}{more}; CouplingGain(rate) needs no list.",
    )


def structural_residual(H: FloatArray, cascade_: Cascade, n: int) -> float:
    """Largest entry above the block diagonal of H in the cascade's coordinates, relative to the largest of all.

    Args: dense ``H`` (m n, m n), the ``cascade_`` and the plant's order ``n``.
    """
    split = cascade_.split
    m = H.shape[0] // n
    T = np.kron(np.eye(m), split.T)
    inner = (T.T @ H @ T).reshape(m, n, m, n)
    rank = np.empty((m, n), dtype=np.int64)
    ordered = sorted(cascade_.depth, key=lambda slot: (slot[0], cascade_.depth[slot], slot[1]))
    for position, (k, agent) in enumerate(ordered):
        rank[agent, split.blocks.slice(k)] = position
    above = rank[:, :, None, None] < rank[None, None, :, :]
    return float(np.abs(inner[above]).max(initial=0.0)) / (float(np.abs(inner).max(initial=0.0)) or 1.0)
