"""Real processes over real links: who runs, who dies, who comes back."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import numpy as np
import pytest

from tests import machine
from tests.machine import PATIENCE, with_time
from tests.runtime.living import (
    CHAIN,
    GRID,
    anchored,
    designed,
    everybody_heard,
    killed,
    living,
    log_so_far,
    runs,
    status_of,
    until,
)
from trigpoint.cli.live import facts_of
from trigpoint.errors import ArgumentError
from trigpoint.runtime import Kind
from trigpoint.runtime.clock import new_epoch
from trigpoint.runtime.status import STATUS_FIELDS


def test_a_killed_process_is_replaced_and_the_network_converges(tmp_path):
    """Three processes; one is killed from outside: the next estimate comes from a new process, of a new epoch."""
    with living(CHAIN, tmp_path) as live:
        until(live, lambda: everybody_heard(live))
        pids = {name: one["pid"] for name, one in status_of(live)["nodes"].items()}
        assert len(set(pids.values()) | {status_of(live)["plant"], status_of(live)["supervisor"]}) == 5
        assert all(runs(pid) for pid in pids.values())
        epoch, started = live.monitor.epoch("1"), new_epoch(live.clock)
        assert epoch < started
        killed(pids["1"])
        until(live, lambda: live.monitor.epoch("1") > started)
        again = status_of(live)["nodes"]["1"]
        assert again["pid"] != pids["1"]
        assert again["restarts"] == 1
        assert status_of(live)["nodes"]["0"] == {"pid": pids["0"], "restarts": 0, "state": "running", "exit_code": None}
        assert any("SIGKILL" in text for _, name, text in live.supervisor.events if name == "1")
        until(live, lambda: live.monitor.snapshot().error.max() < 1e-3)
        until(live, lambda: anchored(live) == 3)


def test_orders_from_the_page(tmp_path):
    """Pause and go by frames; killed on request stays dead; a name that is no node is refused."""
    with living(CHAIN, tmp_path) as live:
        until(live, lambda: everybody_heard(live))
        live.supervisor.pause("2")
        until(live, lambda: (status := live.monitor.snapshot().status[2]) is not None and status.paused)
        live.supervisor.go("2")
        until(live, lambda: not live.monitor.snapshot().status[2].paused and everybody_heard(live))
        live.supervisor.kill("1")
        assert status_of(live)["nodes"]["1"]["state"] == "dead"
        assert live.supervisor.dead == ("1",)
        until(live, lambda: live.monitor.snapshot().age[1] > 1.5)  # longer than the first back-off
        assert live.supervisor.pids["1"] is None
        live.supervisor.revive("1")
        until(live, lambda: everybody_heard(live))
        assert live.supervisor.usage()[1].restarts == 1
        with pytest.raises(ArgumentError, match="no node 'nobody'; the nodes are 0, 1, 2"):
            live.supervisor.kill("nobody")


def test_everybody_ends_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr("trigpoint.runtime.supervisor._PATIENCE", PATIENCE)  # nobody is killed for being slow
    with living(CHAIN, tmp_path, agents_per_process=2) as live:
        until(live, lambda: everybody_heard(live))
        pids = [*live.supervisor.pids.values(), live.supervisor.plant_pid]
        assert len(set(pids)) == 3  # two nodes share one process
    assert not any(runs(pid) for pid in pids)
    assert {one["exit_code"] for one in status_of(live)["nodes"].values()} == {0}
    assert live.supervisor.dead_before_the_end == ()
    usage = live.supervisor.usage()
    assert all(one.cpu > 0.0 and one.memory > 2**24 for one in usage)


def test_no_orphans_whatever_kills_the_parent(tmp_path):
    """SIGKILL of ``trigpoint run``: its processes see their standard input end."""
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(CHAIN, encoding="utf-8")
    main = "import sys; sys.argv[0] = 'trigpoint'; from trigpoint.cli import main; main()"
    parent = subprocess.Popen([sys.executable, "-c", main, "run", str(scenario), "--out", str(tmp_path / "out")])
    log = tmp_path / "out" / "run.mcap"

    def all_speak():
        found = log_so_far(log)
        return found is not None and len(found.estimates) == 3 and len(found.readings) == 3

    assert machine.until(all_speak, within=2.0 * PATIENCE)
    found = json.loads((tmp_path / "out" / "status.json").read_text(encoding="utf-8"))
    pids = [found["plant"], *(one["pid"] for one in found["nodes"].values())]
    assert found["supervisor"] == parent.pid
    assert all(runs(pid) for pid in pids)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert machine.until(lambda: not any(runs(pid) for pid in pids)), "a node outlived its parent"


def recorded(live):
    snapshot = live.monitor.snapshot()
    live.recorder.take(snapshot)
    return snapshot.time


@pytest.mark.slow
def test_nine_oscillators_at_50_hz(tmp_path):
    """Issue: below 0.5 % within 25 s from a random start, at the predicted rate within 15 %."""
    with_time(lambda attempt: nine_oscillators(made(tmp_path / str(attempt))))


def made(folder):
    folder.mkdir()
    return folder


def nine_oscillators(folder):
    with living(GRID, folder) as live:
        until(live, lambda: everybody_heard(live))
        began = live.monitor.snapshot().time
        size = np.linalg.norm(np.concatenate(live.monitor.snapshot().truth))
        until(live, lambda: recorded(live) > began + 25.0)
        last = live.monitor.snapshot()
        assert np.linalg.norm(last.error) < 0.005 * size
        assert anchored(live) == 9
        facts = facts_of(live, last, designed(folder / "scenario.toml").programs)
        assert facts["decay_rate_measured"] == pytest.approx(facts["decay_rate_predicted"], rel=0.15)
        assert facts["decay_rate_measured"] == pytest.approx(facts["decay_rate_expected"], rel=0.1)
        assert facts["restarts"] == 0


@pytest.mark.slow
def test_the_naive_policy_leaves_a_floor(tmp_path):
    """Old messages taken as if they were new: an error of some percent that stays; engines.md found 0.2-0.6 of 9."""
    with living(GRID, tmp_path, old="use") as live:
        until(live, lambda: everybody_heard(live))
        began = live.monitor.snapshot().time
        until(live, lambda: live.monitor.snapshot().time > began + 25.0)
        levels = []
        for _ in range(20):
            now = live.monitor.snapshot()
            levels.append(np.linalg.norm(now.error) / np.linalg.norm(np.concatenate(now.truth)))
            until(live, lambda end=now.time + 0.1: live.monitor.snapshot().time > end)
        assert min(levels) > 0.01


@pytest.mark.slow
def test_without_its_anchor_everybody_says_relative(tmp_path):
    """The one node with an anchor is killed: all say relative within ``anchor_timeout``, and come back with it.

    Nothing that a node knows of an anchor is younger than the kill, so that whatever it says of an instant that is more
    than ``anchor_timeout`` later says relative, however busy the machine is.
    """
    with living(GRID, tmp_path) as live:
        until(live, lambda: anchored(live) == 9)
        live.supervisor.kill(live.plan.names[0])
        limit = live.clock.now() + live.plan.nodes[0].anchor_timeout
        said = {}

        def listen(frame, _):
            if frame.kind is Kind.STATUS and frame.time > limit:
                said.setdefault(frame.sender, []).append(frame.values[STATUS_FIELDS.index("anchored")])

        live.monitor.hooks.append(listen)
        until(live, lambda: len(said) == 8 and min(map(len, said.values())) >= 2)
        assert not any(map(any, said.values()))
        live.monitor.hooks.remove(listen)
        live.supervisor.revive(live.plan.names[0])
        until(live, lambda: anchored(live) == 9)
