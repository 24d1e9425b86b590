"""A live run under a test's hands: made from a scenario's text, driven step by step, waited for."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests import machine
from tests.machine import PATIENCE
from trigpoint.cli.choices import method_of
from trigpoint.cli.compose import part_of, read_any
from trigpoint.cli.live import LiveRun
from trigpoint.cli.live_plan import Design, Places, plan_of
from trigpoint.errors import FileFormatError
from trigpoint.methods import design
from trigpoint.runtime import Log, read_log

CHAIN = """
[network]
gallery = { kind = "chain", n = 3, anchors = [0] }
[simulate]
initial_state = [1.0, 4.0, 2.0]
initial_error = 2.0
[run]
rate = 25
"""
GRID = (Path(__file__).resolve().parents[2] / "examples" / "grid_live.toml").read_text(encoding="utf-8")


def designed(path: Path) -> Design:
    given = read_any(path)
    part = part_of(given, given.design)
    return Design(given, part, given.design, design(part.problem, method_of(given.design, part.problem)))


def ports_of_our_own(count: int, kind: int) -> list[int]:
    """Instead of any that are free now, which others may get before the nodes take them."""
    return [machine.free_port(kind) for _ in range(count)]


@contextmanager
def planned(text: str, folder: Path, **changes: Any) -> Iterator[Any]:
    """The design and the plan of a scenario; socket files lie in a short folder of their own."""
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    found = designed(path)
    section = found.given.run.model_copy(update=changes)
    with tempfile.TemporaryDirectory(prefix="tp-") as sockets, pytest.MonkeyPatch.context() as patch:
        patch.setattr("trigpoint.runtime.plan._free_ports", ports_of_our_own)
        (Path(sockets) / "watch").mkdir()
        yield found, plan_of(found, section, Places(folder / "out", Path(sockets)))


@contextmanager
def living(text: str, folder: Path, **changes: Any) -> Iterator[LiveRun]:
    """The run, started; ended at the end of the block, whatever happens."""
    with planned(text, folder, **changes) as (_, plan):
        plan.folder.mkdir(exist_ok=True)
        live = LiveRun(plan, None)
        try:
            live.supervisor.start()
            yield live
        finally:
            live.close()


def until(live: LiveRun, what: Callable[[], Any]) -> None:
    """Let the run go on until ``what`` is true; the test fails where that never happens."""
    came = machine.until(what, live.step, within=2.0 * PATIENCE)
    assert came, f"not within {2.0 * PATIENCE} s: {what.__doc__ or what}; {live.supervisor.events}"


def everybody_heard(live: LiveRun) -> bool:
    return bool((live.monitor.snapshot().age < 1.0).all())


def anchored(live: LiveRun) -> int:
    return sum(status.anchored for status in live.monitor.snapshot().status if status is not None)


def log_so_far(path: Path) -> Log | None:
    """The log of a run that goes on; None while it does not say yet whose it is."""
    try:
        return read_log(path)
    except FileFormatError:
        return None


def status_of(live: LiveRun) -> dict[str, Any]:
    return json.loads(live.supervisor.status_file.read_text(encoding="utf-8"))


def runs(pid: int) -> bool:
    """Whether the process is there and no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def killed(pid: int) -> None:
    os.kill(pid, 9)
