"""Certificates from strangers: whatever is changed in one, it is refused or it is true."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from tests.certificates.oracle import AGENTS, holds
from trigpoint.arrays import at_least, digest_of, encode_array
from trigpoint.certificates import CLAIMS, Convergence, Locality, certify, verify
from trigpoint.errors import ArgumentError, ProtocolError, TrigpointError
from trigpoint.observers.certificate import Certificate, certificate_document, read_certificate
from trigpoint.observers.network import DiffusiveObserver

GRAPH = tp.graphs.grid(2, 2, anchors=(3,))
PROBLEM = tp.NetworkedAgents(GRAPH, AGENTS["double integrator"])
OBSERVER = tp.design(PROBLEM, tp.methods.LocalKalman())
assert isinstance(OBSERVER, DiffusiveObserver)
DOCUMENT = json.loads(json.dumps(certificate_document(certify(PROBLEM, OBSERVER))))

POISON: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    1,
    1e9,
    1e-300,
    1.7e308,
    10**400,
    float("nan"),
    float("inf"),
    "",
    "certified",
    "convergence",
    "9" * 64,
    [],
    [1],
    {},
    {"rate": 1.0},
    encode_array(np.ones(4)),
    encode_array(np.ones((2, 2))),
    encode_array(np.ones((2, 2), dtype=np.int64)),
    {"type": "f8", "shape": [2**31 - 1, 2**31 - 1], "base64": ""},
)


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Path of every value inside a JSON document."""
    if at:
        yield at
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield from places(entry, (*at, key))


def changed(at: tuple[Any, ...], value: Any, *, delete: bool = False) -> dict[str, Any]:
    document = copy.deepcopy(DOCUMENT)
    owner: Any = document
    for key in at[:-1]:
        owner = owner[key]
    if delete:
        del owner[at[-1]]
    else:
        owner[at[-1]] = value
    return document


def resealed(document: dict[str, Any]) -> dict[str, Any]:
    """The document with the digest that a forger would compute."""
    body = {key: value for key, value in document.items() if key != "digest"}
    try:
        return {**body, "digest": digest_of(body)}
    except ValueError:
        return {**body, "digest": "0" * 64}


def poisons(at: tuple[Any, ...]) -> list[Any]:
    """Values that differ from what stands there."""
    value: Any = DOCUMENT
    for key in at:
        value = value[key]
    return [poison for poison in POISON if json.dumps(poison) != json.dumps(value)]


def outcome(document: Any) -> str:
    """``refused``, or the verdict of checking again; a certified one must be true."""
    try:
        certificate = read_certificate(document)
        verdict = verify(certificate, PROBLEM, OBSERVER)
    except ProtocolError:
        return "refused"
    if verdict.outcome == "certified":
        for record in certificate.records:
            assert holds(record, OBSERVER), record
    return verdict.outcome


def test_the_unchanged_certificate_is_certified() -> None:
    assert outcome(DOCUMENT) == "certified"
    assert [claim["claim"] for claim in DOCUMENT["claims"]] == [kind.name for kind in CLAIMS if kind.concerns(OBSERVER)]


@pytest.mark.parametrize("at", list(places(DOCUMENT)), ids=lambda at: ".".join(map(str, at)))
def test_every_field_is_sealed_by_the_digest(at: tuple[Any, ...]) -> None:
    for poison in poisons(at):
        assert outcome(changed(at, poison)) == "refused"
    assert outcome(changed(at, None, delete=True)) == "refused"


@pytest.mark.parametrize("at", list(places(DOCUMENT)), ids=lambda at: ".".join(map(str, at)))
def test_a_resealed_forgery_is_refused_inconclusive_or_true(at: tuple[Any, ...]) -> None:
    seen = {outcome(resealed(changed(at, poison))) for poison in poisons(at)}
    seen.add(outcome(resealed(changed(at, None, delete=True))))
    assert "refused" in seen or "inconclusive" in seen or at[-1] == "digest"


NUMBERS = [at for at in places(DOCUMENT) if "numbers" in at and at[-1] != "numbers"]


@pytest.mark.parametrize("at", NUMBERS, ids=lambda at: ".".join(map(str, at)))
def test_no_number_can_be_improved(at: tuple[Any, ...]) -> None:
    """A larger rate or floor, a larger lower bound, a smaller upper bound: none of it passes."""
    value = float(DOCUMENT["claims"][at[1]]["numbers"][at[-1]])
    better = -1.0 if at[-1] == "upper" else 1.0
    for share in (1e-2, 0.1, 0.5):
        assert outcome(resealed(changed(at, value * (1.0 + better * share)))) in ("inconclusive", "refuted")


def test_claims_of_another_name_or_version_are_refused() -> None:
    assert outcome(resealed(changed(("claims", 1, "claim"), "convergence-twice-as-fast"))) == "refused"
    for version in (0, 2, "1", 1.0, True, None):
        assert outcome(resealed(changed(("version",), version))) == "refused"
    for key in ("problem", "observer"):
        assert outcome(resealed(changed((key,), "0" * 64))) == "refused"


def test_a_verdict_that_is_not_that_of_the_claims_is_refused() -> None:
    for verdict in ("inconclusive", "refuted", "probably"):
        assert outcome(resealed(changed(("verdict",), verdict))) == "refused"
    assert outcome(resealed(changed(("claims",), []))) == "refused"


def test_a_claim_that_calls_itself_certified_is_judged_by_its_witness() -> None:
    """The verdicts in the file are decoration: an inconclusive claim relabelled certified stays inconclusive."""
    weak = tp.design(PROBLEM, tp.methods.LocalKalman(gain=tp.Fixed(1e-3)))
    assert isinstance(weak, DiffusiveObserver)
    document = certificate_document(certify(PROBLEM, weak))
    assert document["verdict"] == "inconclusive"
    document["verdict"] = "certified"
    for claim in document["claims"]:
        claim["verdict"] = "certified"
        if claim["claim"] == "convergence":
            claim["numbers"]["rate"] = 0.1
    certificate = read_certificate(resealed(document))
    assert certificate.verdict == "certified"
    assert verify(certificate, PROBLEM, weak).outcome == "inconclusive"


def test_a_certificate_is_for_one_observer_and_one_problem() -> None:
    certificate = read_certificate(DOCUMENT)
    other = tp.design(PROBLEM, tp.methods.LocalKalman(gain=tp.FromGraph(2.0)))
    elsewhere = tp.NetworkedAgents(tp.graphs.grid(2, 2, anchors=(0,)), AGENTS["double integrator"])
    with pytest.raises(ProtocolError, match="another observer"):
        verify(certificate, PROBLEM, other)
    with pytest.raises(ArgumentError, match="another problem"):
        verify(certificate, elsewhere, OBSERVER)
    with pytest.raises(ProtocolError, match="another problem"):
        verify(certificate, elsewhere, tp.design(elsewhere, tp.methods.LocalKalman()))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@given(JSON)
@settings(max_examples=200)
def test_reading_nonsense_raises_only_protocol_errors(document: Any) -> None:
    with pytest.raises(ProtocolError):
        read_certificate(document)


@given(st.sampled_from(list(places(DOCUMENT))), JSON, st.booleans())
@settings(max_examples=400)
def test_reading_damaged_certificates_raises_only_protocol_errors(at: tuple[Any, ...], value: Any, seal: bool) -> None:
    document = changed(at, value)
    if seal:
        document = resealed(document)
    try:
        certificate = read_certificate(document)
    except ProtocolError:
        return
    assert isinstance(certificate, Certificate)
    assert outcome(document) in ("refused", "inconclusive", "certified")


@pytest.mark.parametrize("extra", [{"claims": [set()]}, {1: 2}, {"deep": None}, {"problem": b"bytes"}])
def test_documents_that_json_cannot_hold_are_protocol_errors(extra: dict[Any, Any]) -> None:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    document = {**DOCUMENT, **extra}
    if "deep" in extra:
        document["deep"] = deep
    with pytest.raises(ProtocolError):
        read_certificate(document)


def test_a_certificate_survives_its_document_bit_for_bit() -> None:
    certificate = certify(PROBLEM, OBSERVER)
    again = read_certificate(json.loads(json.dumps(certificate_document(certificate))))
    assert certificate_document(again) == certificate_document(certificate)
    for here, there in zip(certificate.records, again.records, strict=True):
        assert here.numbers == there.numbers
        for name, array in here.witness.items():
            np.testing.assert_array_equal(array, there.witness[name])


def test_chosen_claims_only_are_stated() -> None:
    certificate = certify(PROBLEM, OBSERVER, [Locality(), Convergence(rate=0.01)])
    assert [record.claim for record in certificate.records] == ["locality", "convergence"]
    assert certificate.records[1].numbers["rate"] == 0.01
    assert certificate.verdict == "certified"
    assert certificate.summary().count("certified: ") == 2
    with pytest.raises(ArgumentError, match="at least one claim"):
        certify(PROBLEM, OBSERVER, [])


def test_an_observer_of_another_problem_cannot_be_certified() -> None:
    other = tp.NetworkedAgents(tp.graphs.chain(4), AGENTS["double integrator"])
    with pytest.raises(ArgumentError, match="another problem"):
        certify(other, OBSERVER)


def test_the_worst_claim_decides() -> None:
    weak = tp.design(PROBLEM, tp.methods.LocalKalman(gain=tp.Fixed(1e-3)))
    certificate = certify(PROBLEM, weak)
    assert {record.claim: record.verdict for record in certificate.records} == {
        "smallest-eigenvalue": "certified",
        "convergence": "inconclusive",
        "locality": "certified",
    }
    verdict = verify(certificate, PROBLEM, weak)
    assert verdict.outcome == "inconclusive"
    lines = verdict.summary().splitlines()
    assert lines[1].startswith("inconclusive: convergence (rate ")
    assert f"lower {certificate.records[0].numbers['lower']:.9g}" in lines[0]
    assert lines[2] == "certified: locality"


def test_assumptions_are_those_of_the_claim_and_sentences_are_not_believed() -> None:
    """A forger may write any sentence; what is shown after checking are the numbers that were checked."""
    fewer = changed(("claims", 1, "assumptions"), DOCUMENT["claims"][1]["assumptions"][:1])
    for at in (fewer, changed(("claims", 1, "assumptions"), ["any delay and any loss"])):
        with pytest.raises(ProtocolError, match="states other assumptions than it has"):
            verify(read_certificate(resealed(at)), PROBLEM, OBSERVER)
    boast = resealed(changed(("claims", 1, "text"), "the error decays at 1000 /s"))
    summary = verify(read_certificate(boast), PROBLEM, OBSERVER).summary()
    assert "1000" not in summary
    assert f"rate {at_least(DOCUMENT['claims'][1]['numbers']['rate'])}" in summary


def test_every_error_is_one_of_the_house() -> None:
    assert issubclass(ProtocolError, TrigpointError)
