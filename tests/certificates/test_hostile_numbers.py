"""Observers and witnesses built to be certified falsely: by overflow, underflow, signs, and unchecked hypotheses."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

import trigpoint as tp
from tests.certificates.exact import decays_faster, exact
from tests.certificates.oracle import AGENTS
from trigpoint.certificates import (
    Convergence,
    CovarianceBound,
    DelayMargin,
    MeanSquareStability,
    NoiseBudget,
    SampledStability,
    SwitchingStability,
)
from trigpoint.certificates.programs import error_is_autonomous, error_magnitude, error_to_more_digits, reading_gain
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.observers.network import DiffusiveObserver

ONE, NONE = np.ones((1, 1)), np.zeros((1, 1))


def diffusive(agent: tp.LinearAgent, injection: np.ndarray, gain: float, nodes: int = 1) -> DiffusiveObserver:
    problem = tp.NetworkedAgents(tp.graphs.chain(nodes), agent)
    return DiffusiveObserver("hostile", problem, injection, gain, 1e-9, None, {})


def shared(A: np.ndarray, *nodes: LocalObserver, inputs: np.ndarray | None = None, targets=None) -> AssembledObserver:
    n, agents = A.shape[0], len(nodes)
    hears = {k: [j for j in range(agents) if j != k] for k in range(agents)}
    plant = tp.SharedPlant(A, [np.eye(1, n)] * agents, hears, inputs)
    return AssembledObserver("hostile", plant, nodes, 0.0, None, targets=targets)


def test_products_that_underflow_before_a_huge_gain_are_not_lost() -> None:
    """``g K C = -1e308 1e-200 1e-200``: computed as zero it leaves a decay that is none."""
    observer = diffusive(tp.LinearAgent([[-1e-95]], [[1e-200]]), np.array([[-1e-200]]), 1e308)
    assert not decays_faster(observer, exact(1e-96))
    assert Convergence(1e-96).check(observer.problem, observer).verdict != "certified"
    assert SwitchingStability(floor=1.0, ceiling=1.0).check(observer.problem, observer).verdict != "certified"


def test_an_anti_gain_makes_nothing_stable() -> None:
    observer = diffusive(AGENTS["static"], ONE, -1.0, nodes=3)
    for claim in (SampledStability(0.1), MeanSquareStability(0.5, 0.1), DelayMargin(0.01), NoiseBudget(1.0)):
        assert claim.check(observer.problem, observer).verdict != "certified", claim
    assert Convergence(0.01).check(observer.problem, observer).verdict == "refuted"
    assert SwitchingStability().check(observer.problem, observer).verdict == "refuted"


def test_a_neighbour_heard_too_faintly_for_a_sum_of_floats_still_drives_the_error() -> None:
    """``1 - 1e-20`` is 1 in floats, but the innovation does not vanish in agreement."""
    faint = LocalObserver("0", NONE, None, (LocalArc(0, "1", 1.0, ONE, ONE, 1e-20 * ONE),))
    plain = LocalObserver("1", NONE, None, (LocalArc(1, None, 1.0, ONE, ONE, None),))
    observer = shared(NONE, faint, plain)
    for claim in (Convergence(0.5), SampledStability(0.1), CovarianceBound()):
        assert claim.check(observer.problem, observer).verdict == "inconclusive"
    other = LocalObserver("0", NONE, None, (LocalArc(0, None, 1.0, ONE, ONE, None),))
    honest = shared(NONE, other, plain)
    assert Convergence(0.5).check(honest.problem, honest).verdict == "certified"


def test_sums_over_two_copies_of_a_state_are_compared_exactly() -> None:
    """``0.1 + 0.2`` rounds to what the truth has, and is not it."""
    target = (np.ones((2, 1)),)
    A = np.array([[0.1, 0.2], [0.2, 0.1]]) - 2.0 * np.eye(2)
    for whole in (-2.0 + 0.1 + 0.2, A[0, 0] + A[0, 1], -1.75):
        observer = shared(np.array([[whole]]), LocalObserver("0", A, None, ()), targets=target)
        assert error_is_autonomous(observer) == (Fraction(A[0, 0]) + Fraction(A[0, 1]) == Fraction(whole))
    alike = LocalObserver("0", np.array([[-1.5, -0.25], [-0.25, -1.5]]), None, ())
    assert error_is_autonomous(shared(np.array([[-1.75]]), alike, targets=target))


def test_an_input_that_enters_a_program_otherwise_than_the_truth_is_a_drive() -> None:
    arcs = (LocalArc(0, None, 1.0, ONE, ONE, None),)
    for B, proved in ((ONE, True), (2.0 * ONE, False), (None, False)):
        observer = shared(NONE, LocalObserver("0", NONE, B, arcs), inputs=ONE)
        assert error_is_autonomous(observer) is proved


def test_a_readout_that_returns_something_else_is_not_proved() -> None:
    arcs = (LocalArc(0, None, 1.0, ONE, ONE, None),)
    plain = LocalObserver("0", NONE, None, arcs)
    for change, proved in (
        ({}, True),
        ({"readout": ONE}, True),
        ({"readout": 2.0 * ONE}, False),
        ({"feedthrough": ((0, 1e-9 * ONE),)}, False),
    ):
        assert error_is_autonomous(shared(NONE, dataclasses.replace(plain, **change, _memo={}))) is proved


@pytest.mark.parametrize("sign", [0.1, 0.0, 2.0])
def test_a_sign_that_is_none_is_not_multiplied_out(sign) -> None:
    arc = LocalArc(0, None, sign, ONE, sign * ONE, None)
    assert not error_is_autonomous(shared(NONE, LocalObserver("0", NONE, None, (arc,))))


def test_entries_whose_sum_overflows_prove_nothing() -> None:
    arc = LocalArc(0, None, 1.0, ONE, np.array([[1e308, 1e308]]), None)
    observer = shared(NONE, LocalObserver("0", np.zeros((2, 2)), None, (arc,)), targets=(np.ones((2, 1)),))
    assert not error_is_autonomous(observer)


def test_maps_and_differential_equations_do_not_mix() -> None:
    A = np.zeros((1, 1))
    arcs = [LocalArc(k, None, 1.0, 0.5 * ONE, ONE, None) for k in range(2)]
    nodes = [LocalObserver(str(k), A, None, (arc,)) for k, arc in enumerate(arcs)]
    observer = shared(A, nodes[0], dataclasses.replace(nodes[1], exchange="discrete", _memo={}))
    record = SampledStability(0.1).check(observer.problem, observer)
    assert record.verdict == "inconclusive"
    assert "maps" in record.text


@pytest.mark.parametrize("period", [1e308, 1e14])
def test_a_period_beyond_every_exponential_is_inconclusive(period) -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(3), AGENTS["oscillator"])
    observer = tp.design(problem, tp.methods.LocalKalman())
    record = SampledStability(period).check(problem, observer)
    assert record.verdict == "inconclusive"
    forged = dataclasses.replace(record, numbers={"period": period, "factor": 0.5}, witness={"P": np.eye(6)})
    assert SampledStability.verify(forged, problem, observer) == "inconclusive"


def test_a_thousand_outputs_are_a_thousand_roundings() -> None:
    """The pull is a sum of 2000 products: its error is bounded as such, and the edge is met from the right side."""
    rng = np.random.default_rng(0)
    C, K = rng.uniform(-1.0, 1.0, (2000, 1)), rng.uniform(-1.0, 1.0, (1, 2000))
    K = K * np.sign(K @ C)
    observer = diffusive(tp.LinearAgent(NONE, C), K, 1.0)
    edge = float((K @ C).item())
    decided = []
    for away in (-1e-9, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1e-9):
        rate = edge * (1.0 + away)
        verdict = Convergence(rate).check(observer.problem, observer).verdict
        assert verdict != ("refuted" if decays_faster(observer, exact(rate)) else "certified")
        decided.append(verdict)
    assert (decided[0], decided[-1]) == ("certified", "refuted")


def test_witnesses_of_any_size_make_no_false_proof() -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(2), AGENTS["unstable"])
    weak = DiffusiveObserver("hostile", problem, ONE, 1e-3, 0.1, None, {})
    record = Convergence(0.1).check(problem, weak)
    assert record.verdict == "refuted"
    x = tp.smallest_eigenvalue(problem.graph)
    for P in (1e-310, 1e-200, 1.0, 1e200, 1e308):
        for rate in (1e-300, 0.1, 1e308):
            numbers = {"rate": rate, "lambda_floor": x.lower}
            for witness in (
                {"P": np.full((1, 1), P), "x": x.witness},
                {"P": P * np.eye(2), "whole": np.ones(1)},
                {"R": P * np.eye(2), "T": np.eye(2) / P if P > 1e-300 else np.eye(2), "whole": np.ones(1)},
            ):
                forged = dataclasses.replace(record, numbers=numbers, witness=witness)
                assert Convergence.verify(forged, problem, weak) != "certified"


def test_the_error_matrix_and_the_gains_of_the_readings_are_enclosed() -> None:
    """Parallel arcs and gains that cancel: what rounding took is inside the radius."""
    rng = np.random.default_rng(4)
    for _ in range(50):
        gains = np.array([0.1, 0.2, -0.3]) * rng.uniform(0.5, 2.0, 3)
        gains[2] = -(gains[0] + gains[1])
        outputs = rng.uniform(0.5, 1.5, 3)
        arcs = tuple(LocalArc(0, None, 1.0, g * ONE, c * ONE, None) for g, c in zip(gains, outputs, strict=True))
        observer = shared(0.3 * ONE, LocalObserver("0", 0.3 * ONE, None, arcs))
        pull = sum((Fraction(g) * Fraction(c) for g, c in zip(gains, outputs, strict=True)), Fraction(0))
        truth, K = Fraction(0.3) - pull, sum(map(Fraction, gains.tolist()), Fraction(0))
        H, fine, read = error_magnitude(observer), error_to_more_digits(observer), reading_gain(observer)
        assert abs(truth - Fraction(H.middle.item())) <= Fraction(H.radius.item())
        assert abs(truth - Fraction(fine.middle.item()) - Fraction(fine.low.item())) <= Fraction(fine.radius.item())
        assert fine.radius.item() < 1e-24
        assert abs(K - Fraction(read.middle.item())) <= Fraction(read.radius.item())


def test_a_step_that_underflows_before_heavy_weights_multiply_it_is_no_small_step() -> None:
    """``period gain = 1e-400`` is 0 in floats; with the pull 1e300 and the weight 1e300 the step is 1e200."""
    for weight, arrival, period in ((1e300, 1.0, 1e-200), (1.7e308, 1.0, 1e-200), (1e300, 1e-320, 1e-200)):
        graph = tp.MeasurementGraph(1, [tp.EXTERNAL], [0], [weight])
        problem = tp.NetworkedAgents(graph, tp.LinearAgent(NONE, 1e150 * ONE))
        observer = DiffusiveObserver("hostile", problem, 1e150 * ONE, 1e-200, 1e-9, None, {})
        assert MeanSquareStability(arrival, period).check(problem, observer).verdict == "inconclusive"


def test_a_witness_of_an_extreme_second_moment_proves_nothing() -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(2), AGENTS["static"])
    observer = DiffusiveObserver("plain", problem, ONE, 1.0, 0.1, None, {})
    record = MeanSquareStability(0.5, 0.88).check(problem, observer)
    assert record.verdict == "certified"
    for size in (1e-200, 1e200):
        forged = dataclasses.replace(record, witness={"X": size * record.witness["X"]})
        assert MeanSquareStability.verify(forged, problem, observer) == "inconclusive"


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("seed", range(12))
def test_observers_of_any_numbers_end_with_an_outcome(seed) -> None:
    """Entries from 1e-300 to 1e300: no error, no claim that its own check does not confirm, no false rate."""
    rng = np.random.default_rng(seed)
    size = float(rng.choice([10.0, 100.0, 300.0]))

    def drawn(*shape: int) -> np.ndarray:
        return rng.choice([-1.0, 1.0], shape) * 10.0 ** rng.uniform(-size, size, shape)

    n = int(rng.integers(1, 3))
    agent = tp.LinearAgent(drawn(n, n) * (rng.random() < 0.5), np.abs(drawn(1, n)))
    graph = tp.graphs.chain(2).with_weight(np.abs(drawn(2)))
    problem = tp.NetworkedAgents(graph, agent)
    observer = DiffusiveObserver("hostile", problem, np.abs(drawn(n, 1)), float(np.abs(drawn(1))[0]), 0.1, None, {})
    level = float(np.abs(drawn(1))[0])
    claims = (
        *(Convergence(level), Convergence(), SwitchingStability(), SampledStability(level), DelayMargin()),
        *(DelayMargin(level), NoiseBudget(), NoiseBudget(level), CovarianceBound(level, 1.0)),
    )
    with np.errstate(all="ignore"):
        for claim in claims:
            record = claim.check(problem, observer)
            assert claim.verify(record, problem, observer) == record.verdict
            if isinstance(claim, Convergence) and record.verdict != "inconclusive":
                true = decays_faster(observer, exact(record.numbers["rate"]))
                assert record.verdict == ("certified" if true else "refuted")
