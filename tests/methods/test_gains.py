"""The coupling gain: from the graph, from the worst graph, from a family, given (G16, Theorems 4, 6, 7)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.analysis import smallest_eigenvalue, worst_case_gain
from trigpoint.graphs import chain, complete, cycle, star
from trigpoint.methods import Family, Fixed, FromGraph, LocalKalman, WorstCase, design
from trigpoint.model import NetworkedAgents
from trigpoint.testing.strategies import measurement_graphs

from .drawn import FALLING, OSCILLATOR, RISING

SIGMA_MAX = {2: 2.618034, 3: 5.048917, 4: 8.290859, 8: 29.36529789, 16: 110.4221, 64: 1686.169, 1000: 405690.204}


def choose(rule, graph):
    return rule.choose(graph, smallest_eigenvalue(graph))


@settings(max_examples=60)
@given(measurement_graphs(weighted=True, externally_connected=True), st.floats(1.0001, 10.0))
def test_from_graph_takes_the_rigorous_lower_bound(graph, margin) -> None:
    bound = smallest_eigenvalue(graph)
    choice = FromGraph(margin).choose(graph, bound)
    assert choice.gain == margin / bound.lower
    assert choice.lambda_floor == bound.lower
    assert choice.gain >= margin / bound.value, "never below what the theorem asks for"


@pytest.mark.parametrize(("size", "sigma"), SIGMA_MAX.items())
def test_worst_case_is_the_published_number(size, sigma) -> None:
    choice = choose(WorstCase(size, margin=1.5), complete(2, anchors=(0,)))
    digits = len(str(sigma).split(".")[1])
    assert choice.gain / 1.5 == pytest.approx(sigma, abs=0.51 * 10.0**-digits)
    assert choice.lambda_floor <= 1.0 / worst_case_gain(size)
    assert choice.lambda_floor == pytest.approx(1.0 / worst_case_gain(size), rel=1e-14)


@settings(max_examples=60)
@given(measurement_graphs(max_nodes=7, externally_connected=True))
def test_worst_case_serves_every_graph_of_its_size(graph) -> None:
    choice = choose(WorstCase(7, margin=1.0001), graph)
    assert la.eigvalsh(graph.laplacian().toarray())[0] >= choice.lambda_floor
    observer = design(NetworkedAgents(graph, OSCILLATOR), LocalKalman(WorstCase(7, margin=1.0001)))
    assert observer.spectral_abscissa < 0
    assert 0 < observer.facts["decay_rate_at_floor"] <= observer.decay_rate


def test_worst_case_is_tight_on_the_chain_anchored_at_its_end() -> None:
    choice = choose(WorstCase(12), chain(12))
    assert la.eigvalsh(chain(12).laplacian().toarray())[0] == pytest.approx(choice.lambda_floor, rel=1e-11)


def test_worst_case_weights_of_exactly_one_and_more_pass() -> None:
    graph = chain(3).with_weight([1.0, 7.0, 1.0])
    assert choose(WorstCase(3), graph).gain == choose(WorstCase(3), chain(3)).gain
    blocks = chain(3).with_weight(np.array([np.eye(2), [[3.0, 1.0], [1.0, 3.0]], 2 * np.eye(2)]))
    assert choose(WorstCase(3), blocks).gain == choose(WorstCase(3), chain(3)).gain


def test_the_family_needs_the_largest_bound_not_the_smallest() -> None:
    """E-000-1: with the printed minimum the other topology is unstable, with the maximum both are stable."""
    slow, fast = chain(4), complete(4, anchors=(0, 1, 2, 3))
    bounds = [1.0 / smallest_eigenvalue(graph).value for graph in (slow, fast)]

    def abscissa(graph, gain: float) -> float:
        return design(NetworkedAgents(graph, RISING), LocalKalman(Fixed(gain))).spectral_abscissa

    assert abscissa(fast, 1.05 * min(bounds)) < 0
    assert abscissa(slow, 1.05 * min(bounds)) > 0.5, "the printed formula (23)"
    gain = choose(Family([slow, fast], margin=1.01), fast).gain
    assert gain == pytest.approx(1.01 * max(bounds), rel=1e-8)
    assert abscissa(slow, gain) < 0
    assert abscissa(fast, gain) < 0


def test_the_family_includes_the_graph_of_the_problem() -> None:
    family = Family([complete(5, anchors=(0,))])
    assert choose(family, chain(5)).gain == choose(FromGraph(), chain(5)).gain
    assert choose(family, complete(5, anchors=(0, 1, 2, 3, 4))).gain == choose(FromGraph(), complete(5, (0,))).gain
    assert "1 graphs" in choose(family, chain(5)).text


@settings(max_examples=30)
@given(st.lists(measurement_graphs(max_nodes=5, externally_connected=True), min_size=1, max_size=4))
def test_one_gain_and_one_lyapunov_function_serve_the_whole_family(graphs) -> None:
    """Theorem 6: V = e' (I x Q^-1) e decreases on every graph of the family, hence under any switching."""
    observer = design(NetworkedAgents(graphs[0], OSCILLATOR), LocalKalman(Family(graphs, margin=1.001)))
    P = la.inv(observer.facts["Q"])
    for graph in graphs:
        same_gain = design(NetworkedAgents(graph, OSCILLATOR), LocalKalman(Fixed(observer.gain)))
        H = same_gain.error_matrix().toarray()
        wide = np.kron(np.eye(graph.n_nodes), P)
        assert la.eigvalsh(H.T @ wide + wide @ H)[-1] < 0
        assert same_gain.decay_rate >= observer.facts["decay_rate_at_floor"] * (1 - 1e-9) > 0


def test_a_given_gain_is_taken_as_it_is() -> None:
    choice = choose(Fixed(3), cycle(4, anchors=(3,)))
    assert (choice.gain, choice.text) == (3.0, "given")
    assert choice.lambda_floor == smallest_eigenvalue(cycle(4, anchors=(3,))).lower
    assert choose(Fixed(3), cycle(4)).lambda_floor == 0.0


def test_a_gain_that_is_too_small_is_reported_not_hidden() -> None:
    observer = design(NetworkedAgents(chain(8), RISING), LocalKalman(Fixed(0.5)))
    assert observer.decay_rate < 0
    assert observer.spectral_abscissa > 0


def test_more_margin_means_more_gain_and_no_slower_guarantee() -> None:
    designs = [design(NetworkedAgents(star(5), FALLING), LocalKalman(FromGraph(m))) for m in (1.01, 1.5, 4.0)]
    assert all(a.gain < b.gain and a.decay_rate <= b.decay_rate + 1e-12 for a, b in pairwise(designs))
