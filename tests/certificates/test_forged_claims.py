"""For every claim, certificates with right digests and a false statement, through the file: none is believed."""

from __future__ import annotations

import copy
import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import trigpoint as tp
from tests.certificates.oracle import AGENTS
from tests.certificates.test_forgeries import places
from tests.certificates.test_requested_claims import watts_strogatz
from tests.certificates.test_structure import designed as cascaded
from tests.certificates.test_structure import ring
from trigpoint.arrays import digest_of, encode_array
from trigpoint.certificates import (
    CLAIMS,
    Convergence,
    CovarianceBound,
    DelayMargin,
    Locality,
    MeanSquareStability,
    NoiseBudget,
    Observable,
    SampledStability,
    SmallestEigenvalue,
    SwitchingStability,
    certify,
    verify,
)
from trigpoint.certificates.base import Claim
from trigpoint.errors import ProtocolError
from trigpoint.observers.certificate import certificate_document, read_certificate
from trigpoint.observers.local import LocalArc
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

Case = tuple[Any, NetworkObserver]


def designed(agent: str, gain: float = 1.0) -> Case:
    problem = tp.NetworkedAgents(tp.graphs.grid(2, 2, anchors=(3,)), AGENTS[agent])
    return problem, tp.design(problem, tp.methods.LocalKalman(gain=tp.FromGraph(1.05 * gain)))


def unstable() -> Case:
    problem = tp.NetworkedAgents(tp.graphs.chain(3), AGENTS["unstable"])
    return problem, DiffusiveObserver("weak", problem, np.ones((1, 1)), 0.01, 0.1, None, {})


def programs(exchange: str) -> Case:
    problem, observer = designed("oscillator")
    whole = observer.as_programs()
    nodes = tuple(dataclasses.replace(node, exchange=exchange, _memo={}) for node in whole.nodes)
    return problem, dataclasses.replace(whole, nodes=nodes)


def cascade() -> Case:
    """A shared plant whose observer needs the factors R and T."""
    problem = ring(8, rotated=True)
    return problem, cascaded(problem)


def stranger() -> Case:
    """A node that reads an arc at whose ends it is not."""
    problem, observer = designed("static")
    whole = observer.as_programs()
    arc = LocalArc(3, None, 1.0, np.ones((1, 1)), np.ones((1, 1)), None)
    odd = dataclasses.replace(whole.nodes[0], arcs=(*whole.nodes[0].arcs, arc), _memo={})
    return problem, dataclasses.replace(whole, nodes=(odd, *whole.nodes[1:]))


def blind() -> Case:
    """Nobody sees the third state."""
    plant = tp.SharedPlant(np.diag([-1.0, -2.0, -3.0]), [np.eye(2, 3)], {0: []})
    return plant, tp.design(plant, tp.methods.CouplingGain(rate=0.5))


def with_blocks() -> Case:
    """Weight blocks: no modes to split into."""
    graph = tp.graphs.grid(2, 2, anchors=(3,))
    weight = np.stack([np.array([[1.0, 0.2 * k], [0.2 * k, 1.5]]) for k in range(graph.n_arcs)])
    problem = tp.NetworkedAgents(graph.with_weight(weight), AGENTS["two outputs"])
    return problem, tp.design(problem, tp.methods.LocalKalman())


WHOLE = with_blocks()
STATIC, MOVING, SMALL_WORLD = designed("static"), designed("double integrator"), watts_strogatz()
GROWING, HELD, DEEP = unstable(), programs("innovation-held"), cascade()


@dataclasses.dataclass(frozen=True)
class Forgery:
    """A true claim of ``honest``, handed in for ``given`` with ``numbers`` and ``witness`` changed into a falsehood."""

    claim: Claim
    given: Case
    numbers: dict[str, float] = dataclasses.field(default_factory=dict)
    witness: Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]] = dict
    honest: Case | None = None


def without(name: str) -> Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]:
    return lambda arrays: {key: array for key, array in arrays.items() if key != name}


FORGERIES = [
    Forgery(SmallestEigenvalue(), STATIC, {"lower": 0.5, "upper": 0.6}),
    Forgery(SmallestEigenvalue(), STATIC, {"lower": 1e-3, "upper": 2e-3}),
    Forgery(Convergence(), MOVING, {"rate": 5.0}),
    Forgery(Convergence(0.55), MOVING, {"rate": 5.0}),  # proved on the whole network
    Forgery(Convergence(0.99), WHOLE, {"rate": 5.0}),  # the same, with weight blocks
    Forgery(Convergence(), GROWING, {}, dict, designed("unstable")),
    Forgery(Convergence(0.8), DEEP, {"rate": 1.2}),
    Forgery(Locality(), stranger(), {}, dict, STATIC),
    Forgery(SwitchingStability(), MOVING, {"floor": 1e-6}),
    Forgery(SwitchingStability(), MOVING, {"rate": 50.0}),
    Forgery(SwitchingStability(max_nodes=4), designed("double integrator", 3.0), {"max_nodes": 40.0}),
    Forgery(SampledStability(0.05), HELD, {"period": 50.0}),
    Forgery(SampledStability(0.05), HELD, {"factor": 0.1}),
    Forgery(SampledStability(0.05), MOVING, {"factor": 1.0}, lambda _: {}),  # the constants' claim, for moving agents
    Forgery(DelayMargin(), STATIC, {"delay": 10.0}),
    Forgery(DelayMargin(), MOVING, {"delay": 10.0}),
    Forgery(DelayMargin(), designed("two outputs"), {"delay": 10.0}),
    Forgery(MeanSquareStability(0.5, 0.1), STATIC, {"period": 10.0}),
    Forgery(NoiseBudget(0.1), MOVING, {"mu": 10.0}),
    Forgery(NoiseBudget(0.1), MOVING, {"per_node": 1e-9}),
    Forgery(CovarianceBound(0.1, 0.1), MOVING, {"worst": 1e-9, "total": 1e-9}),
    Forgery(CovarianceBound(0.1, 0.1), MOVING, {"process": 10.0}),
    Forgery(CovarianceBound(0.1, 0.1), MOVING, {}, lambda arrays: {**arrays, "v": 0.1 * arrays["v"]}),
    Forgery(Observable(), blind(), {}, dict, STATIC),
    Forgery(Observable(), STATIC, {}, lambda _: {"V": np.ones((1, 1))}),
]


def believed(forgery: Forgery) -> str:
    """What becomes of it: ``refused``, or the outcome of checking it again."""
    document = certificate_document(certify(*(forgery.honest or forgery.given), [forgery.claim]))
    body = certificate_document(certify(*forgery.given, [Locality()]))
    record = read_certificate(document).records[0]
    (claim,) = document["claims"]
    claim["numbers"].update(forgery.numbers)
    claim["witness"] = {name: encode_array(array) for name, array in forgery.witness(dict(record.witness)).items()}
    claim["verdict"] = "certified"
    forged = {**body, "claims": [claim], "verdict": "certified"}
    forged["digest"] = digest_of({key: value for key, value in forged.items() if key != "digest"})
    try:
        certificate = read_certificate(json.loads(json.dumps(forged)))
        assert certificate.verdict == "certified"
        return verify(certificate, *forgery.given).outcome
    except ProtocolError:
        return "refused"


@pytest.mark.parametrize("forgery", FORGERIES, ids=lambda f: f"{f.claim.name}:{','.join(f.numbers)}")
def test_a_forgery_with_right_digests_is_not_believed(forgery: Forgery) -> None:
    honest = forgery.honest or forgery.given
    if not isinstance(forgery.claim, SampledStability) or forgery.numbers != {"factor": 1.0}:
        assert certify(*honest, [forgery.claim]).verdict == "certified", "the claim that it was forged from is true"
    assert believed(forgery) in ("refused", "inconclusive", "refuted")


def test_every_field_of_every_claim_is_sealed() -> None:
    """One change anywhere, for each claim's certificate: refused for its digest alone."""
    for claim, given in HONEST:
        document = json.loads(json.dumps(certificate_document(certify(*given, [claim]))))
        for at in places(document):
            for other in (None, 0, "", [], {}):
                changed = copy.deepcopy(document)
                owner = changed
                for key in at[:-1]:
                    owner = owner[key]
                if owner[at[-1]] == other:
                    continue
                owner[at[-1]] = other
                with pytest.raises(ProtocolError):
                    read_certificate(changed)


def test_every_claim_is_forged() -> None:
    assert {forgery.claim.name for forgery in FORGERIES} == {kind.name for kind in CLAIMS}


HONEST: list[tuple[Claim, Case]] = [
    (SmallestEigenvalue(), STATIC),
    (Convergence(), MOVING),
    (Convergence(0.55), MOVING),
    (Convergence(0.99), WHOLE),
    (Convergence(0.8), DEEP),
    (SwitchingStability(), MOVING),
    (SampledStability(0.05), HELD),
    (SampledStability(0.05), MOVING),
    (DelayMargin(), STATIC),
    (DelayMargin(), MOVING),
    (DelayMargin(), designed("two outputs")),
    (MeanSquareStability(0.5, 0.45), SMALL_WORLD),  # beyond the sufficient bound, which needs no witness
    (NoiseBudget(), MOVING),
    (CovarianceBound(), MOVING),
]


honest = pytest.mark.parametrize(("claim", "given"), HONEST, ids=lambda value: str(value)[:24])


@honest
def test_a_witness_without_one_of_its_arrays_or_of_another_shape_proves_nothing(claim: Claim, given: Case) -> None:
    record = claim.check(*given)
    assert claim.verify(record, *given) == "certified"
    for name, array in record.witness.items():
        if name in ("whole", "v") and isinstance(claim, Convergence | DelayMargin):
            continue  # a mark, and a vector that only refutes
        for other in (None, np.ones(3), np.ones((1, 1, 1, 1)), array.ravel()[:-1], array.astype(np.int64)):
            arrays = {key: value for key, value in record.witness.items() if key != name}
            if other is not None:
                arrays[name] = other
            try:
                outcome = claim.verify(dataclasses.replace(record, witness=arrays), *given)
            except ProtocolError:
                outcome = "refused"
            assert outcome != "certified", (name, None if other is None else other.shape)


@honest
def test_a_missing_number_is_refused(claim: Claim, given: Case) -> None:
    record = claim.check(*given)
    for name in record.numbers:
        if name == "lambda_floor" and given is DEEP:
            continue  # programs rest on no eigenvalue
        fewer = {key: value for key, value in record.numbers.items() if key != name}
        forged = dataclasses.replace(record, numbers=fewer)
        with pytest.raises(ProtocolError, match=f"lacks the number '{name}'"):
            claim.verify(forged, *given)


@honest
def test_numbers_and_arrays_of_any_size_raise_nothing_but_protocol_errors(claim: Claim, given: Case) -> None:
    """Whatever a stranger writes, the checker ends with an outcome."""
    record = claim.check(*given)
    extremes = (0.0, -1.0, 5e-324, 1e-300, 1e300, 1.7e308)
    for name in record.numbers:
        for value in extremes:
            forged = dataclasses.replace(record, numbers={**record.numbers, name: value})
            assert claim.verify(forged, *given) in ("certified", "inconclusive", "refuted")
    for name, array in record.witness.items():
        for value in extremes:
            forged = dataclasses.replace(record, witness={**record.witness, name: np.full_like(array, value)})
            # x and v may be multiples of the constant vector; the mark's value says nothing.
            assert claim.verify(forged, *given) != "certified" or name in ("v", "x", "whole"), (name, value)
