"""Kills, partitions, losses, late frames and clocks that differ: on the virtual clock, exactly and again and again.

The network of the issue: a 3 x 3 grid of oscillators, one anchor, 50 Hz.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

import trigpoint as tp
from tests.runtime.given import PERIOD, STATIC, Case, case
from trigpoint.runtime import Down, Mute, Trouble, run_virtual

NAMES = tuple("012345678")
TOP, REST = NAMES[:4], NAMES[4:]
DELAY = 0.01


@functools.cache
def grid() -> Case:
    """With the gain for every anchored network of these nodes."""
    return case(gain=tp.methods.WorstCase(9))


def relative_error(run) -> np.ndarray:
    return run.error_norm / np.linalg.norm(run.truth, axis=(1, 2))


def slowest(one: Case, late: int, gone: tuple[str, ...] = ()) -> float:
    """The rate [1/s] that theory predicts when each estimate is ``late`` periods old: of the whole map, lifted."""
    size = sum(program.n_states for program in one.programs)
    place = {program.name: slice(2 * k, 2 * k + 2) for k, program in enumerate(one.programs)}
    lifted = np.eye(size * (late + 1), k=-size)
    for program in one.programs:
        own = place[program.name]
        move, _, phi = program.maps(PERIOD)
        lifted[own, own] = move
        for arc in program.arcs:
            lifted[own, own] -= phi @ arc.gain @ arc.output
            for name, rows in arc.heard:
                old = slice(late * size + place[name].start, late * size + place[name].stop)
                lifted[own, old] += phi @ arc.gain @ rows @ np.linalg.matrix_power(move, late)
    kept = [k for name in NAMES if name not in gone for k in range(place[name].start, place[name].stop)]
    if gone:
        kept = [block * size + k for block in range(late + 1) for k in kept]
        lifted = lifted[np.ix_(kept, kept)]
    return float(-np.log(np.abs(np.linalg.eigvals(lifted)).max()) / PERIOD)


def test_the_default_converges_and_the_naive_policy_keeps_a_floor() -> None:
    one = grid()
    times = np.arange(0.0, 25.1, 0.5)
    found = {}
    for old in ("propagate", "use"):
        found[old] = relative_error(run_virtual(one.settings(old=old), one.plant(), times, one.network(delay=DELAY)))
    assert found["propagate"][-1] < 0.005
    assert found["propagate"][-1] < 0.3 * found["propagate"][-11]
    assert found["use"][-1] > 0.05
    assert found["use"][-1] > 0.8 * found["use"][-11]


@pytest.mark.parametrize("late", [0, 3])
def test_the_rate_is_the_predicted_one(late) -> None:
    one = grid()
    times = np.arange(0.0, 24.0, 0.1)
    run = run_virtual(one.settings(), one.plant(), times, one.network(delay=late * PERIOD))
    assert run.measured_decay_rate() == pytest.approx(slowest(one, late), rel=0.05)


def killed(one: Case, victims, *, apart: float, first: float = 6.0) -> None:
    """Kill each in turn, restart it after 4 s; the others go on, and all are back within the predicted time."""
    downs = [Down(name, first + apart * k, first + apart * k + 4.0) for k, name in enumerate(victims)]
    until = first + apart * len(victims)
    times = np.arange(0.0, until, 0.1)
    settings = one.settings(coverage="every", start=np.zeros(2))
    run = run_virtual(settings, one.plant(), times, one.network(delay=DELAY), Trouble(downs))
    rate = slowest(one, 1)
    for down in downs:
        victim = NAMES.index(down.name)
        others = [k for k in range(9) if k != victim]
        error = np.linalg.norm(run.error, axis=2)
        gone = (times > down.start + 0.05) & (times < down.stop - 0.05)
        assert (run.status[gone, victim] == "away").all()
        rest = np.linalg.norm(error[:, others], axis=1)
        assert np.isfinite(rest[gone]).all()
        before = int(np.searchsorted(times, down.start)) - 1
        after = int(np.searchsorted(times, down.stop)) - 1
        assert rest[after] < 1.1 * rest[before]
        late = (times > down.start + 1.1) & gone
        if down.name == "0":
            assert (run.status[late][:, others] == "relative").all()
        elif down.name not in ("1", "3"):
            assert rest[after] < rest[before]
            assert (run.status[late][:, others] == "anchored").all()
        back = (times > down.stop + 0.3) & (times < down.start + apart)
        assert (run.status[back] == "anchored").all()
        whole = run.error_norm
        start = int(np.searchsorted(times, down.stop + 0.05))
        level = whole[start] / np.e**2
        predicted = 2.0 / rate
        reached = times[start:][whole[start:] <= level]
        assert reached.size
        assert reached[0] - down.stop < 1.15 * predicted + 0.3, (down, reached[0] - down.stop, predicted)


def test_the_anchored_node_and_the_centre_are_killed_and_come_back() -> None:
    killed(grid(), ["0", "4"], apart=14.0)


@pytest.mark.slow
def test_each_node_in_turn_is_killed_and_comes_back() -> None:
    killed(grid(), NAMES, apart=14.0)


@pytest.mark.parametrize("how", ["killed", "silent"])
def test_without_its_anchor_every_node_is_relative_within_the_bound_and_comes_back(how) -> None:
    """The bound: ``anchor_timeout`` after the last reading, at every node, whatever the hops."""
    one, start, stop = grid(), 3.0, 7.0
    trouble = Trouble([Down("0", start, stop)]) if how == "killed" else Trouble(mutes=[Mute(12, start, stop)])
    assert [arc.label for program in one.programs for arc in program.arcs if not arc.heard] == [12]
    times = PERIOD * np.arange(1, 450)
    claims, hops = [], []

    def watch(now, machines) -> None:
        claims.append([name for name, machine in machines.items() if machine.anchored])
        hops.append({name: machine.status.hops for name, machine in machines.items()})

    run_virtual(one.settings(), one.plant(), times, one.network(delay=DELAY, loss=0.2), trouble, watch)
    timeout, last = 1.0, start - PERIOD
    ahead = 0.5  # four hops of a delay and a period each, and losses
    for now, claimed, near in zip(times, claims, hops, strict=True):
        if last + timeout + 1e-9 < now < stop:
            assert claimed == [], now
        if ahead < now < start or now > stop + ahead:
            assert len(claimed) == 9, now
            assert [near[name] for name in NAMES] == [0, 1, 2, 1, 2, 3, 2, 3, 4]


def test_a_partition_leaves_one_half_anchored_and_heals_at_the_predicted_rate() -> None:
    """Loss 20 %, delay 50 ms +- 10, reordering, and 6 s of two halves of which one has no anchor."""
    one, start, stop = grid(), 6.0, 12.0
    network = one.network(delay=0.04, jitter=0.02, loss=0.2, seed=4)
    network.part(TOP, REST, start, stop)
    times = np.arange(0.0, 30.0, 0.1)
    covered: list[list[bool]] = []

    def watch(now, machines) -> None:
        covered.append([machines[name].status.covered for name in NAMES])

    run = run_virtual(one.settings(coverage="every"), one.plant(), times, network, watch=watch)
    during = (times > start + 1.5) & (times < stop)
    assert (run.status[during][:, :4] == "anchored").all()
    assert (run.status[during][:, 4:] == "relative").all()
    said = np.array(covered)
    np.testing.assert_array_equal(said[during], run.status[during] == "anchored")
    assert (run.status[times > stop + 0.7] == "anchored").all()
    norm = run.error_norm
    assert norm[during].max() < norm[0]
    top = np.linalg.norm(run.error[:, :4], axis=(1, 2))
    assert top[during][-1] < 0.5 * top[during][0]
    after = times > stop + 1.0
    slope = -np.polyfit(times[after], np.log(norm[after]), 1)[0]
    assert slope == pytest.approx(slowest(one, 3), rel=0.15)


def test_a_missing_arc_anywhere_ends_the_cover_of_a_gain_for_the_whole_network_only() -> None:
    one = case()
    times = np.arange(0.0, 12.0, 0.1)
    found: list[list[bool]] = []

    def watch(now, machines) -> None:
        found.append([name in machines and machines[name].status.covered for name in NAMES])

    trouble = Trouble([Down("8", 4.0, 8.0)])
    run = run_virtual(one.settings(coverage="nominal"), one.plant(), times, one.network(), trouble, watch)
    said = np.array(found)
    assert said[(times > 1.5) & (times < 4.0)].all()
    missing = (times > 4.6) & (times < 8.0)
    assert not said[missing].any()
    assert (run.status[missing][:, :8] == "anchored").all()
    assert said[times > 9.6].all()


def test_news_of_a_missing_arc_counts_however_old_it_is_when_it_comes() -> None:
    """It takes longer than ``anchor_timeout`` from the far end of the chain; both ends have an anchor."""
    one = case(STATIC, tp.graphs.chain(40, anchors=[0, 39]))
    far = next(arc.label for arc in one.programs[39].arcs if not arc.heard)
    found = {}

    def watch(now, machines) -> None:
        found[round(now, 6)] = machines[one.names[0]].anchored, machines[one.names[0]].status.covered

    times = np.arange(0.0, 8.0, 0.5)
    settings = one.settings(anchor_timeout=0.6, coverage="nominal")
    run_virtual(settings, one.plant(), times, one.network(), Trouble(mutes=[Mute(far, 4.0)]), watch)
    assert found[3.5] == (True, True)
    assert {found[time] for time in (6.0, 6.5, 7.0, 7.5)} == {(True, False)}


def test_clocks_that_differ_are_measured_and_cause_the_floor_that_is_predicted() -> None:
    one = grid()
    ahead = 0.03
    machines = {}

    def watch(now, found) -> None:
        machines.update(found)

    times = np.arange(0.0, 24.0, 0.5)
    trouble = Trouble(offsets={"4": ahead})
    run = run_virtual(one.settings(), one.plant(), times, one.network(delay=DELAY), trouble, watch)
    for name in ("1", "3", "5", "7"):
        link = next(link for link in machines[name].status.links if link.neighbour == "4")
        assert link.offset == pytest.approx(ahead, abs=1e-9)
        assert link.round_trip == pytest.approx(2 * DELAY, abs=1e-9)
        assert machines[name].status.warning is not None
    assert machines["0"].status.warning is None
    error = np.linalg.norm(run.error, axis=2)[-20:].max()
    floor = max(machine.status.floor for machine in machines.values())
    assert 0.1 * floor < error < 10.0 * floor


def test_a_newcomer_joins_when_its_neighbour_takes_new_settings() -> None:
    """A chain of three becomes one of four at 2 s; nobody but the neighbour of the newcomer is told."""
    one, join = case(STATIC, tp.graphs.chain(4, anchors=[0]), tp.methods.WorstCase(4)), 2.0
    later = one.settings(coverage="every", start=np.zeros(2))
    first = [*later[:2], replace(later[2], program=_without(one, 2, "3")), later[3]]
    trouble = Trouble([Down("3", 0.0, join)], reloads=[(join, later[2])])
    times = np.arange(0.0, 12.0, 0.1)
    run = run_virtual(first, one.plant(), times, one.network(), trouble)
    assert (run.status[(times > 1.0) & (times < join), :3] == "anchored").all()
    assert (run.status[times > join + 0.5] == "anchored").all()
    assert np.abs(run.error[-1]).max() < 1e-3


def _without(one: Case, node: int, name: str):
    program = one.programs[node]
    kept = tuple(arc for arc in program.arcs if arc.neighbour != name)
    return replace(program, arcs=kept, _memo={})
