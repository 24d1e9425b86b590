"""The conformance kit for observers: passes on good ones, fails with a number on tampered ones."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trigpoint.errors import MethodError
from trigpoint.graphs import EXTERNAL, MeasurementGraph, chain, cycle
from trigpoint.methods import Fixed, FromGraph, LocalKalman, WorstCase, design
from trigpoint.model import LinearAgent, NetworkedAgents
from trigpoint.observers import DiffusiveObserver, LocalArc, LocalObserver
from trigpoint.testing import check_design, check_observer
from trigpoint.testing.strategies import measurement_graphs

AGENTS = [
    LinearAgent.static(2),
    LinearAgent([[0, 1], [0, 0]], [[1, 0]]),
    LinearAgent([[0.2, 1], [-1, 0.2]], [[1, 0]]),
    LinearAgent(-1.0, 1.0),
]
NUMBER = re.compile(r"\d")


def network(agent=AGENTS[1]) -> NetworkedAgents:
    """Parallel arcs, the last node anchored."""
    return NetworkedAgents(MeasurementGraph(4, [0, 1, 1, 2, EXTERNAL], [1, 0, 2, 3, 3]), agent)


@settings(max_examples=10)
@given(
    measurement_graphs(max_nodes=4, max_extra_arcs=3, externally_connected=True, weighted=True, decades=1),
    st.sampled_from(AGENTS),
)
def test_designed_observers_pass(graph, agent) -> None:
    observer = check_design(LocalKalman(FromGraph(1.5)), NetworkedAgents(graph, agent))
    assert isinstance(observer, DiffusiveObserver)
    assert observer.graph is graph


@pytest.mark.parametrize("rule", [FromGraph(), WorstCase(4), Fixed(3.0)])
def test_every_gain_rule_passes(rule) -> None:
    observer = check_design(LocalKalman(rule), network())
    check_observer(network(), observer, seed=4)


def test_weight_blocks_pass() -> None:
    root = np.random.default_rng(0).normal(size=(5, 2, 2))
    graph = network().graph.with_weight(np.eye(2) + root @ root.transpose(0, 2, 1))
    assert check_design(LocalKalman(), NetworkedAgents(graph, LinearAgent.static(2))).decay_rate > 0


def test_a_method_that_refuses_still_refuses() -> None:
    with pytest.raises(MethodError, match="Theorem 3"):
        check_design(LocalKalman(Fixed(1.0)), NetworkedAgents(cycle(3), LinearAgent.static()))


# -- tampered observers ------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Tampered(DiffusiveObserver):
    """An observer whose node 1 runs another program."""

    change: object = None

    def local(self, node: int) -> LocalObserver:
        program = super().local(node)
        return self.change(program) if node == 1 else program


def tampered(change, problem=None) -> tuple[NetworkedAgents, Tampered]:
    problem = network() if problem is None else problem
    good = design(problem, LocalKalman())
    fields = {field.name: getattr(good, field.name) for field in dataclasses.fields(DiffusiveObserver)}
    return problem, Tampered(**fields, change=change)


def with_arc(program: LocalObserver, position: int, **changes) -> LocalObserver:
    arcs = list(program.arcs)
    arcs[position] = dataclasses.replace(arcs[position], **changes)
    return dataclasses.replace(program, arcs=tuple(arcs), _memo={})


def refused(problem, observer, words: str) -> None:
    with pytest.raises(AssertionError, match=words) as caught:
        check_observer(problem, observer)
    assert NUMBER.search(str(caught.value).replace("W17 (5)", "").replace("W17 (8)", ""))


def test_an_untouched_copy_passes() -> None:
    check_observer(*tampered(lambda program: program))


def test_a_wrong_gain_in_one_local_arc_is_found() -> None:
    """All of an arc's terms scale together, so the design equations still hold; the rows differ."""
    refused(*tampered(lambda p: with_arc(p, 1, gain=1.001 * p.arcs[1].gain)), "local rows and error matrix differ by")


def test_a_local_arc_to_a_stranger_is_found() -> None:
    refused(*tampered(lambda p: with_arc(p, 0, neighbour="3")), r"W17 \(5\) violated by")


def test_a_further_local_arc_to_a_stranger_is_found() -> None:
    def listen(program: LocalObserver) -> LocalObserver:
        first = program.arcs[0]
        stranger = LocalArc(4, "3", 1.0, first.gain, first.output, first.output)
        return dataclasses.replace(program, arcs=(*program.arcs, stranger), _memo={})

    refused(*tampered(listen), r"W17 \(5\) violated by")


def test_a_wrong_sign_is_found() -> None:
    refused(*tampered(lambda p: with_arc(p, 0, sign=-p.arcs[0].sign)), r"W17 \(5\) violated by")


def test_a_wrong_model_is_found() -> None:
    refused(*tampered(lambda p: dataclasses.replace(p, A=p.A + 1e-6, _memo={})), r"W17 \(5\) violated by")


def test_wrong_design_equations_are_found() -> None:
    problem = network()
    good = design(problem, LocalKalman())

    @dataclass(frozen=True, eq=False)
    class Biased(DiffusiveObserver):
        def general_form(self):
            form = super().general_form()
            return dataclasses.replace(form, M=form.M * (1.0 + 1e-9))

    fields = {field.name: getattr(good, field.name) for field in dataclasses.fields(DiffusiveObserver)}
    refused(problem, Biased(**fields), r"W17 \(8\) violated by 1e-09")


@dataclass(frozen=True, eq=False)
class Nosy(LocalObserver):
    """A program that looks into every message it can see."""

    def step(self, state, inbox, readings, duration, u=None):
        result = super().step(state, inbox, readings, duration, u)
        extra = sum(message.estimate.sum() for message in inbox.values())
        return dataclasses.replace(result, estimate=result.estimate + 0.0 * extra)


@dataclass(frozen=True, eq=False)
class Forgetful(LocalObserver):
    """A program that keeps a counter on itself."""

    def step(self, state, inbox, readings, duration, u=None):
        self._memo["count"] = self._memo.get("count", 0) + 1
        result = super().step(state, inbox, readings, duration, u)
        return dataclasses.replace(result, estimate=result.estimate + self._memo["count"])


@dataclass(frozen=True, eq=False)
class Fragile(LocalObserver):
    """A program that cannot do without messages."""

    def step(self, state, inbox, readings, duration, u=None):
        result = super().step(state, inbox, readings, duration, u)
        return result if inbox else dataclasses.replace(result, estimate=result.estimate * np.nan)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Nosy, "node 1 uses something outside its neighbourhood"),
        (Forgetful, "node 1 depends on more than its neighbours"),
        (Fragile, "node 1 cannot do without messages"),
    ],
)
def test_programs_that_break_the_rules_are_found(kind, words) -> None:
    refused(*tampered(lambda p: kind(p.name, p.A, p.B, p.arcs)), words)


def test_a_node_file_of_another_program_is_found() -> None:
    class Lying(LocalObserver):
        def to_document(self):
            return with_arc(
                LocalObserver(self.name, self.A, self.B, self.arcs), 0, sign=-self.arcs[0].sign
            ).to_document()

    refused(*tampered(lambda p: Lying(p.name, p.A, p.B, p.arcs)), "node 1: its file describes another program")


def test_stacked_maps_that_differ_are_found() -> None:
    problem = network()
    good = design(problem, LocalKalman())

    @dataclass(frozen=True, eq=False)
    class Hasty(DiffusiveObserver):
        def sampled_maps(self, duration):
            transition, correction = super().sampled_maps(duration)
            return transition, correction * (1.0 + 1e-5)

    fields = {field.name: getattr(good, field.name) for field in dataclasses.fields(DiffusiveObserver)}
    refused(problem, Hasty(**fields), r"stacked and reference paths differ by .*\(period 0\.\d+\)")


def test_a_promise_that_is_too_good_is_found() -> None:
    class Boastful(LocalKalman):
        def build(self, problem):
            return dataclasses.replace(super().build(problem), decay_rate=1e3)

    with pytest.raises(AssertionError, match="guaranteed rate 1000, but the spectrum reaches -"):
        check_design(Boastful(), NetworkedAgents(chain(3), AGENTS[1]))
