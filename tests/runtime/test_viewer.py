"""A monitor that joins a run from outside: by the folder's files, hearing all and saying nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests import machine
from tests.runtime.living import CHAIN, GRID, anchored, everybody_heard, killed, living, planned, status_of, until
from trigpoint.cli.watching import attached
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.runtime import Identity, SimulatedPlant, ZenohTransport
from trigpoint.runtime.__main__ import plant_transport
from trigpoint.runtime.topics import everything, reading_key, truth_key
from trigpoint.runtime.viewer import (
    VIEWER_FILE,
    Viewer,
    nodes_in,
    read_viewer,
    running,
    view_transport,
    write_viewer,
)

VIEWER = Viewer("net", "monitor", "plant", "tcp/127.0.0.1:7000", {"a": np.eye(2)}, Identity("a", "b", "c"))


@pytest.mark.parametrize("kind", ["unixsock", pytest.param("tls", marks=pytest.mark.slow)])
def test_what_a_run_shows_from_outside(tmp_path, kind):
    """Estimates, statuses and the truth, over links of its own; any number at once."""
    with living(CHAIN, tmp_path, transport=kind) as live:
        folder = live.plan.folder
        until(live, lambda: everybody_heard(live) and anchored(live) == 3)
        assert (status_of(live)["over"], running(folder)) == (False, True)
        with attached(folder) as feed, attached(folder) as second:
            sources = [one._source for one in (feed, second)]
            until(live, lambda: all(np.isfinite(source().age).all() for source in sources))
            until(live, lambda: all(np.isfinite(source().error).all() for source in sources))
            until(live, lambda: None not in sources[0]().status)
            snapshot = sources[0]()
            feed.absorb(snapshot)
            assert snapshot.names == ("0", "1", "2")
            assert [status.anchored for status in snapshot.status] == [True] * 3
            assert feed.controls is None
            assert feed.topology()["arcs"] == [[0, 1], [1, 2]]
            until(live, lambda: sources[0]().error.max() < 1e-2)
            assert live.monitor.malformed == 0
            dropped = [status.counters.dropped for status in live.monitor.snapshot().status]
            assert dropped == [0, 0, 0]  # it has said nothing
            before = live.supervisor.plant_pid
            killed(before)
            until(live, lambda: live.supervisor.plant_pid not in (None, before))
            with attached(folder) as third:  # at the same address, from the plant that was started again
                until(live, lambda: np.isfinite(third._source().error).all())
            live.close()
            assert status_of(live)["over"] is True
            assert not running(folder)
            assert machine.until(lambda: feed.ended is not None, sources[0])
            assert feed.ended == "The run is over."


def status(folder, **changes):
    document = {"supervisor": os.getpid(), "over": False, "plant": None, "nodes": {}, **changes}
    (folder / "status.json").write_text(json.dumps(document), encoding="utf-8")


def test_whether_a_run_goes_on(tmp_path):
    assert not running(tmp_path)
    status(tmp_path)
    assert running(tmp_path)
    status(tmp_path, over=True)
    assert not running(tmp_path)
    child = subprocess.Popen([sys.executable, "-c", "pass"])
    child.wait()
    status(tmp_path, supervisor=child.pid)  # killed: it could not say so
    assert not running(tmp_path)
    status(tmp_path)
    os.utime(tmp_path / "status.json", (1e9, 1e9))  # another process that has the number now
    assert not running(tmp_path)
    for text in ("{", "[]", "{}", '{"over": false, "supervisor": "x"}'):
        (tmp_path / "status.json").write_text(text, encoding="utf-8")
        with pytest.raises(FileFormatError, match="no status of a run"):
            running(tmp_path)


def test_without_psutil_it_says_what_to_install(tmp_path, monkeypatch):
    status(tmp_path)
    monkeypatch.setitem(sys.modules, "psutil", None)
    with pytest.raises(Exception, match="psutil"):
        running(tmp_path)


def test_the_file_of_a_viewer(tmp_path):
    path = tmp_path / "viewer.json"
    write_viewer(VIEWER, path)
    assert path.stat().st_mode & 0o777 == 0o600
    found = read_viewer(path)
    assert replace(found, motions={}).to_document() == replace(VIEWER, motions={}).to_document()
    np.testing.assert_array_equal(found.motions["a"], np.eye(2))
    document = VIEWER.to_document()
    changes = ({"version": 9}, {"source": 3}, {"motions": 3}, {"identity": {"key": "a"}})
    lacking = {key: value for key, value in document.items() if key != "sensor"}
    for spoiled in ({}, lacking, *({**document, **change} for change in changes)):
        with pytest.raises(ProtocolError, match="viewer"):
            Viewer.from_document(spoiled)
    path.write_text("{", encoding="utf-8")
    with pytest.raises(FileFormatError, match="tells no viewer"):
        read_viewer(path)


def test_the_plan_names_it_to_everybody(tmp_path):
    with planned(GRID, tmp_path) as (_, plan):
        plan.folder.mkdir()
        plan.write()
        viewer = read_viewer(plan.folder / VIEWER_FILE)
        assert all(node.guests[viewer.name] == "monitor" for node in nodes_in(plan.folder))
        assert viewer.name not in plan.plant.peers
        assert (viewer.source, viewer.sensor) == (plan.plant.listen, plan.plant.name)
        assert plan.plant.guests == {viewer.name: "monitor"}
        told = [path.read_text(encoding="utf-8") for path in plan.settings_folder.glob("node-*.json")]
        assert not [text for text in told if plan.plant.listen in text]  # no node knows where the truth is told
        assert [node.name for node in nodes_in(plan.folder)] == list(plan.names)
        assert set(viewer.motions) == set(plan.names)
    with pytest.raises(FileFormatError, match="run with --out writes them"):
        nodes_in(tmp_path)


def test_the_truth_is_told_to_viewers_and_not_to_nodes(tmp_path):
    """A node that finds the plant's address gets the readings, which it has anyway, whatever else it asks for."""
    with planned(CHAIN, tmp_path, transport="tls") as (_, plan):
        plan.folder.mkdir(exist_ok=True)
        heard = {"node": set(), "viewer": set()}
        plant = plant_transport(plan.plant)
        node = ZenohTransport("", [plan.plant.listen], identity=plan.nodes[1].identity)
        viewer = view_transport(plan.viewer, plan.nodes)
        try:
            for name, link in (("node", node), ("viewer", viewer)):
                for pattern in (everything(plan.network), reading_key(plan.network, 1), truth_key(plan.network, "1")):
                    link.subscribe(pattern, lambda key, _, who=name: heard[who].add(key.split("/")[2]))
            process = SimulatedPlant(plan.plant, epoch=1, origin=0.0)

            def publish():
                for key, data in process.frames():
                    plant.publish(key, data)

            assert machine.until(lambda: "truth" in heard["viewer"] and "reading" in heard["node"], publish), heard
            assert heard == {"node": {"reading"}, "viewer": {"reading", "truth"}}
        finally:
            for link in (plant, node, viewer):
                link.close()


def test_links_with_certificates_need_one(tmp_path):
    with planned(CHAIN, tmp_path, transport="tls") as (_, plan):
        assert plan.viewer.identity is not None
        with pytest.raises(ArgumentError, match="need a certificate for 'monitor'"):
            view_transport(replace(plan.viewer, identity=None), plan.nodes)
    keys = tmp_path / "out" / "keys"
    for file in keys.glob("monitor.*"):
        file.unlink()
    with planned(CHAIN, tmp_path, transport="tls", security=str(keys)) as (_, plan):
        assert plan.viewer.identity is None  # the run goes without
