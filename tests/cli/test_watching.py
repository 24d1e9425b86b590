"""``trigpoint watch`` on every kind of run, and the page of ``trigpoint run --watch`` with its orders."""

import json
import re
import signal
import subprocess
import sys
from contextlib import suppress

import numpy as np
import pytest
from websockets.sync.client import connect

from tests.cli.shelled import refused, trigpoint
from tests.machine import PATIENCE, free_port, until
from trigpoint import graphs
from trigpoint.cli.watching import attached, feed_of, links_of
from trigpoint.dashboard import STATES, decode_moment
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.io import save
from trigpoint.model import Network
from trigpoint.runtime import Frame, Kind, LogWriter
from trigpoint.runtime.viewer import running

NAMES = ("a", "b", "c")
HEARS = {"a": ["b"], "b": ["a", "c"], "c": ["b"]}


def logged(path, **attributes):
    """A log of three nodes, ten estimates a second each for two seconds; c falls silent after one."""
    with LogWriter(path, network="net", names=NAMES, attributes=attributes) as log:
        for k in range(20):
            time = 100.0 + 0.1 * k
            for name in NAMES:
                truth = Frame(Kind.TRUTH, name, 1, k, time, (), np.array([1.0]))
                log.write(truth, time)
                if name != "c" or k <= 10:
                    facts = (1.0, time, 0.0, 0.5 / (1 + k))
                    log.write(Frame(Kind.ESTIMATE, name, 1, k, time, facts, np.array([1.0 + 0.1 * k])), time)
        log.event("killed on request", "c", time=101.0)
    return path


def test_a_log_names_its_own_links(tmp_path):
    feed = feed_of(logged(tmp_path / "run.mcap", hears=HEARS, anchors=["a"], guaranteed_rate=0.25, stale=0.25), None)
    topology = feed.topology()
    assert (topology["names"], topology["arcs"], topology["anchored"]) == (list(NAMES), [[0, 1], [1, 2]], [0])
    assert (topology["rate"], topology["stale"], topology["title"]) == (0.25, 0.5, "net (run.mcap)")
    assert topology["colours"] == ["error", "uncertainty", "state", "age"]
    moment = decode_moment(feed.frame(19))
    np.testing.assert_allclose(moment.error, [1.9, 1.9, np.nan], rtol=1e-6)
    np.testing.assert_allclose(moment.uncertainty, [0.5 / 20, 0.5 / 20, 0.5 / 11], rtol=1e-6)
    np.testing.assert_allclose(moment.age, [0.0, 0.0, 0.9], atol=1e-5)
    assert [STATES[int(code)] for code in moment.state] == ["anchored", "anchored", "away"]
    assert ("killed on request", 2) in [(event.text, event.node) for event in feed.events(0)[1]]
    assert feed_of(tmp_path, None).topology()["names"] == list(NAMES)  # the folder of the run


def test_a_log_on_a_network_with_places(tmp_path):
    places = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]])
    graph = graphs.chain(3, anchors=(0,))
    graph = type(graph)(3, graph.tail, graph.head, names=NAMES)
    save(Network(graph, np.zeros(3), positions=places, unit="mm"), tmp_path / "net.csv")
    feed = feed_of(logged(tmp_path / "run.mcap"), tmp_path / "net.csv")
    assert (feed.topology()["x"], feed.topology()["y"]) == ([0.0, 1.0, 2.0], [0.0, 0.0, 1.0])
    assert feed.topology()["unit"] == "mm"
    with pytest.raises(ArgumentError, match="does not tell its links"):
        feed_of(tmp_path / "run.mcap", None)


def test_a_log_with_a_newcomer_on_the_network_that_it_joined(tmp_path):
    graph = graphs.chain(3, anchors=(0,))
    graph = type(graph)(3, graph.tail, graph.head, names=NAMES)
    places = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]])
    save(Network(graph, np.zeros(3), positions=places), tmp_path / "net.csv")
    path = tmp_path / "run.mcap"
    logged(path, joined=["new"], hears={**HEARS, "c": ["b", "new"], "new": ["c"]}, anchors=["a", "new"])
    for network in (tmp_path / "net.csv", None):
        topology = feed_of(path, network).topology()
        assert topology["names"] == [*NAMES, "new"]
        assert (topology["joined"], topology["anchored"]) == ([3], [0, 3])
        assert sorted(topology["arcs"]) == [[0, 1], [1, 2], [2, 3]]
    topology = feed_of(path, tmp_path / "net.csv").topology()
    assert topology["x"][:3] == [0.0, 1.0, 2.0]
    refused(
        trigpoint("report", path, "--network", tmp_path / "net.csv", "--animate", tmp_path / "a.gif"), "new joined it"
    )


def test_what_cannot_be_watched(tmp_path):
    with pytest.raises(FileFormatError, match=r"run\.mcap"):
        feed_of(tmp_path, None)
    save(graphs.chain(3), tmp_path / "net.json")
    with pytest.raises(FileFormatError, match="expected a recorded run"):
        feed_of(tmp_path / "net.json", None)


def test_links_of_who_hears_whom():
    graph = links_of(NAMES, {**HEARS, "stranger": ["a"], "c": ["b", "plant"]}, ["c", "stranger"])
    assert graph.names == NAMES
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist(), strict=True)) == [(-1, 2), (0, 1), (1, 2)]


SCENARIO = """
[network]
gallery = { kind = "chain", n = 3, anchors = [0] }
[agent]
A = [[0, 1], [-1, 0]]
C = [[1, 0]]
[design]
method = "local-kalman"
gain = "from-graph"
[simulate]
initial_error = 1.0
initial_state = 1.0
[run]
rate = 20
"""


def test_a_live_run_is_watched_and_obeys(tmp_path):
    (tmp_path / "three.toml").write_text(SCENARIO, encoding="utf-8")
    program = "from trigpoint.cli import main; main()"
    port = free_port()
    options = ["--for", "1h", "--watch", "--port", str(port), "--json", "--out", str(tmp_path)]
    command = [sys.executable, "-c", program, "run", str(tmp_path / "three.toml"), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        try:
            line = next(line for line in run.stderr if "Open http" in line)
            token = re.search(r"token=(\S+)", line)[1]
            with page_at(port, token) as page:
                topology = json.loads(page.recv(timeout=PATIENCE))
                assert (topology["arcs"], topology["anchored"]) == ([[0, 1], [1, 2]], [0])
                assert topology["controls"] == ["pause", "go", "kill", "revive"]
                until_states(page, lambda states: states == ["anchored"] * 3)
                for order, states in (("kill", ("silent",)), ("revive", ("anchored",)), ("pause", ("paused",))):
                    page.send(json.dumps({"type": "order", "order": order, "node": 1}))
                    until_states(page, lambda found, wanted=states: found[1] in wanted)
            run.send_signal(signal.SIGINT)
            out, _ = run.communicate(timeout=PATIENCE)
        finally:
            run.kill()
    assert json.loads(out)["nodes"] == 3
    assert feed_of(tmp_path, None).topology()["arcs"] == [[0, 1], [1, 2]]


def test_a_run_that_goes_on_is_watched_from_outside_and_replayed_when_it_is_over(tmp_path):
    """Two programs: one runs, the other shows its folder, and gives no orders."""
    (tmp_path / "three.toml").write_text(SCENARIO, encoding="utf-8")
    program = "import sys; sys.argv[0] = 'trigpoint'; from trigpoint.cli import main; main()"
    command = [sys.executable, "-c", program]
    out, port = tmp_path / "out", free_port()
    run = subprocess.Popen([*command, "run", str(tmp_path / "three.toml"), "--for", "1h", "--out", str(out)],
                           stdout=subprocess.DEVNULL)  # fmt: skip
    page_of = None
    try:
        assert until((out / "status.json").exists)
        page_of = subprocess.Popen(
            [*command, "watch", str(out), "--port", str(port), "--json"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        told = "".join(page_of.stdout.readline() for _ in range(4))
        assert json.loads(told)["live"] is True
        token = re.search(r"token=([^\"\s]+)", told)[1]
        with page_at(port, token) as page:
            topology = json.loads(page.recv(timeout=PATIENCE))
            assert (topology["mode"], topology["arcs"], topology["controls"]) == ("live", [[0, 1], [1, 2]], [])
            until_states(page, lambda states: states == ["anchored"] * 3)
            run.send_signal(signal.SIGINT)
            assert run.wait(PATIENCE) == 0
            until_said(page, "The run is over.")
    finally:
        for process in (run, page_of):
            if process is not None:
                process.kill()
                process.communicate()
    assert feed_of(out, None).topology()["mode"] == "replay"
    assert not running(out)


def test_nodes_that_were_started_by_hand_are_watched_from_their_folder(tmp_path):
    """Nobody looks after them, and no status or log lies there: the page follows whoever is heard."""
    file, folder, plain = tmp_path / "three.toml", tmp_path / "files", {"stdout": subprocess.DEVNULL}
    file.write_text(SCENARIO, encoding="utf-8")
    assert trigpoint("run", file, "--prepare", folder).exit_code == 0
    program = "import sys; sys.argv[0] = 'trigpoint'; from trigpoint.cli import main; main()"
    settings = sorted((folder / "settings").glob("node-*.json"))
    commands = [[sys.executable, "-c", program, "node", str(one)] for one in settings]
    commands.append([sys.executable, "-m", "trigpoint.runtime", "plant", str(folder / "settings" / "plant.json")])
    started = []
    try:
        started += [subprocess.Popen(command, **plain) for command in commands]
        with attached(folder) as feed:

            def states():
                feed.absorb(feed._source())
                return [STATES[int(state)] for state in decode_moment(feed.frame(0)).state]

            assert until(lambda: states() == ["anchored"] * 3)
            started[0].kill()
            assert until(lambda: states()[1:] == ["relative"] * 2)  # its anchor is gone, and that is all
            assert feed.ended is None
    finally:
        for process in started:
            process.kill()
            process.wait()


def page_at(port, token):
    """The page's connection, as soon as somebody listens."""
    found = []

    def answered():
        with suppress(ConnectionRefusedError):
            address = f"ws://127.0.0.1:{port}/ws?token={token}"
            found.append(connect(address, origin=f"http://127.0.0.1:{port}", proxy=None, open_timeout=PATIENCE))
        return found

    assert until(answered)
    return found[0]


def until_said(page, text):
    """Reads messages until one holds the text."""
    assert until(lambda: isinstance(message := page.recv(timeout=PATIENCE), str) and text in message)


def until_states(page, wanted):
    """Reads frames until the nodes' states are as wanted."""

    def come():
        message = page.recv(timeout=PATIENCE)
        return isinstance(message, bytes) and wanted([STATES[int(code)] for code in decode_moment(message).state])

    assert until(come, within=2.0 * PATIENCE)
