"""``trigpoint run`` and ``trigpoint node`` as a user calls them."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import typer

from tests.cli.shelled import MAIN, trigpoint
from tests.machine import PATIENCE, until, with_time
from tests.runtime.living import CHAIN, log_so_far, ports_of_our_own, runs
from trigpoint.cli import running as running_module
from trigpoint.cli.live import seconds_of
from trigpoint.cli.nodes import node_command
from trigpoint.cli.recorder import Recorder
from trigpoint.errors import ArgumentError
from trigpoint.runtime import LINK_FIELDS, STATUS_FIELDS, Snapshot, State, parse_address, read_log, read_settings

KEYS = {
    "nodes", "processes", "rate", "seconds", "decay_rate_measured", "decay_rate_expected", "decay_rate_predicted",
    "decay_rate", "message_age", "reading_age", "initial_error", "final_error", "relative_error", "heard", "anchored",
    "covered", "dead", "silent", "restarts", "acts", "missed", "step_us", "frames", "bytes", "cpu_per_node",
    "memory_per_process", "memory", "warnings", "log", "readings", "joined",
}  # fmt: skip


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(CHAIN, encoding="utf-8")
    return path


def running(*arguments):
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@contextmanager
def ended_at_last(process):
    """Whatever fails meanwhile: its nodes end with it."""
    try:
        yield
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()


def until_it_listens(process, address):
    place = parse_address(address)

    def listens():
        if place.path:
            return Path(place.path).exists()
        with socket.socket() as caller:
            return caller.connect_ex((place.host, place.port)) == 0

    assert until(lambda: process.poll() is not None or listens())
    assert process.poll() is None, process.communicate()


@pytest.mark.parametrize(
    ("text", "seconds"), [("20s", 20.0), ("500ms", 0.5), ("2min", 120.0), ("1.5 h", 5400.0), (" .25s ", 0.25)]
)
def test_durations(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "20", "s", "0s", "-3s", "3 weeks", "1e3s", "nan s", "20s 5s"])
def test_other_durations_are_refused(text, scenario):
    with pytest.raises(ArgumentError, match="expected a positive number and ms, s, min or h: 20s, 500ms, 2min"):
        seconds_of(text)
    result = trigpoint("run", scenario, f"--for={text}")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: got")


def come_far(path):
    """Whether a log that is being written shows a hundredth of the first errors, and thirty statuses of each node."""
    log = log_so_far(path)
    tables = () if log is None else (log.estimates, log.truths, log.statuses)
    if not tables or any(len(table) < 3 for table in tables):
        return False
    all_known = max(one.received[0] for table in tables[:2] for one in table.values())
    errors = [one.values - log.truths[name].values[-1] for name, one in log.estimates.items()]  # the truth stands still
    first = [one[series.received <= all_known][-1] for one, series in zip(errors, log.estimates.values(), strict=True)]
    near = np.linalg.norm([one[-1] for one in errors]) < 0.01 * np.linalg.norm(first)
    return near and min(map(len, log.statuses.values())) >= 30


def test_a_run_from_start_to_summary(scenario, tmp_path):
    """Ends in order when its terminal closes: the log is whole, the object on standard output too, nobody is left."""
    with_time(lambda attempt: run_to_summary(scenario, tmp_path / f"out-{attempt}"))


def run_to_summary(scenario, out):
    process = running("run", scenario, "--json", "--out", out, "--agents-per-process", 2)
    with ended_at_last(process):
        status = out / "status.json"
        assert until(lambda: process.poll() is not None or come_far(out / "run.mcap"), within=2.0 * PATIENCE)
        assert process.poll() is None, process.communicate()
        pids = [one["pid"] for one in json.loads(status.read_text(encoding="utf-8"))["nodes"].values()]
        assert all(runs(pid) for pid in pids)
        process.send_signal(signal.SIGHUP)
        output, errors = process.communicate(timeout=PATIENCE)
    facts = json.loads(output)
    assert (process.returncode, errors) == (0, "")
    assert set(facts) == KEYS
    assert (facts["nodes"], facts["processes"], facts["rate"]) == (3, 2, 25.0)
    assert (facts["anchored"], facts["covered"], facts["heard"], facts["dead"], facts["silent"]) == (3, 3, 3, [], [])
    assert facts["final_error"] < 0.1 * facts["initial_error"]
    assert facts["acts"] > 30
    page = trigpoint("report", out / "run.mcap")
    assert page.exit_code == 0, page.stderr
    text = (out / "run.live.html").read_text(encoding="utf-8")
    assert "measured decay rate [1/s]" in text
    assert "predicted decay rate, in the long run [1/s]" in text
    assert not any(runs(pid) for pid in pids)
    log = read_log(out / "run.mcap")
    assert log.complete
    assert facts["log"] == str(out / "run.mcap")
    told = {name: log.attributes.get(name) for name in ("decay_rate_predicted", "message_age", "reading_age")}
    assert told == {name: facts[name] for name in told}  # the end tells the log what it tells the user
    ages_are_differences_of_phases(log, facts)


def ages_are_differences_of_phases(log, facts):
    """What ``test_message_age`` finds for drawn phases, delays and stalls, here by the nodes' own words.

    An age is the difference of two phases and whole periods, to period / 2048, as a state is for an instant of the grid
    period / 1024; and some 2**-22 s, which one addition to a time since 1970 is off by, a deadline. So the ages of both
    ways of a link are whole periods together, at least one, and so are their medians: the mean over all links is half a
    period at least. Between the two nodes in one process, which take turns, each way is half a period.
    """
    ages = {}
    for name, series in log.statuses.items():
        rows = [series.row(k)[len(STATUS_FIELDS) :].reshape(-1, len(LINK_FIELDS)) for k in range(len(series))]
        for column, other in enumerate(log.attributes["hears"][name]):
            said = np.array([row[column][:2] for row in rows])
            ages[other, name] = said[said[:, 0] == State.LIVE, 1]
    near = 0.04 / 2048 + 2.0**-22 * (10 + facts["missed"])
    assert len(ages) == 4
    for one, other in (("0", "1"), ("1", "2")):
        pairs = ages[one, other][:, None] + ages[other, one]
        assert pairs.min() > 0.04 - 2.0 * near
        assert np.abs(pairs - 0.04 * np.round(pairs / 0.04)).max() < 2.0 * near
    assert min(ages["0", "1"].min(), ages["1", "0"].min()) > 0.02 - near
    said = np.concatenate(list(ages.values()))
    assert 0.02 - near < facts["message_age"] <= said.max()


@pytest.mark.slow
def test_a_summary_for_people_and_the_place_of_the_log(scenario):
    with_time(lambda _: summary_for_people(scenario))


def summary_for_people(scenario):
    process = running("run", scenario, "--for", "10s")
    with ended_at_last(process):
        output, errors = process.communicate(timeout=2.0 * PATIENCE)
    assert process.returncode == 0, errors
    words = "3 in 3 processes at 25 Hz", "decay rate        measured", "3 of 3", "missed deadlines", "MB a process"
    assert [each for each in words if each not in output] == []
    assert (scenario.parent / "run.mcap").exists()
    assert sorted(path.name for path in scenario.parent.iterdir()) == ["run.mcap", "scenario.toml"]


@pytest.mark.slow
def test_a_node_that_cannot_run_is_told_by_the_exit_code(scenario, tmp_path):
    """Its address lies in a folder that does not exist: it is started again and again, and dead at the end."""
    text = scenario.read_text(encoding="utf-8") + f'addresses = {{ 2 = "unixsock-stream/{tmp_path}/missing/2.sock" }}\n'
    scenario.write_text(text, encoding="utf-8")
    status = tmp_path / "out" / "status.json"

    def tried_again():
        node = json.loads(status.read_text(encoding="utf-8"))["nodes"]["2"] if status.exists() else {"restarts": 0}
        return node["restarts"] >= 3 and node["state"] == "waiting"  # for the next 4 s: it does not run at the end

    process = running("run", scenario, "--out", tmp_path / "out", "--json")
    with ended_at_last(process):
        assert until(lambda: process.poll() is not None or tried_again(), within=2.0 * PATIENCE)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=PATIENCE)
    facts = json.loads(output)
    assert process.returncode == 1
    assert "node 2 was not heard at the end; ended with exit code 2: error: cannot listen" in errors
    assert facts["restarts"] >= 1
    assert "2" in facts["silent"]
    assert facts["final_error"] is None  # not everybody was ever known


def test_the_log_of_an_earlier_run_is_kept(scenario, capsys):
    log = scenario.parent / "run.mcap"
    for number in (1, 2):
        log.write_text(f"run {number}", encoding="utf-8")
        running_module._set_aside(log)
        assert capsys.readouterr().err == f"the log of an earlier run is kept as run-{number}.mcap\n"
    running_module._set_aside(log)
    kept = {path.name: path.read_text(encoding="utf-8") for path in scenario.parent.glob("*.mcap")}
    assert kept == {"run-1.mcap": "run 1", "run-2.mcap": "run 2"}


def test_a_node_says_on_a_terminal_where_it_listens_and_whom_it_hears(scenario, tmp_path, monkeypatch, capsys):
    trigpoint("run", scenario, "--prepare", tmp_path / "files")
    monkeypatch.setattr("trigpoint.cli.nodes.run_nodes", lambda *_, **__: None)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with pytest.raises(typer.Exit):
        node_command([tmp_path / "files" / "settings" / "node-1.json"])
    assert re.fullmatch(
        r"node 1 listens on unixsock-stream/\S+ and hears 0, 2; Ctrl-C ends it\n", capsys.readouterr().err
    )


def test_nothing_runs_where_no_observer_exists(tmp_path):
    path = tmp_path / "floating.csv"
    path.write_text("from,to,value\na,b,1.0\n", encoding="utf-8")
    result = trigpoint("run", path, "--for", "1s", "--json")
    assert result.exit_code == 1
    assert "no observer exists" in result.stderr
    assert json.loads(result.stdout)["nodes"] is None


@pytest.mark.parametrize("transport", ["tcp", "unixsock"])
def test_settings_for_later(scenario, tmp_path, transport, monkeypatch):
    """--prepare writes one file a node and runs nothing; trigpoint node takes one, SIGTERM ends it."""
    monkeypatch.setattr("trigpoint.runtime.plan._free_ports", ports_of_our_own)
    result = trigpoint("run", scenario, "--prepare", tmp_path / "files", "--transport", transport, "--json")
    assert result.exit_code == 0, result.stderr
    files = json.loads(result.stdout)
    assert set(files["nodes"]) == {"0", "1", "2"}
    assert not (tmp_path / "run.mcap").exists()
    listing = trigpoint("run", scenario, "--prepare", tmp_path / "files", "--transport", transport).stdout
    assert "1: trigpoint node" in listing
    process = running("node", files["nodes"]["1"])
    until_it_listens(process, read_settings(Path(files["nodes"]["1"])).listen)
    process.send_signal(signal.SIGTERM)
    output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, output, errors) == (0, "", "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "{scenario}", "--rate", "-1"], "--rate: got -1.0, expected greater than 0"),
        (["run", "{scenario}", "--transport", "pigeon"], "--transport: got 'pigeon', expected 'unixsock', 'tcp'"),
        (["run", "{scenario}", "--agents-per-process", "0"], "--agents-per-process: got 0, expected greater than"),
        (["run", "nothing.toml"], "nothing.toml: there is no such file"),
        (["node", "nothing.json"], "nothing.json: no node settings"),
        (["node", "{scenario}"], "no node settings: got no JSON, expected what run --prepare wrote"),
        (["node", "{node}", "--peer", "0"], "--peer: got '0', expected NAME=ADDRESS"),
        (["node", "{node}", "--peer", "0=nowhere"], "address 'nowhere'"),
        (["node", "{node}", "--peer", "stranger=tcp/127.0.0.1:9"], "--peer names 'stranger', no neighbour of '1'"),
        (["node", "{node}", "{node}", "--listen", "tcp/127.0.0.1:9"], "--listen is one address; give one file"),
        (["node", "{node}", "--listen", "tcp/192.0.2.1:9"], "plain text that anybody there can read and forge"),
    ],
)
def test_misuse(arguments, words, scenario, tmp_path):
    trigpoint("run", scenario, "--prepare", tmp_path / "files", "--transport", "tcp")
    places = {"scenario": scenario, "node": tmp_path / "files" / "settings" / "node-1.json"}
    result = trigpoint(*(text.format(**places) for text in arguments))
    assert result.exit_code == 2
    assert words in result.stderr
    assert not (tmp_path / "run.mcap").exists()


def test_plain_text_beyond_the_machine_needs_leave_and_warns(scenario, tmp_path):
    text = scenario.read_text(encoding="utf-8") + 'transport = "tcp"\naddresses = { 0 = "tcp/192.0.2.1:7447" }\n'
    scenario.write_text(text, encoding="utf-8")
    refused = trigpoint("run", scenario, "--prepare", tmp_path / "files")
    assert refused.exit_code == 2
    assert "plain text" in refused.stderr
    allowed = trigpoint("run", scenario, "--prepare", tmp_path / "files", "--allow-plain")
    assert allowed.exit_code == 0, allowed.stderr
    assert "warning: tcp/192.0.2.1:7447 is plain text" in allowed.stderr


def test_what_the_simulation_alone_has_is_said(scenario, tmp_path):
    text = scenario.read_text(encoding="utf-8").replace("[simulate]", "[simulate]\nperiod = 0.1\nloss = 0.5")
    scenario.write_text(text, encoding="utf-8")
    result = trigpoint("run", scenario, "--prepare", tmp_path / "files")
    assert "[simulate] loss: not used" in result.stderr


def snapshot(time, value, known=None):
    known = known or (np.array([value]), np.array([value, 1.0]))
    nothing = (np.zeros(1), np.zeros(2))
    return Snapshot(time, ("a", "b"), known, nothing, (None, None), np.zeros(2), np.zeros(2))


def test_samples_are_thinned_out():
    recorder = Recorder(("a", "b"), 0.1, most=50)
    assert recorder.run() is None
    for k in range(4000):
        recorder.take(snapshot(0.01 * k, np.exp(-0.3 * 0.01 * k)))
    run = recorder.run()
    assert run.times.shape[0] < 50
    assert run.times[-1] > 35.0
    assert run.truth.shape[1:] == (2, 2)
    gap = run.estimate[:, 0, 0]
    np.testing.assert_allclose(gap, np.exp(-0.3 * run.times))


def test_a_recorded_run_begins_when_every_node_is_known():
    """As that of its log does: by ``first_known``; nodes of fewer states are filled up with zeros."""
    recorder = Recorder(("a", "b"), 0.1)
    recorder.take(snapshot(0.0, 2.0, known=(None, None)))
    recorder.take(snapshot(0.2, 2.0, known=(np.array([5.0]), None)))
    assert recorder.run() is None
    recorder.take(snapshot(0.25, 2.0))  # not due yet
    recorder.take(snapshot(0.4, 2.0))
    recorder.take(snapshot(0.6, 1.0))
    run = recorder.run()
    assert run.times.tolist() == [0.4, 0.6]
    assert run.estimate[0].tolist() == [[2.0, 0.0], [2.0, 1.0]]
    assert (run.status == "anchored").all()
    assert np.isfinite(run.error_norm).all()


def test_a_method_that_nobody_knows_is_told_with_its_line(scenario):
    text = scenario.read_text(encoding="utf-8")
    scenario.write_text(text + '\n[design]\nmethod = "local-calman"\n', encoding="utf-8")
    result = trigpoint("run", scenario, "--for", "1s")
    assert result.exit_code == 2
    line = scenario.read_text(encoding="utf-8").splitlines().index('method = "local-calman"') + 1
    assert f"scenario.toml:{line}: " in result.stderr
