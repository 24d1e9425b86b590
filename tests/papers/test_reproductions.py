"""Reproductions compute their numbers: they agree, and they would notice if they did not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import trigpoint as tp
from trigpoint.errors import ArgumentError
from trigpoint.papers import EXPERIMENTS, Reproduction, g16_example1, g16_riccati, g16_worst_case, reproduce
from trigpoint.papers.base import cell


def ours(result: Reproduction) -> list[float]:
    return [entry.ours for entry in result.cells]


def verdicts(result: Reproduction) -> list[str]:
    return [entry.verdict for entry in result.cells]


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_agrees_with_its_paper(name: str) -> None:
    result = reproduce(name)
    assert result.name == name
    assert result.agrees
    assert result.cells
    assert "agrees" in verdicts(result)
    for entry in result.cells:
        assert entry.error == entry.ours - entry.paper
        assert np.isfinite([entry.paper, entry.ours]).all()
    assert len({entry.at for entry in result.cells}) == len(result.cells)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_says_where_it_stands_and_what_to_look_at(name: str) -> None:
    result = reproduce(name)
    assert result.source.startswith(("G16", "R23", "W17"))
    assert result.text.endswith(".")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiment_gives_the_same_numbers_twice(name: str) -> None:
    assert reproduce(name) == reproduce(name)


@pytest.mark.parametrize("name", ["", "g16", "G16-example1", "g16-example1 "])
def test_an_unknown_experiment_is_an_error_that_lists_the_known_ones(name: str) -> None:
    with pytest.raises(ArgumentError, match="g16-example1, g16-riccati, g16-worst-case") as caught:
        reproduce(name)
    assert repr(name) in str(caught.value)


def test_another_graph_gives_other_eigenvalues_that_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    before = reproduce("g16-example1")
    monkeypatch.setattr(g16_example1, "graph", lambda: tp.graphs.chain(4))
    after = reproduce("g16-example1")
    assert not after.agrees
    assert after.cells[0].verdict == "differs"
    assert after.cells[0].ours == pytest.approx(2.0 - 2.0 * np.cos(np.pi / 9))
    assert ours(before)[:4] != ours(after)[:4]
    assert [entry.paper for entry in before.cells] == [entry.paper for entry in after.cells]


def test_one_arc_less_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = g16_example1.graph()
    less = tp.MeasurementGraph(4, whole.tail[:-1], whole.head[:-1])
    monkeypatch.setattr(g16_example1, "graph", lambda: less)
    assert not reproduce("g16-example1").agrees


def test_another_gain_function_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = tp.worst_case_gain
    before = reproduce("g16-worst-case")
    monkeypatch.setattr(g16_worst_case.tp, "worst_case_gain", lambda n: 1.001 * real(n))
    after = reproduce("g16-worst-case")
    assert set(verdicts(before)) == {"agrees"}
    assert set(verdicts(after)) == {"differs"}
    assert after.cells[0].ours == pytest.approx(1.001 * before.cells[0].ours)


def test_another_eigenvalue_solver_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = tp.smallest_eigenvalue

    def loose(graph: tp.MeasurementGraph) -> tp.EigenvalueBound:
        bound = real(graph)
        return dataclasses.replace(bound, value=bound.value * (1.0 + 1e-8))

    monkeypatch.setattr(g16_worst_case.tp, "smallest_eigenvalue", loose)
    assert verdicts(reproduce("g16-worst-case")) == ["agrees", *["differs"] * 5]


def test_the_worst_case_is_computed_for_every_size() -> None:
    cells = reproduce("g16-worst-case").cells
    for entry, n in zip(cells[1:], (2, 4, 8, 16, 64), strict=True):
        assert entry.at.endswith(f"chain of {n}")
        assert entry.ours == pytest.approx(1.0 / (2.0 - 2.0 * np.cos(np.pi / (2 * n + 1))), rel=1e-9)


def test_the_misprint_of_the_noise_is_an_erratum_and_no_difference() -> None:
    result = reproduce("g16-riccati")
    assert verdicts(result) == ["agrees", "agrees", "erratum"]
    assert ours(result) == pytest.approx([np.sqrt(2.0), 1.0, np.sqrt(3.0)], abs=1e-9)
    assert result.agrees


def test_another_local_filter_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = g16_riccati.local_filter
    monkeypatch.setattr(g16_riccati, "local_filter", lambda process: 1.1 * real(process))
    assert verdicts(reproduce("g16-riccati")) == ["differs", "differs", "erratum"]
    monkeypatch.setattr(g16_riccati, "local_filter", lambda _: real(np.diag([0.0, 0.0, 1.0, 1.0])))
    assert verdicts(reproduce("g16-riccati"))[2] == "agrees"


@pytest.mark.parametrize(
    ("value", "erratum", "verdict"),
    [
        (1.4, False, "agrees"),
        (1.45, False, "agrees"),
        (1.35, False, "agrees"),
        (1.4501, False, "differs"),
        (1.3499, False, "differs"),
        (1.4501, True, "erratum"),
        (1.4, True, "agrees"),
        (float("nan"), False, "differs"),
        (float("inf"), False, "differs"),
    ],
)
def test_agreement_is_half_a_unit_of_the_last_printed_digit(value: float, erratum: bool, verdict: str) -> None:
    assert cell("somewhere", 1.4, value, 0.05, erratum=erratum).verdict == verdict
