"""The clock of a run: it never steps, and a process that is started again has the one that all others have."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from tests.runtime.living import CHAIN, planned
from trigpoint.runtime import Supervisor, SystemClock
from trigpoint.runtime.clock import SET, new_epoch, setting_of, told_clock


def test_a_correction_of_the_wall_clock_moves_nothing(monkeypatch) -> None:
    wall, monotonic = 1.75e9, 1234.5
    monkeypatch.setattr(time, "time", lambda: wall)
    monkeypatch.setattr(time, "monotonic", lambda: monotonic)
    clock = SystemClock()
    told, first = setting_of(clock), new_epoch(clock)
    assert (clock.ahead, clock.now()) == (wall - monotonic, wall)
    wall, monotonic = wall - 3600.0, monotonic + 2.0
    again = told_clock(told)
    assert again.ahead == clock.ahead
    assert again.now() == clock.now() == wall + 3602.0
    assert new_epoch(again) == first + 2_000_000_000
    assert told_clock({}).ahead == clock.ahead - 3602.0


@pytest.mark.parametrize("text", ["", "soon", "nan", "inf"])
def test_a_setting_that_means_nothing_is_left_aside(text, monkeypatch) -> None:
    monkeypatch.setattr(time, "time", lambda: 1.75e9)
    monkeypatch.setattr(time, "monotonic", lambda: 1234.5)
    assert told_clock({SET: text}).now() == 1.75e9


def test_the_processes_of_a_run_get_its_clock(tmp_path, monkeypatch) -> None:
    """Also when the supervisor's clock is another than the machine's: it was set before the machine's was corrected."""
    given = []

    class Process:
        pid, returncode, stdin = 1, 0, None

        def __init__(self, *_, env, **__):
            given.append(env)

        def poll(self):
            return None

        def wait(self, _=None):
            return 0

        def send_signal(self, _):
            pass

    monkeypatch.setattr(subprocess, "Popen", Process)
    clock = SystemClock(ahead=12345.0)
    with planned(CHAIN, tmp_path) as (_, plan):
        supervisor = Supervisor(plan, clock)
        supervisor.start()
        supervisor.kill("0")
        supervisor.revive("0")
    assert len(given) == 5
    assert [float(env[SET]) for env in given] == [12345.0] * 5


def test_a_process_takes_the_clock_that_it_is_told() -> None:
    code = "import os; from trigpoint.runtime.clock import told_clock; print(repr(told_clock(os.environ).ahead))"
    clock = SystemClock(ahead=1e6)
    shown = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **setting_of(clock)},
        capture_output=True,
        check=True,
        text=True,
    )
    assert float(shown.stdout) == 1e6
