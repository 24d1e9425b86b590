"""``MeasurementGraph``: who measures whom. Parallel arcs and several external arcs on a node are allowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from trigpoint.arrays import BoolArray, FloatArray, IntArray, as_floats, as_indices, frozen
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.graphs import algebra, structure
from trigpoint.graphs.algebra import EXTERNAL
from trigpoint.graphs.interop import read_networkx, write_networkx

if TYPE_CHECKING:
    import networkx as nx

_SYMMETRY_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class MeasurementGraph:
    """A network of measurements: arc k measures ``x[head[k]] - x[tail[k]]``, or ``x[head[k]]`` if it is external.

    The generalized incidence matrix ``G`` (N x M) has in column k the entry -1 at the tail and +1 at the head; an
    external arc has only its +1. The generalized Laplacian is ``L = G W G^T``.

    Args:
        n_nodes: number N of nodes, at least 1.
        tail: (M,) whole numbers, the arc's start; ``EXTERNAL`` where the environment measures the head.
        head: (M,) whole numbers, the arc's end.
        weight: None (all 1), (M,) positive numbers, or (M, d, d) symmetric positive definite blocks (kept exactly
            symmetric; blocks of size 1 are kept as numbers).
        names: N different texts; None gives "0", "1", ...

    We assume:
        * no self-loops (an arc from a node to itself measures nothing);
        * weights are positive (a zero weight is no arc: leave it out).

    Raises:
        ArgumentError: an index outside 0..N-1, a self-loop, a weight that is not positive, names that repeat.
        ShapeError: ``tail``, ``head``, ``weight`` or ``names`` of different lengths.

    Source: G16, Section 2.
    """

    n_nodes: int
    tail: IntArray
    head: IntArray
    weight: FloatArray | None
    names: tuple[str, ...]

    def __init__(
        self,
        n_nodes: int,
        tail: ArrayLike,
        head: ArrayLike,
        weight: ArrayLike | None = None,
        names: Sequence[str] | None = None,
    ) -> None:
        if isinstance(n_nodes, bool) or not isinstance(n_nodes, (int, np.integer)) or n_nodes < 1:
            raise ArgumentError(f"n_nodes must be a whole number of at least 1; got {n_nodes!r}")
        n = int(n_nodes)
        tails = as_indices("tail", tail, EXTERNAL, n)
        heads = as_indices("head", head, 0, n)
        if tails.shape != heads.shape:
            raise ShapeError(f"tail and head must have equal length; got {tails.shape[0]} and {heads.shape[0]}")
        labels = tuple(str(k) for k in range(n)) if names is None else tuple(str(name) for name in names)
        _check_names(labels, n)
        loops = np.flatnonzero(tails == heads)
        if loops.size:
            k = int(loops[0])
            raise ArgumentError(
                f"arc {k} is a self-loop on node {labels[heads[k]]!r}: it measures nothing; "
                "an absolute reading is an external arc (tail = EXTERNAL)"
            )
        object.__setattr__(self, "n_nodes", n)
        object.__setattr__(self, "tail", tails)
        object.__setattr__(self, "head", heads)
        object.__setattr__(self, "weight", _checked_weight(weight, tails.shape[0]))
        object.__setattr__(self, "names", labels)

    # -- sizes and views -------------------------------------------------------------------------------------------
    @property
    def n_arcs(self) -> int:
        """Number M of arcs, external ones included."""
        return int(self.tail.shape[0])

    @property
    def dimension(self) -> int:
        """Size d of the weight blocks; 1 for scalar weights and for none."""
        return 1 if self.weight is None or self.weight.ndim == 1 else int(self.weight.shape[1])

    @cached_property
    def is_external(self) -> BoolArray:
        """(M,) true where the arc is external; the only way to ask (``tail`` is no index there)."""
        mask: BoolArray = frozen(self.tail == EXTERNAL, np.bool_)
        return mask

    @cached_property
    def anchored_nodes(self) -> IntArray:
        """Nodes with at least one external arc, ascending."""
        nodes: IntArray = frozen(np.unique(self.head[self.is_external]), np.int64)
        return nodes

    @cached_property
    def arc_weights(self) -> FloatArray:
        """The weights written out: (M,) ones where none were given, else as given."""
        return frozen(np.ones(self.n_arcs)) if self.weight is None else self.weight

    def index(self, name: str) -> int:
        """Index of the node called ``name``; an unknown name is an ``ArgumentError``."""
        try:
            return self._positions[name]
        except KeyError:
            raise ArgumentError(f"no node is called {name!r}; the first names are {list(self.names[:5])}") from None

    @cached_property
    def _positions(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.names)}

    def arc_label(self, arc: int) -> str:
        """Readable name of one arc: ``a -> b``, or ``environment -> b``."""
        start = "environment" if self.is_external[arc] else self.names[self.tail[arc]]
        return f"{start} -> {self.names[self.head[arc]]}"

    def at_tail(self, table: NDArray[Any], environment: Any) -> NDArray[Any]:
        """Rows of a per-node ``table`` (N, ...) at the tails of the arcs (M, ...), ``environment`` where external."""
        rows = table[np.where(self.is_external, 0, self.tail)]
        rows[self.is_external] = environment
        return rows

    def neighbours(self, node: int) -> IntArray:
        """Nodes that share an internal arc with ``node``, ascending."""
        inner = ~self.is_external
        tails, heads = self.tail[inner], self.head[inner]
        found: IntArray = np.unique(np.concatenate([tails[heads == node], heads[tails == node]]))
        return found

    # -- algebra ---------------------------------------------------------------------------------------------------
    def incidence(self) -> sp.csc_array:
        """Generalized incidence matrix ``G``: sparse (N, M), entries -1 (tail), +1 (head).

        Column sums are 0 (internal) and 1 (external). Cost O(N + M). Source: G16, Section 2.
        """
        return algebra.incidence(self.n_nodes, self.tail, self.head, self.is_external)

    def extended_incidence(self) -> sp.csc_array:
        """``G`` with the environment written out as row 0: sparse (N + 1, M), every column sum 0.

        Node k is row k + 1. Deleting row 0 gives ``G``. Source: G16, Remark 1.
        """
        return algebra.extended_incidence(self.n_nodes, self.tail, self.head, self.is_external)

    def laplacian(self) -> sp.csr_array:
        """Generalized Laplacian ``L = G W G^T``: sparse, symmetric, (N, N), or (N d, N d) for d x d weight blocks.

        Row sums equal the weight of the node's external arcs. Cost O(N + M). Source: G16, Section 2.
        """
        return algebra.laplacian(self.n_nodes, self.tail, self.head, self.is_external, self.weight)

    # -- structure -------------------------------------------------------------------------------------------------
    @cached_property
    def component_labels(self) -> IntArray:
        """(N,) number of the internal component of each node; components are numbered by their first node."""
        labels: IntArray = frozen(
            structure.component_labels(self.n_nodes, self._inner_tail, self._inner_head), np.int64
        )
        return labels

    @cached_property
    def components(self) -> tuple[IntArray, ...]:
        """Internal components as ascending index arrays, ordered by first node (G16, Def. 2). Cost O(N + M)."""
        return tuple(frozen(nodes, np.int64) for nodes in structure.groups(self.component_labels))

    @cached_property
    def component_is_anchored(self) -> BoolArray:
        """One truth value a component: has it an external arc?"""
        anchored = np.zeros(int(self.component_labels.max()) + 1, dtype=np.bool_)
        anchored[self.component_labels[self.anchored_nodes]] = True
        anchored.setflags(write=False)
        return anchored

    @property
    def is_internally_connected(self) -> bool:
        """True when a path of internal arcs joins any two nodes (G16, Definition 2)."""
        return len(self.component_is_anchored) == 1

    @property
    def is_externally_connected(self) -> bool:
        """True when every node has a path to the environment: ``lambda_min(L) > 0`` (G16, Prop. 1, 5)."""
        return bool(self.component_is_anchored.all())

    @property
    def is_generalized_tree(self) -> bool:
        """True when the graph with the environment as a node is a tree (G16, Def. 3)."""
        return self.n_arcs == self.n_nodes and self.is_externally_connected

    @property
    def is_chain(self) -> bool:
        """True when it is a generalized tree in which the environment and the nodes form one path (G16, Def. 3)."""
        return self.is_generalized_tree and structure.is_path(
            self.n_nodes, self._inner_tail, self._inner_head, self.head[self.is_external]
        )

    def split(self) -> tuple[MeasurementGraph, ...]:
        """One graph a component, in the order of ``components``; ``L`` is block diagonal over them (000-10)."""
        return tuple(self.subgraph(nodes) for nodes in self.components)

    def subgraph(self, nodes: ArrayLike) -> MeasurementGraph:
        """Graph on the given nodes (in that order) with the arcs that lie inside it, external ones included."""
        chosen = as_indices("nodes", nodes, 0, self.n_nodes)
        position = np.full(self.n_nodes + 1, -2, dtype=np.int64)
        position[chosen] = np.arange(chosen.shape[0])
        position[-1] = EXTERNAL  # where EXTERNAL, as an index, would point
        tail, head = position[self.tail], position[self.head]
        keep = (tail != -2) & (head >= 0)
        weight = None if self.weight is None else self.weight[keep]
        return MeasurementGraph(
            chosen.shape[0], tail[keep], head[keep], weight, [self.names[k] for k in chosen.tolist()]
        )

    def without_arcs(self, arcs: ArrayLike) -> MeasurementGraph:
        """The same nodes without the given arcs (indices, external ones included): what if they fail?"""
        dropped = as_indices("arcs", arcs, 0, self.n_arcs)
        keep = np.ones(self.n_arcs, dtype=np.bool_)
        keep[dropped] = False
        weight = None if self.weight is None else self.weight[keep]
        return MeasurementGraph(self.n_nodes, self.tail[keep], self.head[keep], weight, self.names)

    def with_weight(self, weight: ArrayLike | None) -> MeasurementGraph:
        """The same arcs with other weights."""
        return MeasurementGraph(self.n_nodes, self.tail, self.head, weight, self.names)

    @property
    def _inner_tail(self) -> IntArray:
        return self.tail[~self.is_external]

    @property
    def _inner_head(self) -> IntArray:
        return self.head[~self.is_external]

    # -- networkx --------------------------------------------------------------------------------------------------
    @staticmethod
    def from_networkx(graph: nx.Graph[Any], anchors: Sequence[Any] = (), weight: str = "weight") -> MeasurementGraph:
        """Read any networkx graph: edge (u, v) becomes the arc u -> v, the order of ``graph.nodes`` is kept.

        Args:
            graph: directed or not, parallel edges allowed. A node named ``""`` is the environment: its edges become
                external arcs of their other end (an undirected or reversed edge too).
            anchors: nodes that get one more external arc each, of weight 1.
            weight: edge attribute with the arc's weight (1 where it is missing).

        Raises:
            ArgumentError: a self-loop, an unknown anchor, a graph without nodes, two nodes with the same text.
        """
        found = read_networkx(graph, anchors, weight)
        tail, head = [t for t, _, _ in found.arcs], [h for _, h, _ in found.arcs]
        return MeasurementGraph(len(found.names), tail, head, found.weight(weight), found.names)

    def to_networkx(self) -> nx.MultiDiGraph[Any]:
        """Return nodes by name and one edge an arc (key = arc number); the environment is the node ``""`` if used.

        ``from_networkx(g.to_networkx())`` has the same nodes, arcs and weights (arcs perhaps in another order). A node
        with the empty name is an ``ArgumentError``.
        """
        weights = [None] * self.n_arcs if self.weight is None else self.weight
        return write_networkx(self.names, zip(self.tail.tolist(), self.head.tolist(), weights, strict=True))

    def __repr__(self) -> str:
        outer = int(self.is_external.sum())
        return f"MeasurementGraph({self.n_nodes} nodes, {self.n_arcs - outer} internal and {outer} external arcs)"


def _check_names(labels: tuple[str, ...], n: int) -> None:
    if len(labels) != n:
        raise ShapeError(f"names must hold one name a node ({n}); got {len(labels)}")
    if len(set(labels)) != n:
        seen: set[str] = set()
        twice = next(name for name in labels if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise ArgumentError(f"names must differ; {twice!r} stands twice")


def _checked_weight(weight: ArrayLike | None, n_arcs: int) -> FloatArray | None:
    if weight is None:
        return None
    array = as_floats("weight", weight)
    if array.shape == (n_arcs, 1, 1):  # a block of size 1 is a number
        array = frozen(array.reshape(n_arcs))
    if array.ndim == 1 and array.shape[0] == n_arcs:
        bad = np.flatnonzero(array <= 0)
        if bad.size:
            raise ArgumentError(f"weight[{bad[0]}] = {array[bad[0]]} must be positive; leave an arc of no weight out")
        return array
    if array.ndim == 3 and array.shape[0] == n_arcs and array.shape[1] == array.shape[2] > 0:
        _check_positive_definite(array)
        mirrored = array.transpose(0, 2, 1)
        # What rounding left of the symmetry is taken out: L is symmetric to the last bit.
        return array if np.array_equal(array, mirrored) else frozen(0.5 * array + 0.5 * mirrored)
    raise ShapeError(f"weight must have shape ({n_arcs},) or ({n_arcs}, d, d); got {array.shape}")


def _check_positive_definite(blocks: FloatArray) -> None:
    if not blocks.shape[0]:
        return
    skew = np.abs(blocks - blocks.transpose(0, 2, 1)).max(axis=(1, 2))
    size = np.abs(blocks).max(axis=(1, 2))
    bad = np.flatnonzero((skew > _SYMMETRY_TOLERANCE * size) | (np.linalg.eigvalsh(blocks)[:, 0] <= 0))
    if bad.size:
        raise ArgumentError(
            f"weight[{bad[0]}] must be a symmetric positive definite block; got {blocks[bad[0]].tolist()}"
        )
