"""Both engines of the ground state: the rule, the same answer, rigorous bounds, and life without the extra."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.analysis.eigenvalue import couplings
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.linalg import approximate
from trigpoint.linalg.ground_state import choose_engine, ground_state


def both(graph):
    matrix, stored = couplings(graph), graph.laplacian()
    return ground_state(matrix, stored, "superlu"), ground_state(matrix, stored, "approx-chol")


@given(st.integers(0, 10_000), st.sampled_from([1, 8, 400]), st.sampled_from([0.0, 3.0]))
@settings(max_examples=25, deadline=None)
def test_both_engines_enclose_the_same_eigenvalue(seed, anchors, decades) -> None:
    rng = np.random.default_rng(seed)
    graph = tp.graphs.grid(20, 40, anchors=rng.choice(800, anchors, replace=False).tolist())
    graph = graph.with_weight(10.0 ** rng.uniform(-decades, decades, graph.n_arcs))
    one, other = both(graph)
    exact = float(np.linalg.eigvalsh(graph.laplacian().toarray())[0])
    slack = 1e-13 * float(np.abs(graph.laplacian().data).max())
    for found in (one, other):
        assert 0.0 < found.lower <= found.value <= found.upper
        assert found.lower <= exact + slack
        assert exact - slack <= found.upper
        assert (found.positive > 0).all()
    assert (other.upper - other.lower) <= 1e-5 * other.value


@pytest.mark.parametrize("count", [50, 2000])
def test_a_chain_has_its_closed_form(count) -> None:
    _, found = both(tp.graphs.chain(count))
    exact = tp.worst_case_eigenvalue(count)
    assert found.lower <= exact * (1 + 1e-14)
    assert exact * (1 - 1e-14) <= found.upper
    assert found.value == pytest.approx(exact, rel=1e-8)


def test_the_vector_is_the_eigenvector() -> None:
    graph = tp.graphs.grid(60, 70)
    _, found = both(graph)
    L = graph.laplacian()
    assert np.linalg.norm(L @ found.vector - found.value * found.vector) < 1e-10
    assert found.vector.sum() > 0


def test_the_rule_can_be_inspected_and_overridden() -> None:
    assert choose_engine(1000).name == "superlu"
    assert "below" in choose_engine(1000).reason
    assert choose_engine(1_000_000).name == "approx-chol"
    assert choose_engine(1_000_000, "superlu").reason == "asked for"
    with pytest.raises(ArgumentError, match="engine must be one of superlu, approx-chol; got 'magic'"):
        choose_engine(10, "magic")
    bound = tp.smallest_eigenvalue(tp.graphs.grid(30, 30), engine="approx-chol")
    assert bound.relative_width < 1e-6


def test_without_the_extra_the_core_goes_on(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "approx_chol", None)
    monkeypatch.setattr(approximate, "available", lambda: False)
    assert choose_engine(1_000_000).name == "superlu"
    with pytest.raises(MissingExtraError, match=r"trigpoint\[fast\]"):
        tp.smallest_eigenvalue(tp.graphs.grid(30, 30), engine="approx-chol")


def test_a_large_network_takes_the_approximate_engine_by_itself() -> None:
    graph = tp.graphs.grid(320, 320)
    bound = tp.smallest_eigenvalue(graph)
    exact = tp.smallest_eigenvalue(graph, engine="superlu")
    assert bound.relative_width < 1e-6
    assert max(bound.lower, exact.lower) <= min(bound.upper, exact.upper)
