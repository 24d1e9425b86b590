"""A newcomer joins processes that run: its neighbours read their files again, the others learn nothing."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.cli.shelled import MAIN, trigpoint
from tests.machine import PATIENCE, free_port
from tests.runtime.living import CHAIN, everybody_heard, living, until
from trigpoint.runtime import (
    LINK_FIELDS,
    STATUS_FIELDS,
    Kind,
    Monitor,
    Pace,
    ReadingPublisher,
    SystemClock,
    ZenohTransport,
    find_identity,
    publish_measured,
    read_settings,
)

TRUE = 7.0


def address(kind: str, plan) -> str:
    if kind == "unixsock":
        return plan.nodes[0].listen.rpartition("/")[0] + "/new.sock"
    return f"{kind}/127.0.0.1:{free_port(socket.SOCK_DGRAM if kind == 'quic' else socket.SOCK_STREAM)}"


@pytest.mark.parametrize("kind", ["unixsock", *(pytest.param(one, marks=pytest.mark.slow) for one in ("tls", "quic"))])
def test_a_newcomer_finds_its_state_and_its_neighbours_keep_theirs(tmp_path, kind):
    """Beside the nodes 0 and 2; a sensor of its own publishes both readings to all three."""
    with living(CHAIN, tmp_path, transport=kind) as live:
        until(live, lambda: everybody_heard(live) and off(live) < 0.05)
        folder, secured = live.plan.folder / "settings", kind != "unixsock"
        if secured:
            keys = live.plan.folder / "keys"
            assert trigpoint("keys", "--name", "new", "--guest", "level=sensor", "--out", keys).exit_code == 0
        epochs = {name: live.monitor.epoch(name) for name in "012"}
        bystander = (folder / "node-1.json").read_bytes()
        result = trigpoint(
            "node", "--new", "new", "--beside", folder / "node-0.json", "--beside", folder / "node-2.json",
            "--label", 30, "--label", 31, "--sensor", "level", "--listen", address(kind, live.plan), "--json",
        )  # fmt: skip
        assert result.exit_code == 0, result.stderr
        grown = set()
        usual = {one.name: len(one.program.hears) for one in live.plan.nodes}

        def look(frame, _) -> None:
            links = (len(frame.values) - len(STATUS_FIELDS)) / len(LINK_FIELDS)
            if frame.kind is Kind.STATUS and links == usual.get(frame.sender, 0) + 1:
                grown.add(frame.sender)

        live.monitor.hooks.append(look)
        for name in "02":
            os.kill(live.supervisor.pids[name], signal.SIGHUP)
        until(live, lambda: grown >= {"0", "2"} and off(live) < 1.0)
        assert off(live) < 0.05  # they go on where they were
        file = json.loads(result.stdout)["newcomer"]
        joining(live, file, find_identity(keys, "level") if secured else None)
        assert (folder / "node-1.json").read_bytes() == bystander
        assert {name: live.monitor.epoch(name) for name in "012"} == epochs


def off(live) -> float:
    """The largest error of the run's own nodes."""
    return float(live.monitor.snapshot().error[:3].max())


def joining(live, file, identity) -> None:
    """Start it and its sensor; wait until it is near its truth, which the others have not left meanwhile."""
    newcomer = read_settings(Path(file))
    process = subprocess.Popen([sys.executable, "-c", MAIN, "node", str(file)])
    link = ZenohTransport("", [newcomer.listen, *newcomer.peers.values()], identity=identity)
    eye = ZenohTransport("", [newcomer.listen], identity=live.plan.identity)
    ended = threading.Event()
    sensor = ReadingPublisher(link, newcomer.network, "level", epoch=time.time_ns())
    thread = threading.Thread(
        target=publish_measured,
        args=(sensor, lambda _: {30: [TRUE - 1.0], 31: [TRUE - 2.0]}),
        kwargs={"period": newcomer.period, "pace": Pace(time.time, ended.wait)},
    )
    thread.start()
    monitor = Monitor(eye, newcomer.network, [newcomer.program], SystemClock())
    worst = 0.0

    def arrived() -> bool:
        """The newcomer says what is true, and that it knows of an anchor; both neighbours take it in."""
        nonlocal worst
        monitor.poll()
        snapshot = monitor.snapshot()
        worst = max(worst, off(live))
        near = snapshot.estimate[0] is not None and abs(float(snapshot.estimate[0][0]) - TRUE) < 1e-2
        return near and snapshot.status[0] is not None and snapshot.status[0].anchored

    try:
        until(live, arrived)
        assert monitor.snapshot().status[0].covered
        until(live, lambda: len(live.monitor.snapshot().names) == 4 and everybody_heard(live))  # the run hears it, too
        assert live.monitor.strangers == 0
        assert worst <= TRUE + 0.05  # means of errors: never beyond that of the newcomer, who begins at zero
        until(live, lambda: off(live) < 0.02)
    finally:
        ended.set()
        thread.join()
        link.close()
        eye.close()
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
