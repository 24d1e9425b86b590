"""A node that joins ``trigpoint run``: on its page, in its summary and log; and when it has left for good."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import numpy as np

from tests.cli.shelled import MAIN, trigpoint
from tests.runtime.living import CHAIN, anchored, designed, everybody_heard, living, until
from trigpoint.cli.live import facts_of, holds, log_of
from trigpoint.cli.watching import attached, feed_of
from trigpoint.runtime import Kind, read_log, run_of


def told_links(live, node: int) -> list[str]:
    status = live.monitor.snapshot().status[node]
    return [] if status is None else [link.neighbour for link in status.links]


def told_again(live, names: str) -> None:
    for name in names:
        os.kill(live.supervisor.pids[name], signal.SIGHUP)


def test_who_joins_is_seen_and_logged_and_who_leaves_is_forgotten(tmp_path):
    with living(CHAIN, tmp_path) as live:
        path = tmp_path / "out" / "run.mcap"
        live.keep(log_of(live.plan, path))
        until(live, lambda: everybody_heard(live) and anchored(live) == 3)
        folder = live.plan.settings_folder
        files = folder / "node-0.json", folder / "node-2.json"
        before = [file.read_bytes() for file in files]
        beside = [text for file in files for text in ("--beside", file)]
        place = live.plan.nodes[0].listen.rpartition("/")[0] + "/new.sock"
        labels = ("--label", 30, "--label", 31)
        assert trigpoint("node", "--new", "new", *beside, *labels, "--listen", place).exit_code == 0
        told_again(live, "02")
        heard = []
        live.monitor.hooks.append(lambda frame, _: heard.append(frame.kind) if frame.sender == "new" else None)
        with attached(tmp_path / "out") as feed, subprocess.Popen(
            [sys.executable, "-c", MAIN, "node", str(folder / "new.json")]
        ) as process:  # fmt: skip
            try:
                until(live, lambda: len(live.monitor.names) == 4 and everybody_heard(live))
                until(live, lambda: told_links(live, 0) == ["1", "new"] and told_links(live, 3) == ["0", "2"])
                until(live, lambda: followed(feed) and "new" in feed.names)
                until(live, lambda: followed(feed) and np.isfinite(feed._snapshot.age).all())
                until(live, lambda: heard.count(Kind.ESTIMATE) > 3)
            finally:
                process.send_signal(signal.SIGTERM)
                assert process.wait(30) == 0
        assert feed.topology()["arcs"] == [[0, 1], [0, 3], [1, 2], [2, 3]]
        assert feed.topology()["joined"] == [3]
        assert "new: joined the run" in [event.text for event in feed.events(0)[1]]
        assert trigpoint("node", "--gone", "new", *beside).exit_code == 0
        assert [file.read_bytes() for file in files] == before
        told_again(live, "02")
        until(live, lambda: told_links(live, 0) == told_links(live, 2) == ["1"])
        until(live, lambda: anchored(live) >= 3)
        live.step()
        facts = facts_of(live, live.monitor.snapshot(), designed(tmp_path / "scenario.toml").programs)
        assert (facts["joined"], facts["nodes"], facts["heard"], facts["anchored"]) == (["new"], 3, 3, 3)
        assert holds(facts)
    the_log_has_it(path)


def followed(feed) -> bool:
    feed.absorb(feed._source())
    return True


def the_log_has_it(path) -> None:
    log = read_log(path)
    assert log.complete
    assert log.names == ("0", "1", "2", "new")
    assert len(log.estimates["new"]) > 3
    assert [link.neighbour for link in log.status("new").links] == ["0", "2"]
    assert ("joined the run", "new") in [(event.text, event.node) for event in log.events]
    run = run_of(log)
    assert run.status[0].tolist()[:3] != ["away"] * 3
    assert run.status[0, 3] == "away"  # it begins when the others are known, not when the newcomer is
    assert (run.status[:, 3] != "away").any()
    assert np.isfinite(run.error_norm).all()  # of those whose truth is known
    assert trigpoint("report", path).exit_code == 0
    page = path.with_name("run.live.html").read_text(encoding="utf-8")
    assert "joined the run" in page
    topology = feed_of(path, None).topology()
    assert (topology["names"], topology["joined"]) == (["0", "1", "2", "new"], [3])
    assert [0, 3] in topology["arcs"]
