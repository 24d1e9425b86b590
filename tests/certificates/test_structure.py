"""Cascades through their exact zeros, and what remains of it when the plant is rotated (theory 4.3b)."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import trigpoint as tp
from trigpoint.certificates import Convergence
from trigpoint.errors import ProtocolError
from trigpoint.linalg.precise import precise_eigenvalues


def ring(agents: int, rotated: bool) -> tp.SharedPlant:
    """Agent i of a directed ring sees one of two blocks; the plant is block diagonal, or rotated."""
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = [[0.1, 1.0], [-1.0, 0.1]], [[0.0, 2.0], [-2.0, 0.0]]
    outputs = [np.zeros((1, 4)) for _ in range(agents)]
    outputs[0][0, 0], outputs[1][0, 2] = 1.0, 1.0
    if rotated:
        T = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
        A, outputs = T @ A @ T.T, [C @ T.T for C in outputs]
    return tp.SharedPlant(A, outputs, {i: [(i - 1) % agents] for i in range(agents)})


def designed(problem: tp.SharedPlant):
    agents, n = problem.n_agents, problem.n_states
    return tp.design(problem, tp.methods.SpectrumAssignment(np.linspace(-4.0, -1.0, agents * n)))


def test_a_block_diagonal_plant_is_certified_through_its_structure() -> None:
    problem = ring(20, rotated=False)
    observer = designed(problem)
    record = Convergence(rate=0.9).check(problem, observer)
    assert record.verdict == "certified"
    assert "exact zeros" in record.text
    assert Convergence.verify(record, problem, observer) == "certified"
    for spoilt in (-record.witness["blocks"], record.witness["blocks"] * np.nan):
        forged = dataclasses.replace(record, witness={"blocks": spoilt})
        assert Convergence.verify(forged, problem, observer) == "inconclusive"
    for misshapen in (record.witness["blocks"][:-1], np.ones(record.witness["blocks"].shape, dtype=np.int64)):
        forged = dataclasses.replace(record, witness={"blocks": misshapen})
        with pytest.raises(ProtocolError, match="'blocks' must be floats of shape"):
            Convergence.verify(forged, problem, observer)
    faster = dataclasses.replace(record, numbers={**record.numbers, "rate": 1.1})
    assert Convergence.verify(faster, problem, observer) == "inconclusive"


def test_rotated_only_the_stored_matrix_counts() -> None:
    """P itself would have the condition 1e26; its factors prove 0.95 of what the stored matrix really does."""
    problem = ring(20, rotated=True)
    observer = designed(problem)
    record = Convergence().check(problem, observer)
    assert record.verdict == "certified"
    assert "exact zeros" not in record.text
    truth = -float(precise_eigenvalues(observer.error_matrix().toarray()).real.max())
    rate, R = record.numbers["rate"], record.witness["R"]
    assert 0.95 * truth < rate < truth
    assert np.linalg.cond(R) > 1e10
    assert Convergence.verify(record, problem, observer) == "certified"
    faster = dataclasses.replace(record, numbers={**record.numbers, "rate": 1.0001 * truth})
    assert Convergence.verify(faster, problem, observer) == "inconclusive"
    for name in ("R", "T"):
        for other in (record.witness[name].T, np.eye(R.shape[0]), 0.0 * R):
            spoilt = dataclasses.replace(record, witness={**record.witness, name: other})
            assert Convergence.verify(spoilt, problem, observer) == "inconclusive"


def test_a_wanted_rate_of_a_deep_cascade_is_proved_or_refuted() -> None:
    problem = ring(20, rotated=True)
    observer = designed(problem)
    for rate, verdict in ((0.9, "certified"), (1.1, "refuted")):
        record = Convergence(rate=rate).check(problem, observer)
        assert (record.verdict, record.numbers["rate"]) == (verdict, rate)
        assert Convergence.verify(record, problem, observer) == verdict
    assert {"R", "T", "P", "growing"} <= set(record.witness)
    for name in ("R", "T", "P", "growing"):
        spoilt = dataclasses.replace(record, witness={**record.witness, name: 0.0 * record.witness[name]})
        assert Convergence.verify(spoilt, problem, observer) == "inconclusive"


def drawn_cascade(shortcuts: int):
    """50 agents in a ring, each with some more to hear; ten states, each agent sees one direction of the plant."""
    rng = np.random.default_rng(2)
    agents, n = 50, 10
    T = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A = T @ np.diag(np.linspace(-0.3, 0.2, n)) @ T.T
    outputs = [T[:, [i % n]].T for i in range(agents)]
    hears = {
        i: sorted({(i - 1) % agents, *(int(j) for j in rng.choice(agents, shortcuts) if j != i)}) for i in range(agents)
    }
    problem = tp.SharedPlant(A, outputs, hears)
    return problem, tp.design(problem, tp.methods.SpectrumAssignment(np.linspace(-4.0, -1.0, agents * n)))


@pytest.mark.slow
def test_a_cascade_of_500_states_is_certified_at_nine_tenths_of_its_rate() -> None:
    problem, observer = drawn_cascade(3)
    record = Convergence(rate=0.9).check(problem, observer)
    assert record.verdict == "certified"
    assert Convergence.verify(record, problem, observer) == "certified"


@pytest.mark.slow
def test_a_ring_of_50_agents_is_certified_at_seven_tenths_of_its_rate() -> None:
    """One P of floats reaches 0.28 of it."""
    problem, observer = drawn_cascade(0)
    record = Convergence().check(problem, observer)
    assert record.verdict == "certified"
    assert record.numbers["rate"] > 0.7
    assert Convergence.verify(record, problem, observer) == "certified"
