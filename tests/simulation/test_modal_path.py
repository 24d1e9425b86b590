"""The modal path against the others: all modes, Krylov spaces, recorded readings, its rule and its refusals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from trigpoint.errors import ArgumentError
from trigpoint.linalg.krylov import RationalKrylov
from trigpoint.observers.network import DiffusiveObserver
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing.strategies import measurement_graphs

DOUBLE = tp.LinearAgent([[0, 1], [0, 0]], [[1, 0]])
WAVY = tp.LinearAgent([[0.1, 2.0], [-2.0, 0.0]], [[1, 1]])


def designed(graph, agent) -> DiffusiveObserver:
    return tp.design(tp.NetworkedAgents(graph, agent), tp.methods.LocalKalman())


@given(
    measurement_graphs(max_nodes=9, externally_connected=True),
    st.sampled_from([DOUBLE, WAVY, tp.LinearAgent.static(2)]),
)
@settings(max_examples=40, deadline=None)
def test_modal_and_stacked_agree(graph, agent) -> None:
    observer = designed(graph, agent)
    rng = np.random.default_rng(0)
    rate = max(abs(observer.spectral_abscissa), 1e-3)
    error = rng.normal(size=(graph.n_nodes, agent.n_states))
    times = np.array([0.0, 0.3, 1.0, 3.0]) / rate
    one, other = (simulate(observer.problem, observer, Scenario(times, error, path=p)) for p in ("stacked", "modal"))
    scale = max(float(np.abs(one.error).max()), 1.0)
    assert np.abs(one.error - other.error).max() < 1e-9 * scale


def test_a_large_network_goes_through_ritz_pairs() -> None:
    observer = designed(tp.graphs.grid(36, 36), DOUBLE)
    rng = np.random.default_rng(1)
    error, times = rng.normal(size=(1296, 2)), np.array([0.0, 0.05, 0.5, 5.0, 50.0])
    run = simulate(observer.problem, observer, Scenario(times, error))
    assert run.path == "modal"
    values, vectors = la.eigh(observer.graph.laplacian().toarray())
    for time, row in zip(times, run.error, strict=True):
        modes = np.stack([DOUBLE.A - observer.gain * v * observer.injection @ DOUBLE.C for v in values])
        exact = vectors @ (la.expm(modes * time) @ (vectors.T @ error)[:, :, None])[:, :, 0]
        gap = np.linalg.norm(row - exact) / np.linalg.norm(error)
        assert gap < 1e-7
    assert 0.0 <= run.attributes["error_estimate"] < 1e-8


def test_recorded_readings_drive_every_mode() -> None:
    graph = tp.graphs.grid(40, 40, anchors=(0, 1599))
    observer = designed(graph, tp.LinearAgent.static())
    readings = np.random.default_rng(2).normal(size=graph.n_arcs)
    times = np.array([1.0, 1e3])
    run = simulate(observer.problem, observer, Scenario(times, 1.0, measurements=readings))
    assert run.path == "modal"
    fixed = la.solve(graph.laplacian().toarray(), graph.incidence() @ readings)
    assert np.abs(run.estimate[-1, :, 0] - fixed).max() < 1e-6 * np.abs(fixed).max()


def test_an_invariant_space_is_noticed() -> None:
    observer = designed(tp.graphs.chain(1300), tp.LinearAgent.static())
    _, vectors = la.eigh(observer.graph.laplacian().toarray(), subset_by_index=(0, 0))
    run = simulate(observer.problem, observer, Scenario([0.0, 1.0], vectors))
    assert np.abs(run.error[1, :, 0] / vectors[:, 0] - run.error[1, 0, 0] / vectors[0, 0]).max() < 1e-6


def test_the_basis_is_orthonormal_and_projects_the_matrix() -> None:
    matrix = tp.graphs.grid(30, 30).laplacian()
    space = RationalKrylov(matrix, np.random.default_rng(3).normal(size=(900, 2)))
    space.grow(0.1, 5)
    pairs = space.pairs()
    assert pairs.vectors.shape == (900, space.size) == (900, 12)
    assert np.abs(pairs.vectors.T @ pairs.vectors - np.eye(12)).max() < 1e-13
    projected = pairs.vectors.T @ (matrix @ pairs.vectors)
    assert np.abs(projected - np.diag(pairs.values)).max() < 1e-12


def test_zero_and_dependent_starts_are_dropped() -> None:
    matrix = tp.graphs.chain(50).laplacian()
    assert RationalKrylov(matrix, np.zeros((50, 2))).size == 0
    assert RationalKrylov(matrix, np.ones((50, 3))).size == 1


def test_the_modal_path_refuses_what_does_not_split() -> None:
    observer = designed(tp.graphs.chain(4), DOUBLE)
    with pytest.raises(ArgumentError, match="the modal path is for equal agents"):
        simulate(observer.problem, observer, Scenario([0.0, 1.0], period=0.1, path="modal"))
    with pytest.raises(ArgumentError, match="the modal path is for equal agents"):
        simulate(observer.problem, observer.as_programs(), Scenario([0.0, 1.0], path="modal"))
