"""Symmetries of a weighted network that leave given nodes in place (R23, Definitions 19 and 20)."""

from __future__ import annotations

import importlib
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import networkx as nx
import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from trigpoint.arrays import IntArray, as_indices
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.graphs import MeasurementGraph

SMALL = 200
"""Up to this many nodes the search works without the extra ``symmetry``."""

_Permutation = tuple[int, ...]


@dataclass(frozen=True)
class Symmetry:
    """Automorphisms of a network that leave given nodes in place.

    Attributes:
        orbits: sets of nodes that the automorphisms move onto each other, those of one node left out; ascending.
        generator: one automorphism other than the identity: node i goes to ``generator[i]``.
    """

    orbits: tuple[tuple[int, ...], ...]
    generator: tuple[int, ...]

    @property
    def is_mirror(self) -> bool:
        """True when doing the generator twice moves nothing: it exchanges nodes in pairs."""
        return all(self.generator[image] == node for node, image in enumerate(self.generator))

    @property
    def cycles(self) -> tuple[tuple[int, ...], ...]:
        """The generator as cycles of two nodes or more, each from its first node; pairs where it is a mirror."""
        seen: set[int] = set()
        found = []
        for start in range(len(self.generator)):
            cycle = [start]
            while start not in seen and (image := self.generator[cycle[-1]]) != start:
                cycle.append(image)
            seen.update(cycle)
            if len(cycle) > 1:
                found.append(tuple(cycle))
        return tuple(found)


def find_symmetry(graph: MeasurementGraph, fixed: ArrayLike = ()) -> Symmetry | None:
    """Automorphisms of ``graph`` other than the identity that leave every node of ``fixed`` in place, or None.

    An automorphism is a permutation ``P`` of the nodes with ``P L = L P``, ``L`` the Laplacian of the internal arcs:
    joined nodes stay joined, with the same weight (the sum over parallel arcs, compared to the last bit).

    Args:
        graph: internal arcs only are looked at; their direction plays no part.
        fixed: indices of the nodes that stay in place.

    We assume:
        * scalar arc weights.

    Raises:
        ArgumentError: an index outside 0..N-1, or weight blocks.
        MissingExtraError: more than 200 nodes, a colour refinement that leaves some alike, and python-igraph
            not installed.

    Cost O((N + M) log N) where the colour refinement tells all nodes apart; beyond it, that of the search by BLISS in
    python-igraph (extra ``symmetry``), or of networkx's VF2 up to 200 nodes where igraph is absent.
    Source: R23, Definitions 19 and 20, Theorem 21 (E-001-9).
    """
    chosen = as_indices("fixed", fixed, 0, graph.n_nodes)
    network, colours = _coloured(graph, chosen)
    colours = refine_colours(network, colours)
    if np.unique(colours).shape[0] == graph.n_nodes:
        return None
    try:
        igraph: Any = importlib.import_module("igraph")
    except ImportError:
        if graph.n_nodes > SMALL:
            raise MissingExtraError("igraph", "symmetry", "looking for symmetries of more than 200 nodes") from None
        generators = _by_networkx(network, colours)
    else:
        generators = _by_igraph(igraph, network, colours)
    return _assembled(graph.n_nodes, generators)


def refine_colours(network: sp.csr_array, colours: Sequence[int] | IntArray) -> IntArray:
    """Coarsest colouring, finer than ``colours``, in which equal nodes see equal colours over equal weights.

    Nodes of different colours are never exchanged by an automorphism; if all differ there is none but the identity.

    Args:
        network: sparse symmetric (N, N); its entries are the weights of the edges, compared exactly.
        colours: (N,) whole numbers: nodes that may be exchanged have the same.

    Cost O((N + M) log N). Source: R23, Definition 19 (a fast necessary test).
    """
    members = [set(nodes.tolist()) for nodes in _groups(np.asarray(colours))]
    colour = [0] * network.shape[0]
    for label, nodes in enumerate(members):
        for node in nodes:
            colour[node] = label
    indptr, indices = network.indptr.tolist(), network.indices.tolist()
    weights = np.unique(network.data, return_inverse=True)[1].tolist()
    queue, waiting = list(range(len(members))), set(range(len(members)))
    while queue:
        splitter = queue.pop()
        waiting.discard(splitter)
        seen: defaultdict[int, list[int]] = defaultdict(list)
        for node in members[splitter]:
            for at in range(indptr[node], indptr[node + 1]):
                seen[indices[at]].append(weights[at])
        for cell, parts in _fragments(seen, colour).items():
            queue += _split(cell, parts, members, colour, waiting)
    return np.array(colour, dtype=np.int64)


def _fragments(seen: dict[int, list[int]], colour: list[int]) -> dict[int, list[list[int]]]:
    """Touched nodes by cell, then by what they see of the splitter."""
    views: defaultdict[int, defaultdict[tuple[int, ...], list[int]]] = defaultdict(lambda: defaultdict(list))
    for node, weights in seen.items():
        views[colour[node]][tuple(sorted(weights))].append(node)
    return {cell: list(parts.values()) for cell, parts in views.items()}


def _split(
    cell: int, parts: list[list[int]], members: list[set[int]], colour: list[int], waiting: set[int]
) -> list[int]:
    """Split a cell into its fragments; returns the cells that must still act (all but the largest)."""
    if sum(map(len, parts)) == len(members[cell]):
        largest = max(range(len(parts)), key=lambda k: len(parts[k]))
        parts = parts[:largest] + parts[largest + 1 :]
    labels = [cell]
    for part in parts:
        labels.append(len(members))
        members.append(set(part))
        members[cell].difference_update(part)
        for node in part:
            colour[node] = labels[-1]
    idle = [label for label in labels if label not in waiting]
    if cell not in waiting:
        idle.remove(max(labels, key=lambda label: len(members[label])))
    waiting.update(idle)
    return idle


def _coloured(graph: MeasurementGraph, fixed: IntArray) -> tuple[sp.csr_array, IntArray]:
    """Weighted adjacency of the internal arcs, and colours in which each fixed node stands alone."""
    if graph.dimension != 1:
        raise ArgumentError(f"symmetries need scalar arc weights; got {graph.dimension} x {graph.dimension} blocks")
    inner = ~graph.is_external
    low = np.minimum(graph.tail[inner], graph.head[inner])
    high = np.maximum(graph.tail[inner], graph.head[inner])
    weight = graph.arc_weights[inner]
    order = np.lexsort((weight, high, low))  # parallel arcs are summed in ascending order: equal bundles, equal sums
    low, high, weight = low[order], high[order], weight[order]
    if low.size:
        first = np.flatnonzero(np.concatenate([[True], (np.diff(low) != 0) | (np.diff(high) != 0)]))
        low, high, weight = low[first], high[first], np.add.reduceat(weight, first)
    ends = (np.concatenate([low, high]), np.concatenate([high, low]))
    network = sp.csr_array((np.concatenate([weight, weight]), ends), shape=(graph.n_nodes, graph.n_nodes))
    colours = np.zeros(graph.n_nodes, dtype=np.int64)
    colours[fixed] = 1 + np.arange(fixed.shape[0])
    return network, colours


def _groups(colours: IntArray) -> list[IntArray]:
    order = np.argsort(colours, kind="stable")
    ends = np.flatnonzero(np.diff(colours[order])) + 1
    return np.split(order, ends)


def _by_igraph(igraph: Any, network: sp.csr_array, colours: IntArray) -> list[_Permutation]:
    """Generators by BLISS; a weight is a node in the middle of its edge, coloured by the weight's rank."""
    n = network.shape[0]
    upper = sp.triu(network, format="coo")
    ranks = np.unique(upper.data, return_inverse=True)[1]
    if np.unique(ranks).shape[0] <= 1:
        edges = np.column_stack([upper.row, upper.col])
        every = colours
    else:
        middle = n + np.arange(ranks.shape[0])
        edges = np.concatenate([np.column_stack([upper.row, middle]), np.column_stack([upper.col, middle])])
        every = np.concatenate([colours, colours.max() + 1 + ranks])
    whole = igraph.Graph(n=every.shape[0], edges=edges.tolist())
    return [tuple(generator[:n]) for generator in whole.automorphism_group(color=every.tolist())]


def _by_networkx(network: sp.csr_array, colours: IntArray) -> list[_Permutation]:
    """Generators by VF2: for two nodes of one colour not yet in one orbit, is there an automorphism between them?"""
    found: list[_Permutation] = []
    for nodes in _groups(colours):
        first = int(nodes[0])
        reached = {first}
        for node in nodes[1:].tolist():
            if node in reached:
                continue
            image = _mapping(network, colours, first, node)
            if image is not None:
                found.append(image)
                reached = set(next(orbit for orbit in _orbits(len(colours), found) if first in orbit))
    return found


def _mapping(network: sp.csr_array, colours: IntArray, first: int, node: int) -> _Permutation | None:
    """An automorphism that takes ``first`` to ``node``, or None."""
    n = network.shape[0]
    marked = np.concatenate([colours, colours])
    marked[[first, n + node]] = colours.max() + 1
    both = refine_colours(sp.csr_array(sp.block_diag([network, network])), marked)
    here, there = both[:n], both[n:]
    if not np.array_equal(np.sort(here), np.sort(there)):
        return None
    copies = [nx.from_scipy_sparse_array(network) for _ in range(2)]
    for copy, labels in zip(copies, (here, there), strict=True):
        nx.set_node_attributes(copy, dict(enumerate(labels.tolist())), "colour")
    matcher = nx.algorithms.isomorphism.GraphMatcher(
        *copies,
        node_match=lambda a, b: a["colour"] == b["colour"],
        edge_match=lambda a, b: a["weight"] == b["weight"],
    )
    return tuple(matcher.mapping[k] for k in range(n)) if matcher.is_isomorphic() else None


def _orbits(n: int, generators: Iterable[_Permutation]) -> tuple[tuple[int, ...], ...]:
    images = [np.array(generator) for generator in generators]
    starts = np.tile(np.arange(n), len(images))
    links = sp.coo_array((np.ones(starts.shape[0]), (starts, np.concatenate(images))), shape=(n, n))
    labels = sp.csgraph.connected_components(links, directed=False)[1]
    orbits = (tuple(nodes.tolist()) for nodes in _groups(labels) if nodes.shape[0] > 1)
    return tuple(sorted(orbits))


def _assembled(n: int, generators: list[_Permutation]) -> Symmetry | None:
    """Orbits of all generators, and the generator that moves the fewest nodes."""
    if not generators:
        return None
    moved = [sum(image != node for node, image in enumerate(generator)) for generator in generators]
    return Symmetry(_orbits(n, generators), generators[int(np.argmin(moved))])
