"""Relative sensing: R23's examples, planted motions, random systems."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from tests.analysis.relative.drawn import floating_indicators, islands, jordan, planted_sensing
from trigpoint.analysis.pairs import pair_margin
from trigpoint.analysis.relative_sensing import diagnose_relative_sensing
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle, grid
from trigpoint.model.relative_sensing import RelativeSensing


def whole_direction(finding, n) -> np.ndarray:
    vector = np.zeros(n, dtype=finding.direction.dtype)
    vector[list(finding.nodes)] = finding.direction[:, 0]
    return vector


def check_directions(problem, found) -> None:
    """The findings span motions that A keeps and no arc shows."""
    n = problem.n_states
    A = problem.A.toarray() if problem.is_sparse else problem.A
    vectors = np.column_stack([whole_direction(finding, n) for finding in found.findings])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=0), 1.0)
    assert np.linalg.norm(problem.output() @ vectors) < 1e-9
    span = np.column_stack([vectors, vectors.conj()])
    outside = A @ vectors - span @ np.linalg.lstsq(span, A @ vectors)[0]
    assert np.linalg.norm(outside) < 1e-9 * max(1.0, np.linalg.norm(A))


@pytest.mark.parametrize(
    ("A", "expected"), [(np.diag([1.0, 1.0, 2.0]), True), (np.eye(3), False), (np.zeros((3, 3)), False)]
)
@pytest.mark.parametrize("kind", [np.asarray, sp.csr_array])
def test_cycle_sensing_of_the_paper(A, expected, kind) -> None:
    """R23, Section IV: diag(1, 1, 2) has rank 3; I_3 and 0_3 have rank 2."""
    problem = RelativeSensing(kind(A), cycle(3))
    found = diagnose_relative_sensing(problem)
    assert found.observable is found.detectable is expected
    assert found.theorem == "R23, Theorem 13"
    if not expected:
        (finding,) = found.findings
        assert finding.nodes == (0, 1, 2)
        np.testing.assert_allclose(np.abs(finding.direction), 3**-0.5)
        assert f"s = {A[0, 0]:.6g}" in finding.text


@pytest.mark.parametrize("n", [3, 61, 700])
def test_agreement_seen_through_its_own_arcs_is_unobservable(n) -> None:
    """R23, Corollary 15; and Lemma 14 as soon as one node is anchored."""
    floating, anchored = chain(n, anchors=()), chain(n, anchors=(n - 1,))
    found = diagnose_relative_sensing(RelativeSensing(-floating.laplacian(), floating))
    assert (found.observable, found.detectable) == (False, False)
    check_directions(RelativeSensing(-floating.laplacian(), floating), found)
    found = diagnose_relative_sensing(RelativeSensing(-floating.laplacian(), anchored))
    assert (found.observable, found.detectable, found.findings) == (True, True, ())
    assert found.theorem == "R23, Lemma 14"
    assert 0 < found.margin < 1


def test_two_indicators_turned_into_each_other() -> None:
    """E-001-1: only a complex mode shows that two floating components hide a rotation."""
    J = np.array([[0.0, -2.0], [2.0, 0.0]])
    problem = RelativeSensing(np.kron(J, np.eye(2)), MeasurementGraph(4, [0, 2], [1, 3]))
    found = diagnose_relative_sensing(problem)
    assert (found.observable, found.detectable) == (False, False)
    (finding,) = found.findings
    assert finding.kind == "blind-motion"
    assert "s = 0+2j" in finding.text
    assert "component by component" in finding.text
    assert np.iscomplexobj(finding.direction)
    check_directions(problem, found)


def test_a_motion_that_dies_out_is_detectable() -> None:
    found = diagnose_relative_sensing(RelativeSensing(-np.eye(4), chain(4, anchors=())))
    assert (found.observable, found.detectable) == (False, True)
    assert "dies out by itself" in found.findings[0].text


@pytest.mark.parametrize("size", [2, 3])
def test_jordan_blocks_inside_the_span(size) -> None:
    rng = np.random.default_rng(size)
    graph = islands(rng, [3] * size)
    K = floating_indicators(graph)
    Q = la.qr(K)[0]
    Q[:, :size] = K
    turn = la.qr(rng.normal(size=(size, size)))[0]
    A = Q @ la.block_diag(turn @ jordan(size, 0.5) @ turn.T, rng.normal(size=(2 * size, 2 * size))) @ Q.T
    found = diagnose_relative_sensing(RelativeSensing(A, graph))
    assert found.observable is False
    assert len(found.findings) == size
    check_directions(RelativeSensing(A, graph), found)


def test_planted_motions_are_found_in_their_direction() -> None:
    rng = np.random.default_rng(5)
    undecided, worst = 0, 0.0
    for _ in range(100):
        problem, hidden = planted_sensing(rng)
        found = diagnose_relative_sensing(problem)
        assert found.observable is not True
        if found.observable is None:
            undecided += 1
            continue
        direction = whole_direction(found.findings[0], problem.n_states)
        worst = max(worst, float(np.linalg.norm(direction - hidden * (hidden @ direction))))
    print(f"undecided {undecided} of 100, worst direction {worst:.1e}")
    assert undecided < 0.01 * 100
    assert worst < 1e-6


def test_random_systems_are_never_called_unobservable() -> None:
    rng = np.random.default_rng(6)
    undecided = 0
    for _ in range(100):
        graph = islands(rng, rng.integers(2, 5, size=int(rng.integers(1, 4))).tolist())
        found = diagnose_relative_sensing(RelativeSensing(rng.normal(size=(graph.n_nodes,) * 2), graph))
        assert found.observable is not False
        assert found.detectable is not False
        undecided += found.observable is None
    print(f"undecided {undecided} of 100")
    assert undecided < 0.01 * 100


def test_the_margin_is_that_of_the_whole_pair_in_units_of_its_parts() -> None:
    rng = np.random.default_rng(7)
    graph = islands(rng, [4, 3])
    A = rng.normal(size=(7, 7))
    problem = RelativeSensing(A, graph)
    C = problem.output().toarray()
    expected = pair_margin(A / np.linalg.norm(A, 2), C / np.linalg.norm(C, 2)).margin
    assert diagnose_relative_sensing(problem).margin == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("unit", [1e-14, 1.0, 1e14])
def test_the_unit_of_time_plays_no_part(unit) -> None:
    assert diagnose_relative_sensing(RelativeSensing(unit * np.diag([1.0, 1, 2]), cycle(3))).observable is True
    assert diagnose_relative_sensing(RelativeSensing(unit * np.eye(3), cycle(3))).observable is False


@pytest.mark.parametrize("n", [4, 100])
def test_between_the_thresholds_nothing_is_decided(n) -> None:
    A = np.eye(n)
    A[0, 0] += 1e-10
    found = diagnose_relative_sensing(RelativeSensing(A, chain(n, anchors=())))
    assert (found.observable, found.detectable) == (None, None)
    (finding,) = found.findings
    assert finding.kind == "undecided"
    assert "rounding decides there" in finding.text


@pytest.mark.parametrize("n", [80, 600])
def test_larger_systems(n) -> None:
    rng = np.random.default_rng(n)
    graph = MeasurementGraph(n, np.arange(n - 2), np.arange(1, n - 1))  # a chain, and node n-1 by itself
    A = rng.normal(size=(n, n))
    assert diagnose_relative_sensing(RelativeSensing(A, graph)).observable is True
    K = floating_indicators(graph)
    hidden = K @ np.array([0.6, 0.8])
    A = A + np.outer(0.3 * hidden - A @ hidden, hidden)
    found = diagnose_relative_sensing(RelativeSensing(A, graph))
    assert found.observable is found.detectable is False
    direction = whole_direction(found.findings[0], n)
    assert np.linalg.norm(direction - hidden * (hidden @ direction)) < 1e-6


def test_many_floating_components() -> None:
    graph = MeasurementGraph(60, [EXTERNAL], [59])
    found = diagnose_relative_sensing(RelativeSensing(sp.csr_array((60, 60)), graph))
    assert (found.observable, found.detectable) == (False, False)
    assert len(found.findings) == 8
    found = diagnose_relative_sensing(RelativeSensing(-sp.eye_array(60), graph))
    assert (found.observable, found.detectable) == (False, None)
    pairs = MeasurementGraph(100, np.arange(0, 100, 2), np.arange(1, 100, 2))
    A = np.random.default_rng(1).normal(size=(100, 100))
    assert diagnose_relative_sensing(RelativeSensing(A, pairs)).observable is True
    swapped = sp.csr_array(np.roll(np.eye(100), 2, axis=0))  # turns the pairs round: hidden, but in no pair alone
    found = diagnose_relative_sensing(RelativeSensing(swapped, pairs))
    assert (found.observable, found.detectable) == (None, None)
    assert found.findings[0].kind == "undecided"


def test_a_large_sparse_system() -> None:
    graph = grid(200, 200, anchors=())
    found = diagnose_relative_sensing(RelativeSensing(-graph.laplacian(), graph))
    assert found.observable is False
    assert found.findings[0].nodes == tuple(range(40_000))
    A = sp.diags_array(np.arange(40_000) / 40_000.0)
    assert diagnose_relative_sensing(RelativeSensing(A, graph)).observable is True
