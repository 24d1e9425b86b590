"""The numerical parts of ``Heterogeneous`` one by one, against differences, closed forms and slow searches."""

from __future__ import annotations

import clarabel
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.methods.heterogeneous import Heterogeneous, abscissa, inequality
from trigpoint.methods.heterogeneous.abscissa import minimise_abscissa, minimise_nonsmooth
from trigpoint.methods.heterogeneous.dynamic import closed_loop, dynamic_stabiliser
from trigpoint.methods.heterogeneous.inequality import block_inequality, certificate_margin
from trigpoint.methods.heterogeneous.marginal import is_marginal, modal_inverse
from trigpoint.methods.heterogeneous.parts import unstable_parts
from trigpoint.methods.heterogeneous.proof import proved_decay
from trigpoint.methods.heterogeneous.semidefinite import minimise, symmetric_basis
from trigpoint.methods.heterogeneous.steps import Choices, design_part, fixed_mode_verdict
from trigpoint.model import HyperNetwork

from .drawn_heterogeneous import TWO, marginal_networks, rotation, unstable_network, with_stable_parts

SEEDS = st.integers(0, 2**32 - 1)


def only_part(network: HyperNetwork, rate: float = 0.0):
    (part,) = unstable_parts(network, rate)
    return part


# -- step 1 ------------------------------------------------------------------------------------------------------------
@settings(max_examples=30)
@given(SEEDS)
def test_the_unstable_part_is_invariant_and_complete(seed) -> None:
    network = with_stable_parts(np.random.default_rng(seed), (0.4, 0.9, 0.2))
    part = only_part(network)
    assert part.nodes == (0, 1, 2)
    for agent, rate in zip(part.agents, (0.4, 0.9, 0.2), strict=True):
        A = network.agents[agent.node].A
        assert np.abs(A @ agent.Q - agent.Q @ agent.T).max() < 1e-12 * np.abs(A).max()
        assert np.abs(agent.Q.T @ agent.Q - 1.0).max() < 1e-14
        assert agent.T[0, 0] == pytest.approx(rate, rel=1e-6)
    A, C = part.scaled()
    L = np.random.default_rng(seed).normal(size=part.mask.shape)
    assert np.linalg.norm(A, 2) == pytest.approx(1.0)
    assert np.abs(part.unscaled(L) @ part.C - part.size * L @ C).max() < 1e-12 * part.size * np.abs(L).sum()


def test_modes_at_zero_beside_fast_ones_are_not_lost_to_rounding() -> None:
    """Two constants and an oscillator in skew coordinates: the computed zeros may have either sign."""
    rng = np.random.default_rng(5)
    T = la.block_diag(np.zeros((2, 2)), rotation(2.0))
    for _ in range(50):
        basis = np.linalg.qr(rng.normal(size=(4, 4)))[0] * rng.uniform(0.5, 2.0, size=4)
        A = basis @ T @ np.linalg.inv(basis)
        part = only_part(HyperNetwork([A], [{0: rng.normal(size=(2, 4))}]))
        assert part.A.shape == (4, 4)
        assert is_marginal(part)


# -- step 2 ------------------------------------------------------------------------------------------------------------
@settings(max_examples=40)
@given(marginal_networks())
def test_the_modal_inner_product_is_conserved(network) -> None:
    for part in unstable_parts(network, 0.0):
        assert is_marginal(part)
        for agent in part.agents:
            inverse = modal_inverse(agent)
            assert la.eigvalsh(inverse)[0] > 0.0
            rest = agent.T @ inverse + inverse @ agent.T.T
            assert np.abs(rest).max() <= 1e-12 * agent.scale * np.abs(inverse).max()


@pytest.mark.parametrize("A", [[[0.0, 1.0], [0.0, 0.0]], [[0.1]], la.block_diag(rotation(1.0), [[0.2]])])
def test_jordan_blocks_and_growth_are_not_marginal(A) -> None:
    assert not is_marginal(only_part(HyperNetwork([A], [{0: np.ones((1, len(A)))}])))
    skew = np.array([[1.0, 2.0, 0.5], [0.0, 1.0, -1.0], [1.0, 0.0, 2.0]])[: len(A), : len(A)]
    assert not is_marginal(only_part(HyperNetwork([skew @ A @ np.linalg.inv(skew)], [{0: np.ones((1, len(A)))}])))


# -- step 3 ------------------------------------------------------------------------------------------------------------
def test_the_engine_solves_a_program_known_in_closed_form() -> None:
    """The largest eigenvalue of M is the smallest t with t I - M >= 0, and the dual is its eigenprojector."""
    M = np.array([[2.0, 1.0, 0.0], [1.0, 0.0, -1.0], [0.0, -1.0, 1.0]])
    values, vectors = la.eigh(M)
    solution = minimise(clarabel, np.ones(1), [(-M, np.eye(3)[None])])
    assert solution.solved
    assert solution.x[0] == pytest.approx(values[-1], abs=1e-7)
    assert np.abs(solution.duals[0] - np.outer(vectors[:, -1], vectors[:, -1])).max() < 1e-6


def test_an_impossible_program_is_not_solved() -> None:
    assert not minimise(clarabel, np.ones(1), [(-np.eye(2), np.zeros((1, 2, 2)))]).solved


def test_the_symmetric_basis_spans() -> None:
    basis = symmetric_basis(3)
    assert basis.shape == (6, 3, 3)
    assert np.array_equal(basis, basis.transpose(0, 2, 1))
    assert np.linalg.matrix_rank(basis.reshape(6, 9)) == 6


@settings(max_examples=40)
@given(SEEDS, st.sampled_from(["external", "ring", "tree", "path"]))
def test_there_is_a_block_diagonal_matrix_or_a_certificate(seed, kind) -> None:
    part = only_part(unstable_network(kind, np.random.default_rng(seed)))
    A, C = part.scaled()
    found = block_inequality(clarabel, A, C, part.states)
    assume(abs(found.margin) > 1e-5)
    if found.Z is None:
        P, gamma = found.P, found.gamma
        assert la.eigvalsh(P)[0] > 0.0
        assert np.array_equal(P, la.block_diag(*[P[s, s] for s in map(part.states.slice, range(part.states.count))]))
        assert np.abs(C.T + P @ found.gain / gamma).max() < 1e-9 * np.abs(P).max()
        assert spectral_abscissa(A + found.gain @ C) < 0.0
        assert not found.gain[~part.mask].any()
    else:
        assert la.eigvalsh(found.Z)[0] > -1e-14
        assert np.abs(C @ found.Z).max() < 1e-12
        assert certificate_margin(A, found.Z, part.states) == pytest.approx(found.margin, abs=1e-6)
        assert found.margin > 0.0


def test_a_slow_search_agrees_with_the_program_for_two_agents() -> None:
    """P = diag(1, p): on ker C the inequality is one number, whose sign over all p the program must know."""
    rng = np.random.default_rng(3)
    for a, b in rng.uniform(-1.0, 1.0, size=(20, 2)).tolist():
        A, C = np.diag([a, b]) / max(abs(a), abs(b)), np.array([[1.0, 1.0]]) / np.sqrt(2.0)
        shares = np.linspace(0.0, 1.0, 101)
        slow = min(shares * A[0, 0] + (1.0 - shares) * A[1, 1])
        part = only_part(HyperNetwork([[[1.0]], [[1.0]]], [{0: [[1.0]], 1: [[1.0]]}]))
        found = block_inequality(clarabel, A, C, part.states)
        assert found.margin == pytest.approx(slow, abs=1e-6)
        assert (found.Z is None) == (slow < 0.0)


def test_without_a_moderate_gain_the_dual_matrix_serves(monkeypatch) -> None:
    monkeypatch.setattr(inequality, "_small_gain", lambda *_: None)
    part = only_part(unstable_network("external", np.random.default_rng(1)))
    A, C = part.scaled()
    found = block_inequality(clarabel, A, C, part.states)
    assert spectral_abscissa(A + found.gain @ C) < 0.0


# -- step 4 ------------------------------------------------------------------------------------------------------------
@settings(max_examples=40)
@given(SEEDS)
def test_the_gradient_is_that_of_differences(seed) -> None:
    rng = np.random.default_rng(seed)
    A, C, mask = rng.normal(size=(5, 5)), rng.normal(size=(3, 5)), rng.uniform(size=(5, 3)) < 0.6
    assume(mask.any())
    objective = abscissa._objective(A, C, mask)
    point = rng.normal(size=int(mask.sum()))
    values = np.sort(np.unique(np.round(np.linalg.eigvals(A + abscissa.filled(mask, point) @ C).real, 9)))
    assume(values.shape[0] > 1 and values[-1] - values[-2] > 1e-2)
    _, slope = objective(point)
    step = 1e-6
    for k, unit in enumerate(np.eye(point.shape[0])):
        difference = (objective(point + step * unit)[0] - objective(point - step * unit)[0]) / (2.0 * step)
        assert slope[k] == pytest.approx(difference, abs=1e-3 * (1.0 + np.abs(slope).max() ** 2))


def test_quasi_newton_steps_pass_a_kink() -> None:
    """The minimum of 3 |x - y| + y^2 lies where the gradient jumps."""

    def kinked(x: np.ndarray) -> tuple[float, np.ndarray]:
        return float(3.0 * abs(x[0] - x[1]) + x[1] ** 2), np.array(
            [3.0 * np.sign(x[0] - x[1]), -3.0 * np.sign(x[0] - x[1]) + 2.0 * x[1]]
        )

    point, value = minimise_nonsmooth(kinked, np.array([2.0, -1.0]), -1.0)
    assert value < 1e-6
    assert np.abs(point).max() < 1e-2


def test_a_search_at_a_jordan_block_still_moves() -> None:
    found = minimise_abscissa(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]]), np.ones((2, 1), bool), 0.1, 8, 0
    )
    assert found.abscissa <= -0.1
    objective = abscissa._objective(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]]), np.ones((2, 1), bool))
    value, slope = objective(np.zeros(2))
    assert value == 0.0
    assert np.isfinite(slope).all()


def test_a_search_that_cannot_succeed_says_how_far_it_got() -> None:
    found = minimise_abscissa(np.diag([0.5, -1.0]), np.array([[0.0, 1.0]]), np.ones((2, 1), bool), 0.1, 3, 0)
    assert found.starts == 3
    assert found.abscissa == pytest.approx(0.5)


def test_infinite_points_are_walls() -> None:
    objective = abscissa._objective(np.eye(1), np.eye(1), np.ones((1, 1), bool))
    assert objective(np.array([np.inf]))[0] == np.inf


@pytest.mark.slow
def test_the_search_alone_finds_most_structured_gains() -> None:
    """Theory, section 5: 113 of 120."""
    rng, found = np.random.default_rng(120), 0
    for kind in ["tree", "path", "ring", "external"] * 30:
        part = only_part(unstable_network(kind, rng))
        found += design_part(part, Choices("abscissa", None, 8, 0)).step == "abscissa"
    assert found >= 113


# -- step 5 ------------------------------------------------------------------------------------------------------------
@settings(max_examples=15)
@given(SEEDS, st.sampled_from(["tree", "path"]))
def test_a_compensator_at_one_agent_stabilises_all(seed, kind) -> None:
    part = only_part(unstable_network(kind, np.random.default_rng(seed)))
    A, C = part.scaled()
    assume(np.linalg.svd(np.vstack([C @ np.linalg.matrix_power(A, k) for k in range(A.shape[0])]))[1][-1] > 1e-3)
    found = dynamic_stabiliser(A, C, part.mask, part.states, np.zeros(part.mask.shape), 0)
    assert found is not None
    gain, made = found
    assert not gain[~part.mask].any()
    unread = ~part.mask[part.states.slice(made.agent)].any(axis=0)
    assert not made.G[:, unread].any()
    assert spectral_abscissa(closed_loop(A + gain @ C, C, part.states, made)) < 0.0


# -- the proof ---------------------------------------------------------------------------------------------------------
@settings(max_examples=40)
@given(SEEDS, st.floats(0.01, 2.0))
def test_a_proved_rate_holds_and_is_near_the_abscissa(seed, rate) -> None:
    H = np.random.default_rng(seed).normal(size=(5, 5))
    H -= (spectral_abscissa(H) + rate) * np.eye(5)
    found = proved_decay(H, 1e-15 * np.abs(H))
    assert found is not None
    proved, P = found
    assert 0.5 * rate < proved <= rate * (1.0 + 1e-9)
    assert la.eigvalsh(P)[0] > 0.0


def test_nothing_is_proved_for_what_does_not_decay() -> None:
    assert proved_decay(np.eye(2), np.zeros((2, 2))) is None
    assert proved_decay(rotation(1.0), np.zeros((2, 2))) is None
    assert proved_decay(-np.eye(2), np.full((2, 2), 2.0)) is None


def test_a_badly_scaled_matrix_is_balanced_first() -> None:
    scale = np.array([1.0, 1e7, 1e-7])
    H = np.array([[-1.0, 0.4, 0.1], [0.2, -2.0, 0.3], [0.5, 0.1, -3.0]]) * scale / scale[:, None]
    found = proved_decay(H, 1e-15 * np.abs(H))
    assert found is not None
    assert found[0] == pytest.approx(-spectral_abscissa(H), rel=1e-2)


# -- verdicts ----------------------------------------------------------------------------------------------------------
def test_fixed_modes_are_named_where_the_part_is_not_detectable() -> None:
    same = only_part(HyperNetwork([[[0.3]], [[0.3]]], [{0: [[1.0]], 1: [[1.0]]}]))
    assert fixed_mode_verdict(same).startswith("unstable decentralized fixed modes: 0.3")
    assert "no unstable decentralized fixed mode" in fixed_mode_verdict(only_part(TWO))
    design = design_part(same, Choices(None, None, 2, 0))
    assert design.step is None
    assert [note.split(":")[0] for note in design.notes] == ["marginal", "inequality", "abscissa", "dynamic"]


def test_fixed_modes_of_many_agents_are_not_computed() -> None:
    many = HyperNetwork([[[0.1 * k]] for k in range(1, 10)], [{k: [[1.0]] for k in range(9)}])
    assert "not computed for 9 agents" in fixed_mode_verdict(only_part(many))


def test_each_note_of_a_full_search_is_kept() -> None:
    observer = Heterogeneous(starts=1).build(unstable_network("path", np.random.default_rng(7)))
    kinds = [note.split(": ")[1] for note in observer.facts["notes"]]
    assert kinds[:2] == ["marginal", "inequality"]
