"""A newcomer's settings, and those of its neighbours: what they are, what is refused, that nobody else is touched."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import trigpoint as tp
from tests.cli.shelled import refused, trigpoint
from tests.runtime.given import DOUBLE, OSCILLATOR, PERIOD, STATIC, case
from trigpoint.errors import ArgumentError
from trigpoint.runtime import (
    SENSOR,
    LinearPlant,
    MemoryNetwork,
    Newcomer,
    NodeSettings,
    join,
    leave,
    make_keys,
    read_settings,
    run_virtual,
    write_settings,
)

WORST = tp.methods.WorstCase(6)
CHAIN_5 = tp.graphs.chain(5, anchors=[0])
NEW = Newcomer("new", "tcp/127.0.0.1:7099", (30, 31))


def beside(agent=OSCILLATOR, **options) -> list[NodeSettings]:
    """The settings of all nodes of a network that one more may join."""
    given = {"coverage": "every", "max_nodes": 6, "nodes": 5, **options}
    every = case(agent, CHAIN_5, WORST).settings(**given)
    return [replace(one, listen=f"tcp/127.0.0.1:{7000 + k}") for k, one in enumerate(every)]


def two(**options) -> list[NodeSettings]:
    every = beside(**options)
    return [every[1], every[4]]


@pytest.mark.parametrize("agent", [OSCILLATOR, DOUBLE, STATIC])
def test_it_is_what_a_design_of_the_larger_network_gives(agent) -> None:
    """The same gain and arcs, on both ends, as if the network had been designed with the newcomer in it."""
    own, grown = join(replace(NEW, anchor_label=32), two(agent=agent))
    graph = CHAIN_5
    larger = tp.MeasurementGraph(
        6, [*graph.tail, 1, 4, tp.graphs.EXTERNAL], [*graph.head, 5, 5, 5], names=[*graph.names, "new"]
    )
    programs = case(agent, larger, WORST).programs
    label_of = {5: 30, 6: 31, 7: 32}
    for found, k in ((own, 5), (grown[0], 1), (grown[1], 4)):
        for mine, yours in zip(found.program.arcs, programs[k].arcs, strict=True):
            assert (mine.label, mine.neighbour, mine.sign) == (
                label_of.get(yours.label, yours.label), yours.neighbour, yours.sign,
            )  # fmt: skip
            np.testing.assert_allclose(mine.gain, yours.gain, rtol=1e-12)
            np.testing.assert_array_equal(mine.output, yours.output)
            assert (mine.neighbour_output is None) == (yours.neighbour_output is None)
    assert NodeSettings.from_document(json.loads(json.dumps(own.to_document()))).nodes == 6
    assert dict(own.peers) == {"1": "tcp/127.0.0.1:7001", "4": "tcp/127.0.0.1:7004"}
    assert [dict(one.peers) for one in grown] == [{}, {}]


@pytest.mark.parametrize("agent", [OSCILLATOR, DOUBLE])
def test_it_finds_its_state(agent) -> None:
    """On the virtual clock: five nodes near the truth and a sixth beside two of them, that begins at zero."""
    five = case(agent, CHAIN_5, WORST)
    five.error[:] *= 1e-9
    settings = five.settings(coverage="every", max_nodes=6, nodes=5)
    settings = [replace(one, listen=f"tcp/127.0.0.1:{7000 + k}") for k, one in enumerate(settings)]
    own, grown = join(NEW, [settings[1], settings[4]])
    everybody = [settings[0], grown[0], *settings[2:4], grown[1], own]
    plant = LinearPlant.of([one.program for one in everybody], [*five.truth, np.array([0.5, 0.2])])
    between = [(name, one.name) for one in everybody for name in one.program.hears]
    network = MemoryNetwork([*between, *((SENSOR, one.name) for one in everybody)], calm=[SENSOR])
    run = run_virtual(everybody, plant, PERIOD * np.arange(1, 1002, 50), network)
    norms = np.linalg.norm(run.error, axis=2)
    assert norms[0].max() > 0.1
    assert norms[-1].max() < 1e-4


@pytest.mark.parametrize(
    ("changes", "neighbours", "words"),
    [
        ({"labels": ()}, [], "at least one neighbour"),
        ({"labels": (30,)}, two(), "got 2 of them and 1 labels"),
        ({}, [two()[0]] * 2, "each neighbour once"),
        ({"name": "2"}, two(), "the name '2' is taken"),
        ({"name": ""}, two(), "the name '' is taken"),
        ({"name": SENSOR}, two(), "is a sensor's"),
        ({"sensor": "boss"}, two(), "the name 'boss' is taken"),
        ({"sensor": "new"}, two(), "is a sensor's"),
        ({"labels": (30, 3)}, two(), "that no other has; got 3"),
        ({"anchor_label": 30}, two(), "that no other has; got 30"),
        ({"labels": (-1, 9)}, two(), "at least 0"),
        ({}, [two()[0], two(stale=0.5)[1]], "the same stale; '1' has 0.25 and '4' 0.5"),
        ({}, [two()[0], two(agent=DOUBLE)[1]], "whose agents must be equal"),
        ({}, two(models={"0": np.eye(2)}), "whose agents must be equal"),
        ({}, two(coverage="nominal"), "for their present network only"),
        ({}, two(nodes=6), "serves at most max_nodes = 6 nodes, and this would be number 7"),
        ({}, two(nodes=0), "do not say how many there are"),
        ({"nodes": 5}, two(), "more than the 5 that the neighbours know of; got 5"),
        ({"nodes": 7}, two(), "this would be number 7"),
        ({"listen": "tls/127.0.0.1:1"}, two(), "another kind of link"),
        ({"listen": "tcp/127.0.0.1:7001"}, two(), "is the address of '1'"),
        ({}, [replace(one, listen="") for one in two()], "listens nowhere"),
    ],
)
def test_what_does_not_fit_is_refused(changes, neighbours, words) -> None:
    with pytest.raises(ArgumentError) as caught:
        join(replace(NEW, **changes), neighbours)
    assert words in str(caught.value)


def test_who_left_for_good_leaves_no_trace() -> None:
    """Joining and leaving again: the neighbours have what they had."""
    before = [replace(one, nodes=5) for one in two()]
    _, grown = join(NEW, before)
    after = leave("new", grown)
    assert [one.to_document() for one in after] == [one.to_document() for one in before]
    (alone,) = leave("0", [replace(two()[0], peers={"0": "tcp/127.0.0.1:7000"}, drives={"0": np.zeros(2)})])
    assert (alone.program.hears, dict(alone.peers), dict(alone.drives)) == (("2",), {}, {})
    assert len(alone.program.reads) == 1


@pytest.mark.parametrize(
    ("name", "neighbours", "words"),
    [
        ("0", [], "got no neighbour"),
        ("3", [two()[0]], "'1' does not hear '3'; it hears 0, 2"),
        ("0", [two(coverage="nominal")[0]], "for its present network only"),
        ("3", [two()[1]], "'4' would hear nobody and read nothing"),
    ],
)
def test_who_cannot_be_left_out(name, neighbours, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        leave(name, neighbours)


def test_a_measurement_of_many_cannot_be_left_out() -> None:
    one = two()[0]
    arc = replace(one.program.arcs[0], more=(("2", np.ones((1, 2))),))
    with pytest.raises(ArgumentError, match="joins '0' and others"):
        leave("0", [replace(one, program=replace(one.program, arcs=(arc,), _memo={}))])


def test_programs_that_say_nothing_of_a_new_arc_are_refused() -> None:
    first, second = two()
    heavier = replace(second.program.arcs[0], gain=2.0 * second.program.arcs[0].gain)
    for program, words in (
        (replace(second.program, arcs=(heavier,), _memo={}), "one gain and one output"),
        (replace(second.program, readout=np.eye(2), _memo={}), "a readout"),
    ):
        with pytest.raises(ArgumentError, match=words):
            join(NEW, [first, replace(second, program=program)])
    bare = [replace(one, program=replace(one.program, arcs=(), _memo={})) for one in (first, second)]
    with pytest.raises(ArgumentError, match="no arcs"):
        join(NEW, bare)


def test_known_inputs_and_the_numbers_that_follow() -> None:
    told = [replace(one, input=np.array([2.0])) for one in two()]
    first = replace(told[0], deviations={1: 0.2, 2: 0.1}, settle_rate=0.2, overshoot=1.5, decay_rate=0.3)
    own, grown = join(replace(NEW, sensor="level", nodes=6), [first, told[1]])
    np.testing.assert_array_equal(own.drives["4"], told[1].program.B @ [2.0])
    assert own.input is None
    assert own.deviations == {30: 0.2, 31: 0.2}
    assert grown[0].deviations == {1: 0.2, 2: 0.1, 30: 0.2}
    assert (own.settle_rate, own.overshoot, own.decay_rate) == (0.0, 1.5, 0.0)
    assert own.guests == {SENSOR: "sensor", "boss": "supervisor", "level": "sensor"}
    assert all(one.guests["level"] == "sensor" for one in grown)
    assert own.anchor_timeout == first.anchor_timeout + first.period
    exact, _ = join(replace(NEW, deviation=0.7), told)
    assert exact.deviations == {30: 0.7, 31: 0.7}


@pytest.fixture
def files(tmp_path):
    for k, one in enumerate(beside()):
        write_settings(one, tmp_path / f"node-{k}.json")
    return tmp_path


def asked(files, *more):
    return ("node", "--new", "new", "--beside", files / "node-1.json", "--beside", files / "node-4.json", "--label", 30,
            "--label", 31, "--listen", "tcp/127.0.0.1:7099", *more)  # fmt: skip


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_the_files_of_the_neighbours_and_nobody_else_change(files) -> None:
    before = contents(files)
    result = trigpoint(*asked(files, "--json"))
    assert json.loads(result.stdout) == {
        "newcomer": str(files / "new.json"),
        "neighbours": {"1": str(files / "node-1.json"), "4": str(files / "node-4.json")},
    }
    after = contents(files)
    assert {name for name in after if before.get(name) != after[name]} == {"new.json", "node-1.json", "node-4.json"}
    assert read_settings(files / "node-4.json").program.hears == ("3", "new")
    assert (files / "new.json").stat().st_mode & 0o777 == 0o600
    refused(trigpoint(*asked(files)), "is taken")


def test_and_back_again(files) -> None:
    before = contents(files)
    assert trigpoint(*asked(files)).exit_code == 0
    call = ("node", "--gone", "new", "--beside", files / "node-1.json", "--beside", files / "node-4.json")
    result = trigpoint(*call, "--out", files / "fresh", "--json")
    places = {"1": files / "fresh" / "node-1.json", "4": files / "fresh" / "node-4.json"}
    assert json.loads(result.stdout) == {"neighbours": {name: str(place) for name, place in places.items()}}
    result = trigpoint(*call)
    assert f"4: {files / 'node-4.json'}   (send its process SIGHUP)" in result.stdout
    assert {name: text for name, text in contents(files).items() if name != "new.json"} == before
    refused(trigpoint(*call), "does not hear 'new'")
    refused(trigpoint(*call, "--label", "3"), "--gone takes")
    refused(trigpoint(*call, "--new", "n"), "give one of them")
    twice = ("--beside", files / "fresh" / "node-4.json", "--out", files / "more")
    assert trigpoint(*asked(files)).exit_code == 2  # its own file is still there
    (files / "new.json").unlink()
    assert trigpoint(*asked(files)).exit_code == 0
    assert trigpoint(*asked(files / "fresh", "--out", files / "fresh")).exit_code == 0
    refused(trigpoint(*call, *twice), "would have one name")


def test_or_the_files_go_to_a_folder(files) -> None:
    before = contents(files)
    result = trigpoint(*asked(files, "--out", files / "fresh"))
    assert f"new: trigpoint node {files / 'fresh' / 'new.json'}" in result.stdout
    assert set(contents(files / "fresh")) == {"new.json", "node-1.json", "node-4.json"}
    assert contents(files) == before
    refused(trigpoint(*asked(files, "--out", files / "fresh")), "exists", "--out")


def test_a_file_that_cannot_be_written_leaves_all_as_they_were(files) -> None:
    before = contents(files)
    (files / "new.json.part").mkdir()
    assert trigpoint(*asked(files)).exit_code == 2
    assert contents(files) == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("node",), "name the settings of a node"),
        (("node", "a.json", "--label", "3"), "--label belongs to --new NAME"),
        (("node", "a.json", "--json"), "--json belongs to --new NAME or --gone NAME"),
        (("node", "--new", "n"), "needs --listen"),
        (("node", "a.json", "--new", "n", "--listen", "tcp/127.0.0.1:1"), "takes no files"),
    ],
)
def test_options_that_do_not_belong_together(arguments, words) -> None:
    refused(trigpoint(*arguments), words)


def test_plain_text_beyond_this_machine_and_keys_for_plain_links_are_refused(files) -> None:
    before = contents(files)
    far = [str(one).replace("127.0.0.1", "192.0.2.7") for one in asked(files)]
    refused(trigpoint(*far), "plain text")
    refused(trigpoint(*asked(files, "--keys", files)), "--keys")
    assert contents(files) == before
    assert trigpoint(*far, "--allow-plain").exit_code == 0


def test_its_certificate_is_found_beside_its_neighbours(tmp_path) -> None:
    keys = tmp_path / "keys"
    identities = make_keys(keys, CHAIN_5.names)
    for k, one in enumerate(beside()):
        secured = replace(one, listen=f"tls/127.0.0.1:{7000 + k}", identity=identities[one.name])
        write_settings(secured, tmp_path / f"node-{k}.json")
    call = [str(one).replace("tcp/", "tls/") for one in asked(tmp_path)]
    refused(trigpoint(*call), "trigpoint keys")
    refused(trigpoint(*call, "--keys", tmp_path), "trigpoint keys")
    assert trigpoint("keys", "--name", "new", "--out", keys).exit_code == 0
    assert trigpoint(*call).exit_code == 0
    assert read_settings(tmp_path / "new.json").identity.certificate == str(keys / "new.pem")
