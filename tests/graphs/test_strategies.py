"""The shipped Hypothesis strategies draw what they promise."""

from __future__ import annotations

import numpy as np
from hypothesis import Phase, find, given, settings

from trigpoint.testing.strategies import agents, measurement_graphs, weight_blocks


@settings(max_examples=50)
@given(measurement_graphs(max_nodes=5, max_extra_arcs=4), measurement_graphs(min_nodes=3, max_nodes=3))
def test_sizes_are_respected(graph, three) -> None:
    assert 1 <= graph.n_nodes <= 5
    assert graph.n_arcs <= 4
    assert graph.weight is None
    assert three.n_nodes == 3


@settings(max_examples=40)
@given(measurement_graphs(externally_connected=True), measurement_graphs(externally_connected=False, weighted=True))
def test_connectivity_is_as_asked(connected, floating) -> None:
    assert connected.is_externally_connected
    assert not floating.is_externally_connected
    assert floating.weight is not None


@settings(max_examples=20)
@given(measurement_graphs(blocks=3), weight_blocks(2))
def test_blocks_are_symmetric_positive_definite(graph, block) -> None:
    assert graph.dimension == 3
    assert np.array_equal(block, block.T)
    assert np.linalg.eigvalsh(block)[0] > 0


def test_the_cases_that_examples_forget_occur() -> None:
    graphs = measurement_graphs(min_nodes=2)
    wanted = settings(max_examples=500, database=None, derandomize=True, phases=[Phase.generate])
    find(graphs, lambda g: g.n_nodes - 1 in g.anchored_nodes, settings=wanted)
    find(graphs, lambda g: int(g.is_external.sum()) > len(g.anchored_nodes), settings=wanted)
    find(graphs, lambda g: len(set(zip(g.tail.tolist(), g.head.tolist(), strict=True))) < g.n_arcs, settings=wanted)
    find(graphs, lambda g: bool((g.tail[~g.is_external] > g.head[~g.is_external]).any()), settings=wanted)


@settings(max_examples=40)
@given(agents(inputs=True, n_outputs=2), agents(hurwitz=True, max_states=4))
def test_agents_are_as_asked(agent, stable) -> None:
    assert agent.n_outputs == 2
    assert agent.n_inputs in (1, 2)
    assert agent.E is not None
    assert stable.n_states <= 4
    assert np.linalg.eigvals(stable.A).real.max() < 0
