"""``[simulate]`` with channels, clocks, topologies and motion, from the file to the run."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

import trigpoint as tp
from tests.cli.shelled import trigpoint


def run(*arguments):
    return trigpoint(*[str(argument) for argument in arguments])


NETWORK = """
[network]
gallery = {kind = "grid", rows = 2, cols = 3, anchors = [0]}
[agent]
A = [[0, 1], [-1, 0]]
C = [[1, 0]]
[simulate]
horizon = 2.0
samples = 11
"""


@pytest.mark.parametrize(
    ("extra", "path"),
    [
        ("period = 0.1\nchannel = {loss = 0.1, delay = 0.05, old = 'propagate', stale = 1.0}", "reference"),
        ("period = 0.1\nchannel = {delay = 0.05, quantum = 0.01, span = 8}", "stacked"),
        (
            "period = 0.1\nchannel = {bursts = {begin = 0.1, end = 0.5}, outages = [{start = 0.5, stop = 1}]}",
            "reference",
        ),
        ("period = 0.1\nchannel = {outages = [{start = 0.5, stop = 1, links = [['0', '1']]}]}", "reference"),
        ("period = 0.1\nclocks = {drift = 1e-4, period = [0.1, 0.1, 0.2, 0.2, 0.1, 0.1]}", "reference"),
        ("topology = {dwell = 0.25, arrival = 0.7, seed = 3}", "modal"),
        ("topology = {changes = [{time = 0, arcs = [0, 1, 2]}, {time = 1, arcs = [3, 4, 5, 6, 7]}]}", "modal"),
        ("absences = [{node = '4', start = 0.5, stop = 1.5}, {node = '2', start = 1}]", "modal"),
        ("period = 0.1\nchannel = {old = 'use'}\ntrigger = {size = 0.3, rate = 0.1}", "reference"),
        ("noise = {measurement = 0.1, process = 0.1}", "modal"),
    ],
)
def test_trouble_is_read_from_the_file(extra, path, tmp_path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(NETWORK + extra + "\n", encoding="utf-8")
    done = run("simulate", file, "--json", "--out", tmp_path / "run.npz")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["path"] == path
    assert tp.load(tmp_path / "run.npz").path == path


def test_motion_from_a_file_and_bouncing(tmp_path) -> None:
    file = tmp_path / "s.toml"
    table = (
        "t,"
        + ",".join(f"s{k}" for k in range(12))
        + "\n0,"
        + ",".join(["1"] * 12)
        + "\n# half\n2,"
        + ",".join(["3"] * 12)
    )
    (tmp_path / "motion.csv").write_text(table + "\n", encoding="utf-8")
    file.write_text(NETWORK + "motion = {file = 'motion.csv'}\n", encoding="utf-8")
    assert run("simulate", file, "--out", tmp_path / "run.npz").exit_code == 0
    np.testing.assert_allclose(tp.load(tmp_path / "run.npz").truth[5], 2.0)
    plane = NETWORK.replace(
        "A = [[0, 1], [-1, 0]]\nC = [[1, 0]]",
        "A = [[0,0,1,0],[0,0,0,1],[0,0,0,0],[0,0,0,0]]\nC = [[1,0,0,0],[0,1,0,0]]",
    )
    file.write_text(plane + "motion = {side = 2.0, seed = 4}\n", encoding="utf-8")
    assert run("simulate", file, "--out", tmp_path / "run.npz").exit_code == 0
    truth = tp.load(tmp_path / "run.npz").truth
    near = file.read_text(encoding="utf-8") + "topology = {radius = 1.5}\n"
    file.write_text(near, encoding="utf-8")
    assert run("simulate", file, "--out", tmp_path / "near.npz").exit_code == 0
    switched = tp.load(tmp_path / "near.npz")
    assert switched.lambda_min.min() < switched.lambda_min.max() + 1e-12
    np.testing.assert_array_equal(switched.truth, truth)
    moving = ("--network", file, "--animate", tmp_path / "near.gif", "--frames", 3, "--json")
    shown = run("report", tmp_path / "near.npz", *moving)
    assert json.loads(shown.stdout) == {
        "report": str(tmp_path / "near.html"),
        "animation": str(tmp_path / "near.gif"),
    }
    assert (tmp_path / "near.gif").read_bytes()[:6] == b"GIF89a"
    assert "Connectivity" in (tmp_path / "near.html").read_text(encoding="utf-8")
    for options, words in (
        (("--animate", tmp_path / "x.gif"), "--animate needs the run's network"),
        (("--animate", tmp_path / "x.avi", "--network", file), "ending in .gif or .html or .mp4"),
        (("--animate", tmp_path / "near.html", "--network", file), "name one of them otherwise"),
    ):
        refused = run("report", tmp_path / "near.npz", *options)
        assert refused.exit_code == 2
        assert words in refused.stderr
    file.write_text(near.replace("motion = {side = 2.0, seed = 4}\n", ""), encoding="utf-8")
    assert "belongs to bouncing agents" in run("simulate", file).stderr
    assert (truth[:, :, :2] >= 0).all()
    assert (truth[:, :, :2] <= 2.0).all()


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("loss = 0.1\nperiod = 0.1\nchannel = {delay = 0.1}", "got loss beside channel"),
        ("period = 0.1\nchannel = {dely = 0.1}", "did you mean 'delay'"),
        ("period = 0.1\nchannel = {old = 'keep'}", "old"),
        ("absences = [{node = 'Z', start = 1}]", "names the node 'Z'; the nodes are 0, 1, 2"),
        ("absences = [{node = 'Z', start = 1}, {node = '1', start = 2, stop = 1}]", "expected start < stop"),
        ("absences = [{node = {a = 1}, start = 1}]", "got {'a': 1}, expected the name of a node"),
        ("period = 0.1\nchannel = {outages = [{start = 0, stop = 1, links = [['0', 'Q']]}]}", "names the node 'Q'"),
        ("channel = {delay = 0.1}", "channel needs sampled exchange: give a period"),
        ("clocks = {drift = 0.1}", "clocks need sampled exchange: give a period"),
        ("period = 0.1\nclocks = {drift = [1, 2]}", "drift of the clocks must be one number or 6"),
        ("period = 0.1\ngossip = true", "gossip is for constants"),
        ("initial_error = [1, 2]", "initial_error must be a scalar"),
        ("topology = {radius = 1.5}", "belongs to bouncing agents"),
        ("topology = {dwell = 1.0}", "expected either dwell and arrival, or changes"),
        ("motion = {seed = 1}", "expected either a file or a side"),
        ("motion = {side = 1.0}", "bouncing agents have 4 states"),
        ("motion = {file = 'none.csv'}", "there is no such file"),
        ("motion = {file = 'bad.csv'}", "bad.csv:2: got 'x,y', expected numbers separated by commas"),
        ("motion = {file = 'short.csv'}", "got 2 numbers, expected the time and 6 x 2 states"),
        ("motion = {file = 'empty.csv'}", "holds no row of numbers"),
        ("period = 0.1\nchannel = {outages = [{start = 0, stop = 1, links = [['0']]}]}", "must be pairs"),
    ],
)
def test_what_does_not_fit_is_an_error_with_its_reason(extra, words, tmp_path) -> None:
    for name, text in (("bad", "0," + ",".join(["1"] * 12) + "\nx,y\n"), ("short", "0,1\n"), ("empty", "# nothing\n")):
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    file = tmp_path / "s.toml"
    file.write_text(NETWORK + extra + "\n", encoding="utf-8")
    done = run("simulate", file)
    assert done.exit_code == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    elsewhere = {"none.csv", "bad.csv", "short.csv", "empty.csv"} & set(extra.split("'"))
    last = NETWORK.count("\n") + extra.count("\n") + 1
    line = NETWORK.splitlines().index("[simulate]") + 1 if "beside" in words else last
    assert elsewhere or done.stderr.startswith(f"error: {file}:{line}: ")


def test_a_topology_needs_arcs_and_an_end(tmp_path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(
        "[plant]\nA = [[0, 1], [-1, 0]]\noutputs = [[[1, 0]], [[0, 1]]]\nneighbours = [[1], [0]]\n"
        "[simulate]\nhorizon = 1.0\ntopology = {dwell = 0.1, arrival = 0.5}\n",
        encoding="utf-8",
    )
    done = run("simulate", file)
    assert done.exit_code == 2
    assert "use outages of links" in done.stderr
    file.write_text(
        NETWORK.replace("horizon = 2.0\nsamples = 11\n", "topology = {dwell = 1.0, arrival = 0.5}\n"), encoding="utf-8"
    )
    assert "a random topology, or one by radius, needs a horizon or times" in run("simulate", file).stderr


def test_progress_on_a_terminal_changes_no_number(monkeypatch, tmp_path) -> None:
    """A run computes while it is gone through: the bar must take nothing before it is due."""
    from trigpoint.cli.shell import tracked

    problem = tp.NetworkedAgents(tp.graphs.chain(3), tp.LinearAgent.static())
    observer = tp.design(problem, tp.methods.LocalKalman())
    scenario = tp.Scenario([0.0, 0.5, 1.0], period=0.1, channel=tp.Channel(loss=0.2))
    plain = tp.simulate(problem, observer, scenario)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    barred = tp.simulate(problem, observer, scenario, progress=tracked("simulating"))
    assert plain.error_norm[0] > barred.error_norm[-1]
    np.testing.assert_array_equal(plain.estimate, barred.estimate)
    assert list(tracked("counting")(range(3))) == [0, 1, 2]


DESIGNS = [
    ('method = "local-kalmann"', "did you mean 'local-kalman'?"),
    ('method = "sampled"', "needs 'period' in [design]"),
    ('method = "centralised"\nscheme = "abc"', "scheme of this method is one of full, reduced, extended; got 'abc'"),
    ('method = "sampled"\nperiod = 0.1\nscheme = "abc"', "one of held, euler, innovation-held; got 'abc'"),
    ('method = "accelerated"\nscheme = "abc"', "one of heavy-ball, chebyshev, second-order; got 'abc'"),
    ('method = "local-kalman"\nrate = 3.0', "'rate' does not belong to the method 'local-kalman'"),
    ('gain = "worst-case"', "needs max_nodes"),
    ('method = "brasch-pearson"', "needs 'eigenvalues'"),
]


@pytest.mark.parametrize(("extra", "words"), DESIGNS)
@pytest.mark.parametrize("command", ["design", "simulate"])
def test_a_design_that_does_not_fit_has_its_line(command, extra, words, tmp_path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(NETWORK + "[design]\n" + extra + "\n", encoding="utf-8")
    done = run(command, file)
    assert done.exit_code == 2
    assert words in done.stderr
    last = NETWORK.count("\n") + 1 + extra.count("\n") + 1  # where the slip stands
    assert done.stderr.startswith(f"error: {file}:{last}: ")


def test_an_option_of_the_command_line_has_no_line(tmp_path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(NETWORK + '[design]\nmethod = "local-kalman"\n', encoding="utf-8")
    said = run("design", file, "--method", "samplde").stderr
    assert said.startswith("error: no design method is called 'samplde'")
    assert "did you mean 'sampled'?" in said


def test_where_a_run_shall_go_is_checked_before_it_is_computed(monkeypatch, tmp_path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(NETWORK, encoding="utf-8")
    monkeypatch.setattr("trigpoint.cli.simulating.simulate", lambda *_, **__: pytest.fail("it was computed"))
    for module, name in (("h5netcdf", "t1.nc"), ("zarr", "t1.zarr"), ("jinja2", "t1.html"), ("matplotlib", "t1.html")):
        with monkeypatch.context() as patched:
            patched.setitem(sys.modules, module, None)
            assert "which is not installed" in run("simulate", file, "--out", tmp_path / name).stderr
    assert "expected a file name ending in" in run("simulate", file, "--out", tmp_path / "t1.csv").stderr


def test_an_interrupted_run_is_kept_and_said_to_be_short(tmp_path, monkeypatch) -> None:
    def ending(name):
        def some(ticks):
            for count, tick in enumerate(ticks):
                if count == 12:
                    raise KeyboardInterrupt
                yield tick

        return some

    file = tmp_path / "s.toml"
    file.write_text(NETWORK + "period = 0.1\nchannel = {loss = 0.1}\n", encoding="utf-8")
    monkeypatch.setattr("trigpoint.cli.simulating.tracked", ending)
    done = run("simulate", file, "--out", tmp_path / "run.npz")
    assert done.exit_code == 130, done.stderr
    assert done.stderr == "interrupted: 6 of 11 samples are kept, up to 1 of 2 s\n"
    assert tp.load(tmp_path / "run.npz").times.tolist() == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])


def test_an_error_that_grows_is_not_passed_over(tmp_path) -> None:
    file = tmp_path / "s.toml"
    drifting = NETWORK.replace("[-1, 0]", "[0, 0]")
    file.write_text(drifting + "period = 0.01\nchannel = {loss = 0.1}\n", encoding="utf-8")
    assert "grew" not in run("simulate", file, "--horizon", 20.0).stderr
    done = run("simulate", file, "--gain", 0.01)
    assert done.exit_code == 0
    assert done.stderr.startswith("the error grew from ")


def test_an_outage_of_what_is_no_link_is_a_slip(tmp_path) -> None:
    file = tmp_path / "s.toml"
    outage = 'channel = {outages = [{start = 0.5, stop = 1.0, links = [["0", "5"]]}]}\n'
    file.write_text(NETWORK + "period = 0.1\n" + outage, encoding="utf-8")
    done = run("simulate", file)
    assert done.exit_code == 2
    assert "an outage names the link 0 -> 5, but node 5 does not hear 0" in done.stderr
