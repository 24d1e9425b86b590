"""What a checker shows is what it checked: no number, sentence or digit beside it; and files that are bombs."""

from __future__ import annotations

import dataclasses
import json
from fractions import Fraction

import numpy as np
import pytest

import trigpoint as tp
from tests.certificates.oracle import AGENTS, drawn_graph, eigenvalues
from tests.certificates.test_forged_claims import DEEP, MOVING, STATIC, WHOLE
from trigpoint.arrays import at_least, at_most, digest_of, exactly
from trigpoint.certificates import (
    CLAIMS,
    Certificate,
    Convergence,
    CovarianceBound,
    DelayMargin,
    Locality,
    MeanSquareStability,
    NoiseBudget,
    SampledStability,
    SmallestEigenvalue,
    SwitchingStability,
    certify,
    verify,
)
from trigpoint.certificates.statics import eigenvalue_near, largest_eigenvalue_by_degrees
from trigpoint.certificates.verb import Verdict
from trigpoint.errors import FileFormatError, ProtocolError
from trigpoint.linalg.modular import stays_and_is_unseen
from trigpoint.model.documents import problem_document, read_problem
from trigpoint.observers.certificate import certificate_document, read_certificate
from trigpoint.observers.network import DiffusiveObserver

ONE = np.ones((1, 1))
BLOCKS = tp.NetworkedAgents(
    tp.graphs.chain(2).with_weight(np.stack([np.diag([1.0, 2.0])] * 2)),
    tp.LinearAgent.static(2),
)


@pytest.mark.parametrize("name", ["r\u0430te", "guaranteed_rate", "rate ", "rate 1)\ncertified: observable"])
def test_a_number_that_the_claim_does_not_have_is_refused(name: str) -> None:
    """One of the names looks like ``rate`` and has a Cyrillic letter."""
    certificate = certify(*MOVING)
    for record in certificate.records:
        forged = dataclasses.replace(record, numbers={**record.numbers, name: 1e6})
        with pytest.raises(ProtocolError, match="has no number"):
            verify(dataclasses.replace(certificate, records=(forged,)), *MOVING)


def test_every_claim_names_its_numbers() -> None:
    for kind in CLAIMS:
        assert set(kind().check(*STATIC).numbers) <= set(kind.quantities) if kind is not MeanSquareStability else True


@pytest.mark.parametrize(
    ("claim", "given"),
    [
        (Convergence(0.8), DEEP),
        (Convergence(0.99), WHOLE),
        (Convergence(0.1), (BLOCKS, tp.design(BLOCKS, tp.methods.LocalKalman()))),
        (SampledStability(0.05), MOVING),
        (SampledStability(0.05), STATIC),
        (DelayMargin(), STATIC),
    ],
    ids=str,
)
def test_an_eigenvalue_that_nothing_proves_is_not_shown(claim, given) -> None:
    record = claim.check(*given)
    assert record.verdict == "certified"
    for bound in (1e6, 1e300):
        forged = dataclasses.replace(record, numbers={**record.numbers, "lambda_floor": bound})
        assert claim.verify(forged, *given) == "inconclusive"


def test_every_honest_record_is_judged_as_it_says() -> None:
    """Also those that prove nothing: a certificate of its own making is never malformed."""
    rng = np.random.default_rng(3)
    for _ in range(6):
        agent = AGENTS[sorted(AGENTS)[int(rng.integers(len(AGENTS)))]]
        problem = tp.NetworkedAgents(tp.graphs.grid(2, 3, anchors=(int(rng.integers(6)),)), agent)
        observer = DiffusiveObserver(
            "drawn", problem, rng.uniform(-0.3, 1.5, (agent.n_states, agent.n_outputs)), 0.5, 0.1, None, {}
        )
        wanted = [Convergence(float(rate)) for rate in rng.uniform(0.01, 1.0, 3)]
        for claim in (
            *wanted,
            Convergence(),
            SwitchingStability(),
            SampledStability(0.1),
            DelayMargin(),
            NoiseBudget(),
        ):
            for given in (observer, observer.as_programs()):
                record = claim.check(problem, given)
                assert claim.verify(record, problem, given) == record.verdict, record


def test_readings_of_a_light_arc_are_as_noisy_for_programs_as_for_the_formula() -> None:
    """Weight 0.01: the variance is 100, and with pull 1 the steady error 50."""
    problem = tp.NetworkedAgents(tp.MeasurementGraph(1, [tp.EXTERNAL], [0], [0.01]), AGENTS["static"])
    observer = DiffusiveObserver("light", problem, ONE, 100.0, 0.1, None, {})
    for given in (observer, observer.as_programs()):
        assert CovarianceBound(0.0, 1.0).check(problem, given).numbers["worst"] == pytest.approx(50.0)
    programs = tp.design(BLOCKS, tp.methods.LocalKalman()).as_programs()
    assert "weights are matrices" in CovarianceBound().check(BLOCKS, programs).text


def test_a_rate_below_zero_is_not_refuted_by_a_mode_that_grows() -> None:
    problem = tp.NetworkedAgents(tp.graphs.chain(2), AGENTS["unstable"])
    observer = DiffusiveObserver("weak", problem, ONE, 0.01, 0.1, None, {})
    record = SwitchingStability().check(problem, observer)
    assert record.verdict == "refuted"
    slower = dataclasses.replace(record, numbers={**record.numbers, "rate": -5.0})
    assert SwitchingStability.verify(slower, problem, observer) == "inconclusive"


def test_blocks_of_size_one_are_numbers_and_blocks_are_symmetric_to_the_last_bit() -> None:
    weight = np.array([1.0, 2.0, 3.0])
    graph = tp.graphs.chain(3).with_weight(weight.reshape(3, 1, 1))
    np.testing.assert_array_equal(graph.weight, weight)
    problem = tp.NetworkedAgents(graph, AGENTS["double integrator"])
    assert certify(problem, tp.design(problem, tp.methods.LocalKalman())).verdict == "certified"
    skew = np.array([[[1.0, 3e-13], [-3e-13, 1.0]]])
    stored = tp.MeasurementGraph(1, [tp.EXTERNAL], [0], skew).laplacian().toarray()
    np.testing.assert_array_equal(stored, stored.T)


@pytest.mark.slow
def test_the_degree_of_a_hub_is_bounded_whatever_the_number_of_its_arcs() -> None:
    """Twelve million weights that are each lost in the sum, and together are not."""
    count = 12_000_000
    weight = np.full(count, 2.0**-53)
    weight[0] = 1.0
    graph = tp.MeasurementGraph(1, np.full(count, tp.EXTERNAL), np.zeros(count, dtype=np.int64), weight)
    assert Fraction(largest_eigenvalue_by_degrees(graph)) >= 1 + (count - 1) * Fraction(1, 2**53)


def test_numbers_are_shown_on_the_safe_side_of_what_was_found() -> None:
    third = 1.0 / 3.0
    numbers = {"rate": third, "floor": third, "ceiling": third, "period": third, "lambda_floor": third}
    for outcome, shown in (
        ("certified", {"rate": at_least, "floor": at_most, "period": exactly, "lambda_floor": at_least}),
        ("refuted", {"rate": at_most, "floor": at_least, "period": exactly, "lambda_floor": at_least}),
    ):
        text = Verdict(outcome, (("claim", outcome),), (numbers,)).summary()
        for name, rounded in shown.items():
            assert f"{name} {rounded(third)}" in text
    assert exactly(third) == "0.3333333333333333"
    assert exactly(2.0) == "2"
    for claim in (SampledStability(0.1234567890123), MeanSquareStability(0.9, 0.1234567890123)):
        assert "0.1234567890123 s" in claim.check(*STATIC).text


def sealed(document: dict) -> dict:
    body = {key: value for key, value in document.items() if key != "digest"}
    return {**body, "digest": digest_of(body)}


def test_bombs_are_refused_before_they_go_off() -> None:
    document = certificate_document(certify(*STATIC))
    many = {**document, "claims": [document["claims"][-1]] * 101}
    with pytest.raises(ProtocolError, match="at most 100 claims"):
        read_certificate(sealed(many))
    axes = json.loads(json.dumps(document))
    axes["claims"][0]["witness"]["v"]["shape"] = [2**31 - 1] * 100_000
    with pytest.raises(ProtocolError, match="at most 8"):
        read_certificate(sealed(axes))
    problem = json.loads(json.dumps(problem_document(STATIC[0])))
    for names, nodes in ((None, 10**12), (None, 10**400), (["a"], 10**12), ("abcd", 4), (["a"] * 4, 4.0)):
        problem["graph"] |= {"names": names, "n_nodes": nodes}
        with pytest.raises(ProtocolError, match="names must list one text a node"):
            read_problem(problem)
    huge = np.array([[2.0**60], [1.0]])
    assert not stays_and_is_unseen(np.zeros((2, 2)), np.array([[1.0, -(2.0**60)]]), huge)


def test_a_document_with_a_key_twice_is_refused(tmp_path) -> None:
    certificate: Certificate = certify(*STATIC, [Convergence()])
    path = tmp_path / "certificate.json"
    tp.save(certificate, path)
    text = path.read_text()
    assert tp.load(path).verdict == "certified"
    path.write_text(text.replace('"rate":', '"rate": 1000.0, "rate":'))
    with pytest.raises(FileFormatError, match="has the key 'rate' twice"):
        tp.load(path)


def test_the_sizes_of_a_witness_are_no_excuse() -> None:
    """A record of another claim's numbers, and arrays of whole numbers in place of floats."""
    record = SmallestEigenvalue().check(*STATIC)
    whole = {name: np.ones(array.shape, dtype=np.int64) for name, array in record.witness.items()}
    with pytest.raises(ProtocolError, match="must be floats"):
        SmallestEigenvalue.verify(dataclasses.replace(record, witness=whole), *STATIC)
    certificate = certify(*STATIC, [Locality()])
    boast = dataclasses.replace(certificate.records[0], numbers={"rate": 1.0})
    with pytest.raises(ProtocolError, match="has no number"):
        verify(dataclasses.replace(certificate, records=(boast,)), *STATIC)


def test_an_eigenvalue_is_in_the_interval_around_any_quotient() -> None:
    rng = np.random.default_rng(9)
    for _ in range(40):
        graph = drawn_graph(rng, int(rng.integers(1, 6)), float(rng.choice([0.0, 3.0])))
        true = eigenvalues(graph)
        vectors = np.linalg.eigh(graph.laplacian().toarray())[1]
        for v in (*vectors.T, rng.normal(size=graph.n_nodes) * 1e-300, 1e300 * np.ones(graph.n_nodes)):
            near = eigenvalue_near(graph, v)
            assert near is not None
            assert any(near[0] <= value <= near[1] for value in true)
        assert eigenvalue_near(graph, np.zeros(graph.n_nodes)) is None
