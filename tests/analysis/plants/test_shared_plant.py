"""Plants with many observers: published ones, drawn ones against exact rational arithmetic, and directions by hand."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.analysis.plants.oracle import (
    HAN_A,
    HAN_C,
    HAN_HEARS,
    exact_rank,
    exact_unobservable,
    reaching,
    same_subspace,
    thermal_network,
)
from trigpoint.analysis.shared_plant import agent_knowledge, diagnose_shared_plant
from trigpoint.analysis.staircase import unobservable_basis
from trigpoint.model.shared_plant import SharedPlant


def kinds(diagnosis) -> list[str]:
    return [finding.kind for finding in diagnosis.findings]


# -- published plants --------------------------------------------------------------------------------------------------
def test_han_trentelman_wang_shen() -> None:
    alone = agent_knowledge(SharedPlant(HAN_A, HAN_C, {}))
    assert [known.dimension for known in alone] == [2, 5, 1, 5]
    assert [exact_rank(HAN_A, C) for C in HAN_C] == [2, 5, 1, 5]
    for known, C in zip(alone, HAN_C, strict=True):
        assert same_subspace(known.unobservable, exact_unobservable(HAN_A, C)) < 1e-12
        assert known.observable is False
    together = SharedPlant(HAN_A, HAN_C, HAN_HEARS)
    found = diagnose_shared_plant(together)
    assert found.observable is True
    assert found.detectable is True
    assert found.findings == ()
    assert found.margin > 1e-3
    for known in agent_knowledge(together):
        assert known.sources == (0, 1, 2, 3)
        assert known.dimension == 6
        assert known.unobservable.shape == (6, 0)


@pytest.mark.parametrize("ring", [{0: [1, 3], 1: [0, 2], 2: [1, 3], 3: [2, 0]}, {0: [1, 2, 3], 1: [0], 2: [3], 3: [1]}])
def test_the_nine_rooms(ring) -> None:
    A, outputs = thermal_network()
    np.testing.assert_allclose(
        np.sort(la.eigvalsh(A)),
        [-1.25489, -1.07476, -0.86082, -0.79133, -0.44381, -0.36200, -0.18002, -0.13238, 0.0],
        atol=1e-5,
    )
    found = diagnose_shared_plant(SharedPlant(A, outputs, ring))
    assert found.observable is True
    assert found.detectable is True
    for agent, known in enumerate(agent_knowledge(SharedPlant(A, outputs, {}))):
        assert known.dimension == np.linalg.matrix_rank(
            np.vstack([outputs[agent] @ np.linalg.matrix_power(A, k) for k in range(9)]), tol=1e-7
        )


def test_kim_shim_cho() -> None:
    A, outputs = np.diag([-2.0, -3.0]), [[[1.0, 0.0]], [[0.0, 1.0]]]
    assert diagnose_shared_plant(SharedPlant(A, outputs, {0: [1], 1: [0]})).observable is True
    alone = diagnose_shared_plant(SharedPlant(A, outputs, {}))
    assert alone.observable is False
    assert alone.detectable is True
    assert kinds(alone) == ["source-component", "source-component"]
    assert "agent 0 hear agent 1" in alone.findings[0].remedy
    one_way = diagnose_shared_plant(SharedPlant(A, outputs, {1: [0]}))
    assert one_way.observable is False
    assert [finding.nodes for finding in one_way.findings] == [(0,)]
    np.testing.assert_allclose(np.abs(one_way.findings[0].direction), [[0.0], [1.0]], atol=1e-12)


# -- drawn digraphs against exact arithmetic ---------------------------------------------------------------------------
@st.composite
def small_plants(draw):
    n, m = draw(st.integers(1, 5)), draw(st.integers(1, 6))
    entry = st.sampled_from([-1, 0, 0, 1, 2])

    def matrix(rows: int) -> np.ndarray:
        return np.array(draw(st.lists(st.lists(entry, min_size=n, max_size=n), min_size=rows, max_size=rows)))

    A = matrix(n).astype(float)
    outputs = []
    for _ in range(m):
        rows = draw(st.integers(0, 2))
        outputs.append(None if rows == 0 else matrix(rows).astype(float))
    arcs = draw(st.lists(st.tuples(st.integers(0, m - 1), st.integers(0, m - 1)), max_size=2 * m))
    hears = {i: sorted({k for agent, k in arcs if agent == i and k != i}) for i in range(m)}
    return A, outputs, hears


@settings(max_examples=100)
@given(small_plants())
def test_each_agent_against_exact_rank(plant) -> None:
    A, outputs, hears = plant
    problem = SharedPlant(A, outputs, hears)
    n, everyone = A.shape[0], agent_knowledge(problem)
    expected = []
    for agent, known in enumerate(everyone):
        assert known.agent == agent
        sources = reaching(hears, agent)
        assert known.sources == tuple(sorted(sources))
        C = np.vstack([np.zeros((0, n)), *(outputs[k] for k in sorted(sources) if outputs[k] is not None)])
        unseen = exact_unobservable(A, C)
        assert known.dimension == n - unseen.shape[1]
        assert same_subspace(known.unobservable, unseen) < 1e-6
        assert known.observable is (unseen.shape[1] == 0)
        abscissa = la.eigvals(unseen.T @ A @ unseen).real.max() if unseen.size else -np.inf
        if abs(abscissa) > 1e-4:
            assert known.detectable is bool(abscissa < 0)
        expected.append(unseen.shape[1] == 0)
    found = diagnose_shared_plant(problem)
    assert found.observable is all(expected)
    check_findings(problem, found)


def check_findings(problem, found) -> None:
    """Every finding's subspace is invariant and unseen by those that reach its nodes, and the arcs it names mend it."""
    A = problem.A
    whole = unobservable_basis(A, problem.stacked_output())
    for finding in found.findings:
        U = finding.direction
        assert np.linalg.norm(A @ U - U @ (U.T @ A @ U)) < 1e-8 * max(1.0, np.linalg.norm(A))
        assert np.allclose(U.T @ U, np.eye(U.shape[1]))
        if finding.kind == "unobservable-plant":
            assert finding.nodes == tuple(range(problem.n_agents))
            assert np.linalg.norm(problem.stacked_output() @ U) < 1e-8
            continue
        graph = problem.digraph()
        upstream = nx.ancestors(graph, finding.nodes[0]) | {finding.nodes[0]}
        assert (upstream == set(finding.nodes)) is (finding.kind == "source-component")
        words = finding.remedy.rstrip(".").replace("Let ", "").split(" and ")
        for word in words:
            _, hearing, _, _, heard = word.split()
            assert not graph.has_edge(int(heard), int(hearing))
            graph.add_edge(int(heard), int(hearing))
        mended = agent_knowledge(SharedPlant(A, problem.outputs, graph))[finding.nodes[0]]
        assert mended.dimension == problem.n_states - whole.shape[1]


def test_one_arc_is_enough_where_one_agent_knows_all() -> None:
    A, e = np.diag([1.0, 2.0, 3.0]), np.eye(3)
    outputs = [e[:1], e[1:2], e[2:], None, None]
    found = diagnose_shared_plant(SharedPlant(A, outputs, {3: [0, 1, 2], 4: [0]}))
    lacking = next(finding for finding in found.findings if finding.kind == "lacks")
    assert lacking.nodes == (4,)
    assert lacking.remedy == "Let agent 4 hear agent 3."
    assert "agent 0 senses" in lacking.text
    assert kinds(found) == ["source-component"] * 3 + ["lacks"]


def test_a_sensing_remedy_makes_the_plant_observable() -> None:
    A = np.diag([1.0, 1.0, 2.0, -1.0])
    found = diagnose_shared_plant(SharedPlant(A, [[[1.0, 0, 0, 0]], None], {0: [1], 1: [0]}))
    assert found.observable is False
    assert found.detectable is False
    assert kinds(found) == ["unobservable-plant"]
    remedy = found.findings[0].remedy
    states = [int(part.split("]")[0]) for part in remedy.split("x[")[1:]]
    C = np.vstack([[1.0, 0, 0, 0], np.eye(4)[states]])
    assert unobservable_basis(A, C).shape == (4, 0)


# -- directions known by hand ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("size", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", range(5))
def test_unobservable_inside_a_rotated_jordan_block(size, seed) -> None:
    rng = np.random.default_rng(seed)
    A = la.block_diag(0.5 * np.eye(size) + np.eye(size, k=1), np.diag([-1.0, -2.0]))
    C = rng.normal(size=(1, size + 2))
    C[0, 0] = 0.0
    Q = la.qr(rng.normal(size=A.shape))[0]
    problem = SharedPlant(Q @ A @ Q.T, [1e3 * C @ Q.T, None], {1: [0], 0: [1]})
    found = diagnose_shared_plant(problem)
    assert found.observable is False
    assert found.detectable is False
    assert found.findings[0].direction.shape == (size + 2, 1)
    assert same_subspace(found.findings[0].direction, Q[:, :1]) < 1e-6


def test_what_is_unseen_may_die_out() -> None:
    found = diagnose_shared_plant(SharedPlant(np.diag([1.0, -1.0]), [[[1.0, 0.0]]], {}))
    assert found.observable is False
    assert found.detectable is True
    assert "modes s = -1" in found.findings[0].text
    assert "all agents together do not see" in found.summary()


def test_agents_that_sense_nothing() -> None:
    blind = diagnose_shared_plant(SharedPlant([[0.0, 1.0], [-1.0, 0.0]], [None, []], {0: [1]}))
    assert blind.observable is False
    assert blind.detectable is False
    assert kinds(blind) == ["unobservable-plant"]
    np.testing.assert_allclose(blind.findings[0].direction, np.eye(2))
    assert "0 +- 1i" in blind.findings[0].text
    told = diagnose_shared_plant(
        SharedPlant([[0.0, 1.0], [-1.0, 0.0]], [[[1.0, 0.0]], None, np.zeros((1, 2))], {1: [0], 2: [1]})
    )
    assert told.observable is True
    assert told.findings == ()


def test_an_isolated_agent_is_named() -> None:
    outputs = [[[1.0, 0.0]], [[0.0, 1.0]], None]
    found = diagnose_shared_plant(SharedPlant(np.diag([1.0, 2.0]), outputs, {0: [1], 1: [0]}))
    assert [finding.nodes for finding in found.findings] == [(2,)]
    assert found.findings[0].kind == "source-component"
    assert found.findings[0].text.startswith("agent 2 hears nobody else")
    assert found.findings[0].remedy == "Let agent 2 hear agent 0."


def test_units_of_outputs_do_not_matter() -> None:
    A = np.diag([1.0, 2.0])
    for unit in (1e-15, 1.0, 1e12):
        problem = SharedPlant(A, [[[unit, 0.0]], [[0.0, 1.0]]], {0: [1], 1: [0]})
        assert diagnose_shared_plant(problem).observable is True


@pytest.mark.parametrize(("gap", "expected"), [(1e-6, True), (3e-11, None), (1e-14, False)])
def test_between_the_thresholds_nothing_is_decided(gap, expected) -> None:
    found = diagnose_shared_plant(SharedPlant(np.diag([1.0, 2.0]), [[[gap, 1.0]]], {}))
    assert found.observable is expected
    assert found.detectable is expected
    if expected is None:
        assert "undecided" in kinds(found)


def test_the_input_stays_untouched_and_the_answer_the_same() -> None:
    A = HAN_A.copy()
    first, second = (diagnose_shared_plant(SharedPlant(A, HAN_C, {1: [0]})) for _ in range(2))
    assert np.array_equal(A, HAN_A)
    assert first.summary() == second.summary()


@pytest.mark.slow
def test_five_hundred_agents() -> None:
    rng = np.random.default_rng(0)
    A = la.block_diag(*(np.array([[0.1, w], [-w, 0.1]]) for w in range(1, 6)))
    Q = la.qr(rng.normal(size=A.shape))[0]
    outputs = [Q[:, 2 * (k % 5) : 2 * (k % 5) + 1].T if k % 3 == 0 else None for k in range(500)]
    hears = {i: rng.choice(500, size=3, replace=False).tolist() for i in range(500)}
    problem = SharedPlant(Q @ A @ Q.T, outputs, hears)
    core = [known.observable for known in agent_knowledge(problem)]
    assert all(core)
    chained = SharedPlant(problem.A, outputs, {i: [i - 1] for i in range(1, 500)})
    found = agent_knowledge(chained)
    assert [known.dimension for known in found[:14]] == [2, 2, 2, 4, 4, 4, 6, 6, 6, 8, 8, 8, 10, 10]
    assert diagnose_shared_plant(chained).observable is False
