"""The supervisor's rules, with processes that fail at once; and the command that the processes run."""

from __future__ import annotations

import builtins
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest

from tests.machine import until
from tests.runtime.living import CHAIN, planned
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.runtime import Supervisor, SystemClock, write_settings
from trigpoint.runtime.__main__ import main, reread, run_nodes, speaks_plainly
from trigpoint.runtime.supervisor import backoff


def test_waits_double_up_to_ten_seconds():
    assert [backoff(k) for k in range(1, 8)] == [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    assert backoff(10**6) == 10.0


class Hand(SystemClock):
    """A clock that the test moves: processes run, and the waits between them take no time."""

    time = 1000.0

    def now(self):
        return self.time


@pytest.fixture
def clock():
    return Hand()


@pytest.fixture
def failing(tmp_path, clock):
    """A plan of one node that cannot listen where it should, so that its process ends at once."""
    with planned(CHAIN, tmp_path) as (_, plan):
        bad = replace(plan.nodes[0], listen=f"unixsock-stream/{tmp_path}/missing/folder/0.sock")
        plan.folder.mkdir()
        supervisor = Supervisor(replace(plan, nodes=(bad,), plant=None), clock)
        yield supervisor
        supervisor.stop()


def said(supervisor, word):
    return [(moment, text) for moment, _, text in supervisor.events if text.startswith(word)]


def test_a_process_that_keeps_failing_is_started_ever_more_seldom(failing, clock):
    failing.start()
    for restarts in range(5):
        assert until(lambda: len(said(failing, "ended")) > restarts, failing.tick)  # noqa: B023
        clock.time += backoff(restarts + 1) - 2.0**-20
        failing.tick()
        assert failing.restarts == restarts
        clock.time += 2.0**-20
        failing.tick()
        assert failing.restarts == restarts + 1
    started, ended = said(failing, "started"), said(failing, "ended")
    assert all(text.startswith("ended with exit code 2: error: cannot listen on unixsock") for _, text in ended)
    assert failing.reason("0") == ended[-1][1]
    waits = [again - end for (end, _), (again, _) in zip(ended, started[1:], strict=True)]
    assert waits == [0.5, 1.0, 2.0, 4.0, 8.0]
    assert until(lambda: len(said(failing, "ended")) == 6, failing.tick)
    output = (failing.status_file.parent / "output" / "process-0.txt").read_text(encoding="utf-8")
    assert output.startswith("error: ")
    before = failing.dead
    failing.stop()
    assert failing.dead_before_the_end == before
    assert failing.dead == ("0",)
    failing.revive("0")
    assert failing.dead == ()
    failing.kill("0")
    assert failing.dead == ("0",)


def test_what_ended_at_the_end_hides_no_failure_before_it(failing):
    """Stopped while it is being started once more, or just after it died, it says why it had failed."""
    failing.start()
    assert failing.reason("0") is None
    child = failing._group["0"]
    child.process.wait()
    failing.tick()
    for wait in (False, True):
        failing.revive("0")
        if wait:
            failing._group["0"].process.wait()
        failing.stop()
        assert failing.reason("0").startswith("ended with exit code 2: error: cannot listen on unixsock")


def test_a_disk_that_refuses_does_not_end_the_run(failing, clock):
    """Neither the status nor the output can be written: what runs goes on, is started again, and is ended in order."""
    failing.start()
    folder = failing.status_file.parent
    failing.kill("0")
    shutil.rmtree(folder)
    folder.write_text("no folder any more", encoding="utf-8")
    failing.revive("0")
    assert failing.dead == ("0",)
    assert failing.reason("0").startswith("ended before it began: [Errno 20]")
    for restarts, wait in ((1, 0.5), (2, 1.0)):  # it is tried again
        assert failing._group["0"].due == clock.time + wait
        clock.time += wait
        failing.tick()
        assert failing.restarts == restarts + 1
    failing.stop()
    assert sum("cannot write" in text for _, _, text in failing.events) == 1
    folder.unlink()
    folder.mkdir()
    failing.kill("0")
    assert failing.status_file.exists()


def test_orders_need_links(failing):
    with pytest.raises(ArgumentError, match="no transport"):
        failing.pause("0")


def test_measuring_needs_psutil(failing, monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **options):
        if name == "psutil":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"psutil.*trigpoint\[live\]"):
        failing.start()
    assert failing.dead == ("0",)


@pytest.mark.parametrize("arguments", [[], ["node"], ["plant"], ["plant", "a", "b"], ["dance", "a"], ["--tied"]])
def test_misuse_of_the_module(arguments, capsys):
    assert main(arguments) == 2
    assert "expected: python -m trigpoint.runtime" in capsys.readouterr().err


def test_a_damaged_file_is_one_line(tmp_path, capsys):
    path = tmp_path / "node.json"
    path.write_text("{", encoding="utf-8")
    assert main(["node", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {path}: no node settings")
    assert main(["plant", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {path}: no plant settings")


def test_a_tied_process_ends_with_its_input(tmp_path):
    with planned(CHAIN, tmp_path) as (_, plan):
        path = tmp_path / "node.json"
        write_settings(plan.nodes[0], path)
        command = [sys.executable, "-m", "trigpoint.runtime", "node", "--tied", str(path)]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=60, check=False)
        assert (done.returncode, done.stderr) == (0, b"")


def test_settings_that_are_read_again_bring_no_plain_text_that_was_not_allowed(tmp_path):
    """SIGHUP reads the file again; whoever was started without --allow-plain does not listen to the world after it."""
    with planned(CHAIN, tmp_path) as (_, plan):
        path, node = tmp_path / "node.json", plan.nodes[1]
        assert not speaks_plainly(node)
        for change in ({"listen": "tcp/0.0.0.0:7447"}, {"peers": {**node.peers, "0": "udp/192.0.2.1:7447"}}):
            changed = replace(node, **change)
            write_settings(changed, path)
            with pytest.raises(ArgumentError, match="plain text that anybody there can read"):
                reread(path, allow_plain=speaks_plainly(node))
            assert reread(path, allow_plain=speaks_plainly(changed)).to_document() == changed.to_document()


def test_the_process_of_a_node_reads_its_file_again_by_that_rule(tmp_path, monkeypatch):
    members = []

    class Still:
        dropped = 0

        def __init__(self, given, _):
            members.extend(given)

        def run(self, *, tied):
            assert tied

    monkeypatch.setattr("trigpoint.runtime.__main__.Host", Still)
    with planned(CHAIN, tmp_path) as (_, plan):
        path = tmp_path / "node.json"
        write_settings(plan.nodes[0], path)
        run_nodes([(plan.nodes[0], path)], tied=True)
        (member,) = members
        assert member.reread().to_document() == plan.nodes[0].to_document()
        write_settings(replace(plan.nodes[0], listen="tcp/0.0.0.0:7447"), path)
        with pytest.raises(ArgumentError, match="plain text"):
            member.reread()
