"""Reproductions compute their numbers: they agree, and they would notice if they did not."""

from __future__ import annotations

import dataclasses
import inspect

import numpy as np
import pytest

import trigpoint as tp
from tests.papers.runs import FAST, NAMES, PERTURBED, perturbed, result_of
from trigpoint.errors import ArgumentError
from trigpoint.papers import EXPERIMENTS, Reproduction, g16_example1, g16_riccati, g16_worst_case, reproduce
from trigpoint.papers.base import cell, expected, holds, unspecified


def ours(result: Reproduction) -> list[float]:
    return [entry.ours for entry in result.cells]


def verdicts(result: Reproduction) -> list[str]:
    return [entry.verdict for entry in result.cells]


@pytest.mark.parametrize("name", NAMES)
def test_every_experiment_agrees_with_its_paper(name: str) -> None:
    result = result_of(name)
    assert result.name == name
    assert result.agrees, [entry for entry in result.cells if entry.verdict == "differs"]
    assert result.count("agrees")
    for entry in result.cells:
        assert np.isfinite(entry.ours), entry
        assert entry.error == (None if entry.paper is None else entry.ours - entry.paper)
        assert entry.paper is not None or entry.note, f"{entry.at}: against what?"
        assert entry.verdict != "erratum" or entry.note, f"{entry.at}: which erratum?"
    assert len({entry.at for entry in result.cells}) == len(result.cells)


@pytest.mark.parametrize("name", NAMES)
def test_every_experiment_says_where_it_stands_and_what_to_look_at(name: str) -> None:
    result = result_of(name)
    assert result.source.startswith(("G16", "R23", "W17"))
    assert result.name.upper().startswith(result.source[:3])
    assert result.text.endswith(".")
    for series in result.series:
        assert series.lines
        assert all(values.shape == series.x.shape for values in series.lines.values())
    for field in result.fields:
        assert field.values.shape == result.fields[0].values.shape
        assert field.low < field.high


def test_a_perturbation_is_named_for_every_experiment() -> None:
    assert set(PERTURBED) == set(EXPERIMENTS)


@pytest.mark.parametrize("name", NAMES)
def test_another_input_moves_a_number_and_turns_a_verdict(name: str) -> None:
    before, after = result_of(name), perturbed(name)
    found = {entry.at: entry for entry in after.cells}
    shared = [(entry, found[entry.at]) for entry in before.cells if entry.at in found]
    moved = [one.at for one, other in shared if abs(one.ours - other.ours) > 1e-6 * max(1.0, abs(one.ours))]
    turned = [other.at for one, other in shared if one.verdict == "agrees" and other.verdict == "differs"]
    assert set(moved) & set(turned)
    assert not after.agrees


@pytest.mark.parametrize("name", [name for name in NAMES if "seed" in inspect.signature(EXPERIMENTS[name]).parameters])
def test_no_verdict_hangs_on_the_seed(name: str) -> None:
    other = reproduce(name, **{**FAST.get(name, {}), "seed": 11})
    assert other.agrees, [entry for entry in other.cells if entry.verdict == "differs"]


@pytest.mark.parametrize("name", ["g16-altitude", "g16-moving", "g16-table1", "g16-theorem6", "r23-tracking"])
def test_an_experiment_gives_the_same_numbers_twice(name: str) -> None:
    assert reproduce(name, **FAST.get(name, {})) == result_of(name)


@pytest.mark.parametrize("name", ["", "g16", "G16-example1", "g16-example1 "])
def test_an_unknown_experiment_is_an_error_that_lists_the_known_ones(name: str) -> None:
    with pytest.raises(ArgumentError, match="g16-altitude, g16-example1, ") as caught:
        reproduce(name)
    assert repr(name) in str(caught.value)


def test_an_unknown_option_is_an_error_that_lists_the_known_ones() -> None:
    with pytest.raises(ArgumentError, match="r23-image has no option 'gamma'; it has gain, seed, rows, columns, image"):
        reproduce("r23-image", gamma=3.0)


def test_another_graph_gives_other_eigenvalues_that_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    before = reproduce("g16-example1")
    monkeypatch.setattr(g16_example1, "graph", lambda _: tp.graphs.chain(4))
    after = reproduce("g16-example1")
    assert not after.agrees
    assert after.cells[0].verdict == "differs"
    assert after.cells[0].ours == pytest.approx(2.0 - 2.0 * np.cos(np.pi / 9))
    assert ours(before)[:4] != ours(after)[:4]
    assert [entry.paper for entry in before.cells] == [entry.paper for entry in after.cells]


def test_one_arc_less_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = g16_example1.graph()
    less = tp.MeasurementGraph(4, whole.tail[:-1], whole.head[:-1])
    monkeypatch.setattr(g16_example1, "graph", lambda _: less)
    assert not reproduce("g16-example1").agrees


def test_another_gain_function_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = tp.worst_case_gain
    before = reproduce("g16-worst-case")
    monkeypatch.setattr(g16_worst_case.tp, "worst_case_gain", lambda n: 1.001 * real(n))
    after = reproduce("g16-worst-case")
    assert set(verdicts(before)[:6]) == {"agrees"}
    assert set(verdicts(after)[:6]) == {"differs"}
    assert after.cells[0].ours == pytest.approx(1.001 * before.cells[0].ours)


def test_another_eigenvalue_solver_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = tp.smallest_eigenvalue

    def loose(graph: tp.MeasurementGraph) -> tp.EigenvalueBound:
        bound = real(graph)
        return dataclasses.replace(bound, value=bound.value * (1.0 + 1e-8))

    monkeypatch.setattr(g16_worst_case.tp, "smallest_eigenvalue", loose)
    assert verdicts(reproduce("g16-worst-case"))[:6] == ["agrees", *["differs"] * 5]


def test_the_worst_case_is_computed_for_every_size() -> None:
    cells = reproduce("g16-worst-case").cells
    for entry, n in zip(cells[1:6], (2, 4, 8, 16, 64), strict=True):
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


def test_a_statement_is_one_or_zero_and_knows_that_it_is_one() -> None:
    yes, no, wrong = holds("a", True), holds("b", False), holds("c", False, "E-000-1", erratum=True)
    assert [(one.paper, one.ours, one.verdict) for one in (yes, no, wrong)] == [
        (1.0, 1.0, "agrees"),
        (1.0, 0.0, "differs"),
        (1.0, 0.0, "erratum"),
    ]
    assert yes.is_statement
    assert not cell("d", 1.0, 1.0, 0.0).is_statement


def test_what_the_paper_does_not_print_has_no_error() -> None:
    near, far, own = (
        expected("a", 2.0, 2.05, 0.1, "closed form"),
        expected("b", 2.0, 2.2, 0.1, "x"),
        unspecified("c", 3, "y"),
    )
    assert [one.verdict for one in (near, far, own)] == ["agrees", "differs", "not specified"]
    assert near.note == "closed form: 2"
    assert all(one.paper is None and one.error is None for one in (near, far, own))


def test_a_nan_never_agrees() -> None:
    assert expected("a", 2.0, float("nan"), 0.1, "x").verdict == "differs"
    assert cell("a", 2.0, float("nan"), 0.1).verdict == "differs"
