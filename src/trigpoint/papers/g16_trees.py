"""G16, Theorem 1 by enumeration: the smallest eigenvalue over all trees and all places of the anchor."""

from __future__ import annotations

import networkx as nx
import numpy as np

import trigpoint as tp
from trigpoint.papers.base import Reproduction, cell, unspecified


def eigenvalues(n: int, weight: float = 1.0) -> list[float]:
    """``lambda_min`` of every tree of ``n`` nodes with one anchor (its arc's ``weight``), ascending: all n places."""
    found = []
    for tree in nx.nonisomorphic_trees(n):
        arcs = list(tree.edges)
        weights = [*(1.0 for _ in arcs), weight]
        for anchor in range(n):
            tail = [a for a, _ in arcs] + [tp.EXTERNAL]
            head = [b for _, b in arcs] + [anchor]
            laplacian = tp.MeasurementGraph(n, tail, head, weights).laplacian().toarray()
            found.append(float(np.linalg.eigvalsh(laplacian)[0]))
    return sorted(found)


def run(largest: int = 8, weight: float = 1.0) -> Reproduction:
    """Trees of up to ``largest`` nodes against Theorem 1; ``weight`` of the anchor's arc (the paper's is 1)."""
    cells = []
    for n in range(2, largest + 1):
        values = eigenvalues(n, weight)
        at = f"smallest over {len(values)} anchored trees, N = {n}"
        cells.append(cell(at, tp.worst_case_eigenvalue(n), values[0], 1e-13))
        if n == 8:
            other = next(value for value in values if value > values[0] + 1e-9)
            cells.append(cell("1 / smallest, N = 8", 29.37, 1.0 / values[0], 5e-3))
            cells.append(unspecified("second smallest, N = 8", other, "only the chain anchored at its end is worst"))
    text = "No tree, wherever its anchor, has a smaller eigenvalue than the chain anchored at its end."
    return Reproduction("g16-trees", "G16, Proposition 3 and Theorem 1", text, tuple(cells))
