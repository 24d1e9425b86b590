"""The literal construction of W17: it works for the smallest problems, and it says where it ends."""

from __future__ import annotations

import dataclasses
import itertools
import sys

import networkx as nx
import numpy as np
import pytest

import trigpoint as tp
from tests.methods.observed_plants import bed
from trigpoint.analysis.proposition1 import check_prop1, krylov_factor
from trigpoint.errors import ArgumentError, MethodError, MissingExtraError
from trigpoint.methods import BraschPearson
from trigpoint.model import SharedPlant
from trigpoint.observers.local import LocalArc
from trigpoint.simulation import Scenario, simulate
from trigpoint.testing import check_observer

PLANT = bed(3, 2, "ring", 1)
TARGETS = np.linspace(-3.0, -1.0, 8).tolist()


@pytest.mark.parametrize("q", [None, 1])
def test_the_smallest_problem_gets_its_spectrum(q) -> None:
    observer = tp.design(PLANT, BraschPearson(TARGETS, p=0, q=q, digits=60))
    assert observer.states.total == 8
    assert observer.facts["spectrum_error"] < 0.05
    assert observer.spectral_abscissa < -0.9
    check_observer(PLANT, observer)
    run = simulate(PLANT, observer, Scenario([0.0, 20.0], 1.0, 0.1))
    assert run.error_norm[-1] < 1e-3 * run.error_norm[0]


def test_with_the_papers_output_instead_of_the_innovation_the_truth_drives_the_error() -> None:  # E-002-1
    observer = tp.design(PLANT, BraschPearson(TARGETS, p=0, digits=60))
    assert observer.verify_design_equations().dynamics < 1e-12
    node = observer.nodes[0]
    last = node.arcs[-1]
    assert last.label == 0
    literal = LocalArc(0, None, last.sign, last.gain, np.zeros_like(last.output), None)
    nodes = (dataclasses.replace(node, arcs=(*node.arcs[:-1], literal), _memo={}), *observer.nodes[1:])
    wrong = dataclasses.replace(observer, nodes=nodes)
    assert wrong.verify_design_equations().dynamics > 1e-3


@pytest.mark.parametrize(("m", "n"), [(3, 2), (4, 3), (5, 4)])
@pytest.mark.parametrize("blind", [False, True])
def test_proposition_1(m, n, blind) -> None:  # 002-06, E-002-8
    plant = bed(m, n, "ring", 3)
    outputs = list(plant.outputs)
    if blind:  # an agent whose block another one sees, too
        twins = [k for k in range(m) if any(np.allclose(outputs[k] != 0, outputs[j] != 0) for j in range(m) if j != k)]
        outputs[twins[-1] if twins else m - 1] = np.zeros((1, n))
        outputs[0] = outputs[0] + plant.outputs[m - 1]
    found = check_prop1(SharedPlant(plant.A, outputs, dict(enumerate(plant.hears))))
    assert found.controllability_index == m
    assert found.rank_margin > 1e-13
    assert found.unobservable_channels == ()


@pytest.mark.parametrize(("m", "n"), [(2, 3), (4, 2), (5, 3)])
def test_lemma_3(m, n) -> None:  # 002-13
    rng = np.random.default_rng(m)
    A, F, g = rng.normal(size=(n, n)), rng.normal(size=(m, m)), rng.normal(size=(m, 1))
    H, G, eye = np.kron(np.eye(m), A) + np.kron(F, np.eye(n)), np.kron(g, np.eye(n)), np.eye(n)
    left = np.hstack([np.linalg.matrix_power(H, k) @ G for k in range(m)])
    right = np.hstack([np.kron(np.linalg.matrix_power(F, k) @ g, eye) for k in range(m)]) @ krylov_factor(A, m)
    assert np.abs(left - right).max() < 1e-13 * np.abs(left).max()


@pytest.mark.parametrize("seed", range(6))
def test_lemma_2(seed) -> None:  # 002-12: rank C + rank B >= m for every split of the channels
    rng = np.random.default_rng(seed)
    m = 3 + seed % 2
    while True:
        graph = nx.gnp_random_graph(m, 0.6, seed=int(rng.integers(1 << 30)), directed=True)
        if nx.is_strongly_connected(graph) and graph.number_of_edges() <= 8:
            break
    arcs = [(j, i) for j, i in graph.edges]  # i hears j
    eye = np.eye(m)
    for chosen in itertools.product([False, True], repeat=len(arcs)):
        inputs = {i for (_, i), used in zip(arcs, chosen, strict=True) if used}
        if not inputs:
            continue  # the statement is about proper subsets
        rows = [np.zeros(m), *(eye[j] - eye[i] for (j, i), used in zip(arcs, chosen, strict=True) if not used)]
        assert np.linalg.matrix_rank(np.array(rows)) + len(inputs) >= m


def test_an_unseen_plant_is_found_out() -> None:
    plant = SharedPlant(np.diag([0.1, 0.2]), [[[1.0, 0.0]], None], {0: [1], 1: [0]})
    found = check_prop1(plant)
    assert found.observable is False
    assert (0, 0) in found.unobservable_channels


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BraschPearson([1j]), "closed under conjugation"),
        (lambda: BraschPearson([-1.0], digits=3), "digits must be at least 15"),
        (lambda: BraschPearson([-1.0]).build(PLANT), "m n \\+ m - 1 = 8 numbers"),
        (lambda: BraschPearson(TARGETS, p=7).build(PLANT), "p and q must be an agent"),
    ],
)
def test_nonsense_is_refused(make, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


def test_what_it_cannot_do_is_refused_with_the_way_out() -> None:
    large = bed(4, 3, "ring", 1)
    with pytest.raises(MethodError, match=r"at most 6 states.*Use SpectrumAssignment"):
        tp.design(large, BraschPearson(np.linspace(-3, -1, 15).tolist()))
    chain = SharedPlant(PLANT.A, PLANT.outputs, {1: [0], 2: [1]})
    with pytest.raises(MethodError, match="strongly connected"):
        tp.design(chain, BraschPearson(TARGETS))
    unseen = SharedPlant(PLANT.A, [PLANT.outputs[0], None, None], dict(enumerate(PLANT.hears)))
    with pytest.raises(MethodError, match="all agents together see"):
        tp.design(unseen, BraschPearson(TARGETS))
    with pytest.raises(MethodError, match="a SharedPlant problem"):
        tp.design(tp.graphs.chain(3), BraschPearson(TARGETS))


def test_more_digits_need_the_extra(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(MissingExtraError, match=r"trigpoint\[precision\]"):
        tp.design(PLANT, BraschPearson(TARGETS, digits=50))
