"""R23, Section VI: symmetry makes an anchor useless, and not only symmetry does (all graphs of up to six nodes)."""

from __future__ import annotations

import itertools
from dataclasses import replace

import networkx as nx
import numpy as np

import trigpoint as tp
from trigpoint.arrays import FloatArray
from trigpoint.papers.base import Cell, Reproduction, cell, found, unspecified

_ZERO = 1e-9


def is_symmetric(adjacency: FloatArray, node: int) -> bool:
    """True where a permutation other than the identity keeps the graph and leaves ``node`` in place."""
    n = adjacency.shape[0]
    orders = np.array(list(itertools.permutations(range(n))))
    kept = orders[(orders[:, node] == node) & (orders != np.arange(n)).any(axis=1)]
    return bool((adjacency[kept[:, :, None], kept[:, None, :]] == adjacency).all(axis=(1, 2)).any())


def blind(laplacian: FloatArray, node: int) -> bool:
    """True where some eigenvector vanishes at ``node`` or an eigenvalue is repeated (Lemma 17, Theorem 18)."""
    values, vectors = np.linalg.eigh(laplacian)
    return bool((np.diff(values) < _ZERO).any() or (np.abs(vectors[node]) < _ZERO).any())


def count(n: int) -> tuple[int, int, int, int, int]:
    """All connected graphs of ``n`` nodes: anchored pairs; unobservable, symmetric; the first only, the second only."""
    pairs = unobservable = symmetric = without = against = 0
    for graph in nx.graph_atlas_g():
        if graph.number_of_nodes() != n or not nx.is_connected(graph):
            continue
        adjacency = nx.to_numpy_array(graph)
        laplacian = np.diag(adjacency.sum(axis=0)) - adjacency
        for node in range(n):
            unseen, same = blind(laplacian, node), is_symmetric(adjacency, node)
            pairs, unobservable, symmetric = pairs + 1, unobservable + unseen, symmetric + same
            without, against = without + (unseen and not same), against + (same and not unseen)
    return pairs, unobservable, symmetric, without, against


def run(largest: int = 6, anchor: int = 1) -> Reproduction:
    """Fig. 1 and the census of all connected graphs of up to ``largest`` (at most 7) nodes.

    Args: ``anchor``, the middle node of Fig. 1 (a).
    """
    path, ring = tp.graphs.chain(3, anchors=()), tp.graphs.cycle(4)
    cells = [
        _verdict("Fig. 1 (a), node 2: observable", path, anchor, expected_observable=False),
        _verdict("Fig. 1 (a), node 1: observable", path, 0, expected_observable=True),
        _verdict("Fig. 1 (a), node 3: observable", path, 2, expected_observable=True),
    ]
    for name, graph in (("cycle of 4", ring), ("complete graph of 4", tp.graphs.complete(4))):
        for node in range(4):
            at = f"Fig. 1 (b), {name}, node {node + 1}: observable"
            cells.append(_verdict(at, graph, node, expected_observable=False))
    cells += _census(largest)
    cells += _counterexample()
    text = (
        "A symmetry that leaves the anchor in place hides a mode (Theorem 21). The converse is false from six nodes on "
        "(E-001-9): a path of six nodes anchored at its second one has no such symmetry and a mode that it cannot see."
    )
    return Reproduction("r23-symmetry", "R23, Section VI, Theorems 18 and 21, Fig. 1", text, tuple(cells))


def _verdict(at: str, graph: tp.MeasurementGraph, node: int, *, expected_observable: bool) -> Cell:
    observable = tp.diagnose(tp.AgreementDynamics(graph, [node])).observable is True
    one = cell(at, float(expected_observable), float(observable), 0.0)
    return replace(one, is_statement=True)


def _census(largest: int) -> list[Cell]:
    cells = []
    for n in range(2, largest + 1):
        pairs, unobservable, symmetric, without, against = count(n)
        cells.append(unspecified(f"anchored graphs of {n} nodes", pairs, "all connected graphs, every node"))
        cells.append(cell(f"n = {n}: symmetric and observable", 0.0, against, 0.0, note="Theorem 21"))
        cells.append(unspecified(f"n = {n}: unobservable", unobservable, "census"))
        cells.append(unspecified(f"n = {n}: symmetric", symmetric, "census"))
        note = "the converse of Theorem 21 fails (E-001-9)" if without else "the converse of Theorem 21 holds here"
        cells.append(unspecified(f"n = {n}: unobservable without symmetry", without, note))
    return cells


def _counterexample() -> list[Cell]:
    arcs = ((0, 1), (0, 5), (2, 3), (3, 4), (4, 5))
    graph = tp.MeasurementGraph(6, [a for a, _ in arcs], [b for _, b in arcs])
    diagnosis = tp.diagnose(tp.AgreementDynamics(graph, [0]))
    adjacency = np.diag(graph.laplacian().diagonal()) - graph.laplacian().toarray()
    return [
        found("path of 6, second node: unobservable", diagnosis.observable is False, "an eigenvector vanishes there"),
        found("path of 6, second node: without symmetry", not is_symmetric(adjacency, 0), "its ends are 1 and 4 away"),
    ]
