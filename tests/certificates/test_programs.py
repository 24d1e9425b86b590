"""Claims about observers given by programs: a proved rate, locality, and what is not proved."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trigpoint as tp
from tests.observers.given import hyper_network, hyper_observer, shared_observer, shared_plant
from trigpoint.certificates import Convergence, Locality, SmallestEigenvalue, certify, verify
from trigpoint.observers.local import LocalArc, LocalObserver

STABLE = shared_observer(coupling=6.0)
RATE = -float(np.linalg.eigvals(STABLE.error_matrix().toarray()).real.max())


def with_arcs(observer, node: int, *arcs: LocalArc):
    nodes = list(observer.nodes)
    nodes[node] = dataclasses.replace(nodes[node], arcs=(*nodes[node].arcs, *arcs), _memo={})
    return dataclasses.replace(observer, nodes=tuple(nodes))


@pytest.mark.parametrize("observer", [STABLE, hyper_observer()], ids=["shared", "hyper"])
def test_a_stable_observer_is_certified_close_to_its_abscissa(observer, tmp_path) -> None:
    certificate = certify(observer.problem, observer)
    assert [record.claim for record in certificate.records] == ["convergence", "locality"]
    assert certificate.verdict == "certified"
    abscissa = float(np.linalg.eigvals(observer.error_matrix().toarray()).real.max())
    rate = certificate.records[0].numbers["rate"]
    assert 0.9 * -abscissa <= rate <= -abscissa
    for name, value in (("problem", observer.problem), ("observer", observer), ("certificate", certificate)):
        tp.save(value, tmp_path / f"{name}.json")
    problem, again, proof = (tp.load(tmp_path / f"{name}.json") for name in ("problem", "observer", "certificate"))
    assert verify(proof, problem, again).outcome == "certified"


@given(st.floats(0.2, 3.0))
@settings(max_examples=60)
def test_no_rate_beyond_the_abscissa_is_certified(share: float) -> None:
    record = Convergence(rate=share * RATE).check(STABLE.problem, STABLE)
    if record.verdict == "certified":
        assert share < 1.0
    elif share < 0.98:
        raise AssertionError(f"{share} of the rate was not proved")


def test_an_unstable_observer_is_not_certified() -> None:
    observer = shared_observer(coupling=0.0)
    assert Convergence().check(observer.problem, observer).verdict == "inconclusive"


def test_a_forged_rate_is_not_believed() -> None:
    record = Convergence().check(STABLE.problem, STABLE)
    forged = dataclasses.replace(record, numbers={**record.numbers, "rate": 1.01 * RATE})
    assert Convergence.verify(forged, STABLE.problem, STABLE) == "inconclusive"
    without = dataclasses.replace(record, witness={})
    assert Convergence.verify(without, STABLE.problem, STABLE) == "inconclusive"
    negative = dataclasses.replace(record, witness={name: -array for name, array in record.witness.items()})
    assert Convergence.verify(negative, STABLE.problem, STABLE) == "inconclusive"


def test_where_the_truth_drives_the_error_nothing_is_certified() -> None:
    wrong = dataclasses.replace(STABLE.nodes[0], A=STABLE.nodes[0].A * (1.0 + 1e-15), _memo={})
    observer = dataclasses.replace(STABLE, nodes=(wrong, *STABLE.nodes[1:]))
    record = Convergence().check(observer.problem, observer)
    assert record.verdict == "inconclusive"
    assert "the truth may drive the error" in record.text
    arc = STABLE.nodes[0].arcs[-1]
    scaled = dataclasses.replace(arc, output=arc.output * 1.5)
    node = dataclasses.replace(STABLE.nodes[0], arcs=(*STABLE.nodes[0].arcs[:-1], scaled), _memo={})
    other = dataclasses.replace(STABLE, nodes=(node, *STABLE.nodes[1:]))
    assert Convergence().check(other.problem, other).verdict == "inconclusive"


def test_a_sampled_observer_is_outside_this_claim() -> None:
    observer = dataclasses.replace(STABLE, period=0.1)
    record = Convergence().check(observer.problem, observer)
    assert record.verdict == "inconclusive"
    assert "sampled" in record.text
    assert Convergence.verify(record, observer.problem, observer) == "inconclusive"


def test_the_eigenvalue_claim_speaks_of_equal_agents_only() -> None:
    record = SmallestEigenvalue().check(STABLE.problem, STABLE)
    assert record.verdict == "inconclusive"
    assert SmallestEigenvalue.verify(record, STABLE.problem, STABLE) == "inconclusive"


EYE3, ONE = np.eye(3), np.ones((1, 1))


@pytest.mark.parametrize(
    ("observer", "words"),
    [
        (with_arcs(STABLE, 0, LocalArc(None, "2", 1.0, EYE3, EYE3, EYE3)), "node 0 uses a link with 2"),
        (with_arcs(STABLE, 2, LocalArc(0, None, 1.0, np.ones((3, 1)), np.ones((1, 3)), None)), "node 2 uses arc 0"),
        (with_arcs(hyper_observer(), 0, LocalArc(3, None, 1.0, ONE, ONE, None)), "node a uses arc 3"),
    ],
)
def test_strangers_are_refuted_and_named(observer, words) -> None:
    record = Locality().check(observer.problem, observer)
    assert record.verdict == "refuted"
    assert words in record.text
    assert Locality.verify(record, observer.problem, observer) == "refuted"


def test_a_reading_that_enters_the_estimate_counts_too() -> None:
    nodes = [*STABLE.nodes[:2], dataclasses.replace(STABLE.nodes[2], feedthrough=((0, np.ones((3, 1))),), _memo={})]
    observer = dataclasses.replace(STABLE, nodes=tuple(nodes))
    assert "node 2 uses arc 0" in Locality().check(shared_plant(), observer).text


def test_a_node_that_hears_a_part_of_its_neighbours_is_local_but_its_error_is_driven() -> None:
    observer = hyper_observer()
    first = observer.nodes[0]
    partly = LocalArc(0, "b", 1.0, ONE, ONE, np.array([[1.0, 0.0]]))
    node = LocalObserver("a", first.A, first.B, (partly,))
    changed = dataclasses.replace(observer, nodes=(node, *observer.nodes[1:]))
    assert Locality().check(hyper_network(), changed).verdict == "certified"
    assert "the truth may drive the error" in Convergence().check(hyper_network(), changed).text
