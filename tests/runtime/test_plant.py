"""The simulated plant: its truth, its readings, its file."""

from __future__ import annotations

import dataclasses
import json
import threading

import numpy as np
import pytest

import trigpoint as tp
from tests.machine import PATIENCE, until
from tests.runtime.living import CHAIN, GRID, planned
from trigpoint.arrays import expm
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.runtime import (
    SENSOR,
    Instrument,
    Kind,
    LinearPlant,
    MemoryNetwork,
    Part,
    PlantSettings,
    SimulatedPlant,
    SystemClock,
    decode_frame,
    run_virtual,
)
from trigpoint.runtime.endings import Order
from trigpoint.runtime.plant import PlantLoop, read_plant, write_plant

TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
ROW = np.array([[1.0, 0.0]])


def plant(**changes):
    parts = (Part(TURN, np.array([1.0, 2.0])), Part(np.zeros((1, 1)), np.array([5.0])))
    reads = (
        Instrument(0, ((0, ROW),)),
        Instrument(3, ((0, -ROW), (1, np.array([[1.0]])))),
        Instrument(4, (), recorded=np.array([7.0])),
    )
    given = {"network": "n", "name": "plant", "period": 0.1, "parts": parts, "instruments": reads}
    return PlantSettings(**{**given, "shows": (("a", 0), ("b", 1)), **changes})


def test_the_truth_moves_by_its_dynamics_and_is_read_without_error():
    moving = SimulatedPlant(plant(), epoch=1, origin=100.0)
    moving.advance(7)
    assert moving.time == pytest.approx(100.7)
    x = expm(0.7 * TURN) @ [1.0, 2.0]
    np.testing.assert_allclose(moving.state[0], x, rtol=1e-13)
    frames = {key: decode_frame(data) for key, data in moving.frames()}
    assert [key.removeprefix("trigpoint/n/") for key in frames] == [
        "reading/0", "reading/3", "reading/4", "truth/a", "truth/b",
    ]  # fmt: skip
    values = [frame.values for frame in frames.values()]
    for found, wanted in zip(values, ([x[0]], [5.0 - x[0]], [7.0], x, [5.0]), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-13)
    assert [frame.kind for frame in frames.values()] == [Kind.READING] * 3 + [Kind.TRUTH] * 2
    assert [frame.sequence for frame in frames.values()][:3] == [0, 1, 2]
    assert {frame.time for frame in frames.values()} == {moving.time}
    assert frames["trigpoint/n/truth/a"].sender == "a"


def test_a_plant_that_starts_again_is_where_it_would_be():
    steady, again = (SimulatedPlant(plant(), epoch=k, origin=0.0) for k in (1, 2))
    for step in range(1, 51):
        steady.advance(step)
    again.advance(50)
    np.testing.assert_allclose(again.state[0], steady.state[0], rtol=1e-12)
    again.advance(50)
    np.testing.assert_allclose(again.state[0], steady.state[0], rtol=1e-12)


def test_noise_has_the_size_it_was_given():
    """Readings: standard deviation; process: the factor of one period."""
    part = Part(np.zeros((1, 1)), np.zeros(1), np.array([[0.5]]))
    noisy = plant(parts=(part,), instruments=(Instrument(0, ((0, np.eye(1)),), 0.25),), shows=(("a", 0),))
    moving = SimulatedPlant(noisy, epoch=1, origin=0.0)
    readings, jumps, before = [], [], 0.0
    for step in range(1, 801):
        moving.advance(step)
        jumps.append(moving.state[0][0] - before)
        before = moving.state[0][0]
        read, _ = (decode_frame(data).values[0] for _, data in moving.frames())
        readings.append(read - before)
    assert np.std(jumps) == pytest.approx(0.5, rel=0.1)
    assert np.std(readings) == pytest.approx(0.25, rel=0.1)


@pytest.mark.parametrize("text", [CHAIN, GRID])
def test_the_file_holds_the_plant(text, tmp_path):
    with planned(text, tmp_path) as (_, plan):
        path = tmp_path / "plant.json"
        write_plant(plan.plant, path)
        assert path.stat().st_mode & 0o077 == 0
        again = read_plant(path)
    assert again.to_document() == plan.plant.to_document()
    first, second = (SimulatedPlant(one, epoch=5, origin=0.0) for one in (plan.plant, again))
    assert list(first.frames()) == list(second.frames())


def test_the_plan_of_a_measured_network_repeats_its_readings(tmp_path):
    text = '[network]\narcs = [["", "a", 1.0], ["a", "b", 0.5]]\n[run]\nrate = 5\n'
    with planned(text, tmp_path) as (_, plan):
        assert [one.recorded.tolist() for one in plan.plant.instruments] == [[1.0], [0.5]]
        np.testing.assert_allclose(np.concatenate([part.start for part in plan.plant.parts]), [1.0, 1.5])
        assert all(not node.start.any() for node in plan.nodes)  # nobody knows it


def plain(plan):
    """The settings of the plan's nodes, and the memory network between them and the plant."""
    links = [(name, node.name) for node in plan.nodes for name in node.program.hears]
    links += [(SENSOR, node.name) for node in plan.nodes]
    return plan.nodes, MemoryNetwork(links, calm=[SENSOR])


@pytest.mark.parametrize("text", [CHAIN, GRID])
def test_the_truth_of_the_process_in_memory_is_the_simulated_one_to_the_last_bit(text, tmp_path):
    """Truth and estimates of ``simulate``, of a run in memory with the plan's plant, and the frames of its process."""
    with planned(text, tmp_path) as (found, plan):
        nodes, network = plain(plan)
        times = plan.plant.period * np.arange(40)
        given = found.given.simulate
        scenario = tp.Scenario(
            times, given.initial_error, given.initial_state, period=plan.plant.period, path="reference"
        )  # fmt: skip
        simulated = tp.simulate(found.part.problem, found.observer, scenario)
        live = run_virtual(nodes, plan.plant.truth(), times, network)
        np.testing.assert_array_equal(live.truth, simulated.truth)
        np.testing.assert_array_equal(live.estimate, simulated.estimate)
        process = SimulatedPlant(plan.plant, epoch=1, origin=0.0)
        for step, truth in enumerate(live.truth):
            process.advance(step)
            told = [decode_frame(data) for _, data in process.frames()]
            np.testing.assert_array_equal([one.values for one in told if one.kind is Kind.TRUTH], truth)


def test_process_and_memory_draw_one_noise():
    part = Part(TURN, np.array([1.0, 2.0]), 0.3 * np.eye(2), np.array([0.0, 0.5]))
    noisy = plant(parts=(part,), instruments=(Instrument(7, ((0, ROW),), 0.25),), shows=(("a", 0),))
    process, truth = SimulatedPlant(noisy, epoch=6, origin=0.0), noisy.truth(epoch=6)
    for step in (1, 2, 5, 30):
        process.advance(step)
        truth.move(0.1 * step)
        frames = [decode_frame(data).values for _, data in process.frames()]
        np.testing.assert_array_equal(frames[0], truth.readings()[7])
        np.testing.assert_array_equal(frames[1], truth.truth()[0])


def test_a_leap_over_many_periods_and_a_step_within_one_are_free_of_noise():
    quiet, noisy = (
        plant(parts=(Part(TURN, np.array([1.0, 2.0]), factor),) * 2, instruments=()).truth()
        for factor in (None, np.eye(2))
    )
    for moment in (150.03, 150.07):
        quiet.move(moment)
        noisy.move(moment)
        np.testing.assert_array_equal(noisy.truth()[0], quiet.truth()[0])
    noisy.move(150.13)
    quiet.move(150.13)
    assert np.abs(noisy.truth()[0] - quiet.truth()[0]).max() > 1e-3


def test_noise_needs_a_period():
    with pytest.raises(ArgumentError, match="process noise is that of one period"):
        LinearPlant([Part(TURN, np.zeros(2), np.eye(2))], [])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parts": (Part(TURN, np.zeros(3)),) * 2}, r"part 0 of a plant: .* got \(2, 2\), \(3,\)"),
        ({"parts": (Part(np.zeros(()), np.zeros(1)),) * 2}, "part 0 of a plant"),
        ({"parts": (Part(TURN, np.zeros(2), drive=np.zeros(3)),) * 2}, "part 0 of a plant"),
        ({"parts": (Part(TURN, np.zeros(2), np.zeros((3, 2))),) * 2}, "part 0 of a plant"),
        ({"instruments": (Instrument(0, ((1, ROW),)),)}, r"reads the part 1 of 1 states by rows of the shape \(1, 2\)"),
        ({"period": 0.0}, "period of a plant must be a positive number of seconds; got 0"),
        ({"shows": (("a", 2),)}, "of 2 parts was asked for the part 2"),
        ({"instruments": (Instrument(9, ()),)}, "instrument 9 reads nothing"),
    ],
)
def test_impossible_plants_are_refused(changes, words):
    with pytest.raises(ArgumentError, match=words):
        plant(**changes)


@pytest.mark.parametrize(
    "damage",
    [
        {"kind": "other"},
        {"version": 99},
        {"parts": 3},
        {"parts": [[1, 2]]},
        {"instruments": [{"label": 0}]},
        {"shows": [["a"]]},
        {"period": "soon"},
        {"colour": "red"},
        {"identity": {"key": 1}},
    ],
)
def test_damaged_settings_are_refused(damage, tmp_path):
    document = {**plant().to_document(), **damage}
    with pytest.raises(ProtocolError, match="plant settings"):
        PlantSettings.from_document(document)
    path = tmp_path / "plant.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"plant\.json: no plant settings"):
        read_plant(path)


def test_an_absent_or_enormous_file_is_refused(tmp_path, monkeypatch):
    with pytest.raises(FileFormatError, match="no plant settings"):
        read_plant(tmp_path / "nothing.json")
    path = tmp_path / "plant.json"
    write_plant(plant(), path)
    monkeypatch.setattr("trigpoint.runtime.plant._LARGEST_FILE", 10)
    with pytest.raises(FileFormatError, match="at most 10 bytes"):
        read_plant(path)


class Published:
    """A transport that remembers."""

    def __init__(self):
        self.frames = []

    def publish(self, _, data):
        self.frames.append(decode_frame(data))


def test_the_loop_keeps_to_its_grid(monkeypatch):
    monkeypatch.setattr("trigpoint.runtime.plant.listen_for_orders", lambda *_, **__: None)
    clock = SystemClock()
    origin = clock.now() - 0.003
    transport = Published()
    loop = PlantLoop(plant(period=0.01, origin=origin), transport, clock, epoch=3)
    thread = threading.Thread(target=loop.run)
    thread.start()
    assert until(lambda: len(transport.frames) > 100)
    loop.tell(Order.STOP)
    thread.join(PATIENCE)
    assert not thread.is_alive()
    ended = clock.now()
    steps = np.array([frame.time - origin for frame in transport.frames if frame.kind is Kind.TRUTH]) / 0.01
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    points = np.round(steps[::2]).astype(int)
    assert (np.diff(points) >= 1).all()
    left_out = points[-1] - points[0] + 1 - points.shape[0]
    assert left_out <= loop.missed <= left_out + (ended - origin) / 0.01 - points[-1]  # the last may be late, too


def test_dataclasses_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        plant().period = 1.0


def test_a_file_that_others_could_read_is_theirs_no_longer(tmp_path):
    """The truth goes to a new file: whoever had the old one open, or may read it, sees nothing of it."""
    path = tmp_path / "plant.json"
    path.write_text("old", encoding="utf-8")
    path.chmod(0o644)
    with path.open(encoding="utf-8") as before:
        write_plant(plant(), path)
        assert before.read() == "old"
    assert path.stat().st_mode & 0o777 == 0o600
    assert [one.name for one in tmp_path.iterdir()] == ["plant.json"]
    assert read_plant(path).to_document() == plant().to_document()
