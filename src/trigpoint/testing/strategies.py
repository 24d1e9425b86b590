"""Hypothesis strategies for networks and agents, to test code that takes any of them.

The only module of the package that imports Hypothesis (``pip install 'trigpoint[testing]'``); import it by its full
name. Drawn graphs contain what hand-written examples forget: parallel arcs, several external arcs on a node, isolated
nodes, arcs in either direction, and anchors on any node, the last one included.

>>> from hypothesis import given
>>> from trigpoint.testing.strategies import measurement_graphs
>>> @given(measurement_graphs(max_nodes=5, externally_connected=True))
... def test_something(graph):
...     assert graph.is_externally_connected
"""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from trigpoint.arrays import FloatArray
from trigpoint.graphs import EXTERNAL, MeasurementGraph
from trigpoint.model import LinearAgent

_Arc = tuple[int, int]


def measurement_graphs(
    *,
    min_nodes: int = 1,
    max_nodes: int = 8,
    max_extra_arcs: int = 8,
    weighted: bool = False,
    decades: int = 6,
    blocks: int | None = None,
    externally_connected: bool | None = None,
) -> st.SearchStrategy[MeasurementGraph]:
    """Draw measurement graphs.

    Args:
        min_nodes: least number of nodes, at least 1.
        max_nodes: largest number of nodes.
        max_extra_arcs: arcs drawn freely beside those that the wanted connectivity needs.
        weighted: scalar weights, spread over ``2 decades`` orders of magnitude around 1; else unit weights.
        decades: how far weights and blocks reach up and down, in powers of ten.
        blocks: size d of symmetric positive definite weight blocks; None for scalar weights. Overrides ``weighted``.
        externally_connected: True for graphs in which every node has a path to the environment, False for graphs in
            which some node has none, None for any.
    """
    return _graphs(min_nodes, max_nodes, max_extra_arcs, weighted, decades, blocks, externally_connected)


def agents(
    *,
    max_states: int = 3,
    max_outputs: int = 2,
    n_outputs: int | None = None,
    inputs: bool = False,
    hurwitz: bool = False,
) -> st.SearchStrategy[LinearAgent]:
    """Draw small agents with entries in [-2, 2] (multiples of 1/4, so that exact zeros and repeated modes occur).

    Args:
        max_states: largest number n of states.
        max_outputs: largest number p of outputs.
        n_outputs: exactly this many outputs (agents on one network must agree); None for 1 to ``max_outputs``.
        inputs: also draw B (one or two inputs) and E.
        hurwitz: shift A to the left until it is strictly diagonally dominant with negative diagonal, hence Hurwitz.
    """
    return _agents(max_states, max_outputs, n_outputs, inputs, hurwitz)


def weight_blocks(size: int, decades: int = 6) -> st.SearchStrategy[FloatArray]:
    """Draw symmetric positive definite (size, size) blocks ``scale (I + B B')``, exactly symmetric."""
    entries = st.lists(_quarters(), min_size=size * size, max_size=size * size)
    return st.builds(_block, entries, st.floats(-decades, decades), st.just(size))


@st.composite
def _graphs(
    draw: st.DrawFn,
    min_nodes: int,
    max_nodes: int,
    max_extra_arcs: int,
    weighted: bool,
    decades: int,
    blocks: int | None,
    externally_connected: bool | None,
) -> MeasurementGraph:
    n = draw(st.integers(min_nodes, max_nodes), label="nodes")
    order = draw(st.permutations(range(n)), label="order")
    floating = 0
    arcs: list[_Arc] = []
    if externally_connected is True:
        arcs = [(draw(st.sampled_from([EXTERNAL, *order[:k]])), order[k]) for k in range(n)]
    elif externally_connected is False:
        floating = draw(st.integers(1, n), label="floating nodes")
    islands, mainland = list(order[:floating]), list(order[floating:])
    choices = _arcs(islands, mainland)
    if choices:
        arcs += draw(st.lists(st.one_of(choices), max_size=max_extra_arcs), label="extra arcs")
    arcs = [_flipped(arc) if draw(st.booleans()) else arc for arc in draw(st.permutations(arcs))]
    weight: list[float] | list[FloatArray] | FloatArray | None = None
    if blocks is not None:
        drawn = [draw(weight_blocks(blocks, decades)) for _ in arcs]
        weight = np.array(drawn).reshape(-1, blocks, blocks)
    elif weighted:
        weight = [10.0 ** draw(st.floats(-decades, decades)) for _ in arcs]
    return MeasurementGraph(n, [tail for tail, _ in arcs], [head for _, head in arcs], weight)


@st.composite
def _agents(
    draw: st.DrawFn, max_states: int, max_outputs: int, n_outputs: int | None, inputs: bool, hurwitz: bool
) -> LinearAgent:
    n = draw(st.integers(1, max_states), label="states")
    p = draw(st.integers(1, max_outputs), label="outputs") if n_outputs is None else n_outputs
    A = draw(_matrices(n, n), label="A")
    if hurwitz:
        A = A - (np.abs(A).sum(axis=1).max() + 0.25) * np.eye(n)
    B = draw(_matrices(n, draw(st.integers(1, 2))), label="B") if inputs else None
    E = draw(_matrices(n, draw(st.integers(1, n))), label="E") if inputs else None
    return LinearAgent(A, draw(_matrices(p, n), label="C"), B, E)


def _arcs(islands: list[int], mainland: list[int]) -> list[st.SearchStrategy[_Arc]]:
    """Arcs inside the islands, and arcs inside the mainland and the environment, never between the two."""
    choices: list[st.SearchStrategy[_Arc]] = []
    if len(islands) > 1:
        choices.append(_pairs(st.sampled_from(islands), st.sampled_from(islands)))
    if mainland:
        choices.append(_pairs(st.sampled_from([EXTERNAL, *mainland]), st.sampled_from(mainland)))
    return choices


def _pairs(tails: st.SearchStrategy[int], heads: st.SearchStrategy[int]) -> st.SearchStrategy[_Arc]:
    return st.tuples(tails, heads).filter(lambda arc: arc[0] != arc[1])


def _flipped(arc: _Arc) -> _Arc:
    tail, head = arc
    return arc if tail == EXTERNAL else (head, tail)


def _quarters() -> st.SearchStrategy[float]:
    return st.integers(-8, 8).map(lambda k: k / 4.0)


def _matrices(rows: int, columns: int) -> st.SearchStrategy[FloatArray]:
    entries = st.lists(_quarters(), min_size=rows * columns, max_size=rows * columns)
    return entries.map(lambda values: np.array(values).reshape(rows, columns))


def _block(entries: list[float], exponent: float, size: int) -> FloatArray:
    root = np.array(entries).reshape(size, size)
    block = 10.0**exponent * (np.eye(size) + root @ root.T)
    return np.asarray(0.5 * (block + block.T), dtype=np.float64)
