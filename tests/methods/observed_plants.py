"""Plants with many observers: theory's test bed, drawn ones, and the coupling design written out as an oracle."""

from __future__ import annotations

from itertools import pairwise

import networkx as nx
import numpy as np
import scipy.linalg as la
from hypothesis import strategies as st

from trigpoint.model import SharedPlant


def hears_of(kind: str, m: int, rng: np.random.Generator) -> dict[int, list[int]]:
    """Directed ring, bidirectional ring, or a strongly connected digraph of mean in-degree about 3.5."""
    if kind == "directed ring":
        return {i: [(i - 1) % m] for i in range(m)}
    if kind == "ring":
        return {i: [(i - 1) % m, (i + 1) % m] for i in range(m)}
    while True:
        graph = nx.gnp_random_graph(m, min(1.0, 3.5 / m), seed=int(rng.integers(1 << 30)), directed=True)
        if nx.is_strongly_connected(graph):
            return {i: sorted(graph.predecessors(i)) for i in range(m)}


def bed(m: int, n: int, kind: str, seed: int = 0, inputs: int = 0) -> SharedPlant:
    """A rotated block diagonal plant, from unstable to stable; agent i sees one block, and every block is seen."""
    rng = np.random.default_rng(seed)
    sizes: list[int] = []
    while sum(sizes) < n:
        sizes.append(min(n - sum(sizes), int(rng.integers(1, 3))))
    while len(sizes) > m:  # as many blocks as agents at most
        last = sizes.pop()
        sizes[int(np.argmin(sizes))] += last
    ends = np.cumsum([0, *sizes])
    A, C = np.zeros((n, n)), np.zeros((m, n))
    for start, end in pairwise(ends.tolist()):
        block = rng.normal(size=(end - start, end - start))
        A[start:end, start:end] = block - (la.eigvals(block).real.max() - rng.uniform(-1.0, 0.3)) * np.eye(end - start)
    for agent in range(m):
        k = agent % len(sizes)
        C[agent, ends[k] : ends[k + 1]] = rng.uniform(0.5, 1.5, size=sizes[k])
    turn = la.qr(rng.normal(size=(n, n)))[0]
    B = rng.normal(size=(n, inputs)) if inputs else None
    return SharedPlant(turn @ A @ turn.T, [row[None, :] @ turn.T for row in C], hears_of(kind, m, rng), B)


@st.composite
def drawn_plants(draw, max_agents: int = 5, max_states: int = 5) -> SharedPlant:
    """Strongly connected, jointly observable; some agents sense nothing, others one block."""
    m, n = draw(st.integers(1, max_agents)), draw(st.integers(1, max_states))
    kind = draw(st.sampled_from(["directed ring", "ring", "random"]))
    plant = bed(m, n, kind, draw(st.integers(0, 10_000)), draw(st.integers(0, 2)))
    blind = draw(st.integers(0, 2))
    hears = {i: list(others) for i, others in enumerate(plant.hears)}
    for agent in range(m, m + blind):
        hears[agent], hears[agent - 1] = [agent - 1], [*hears[agent - 1], agent]
    return SharedPlant(plant.A, [*plant.outputs, *[None] * blind], hears, plant.B)


def unseen_by_rank(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Null space of ``[C; C A; ...]``."""
    rows = [C]
    for _ in range(A.shape[0] - 1):
        rows.append(rows[-1] @ A / max(np.linalg.norm(A, 2), 1.0))
    return la.null_space(np.vstack(rows), rcond=1e-7)


def oracle(plant: SharedPlant) -> tuple[np.ndarray, float, float]:
    """(r, mu, lam) of a strongly connected plant, from dense matrices."""
    m, n = plant.n_agents, plant.n_states
    L = np.zeros((m, m))
    for i, others in enumerate(plant.hears):
        L[i, i] = len(others)
        L[i, list(others)] = -1.0
    r = np.abs(la.null_space(L.T)[:, 0]) if m > 1 else np.ones(1)
    r = r / r.mean()
    bases = [unseen_by_rank(plant.A, C) if C.size else np.eye(n) for C in plant.outputs]
    mu = max((np.linalg.eigvalsh(U.T @ (plant.A + plant.A.T) @ U / 2)[-1] for U in bases if U.size), default=-np.inf)
    U = la.block_diag(*[basis if basis.size else np.zeros((n, 0)) for basis in bases])
    form = U.T @ np.kron(np.diag(r) @ L + L.T @ np.diag(r), np.eye(n)) @ U
    return r, float(mu), float(np.linalg.eigvalsh(form)[0]) if form.size else np.inf
