"""Zero forcing against a slow reference, and what it promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis.blind_spots import blind_spot, spectrum_of
from trigpoint.analysis.zero_forcing import is_zero_forcing, simple_adjacency
from trigpoint.errors import ArgumentError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, complete, cycle, grid
from trigpoint.model.agreement import AgreementDynamics
from trigpoint.testing.strategies import measurement_graphs


def slow_reference(graph, nodes) -> bool:
    black = set(nodes)
    while True:
        forced = {
            white[0]
            for node in black
            if len(white := [k for k in graph.neighbours(node).tolist() if k not in black]) == 1
        }
        if not forced:
            return len(black) == graph.n_nodes
        black |= forced


@settings(max_examples=150)
@given(measurement_graphs(max_nodes=9), st.data())
def test_it_agrees_with_the_rule_applied_naively(graph, data) -> None:
    nodes = data.draw(st.lists(st.integers(0, graph.n_nodes - 1), max_size=4))
    assert is_zero_forcing(graph, nodes) == slow_reference(graph, nodes)


@settings(max_examples=60)
@given(measurement_graphs(max_nodes=7, weighted=True, decades=0), st.data())
def test_a_forcing_set_is_never_blind(graph, data) -> None:
    nodes = data.draw(st.lists(st.integers(0, graph.n_nodes - 1), min_size=1, max_size=3))
    problem = AgreementDynamics(graph, nodes)
    if is_zero_forcing(graph, nodes):
        assert blind_spot(spectrum_of(problem.laplacian()), problem.measured).verdict is True


def test_known_sets() -> None:
    assert is_zero_forcing(chain(7), [6])
    assert not is_zero_forcing(chain(7), [3])
    assert is_zero_forcing(chain(7), [3, 4])
    assert is_zero_forcing(cycle(5), [0, 1])
    assert not is_zero_forcing(cycle(5), [0, 2])
    assert is_zero_forcing(complete(4), [0, 1, 2])
    assert not is_zero_forcing(complete(4), [0, 1])
    assert is_zero_forcing(grid(3, 5), [0, 5, 10])
    assert not is_zero_forcing(chain(3), [])
    assert is_zero_forcing(MeasurementGraph(1, [], []), [0])


def test_parallel_arcs_count_once_and_external_ones_not_at_all() -> None:
    graph = MeasurementGraph(3, [0, 1, 1, EXTERNAL], [1, 0, 2, 1])
    assert is_zero_forcing(graph, [0])
    np.testing.assert_array_equal(simple_adjacency(graph).toarray(), [[0, 1, 0], [1, 0, 1], [0, 1, 0]])


def test_an_index_outside_is_refused() -> None:
    with pytest.raises(ArgumentError, match=r"nodes\[0\] = 7 is no index"):
        is_zero_forcing(chain(3), [7])
