"""Plans: what each process is told, who connects to whom, and that nobody is told more than it needs."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import trigpoint as tp
from tests.runtime.living import CHAIN, GRID, designed, planned
from trigpoint.cli.live_plan import Places, anchor_timeout, ignored_troubles, plan_of, rate_of
from trigpoint.errors import ArgumentError
from trigpoint.io.sections import RunSection
from trigpoint.observers.aged import aged_decay_rate
from trigpoint.runtime import SimulatedPlant, decode_frame, read_settings
from trigpoint.runtime.endpoints import parse_address
from trigpoint.runtime.plan import free_addresses, linked

PLANT = """
[plant]
A = [[-2, 0], [0, -3]]
outputs = [[[1, 0]], [[0, 1]]]
neighbours = [[1], [0]]
"""
WORST = CHAIN.replace("[simulate]", '[design]\ngain = "worst-case"\nmax_nodes = 5\n[simulate]')
SURVEY = '[network]\narcs = [{to = "a", value = 1.0, sigma = 0.2}, {from = "a", to = "b", value = 0.5, sigma = 0.1}]\n'


def test_a_file_names_nobody_but_the_neighbours(tmp_path):
    """No process gets the graph or the truth: distinctive names and numbers do not leak into other files."""
    names = [f"station-{letter}" for letter in "pqrstuv"]
    rows = ", ".join(f'["{a}", "{b}", {k + 0.123456789}]' for k, (a, b) in enumerate(pairwise(names)))
    text = f'[network]\narcs = [["", "{names[0]}", 3.0], {rows}]\n'
    with planned(text, tmp_path) as (_, plan):
        plan.write()
        for index, node in enumerate(plan.nodes):
            content = plan.settings_file(index).read_text(encoding="utf-8")
            near = {names[k] for k in (index - 1, index, index + 1) if 0 <= k < len(names)}
            assert set(re.findall(r"station-[a-z]", content)) == near
            assert plan.settings_file(index).stat().st_mode & 0o077 == 0
            again = read_settings(plan.settings_file(index))
            assert again.to_document() == node.to_document()
            labels = {int(label) for label in node.program.reads}
            assert labels == {k for k in range(len(names)) if k in (index, index + 1)}
            assert json.loads(content)["start"] is None or not node.start.any()


def test_of_two_neighbours_the_later_connects(tmp_path):
    with planned(GRID, tmp_path) as (found, plan):
        graph = found.part.graph
        inner = [(int(a), int(b)) for a, b in zip(graph.tail, graph.head, strict=True) if a != tp.EXTERNAL]
        links = {(min(a, b), max(a, b)) for a, b in inner}
        names = plan.names
        made = {(names.index(other), k) for k, node in enumerate(plan.nodes) for other in node.peers}
        assert made == links
        listens = {node.name: node.listen for node in plan.nodes}
        assert len(set(listens.values())) == 9
        assert all(address == listens[other] for node in plan.nodes for other, address in node.peers.items())
        assert {parse_address(address).local for address in listens.values()} == {True}
        assert set(plan.plant.peers) == {*names, plan.watcher}


def test_who_is_heard_without_hearing_lets_the_other_listen(tmp_path):
    with planned(PLANT.replace("[[1], [0]]", "[[], [0]]").replace("[[1, 0]]", "[[1, 0], [0, 1]]"), tmp_path) as (
        _,
        plan,
    ):
        hears = {node.name: node.program.hears for node in plan.nodes}
        assert hears["0"] == ()
        assert plan.nodes[0].guests.get("1") == ("listener" if "0" in hears["1"] else None)
        assert [name for name, _ in plan.plant.shows] == ["0", "1"]
        assert {part for _, part in plan.plant.shows} == {0}  # everybody estimates the one plant


def test_the_plant_reads_what_the_simulation_reads(tmp_path):
    """The same truth gives the same readings: G' (x) C x."""
    with planned(GRID, tmp_path) as (found, plan):
        plant = SimulatedPlant(plan.plant, epoch=1, origin=0.0)
        x = np.concatenate(plant.state)
        wanted = found.part.problem.stacked_output() @ x
        read = np.concatenate([decode_frame(data).values for key, data in plant.frames() if "/reading/" in key])
        np.testing.assert_allclose(read, wanted, rtol=1e-13, atol=1e-13)
        starts = np.concatenate([node.start for node in plan.nodes])
        np.testing.assert_allclose(starts - x, np.ravel(found.given.simulate.initial_error), atol=1e-13)
        bound = plan.nodes[0].start_uncertainty
        assert all(np.sqrt(np.mean((node.start - part.start) ** 2)) <= bound
                   for node, part in zip(plan.nodes, plan.plant.parts, strict=True))  # fmt: skip


def test_the_settings_follow_the_scenario(tmp_path):
    with planned(GRID + "stale = 0.5\nold = 'use'\nwindow = 2.0\n", tmp_path) as (found, plan):
        node = plan.nodes[4]
        assert (node.period, node.stale, node.old, node.window) == (0.02, 0.5, "use", 2.0)
        assert node.coverage == "nominal"
        assert node.decay_rate == pytest.approx(found.observer.decay_rate)
        assert (node.settle_rate, node.overshoot) == (0.0, 1.0)  # a floor is left over
        assert node.anchor_timeout == anchor_timeout(9, 0.02, 0.5) == 1.0
    with planned(GRID, tmp_path) as (found, plan):
        rate = min(found.observer.decay_rate, 0.9 * aged_decay_rate(found.programs, 0.02, 0.02, 0.02))
        assert plan.nodes[4].settle_rate == pytest.approx(rate)
        assert 1.0 < plan.nodes[4].overshoot < 3.0
        assert (plan.nodes[4].nodes, plan.nodes[4].max_nodes) == (9, 0)
    with planned(WORST, tmp_path) as (_, plan):  # constants: any number may join
        assert (plan.nodes[0].nodes, plan.nodes[0].max_nodes) == (3, 0)
    with planned(GRID.replace('"from-graph"', '"worst-case"\nmax_nodes = 12'), tmp_path) as (_, plan):
        assert (plan.nodes[0].nodes, plan.nodes[0].max_nodes, plan.nodes[0].coverage) == (9, 12, "every")
    assert anchor_timeout(200, 0.1, 0.4) == pytest.approx(20.8)
    for text in (CHAIN, WORST):
        with planned(text, tmp_path) as (_, plan):
            assert plan.nodes[0].coverage == "every"
    with planned(CHAIN.replace("[run]", "noise = {measurement = 0.3}\n[run]"), tmp_path) as (_, plan):
        assert plan.nodes[1].deviations == dict.fromkeys(plan.nodes[1].program.reads, 0.3)
        assert [one.deviation for one in plan.plant.instruments] == [0.3] * 3
    with planned(SURVEY, tmp_path) as (_, plan):
        assert plan.nodes[0].deviations == pytest.approx({0: 0.2, 1: 0.1})


def test_rates(tmp_path):
    with planned(CHAIN, tmp_path) as (found, plan):
        assert plan.nodes[0].period == 1 / 25
        assert rate_of(RunSection(), found) == 20.0
        section = found.given.simulate.model_copy(update={"period": 0.25})
        given = replace(found.given, simulate=section)
        assert rate_of(RunSection(), replace(found, given=given)) == 4.0


SAMPLED = CHAIN.replace("[simulate]", '[design]\nmethod = "sampled"\nperiod = 0.04\n[simulate]')


def test_an_observer_for_one_period_runs_at_no_other(tmp_path):
    with planned(SAMPLED, tmp_path) as (found, plan):
        assert plan.nodes[0].period == pytest.approx(0.04)
        if found.programs.period is not None:
            with pytest.raises(ArgumentError, match=r"designed for a period of 0.04 s; got a rate of 10 Hz"):
                rate_of(RunSection(rate=10.0), found)


DISCRETE = CHAIN.replace(
    "[simulate]",
    '[agent]\nA = [[1.0]]\nC = [[1.0]]\n[design]\nmethod = "discrete-kalman"\nperiod = 0.1\n[simulate]',
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (DISCRETE, "no common clock"),
        (DISCRETE.replace("discrete-kalman", "accelerated").replace("A = [[1.0]]", "A = [[0.0]]"), "no common clock"),
        (PLANT + '[design]\nmethod = "projected-consensus"\nrate = 1.0\nperiod = 0.1\n', "program of its own"),
    ],
)
def test_what_cannot_run_live_says_why(text, words, tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ArgumentError, match=words):
        plan_of(designed(path), RunSection(), Places(tmp_path, tmp_path))


def test_troubles_of_the_simulation_are_named(tmp_path):
    text = CHAIN.replace("[simulate]", "[simulate]\nperiod = 0.1\nloss = 0.1\ngossip = true")
    with planned(text, tmp_path) as (found, _):
        assert ignored_troubles(found) == ["loss", "gossip"]


def test_addresses(tmp_path):
    names = ["a", "b", "c"]
    found = free_addresses("unixsock", names, tmp_path, {"b": "unixsock-stream//run/b.sock"})
    assert found["b"] == "unixsock-stream//run/b.sock"
    assert len(set(found.values())) == 3
    for kind in ("tcp", "udp", "tls", "quic"):
        ports = [parse_address(address).port for address in free_addresses(kind, names, tmp_path).values()]
        assert len(set(ports)) == 3
        assert min(ports) > 0
    with pytest.raises(ArgumentError, match="addresses names nobody; the nodes are a, b, c"):
        free_addresses("tcp", names, tmp_path, {"nobody": "tcp/127.0.0.1:1"})
    with pytest.raises(ArgumentError, match="address of 'a' must begin with 'tcp/'"):
        free_addresses("tcp", names, tmp_path, {"a": "udp/127.0.0.1:1"})


def test_plain_text_stays_on_the_machine_unless_allowed(tmp_path):
    with planned(CHAIN, tmp_path) as (found, _):
        section = RunSection(transport="tcp", addresses={"0": "tcp/192.0.2.1:7447"})
        with pytest.raises(ArgumentError, match="plain text"):
            plan_of(found, section, Places(tmp_path, tmp_path))
        plan = plan_of(found, section, Places(tmp_path, tmp_path, allow_plain=True))
        assert plan.nodes[0].listen == "tcp/192.0.2.1:7447"
        assert plan.nodes[1].peers == {"0": "tcp/192.0.2.1:7447"}


def test_certificates(tmp_path):
    with planned(CHAIN, tmp_path) as (found, _):
        plan = plan_of(found, RunSection(transport="tls"), Places(tmp_path, tmp_path))
        assert {node.identity.certificate for node in plan.nodes} == {
            str(tmp_path / "keys" / f"{k}.pem") for k in range(3)
        }
        assert plan.identity is not None
        assert plan.plant.identity is not None
        again = plan_of(
            found, RunSection(transport="quic", security=str(tmp_path / "keys")), Places(tmp_path, tmp_path)
        )
        assert again.nodes[0].identity == plan.nodes[0].identity
        with pytest.raises(ArgumentError, match="is missing"):
            plan_of(found, RunSection(transport="tls", security=str(tmp_path)), Places(tmp_path, tmp_path))
        with pytest.raises(ArgumentError, match="security belongs to the transports tls and quic; got unixsock"):
            plan_of(found, RunSection(security="keys"), Places(tmp_path, tmp_path))


def test_impossible_plans_are_refused(tmp_path):
    with planned(CHAIN, tmp_path) as (_, plan):
        with pytest.raises(ArgumentError, match="at least one node"):
            replace(plan, nodes=())
        with pytest.raises(ArgumentError, match="agents_per_process must be at least 1; got 0"):
            replace(plan, agents_per_process=0)
        assert [len(group) for group in replace(plan, agents_per_process=2).groups] == [2, 1]
        assert linked(plan.nodes, {node.name: node.listen for node in plan.nodes})[2].peers == plan.nodes[2].peers


def test_names_of_guests_make_way(tmp_path):
    with planned('[network]\narcs = [["", "plant", 1.0], ["plant", "supervisor", 2.0]]\n', tmp_path) as (_, plan):
        assert plan.plant.name == "plant_"
        assert plan.watcher == "supervisor_"
        assert plan.nodes[0].guests == {"plant_": "sensor", "supervisor_": "supervisor", "monitor": "monitor"}


def test_a_node_that_no_frame_can_speak_for_is_refused_before_anything_runs(tmp_path):
    with planned(CHAIN, tmp_path) as (_, plan):
        named = replace(plan.nodes[0].program, name="x" * 1025, _memo={})
        with pytest.raises(ArgumentError, match="rename"):
            replace(plan, nodes=(replace(plan.nodes[0], program=named),))
