"""Every command with good input, for people and for scripts."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

import trigpoint as tp
from tests.cli.shelled import FLOATING, GKF, NETWORK, SCENARIO, json_of, process, refused, trigpoint, written
from trigpoint.cli import app

CHECK_KEYS = {
    "nodes",
    "arcs",
    "anchors",
    "components",
    "verdict",
    "detectable",
    "findings",
    "lambda_min",
    "gain_bound",
    "worst_case_gain",
}
COMMANDS = [
    "check",
    "estimate",
    "design",
    "certify",
    "verify",
    "simulate",
    "convert",
    "report",
    "watch",
    "reproduce",
    "demo",
]


@pytest.fixture
def network(tmp_path: Path) -> Path:
    return written(tmp_path, "network.csv", NETWORK)


@pytest.fixture
def floating(tmp_path: Path) -> Path:
    return written(tmp_path, "floating.csv", FLOATING)


def test_check_says_observable_with_exit_code_0(network: Path) -> None:
    result = trigpoint("check", network, "--json")
    facts = json_of(result)
    assert result.exit_code == 0
    assert facts.keys() >= CHECK_KEYS
    assert (facts["nodes"], facts["arcs"], facts["anchors"], facts["verdict"]) == (3, 4, 1, "observable")
    assert facts["components"] == [{"nodes": ["a", "b", "c"], "anchored": True}]
    assert facts["lambda_min"]["lower"] <= 2 - np.sqrt(3) <= facts["lambda_min"]["upper"]
    assert facts["gain_bound"] == pytest.approx(2 + np.sqrt(3))
    assert facts["worst_case_gain"] == pytest.approx(tp.worst_case_gain(3))
    assert result.stderr == ""


def test_check_says_unobservable_with_exit_code_1_and_a_remedy(floating: Path) -> None:
    result = trigpoint("check", floating, "--json")
    facts = json_of(result)
    assert result.exit_code == 1
    assert facts["verdict"] == "unobservable"
    assert facts["detectable"] is False
    assert facts["gain_bound"] is None
    assert facts["lambda_min"] == {"value": 0.0, "lower": 0.0, "upper": 0.0}
    assert [component["anchored"] for component in facts["components"]] == [True, False]
    assert {"kind", "nodes", "text", "remedy"} <= facts["findings"][0].keys()
    assert facts["findings"][0]["nodes"] == ["c", "d"]
    assert all(finding["remedy"] for finding in facts["findings"])
    shown = trigpoint("check", floating)
    assert shown.exit_code == 1
    assert facts["findings"][0]["text"] in shown.stdout


def test_check_weighted_uses_the_sigmas(network: Path) -> None:
    plain, weighted = (json_of(trigpoint("check", network, "--json", *more)) for more in ((), ("--weighted",)))
    assert plain["verdict"] == weighted["verdict"]
    assert plain["lambda_min"] != weighted["lambda_min"]


def test_check_reads_a_scenario_with_its_agent(tmp_path: Path) -> None:
    path = written(tmp_path, "s.toml", SCENARIO.replace("C = [[1, 0]]", "C = [[0, 1]]"))
    result = trigpoint("check", path, "--json")
    assert result.exit_code == 1
    assert json_of(result)["verdict"] == "unobservable"


def test_estimate_gives_values_sigmas_and_a_table(network: Path, tmp_path: Path) -> None:
    out = tmp_path / "answer.csv"
    result = trigpoint("estimate", network, "--json", "--out", out)
    facts = json_of(result)
    answer = tp.estimate(tp.load(network))
    assert result.exit_code == 0
    assert facts["degrees_of_freedom"] == 1
    assert facts["variance_factor"] == pytest.approx(answer.variance_factor)
    for name, value, sigma in zip(answer.names, answer.x, answer.sigma, strict=True):
        assert facts["estimates"][name] == {"value": [value], "sigma": [sigma], "status": "anchored"}
    rows = list(csv.DictReader(io.StringIO(out.read_text(encoding="utf-8"))))
    assert [row["node"] for row in rows] == ["a", "b", "c"]
    assert [float(row["value"]) for row in rows] == answer.x.tolist()
    shown = trigpoint("estimate", network)
    assert "1.501667" in shown.stdout
    assert "degrees of freedom 1" in shown.stdout


def test_estimate_of_an_unanchored_part_is_relative_with_exit_code_1(floating: Path) -> None:
    result = trigpoint("estimate", floating, "--json")
    entry = json_of(result)["estimates"]["d"]
    assert result.exit_code == 1
    assert entry["status"] == "relative"
    assert entry["reference"] == "c"
    assert entry["value"] == [pytest.approx(0.25)]
    shown = trigpoint("estimate", floating)
    assert shown.exit_code == 1
    assert "relative to it" in shown.stdout


def test_estimate_a_priori_keeps_the_stated_sigmas(network: Path) -> None:
    facts = json_of(trigpoint("estimate", network, "--json", "--a-priori"))
    assert facts["sigma_kind"] == "a-priori"
    assert json_of(trigpoint("estimate", network, "--json"))["sigma_kind"] == "a-posteriori"


def test_estimate_alarms_where_m0_does_not_fit_the_stated_sigmas(network: Path, tmp_path: Path) -> None:
    rows = (
        "from,to,value,sigma\n,a,0,\na,b,1.05,0.002\nb,c,1,0.002\nc,d,1,0.002\na,d,3,0.002\na,c,2,0.002\nb,d,2,0.002\n"
    )
    blunder = written(tmp_path, "blunder.csv", rows)
    shown = trigpoint("estimate", blunder)
    assert shown.exit_code == 0
    assert "does not fit the stated sigmas (3 degrees of freedom, p 3.9e-67)" in shown.stdout
    assert "a blunder, or sigmas too small" in shown.stdout
    assert "suspect: a -> b, standardized residual 17.68 (by the stated sigmas)" in shown.stdout
    facts = json_of(trigpoint("estimate", blunder, "--json"))
    assert set(facts["global_test"]) == {"statistic", "degrees_of_freedom", "p_value", "level", "passes"}
    assert facts["global_test"]["passes"] is False
    assert facts["suspects_kind"] == "a-priori"
    assert facts["suspects"][0]["row"] == 1
    clean = json_of(trigpoint("estimate", network, "--json"))
    assert clean["global_test"]["passes"] is True
    unstated = written(tmp_path, "unstated.csv", "from,to,value\n,a,0\na,b,1\nb,c,1\na,c,2.5\n")
    assert json_of(trigpoint("estimate", unstated, "--json"))["global_test"] is None
    assert "stated sigmas" not in trigpoint("estimate", unstated).stdout


def test_estimate_without_values_is_refused(tmp_path: Path) -> None:
    refused(trigpoint("estimate", written(tmp_path, "s.toml", SCENARIO)), "no measured values")


def test_design_gives_gain_and_rate(network: Path) -> None:
    result = trigpoint("design", network, "--json", "--certify")
    facts = json_of(result)
    assert result.exit_code == 0
    assert facts["method"] == "local-kalman"
    assert facts["gain"] == pytest.approx(1.05 * (2 + np.sqrt(3)))
    assert facts["decay_rate"] == pytest.approx(1.05)
    assert facts["spectral_abscissa"] <= -facts["decay_rate"] * (1 - 1e-9)
    assert facts["certificate"] == {"verdict": "certified"}
    shown = trigpoint("design", network, "--certify").stdout
    assert "certificate: certified" in shown
    assert "1.05 / lambda_min" in shown


def test_design_without_a_certificate_says_so(network: Path) -> None:
    assert json_of(trigpoint("design", network, "--json"))["certificate"] == {"verdict": None}


def test_design_of_an_unanchored_network_is_exit_code_1(floating: Path, tmp_path: Path) -> None:
    result = trigpoint("design", floating, "--json", "--certify", "--out", tmp_path / "design")
    assert result.exit_code == 1
    assert json_of(result)["certificate"] == {"verdict": None}
    assert "no observer exists" in result.stderr
    assert not (tmp_path / "design").exists()


def test_design_with_too_small_a_gain_is_inconclusive_with_exit_code_3(tmp_path: Path) -> None:
    path = written(tmp_path, "s.toml", SCENARIO)
    result = trigpoint("design", path, "--gain", "1e-3", "--certify", "--json", "--out", tmp_path / "weak")
    assert result.exit_code == 3
    assert json_of(result)["certificate"] == {"verdict": "inconclusive"}
    for command, name in (("certify", "observer.json"), ("verify", "certificate.json")):
        result = trigpoint(command, tmp_path / "weak" / name, "--json")
        assert result.exit_code == 3
        assert json_of(result)["verdict"] == "inconclusive"


@pytest.mark.parametrize("scenario", [True, False])
def test_a_certified_design_is_verified_from_its_folder(tmp_path: Path, network: Path, scenario: bool) -> None:
    path = written(tmp_path, "s.toml", SCENARIO) if scenario else network
    folder = tmp_path / "new" / "design"
    assert trigpoint("design", path, "--certify", "--out", folder).exit_code == 0
    assert sorted(p.name for p in folder.iterdir()) == ["certificate.json", "observer.json", "problem.json"]
    verified = trigpoint("verify", folder / "certificate.json", "--json")
    assert verified.exit_code == 0
    facts = json_of(verified)
    assert facts["verdict"] == "certified"
    assert [claim["verdict"] for claim in facts["claims"]] == ["certified"] * 3
    assert trigpoint("verify", folder / "certificate.json").stdout.count("certified: ") == 3
    again = trigpoint("certify", folder / "observer.json", "--json", "--out", folder / "certificate.json")
    assert again.exit_code == 0
    assert json_of(again)["verdict"] == "certified"
    assert trigpoint("verify", folder / "certificate.json").exit_code == 0


def test_simulate_gives_the_promised_numbers(network: Path, tmp_path: Path) -> None:
    result = trigpoint("simulate", network, "--json", "--seed", 3)
    facts = json_of(result)
    assert result.exit_code == 0
    assert facts.keys() >= {"path", "time_to_1_percent", "final_error", "decay_rate_measured"}
    shown = trigpoint("simulate", network, "--horizon", 2, "--out", tmp_path / "run.html")
    assert "not reached" in shown.stdout
    assert (tmp_path / "run.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_what_a_file_states_and_what_an_option_states_go_together(tmp_path: Path) -> None:
    """Covariances and times are arrays once the file is read; an option beside them reads them once more."""
    choices = "[design]\nprocess = [[1e-4, 0], [0, 1e-4]]\nmeasurement = 0.5\n[simulate]\ntimes = [0.0, 1.0, 2.0]\n"
    path = written(tmp_path, "s.toml", SCENARIO + choices)
    gains = [json_of(trigpoint("design", path, "--margin", m, "--json"))["gain"] for m in (1.5, 3.0)]
    assert gains[1] == pytest.approx(2.0 * gains[0])
    assert json_of(trigpoint("simulate", path, "--period", 0.01, "--json"))["path"] == "stacked"


def test_an_island_stops_no_check(tmp_path: Path) -> None:
    """Its verdict and its advice are what is needed then; only losses cannot be studied."""
    path = written(tmp_path, "n.csv", "from,to,value\n,A,1.0\nA,B,1.0\nC,D,1.0\n")
    result = trigpoint("check", path, "--what-if", "--recommend", 1, "--json")
    facts = json_of(result)
    assert (result.exit_code, facts["verdict"], facts["what_if"]) == (1, "unobservable", None)
    assert facts["recommendation"][0]["node"] in {"C", "D"}
    assert result.stderr.startswith("--what-if is left out: ")
    shown = trigpoint("check", path, "--what-if", "--recommend", 1)
    assert (shown.exit_code, "nodes C, D have no path to an absolute reading" in shown.stdout) == (1, True)


def test_simulate_is_repeatable_for_a_seed(tmp_path: Path) -> None:
    path = written(tmp_path, "s.toml", SCENARIO + "[simulate]\nhorizon = 5.0\nnoise = { measurement = 0.1 }\n")
    first, again, other = (
        json_of(trigpoint("simulate", path, "--json", "--period", 0.1, "--seed", s)) for s in (1, 1, 2)
    )
    assert first == again
    assert first["final_error"] != other["final_error"]


def test_simulate_without_an_observer_is_exit_code_1(floating: Path) -> None:
    result = trigpoint("simulate", floating, "--json")
    assert result.exit_code == 1
    assert json_of(result)["final_error"] is None


def test_a_run_is_kept_and_reported(network: Path, tmp_path: Path) -> None:
    run = tmp_path / "run.npz"
    assert trigpoint("simulate", network, "--out", run).exit_code == 0
    result = trigpoint("report", run, "--json")
    assert result.exit_code == 0
    assert json_of(result) == {"report": str(run.with_suffix(".html"))}
    assert run.with_suffix(".html").stat().st_size > 1000
    elsewhere = tmp_path / "other.html"
    assert str(elsewhere) in trigpoint("report", run, "--out", elsewhere).stdout
    assert elsewhere.is_file()


def test_watch_refuses_what_it_cannot_replay(network: Path, tmp_path: Path) -> None:
    run = tmp_path / "run.npz"
    trigpoint("simulate", network, "--horizon", 1, "--out", run)
    other = written(tmp_path, "other.csv", NETWORK.replace("c", "z"))
    refused(trigpoint("watch", run, other), "other.csv", "node names differ")
    refused(trigpoint("watch", network, network), "expected a recorded run")
    refused(trigpoint("watch", tmp_path / "none.npz", network), "none.npz")


@pytest.mark.parametrize("suffix", ["csv", "tsv", "json", "graphml"])
def test_convert_keeps_the_network(network: Path, tmp_path: Path, suffix: str) -> None:
    target = tmp_path / f"target.{suffix}"
    result = trigpoint("convert", network, target, "--json")
    assert result.exit_code == 0
    assert json_of(result) == {"from": str(network), "to": str(target)}
    before, after = (json_of(trigpoint("estimate", path, "--json")) for path in (network, target))
    assert after["estimates"] == before["estimates"]


def test_convert_reads_and_writes_gama(tmp_path: Path) -> None:
    source = written(tmp_path, "n.gkf", GKF)
    assert "written to" in trigpoint("convert", source, tmp_path / "again.gkf").stdout
    result = trigpoint("estimate", tmp_path / "again.gkf", "--json")
    assert json_of(result)["estimates"]["B"]["value"] == [pytest.approx(11.5)]


def test_convert_makes_no_network_of_a_run(network: Path, tmp_path: Path) -> None:
    trigpoint("simulate", network, "--horizon", 1, "--out", tmp_path / "run.npz")
    refused(trigpoint("convert", tmp_path / "run.npz", tmp_path / "t.csv"), "holds a recorded run", ".npz, .nc, .zarr")


def test_convert_writes_no_scenario(network: Path, tmp_path: Path) -> None:
    refused(trigpoint("convert", network, tmp_path / "t.toml"), "written by hand")
    refused(trigpoint("convert", network, tmp_path / "t.docx"), ".docx")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["network.csv"]


def test_help_lists_every_command() -> None:
    result = trigpoint("--help")
    assert result.exit_code == 0
    for command in COMMANDS:
        assert f" {command} " in result.stdout
    assert "2 misuse or bad input" in result.stdout.replace("\n", " ")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str) -> None:
    result = trigpoint(command, "--help")
    assert result.exit_code == 0
    assert f"trigpoint {command}" in result.stdout
    assert command == "watch" or "--json" in result.stdout


def test_the_version_is_that_of_the_package() -> None:
    assert trigpoint("--version").stdout == f"trigpoint {tp.__version__}\n"


def test_no_or_an_unknown_command_is_misuse() -> None:
    assert trigpoint().exit_code == 2
    assert trigpoint("chekc").exit_code == 2
    assert trigpoint("check").exit_code == 2
    assert trigpoint("check", "a.csv", "--frobnicate").exit_code == 2


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--gain", "nan"), "--gain"),
        (("--gain", "-1"), "--gain"),
        (("--gain", "soon"), "soon"),
        (("--gain", "inf"), "gamma"),
        (("--margin", "1"), "margin"),
        (("--margin", "inf"), "margin"),
        (("--margin", "0.5"), "--margin"),
        (("--method", "magic"), "local-kalman"),
        (("--weights", "heavy"), "--weights"),
        (("--gain", "worst-case"), "--max-nodes"),
        (("--gain", "worst-case", "--max-nodes", "2"), "at most max_nodes = 2"),
        (("--max-nodes", "0"), "--max-nodes"),
        (("--horizon", "0"), "--horizon"),
        (("--horizon", "nan"), "--horizon"),
        (("--horizon", "inf"), "--horizon"),
        (("--period", "inf"), "--period"),
        (("--period", "-1"), "--period"),
        (("--seed", "-1"), "--seed"),
    ],
)
def test_options_out_of_range_are_one_error_line(network: Path, options: tuple[str, ...], word: str) -> None:
    refused(trigpoint("simulate", network, "--json", *options), word)


def test_json_is_alone_on_standard_output_of_a_real_process(tmp_path: Path) -> None:
    written(tmp_path, "floating.csv", FLOATING)
    done = process("design", "floating.csv", "--json", cwd=tmp_path)
    assert done.returncode == 1
    assert json.loads(done.stdout)["gain"] is None
    assert done.stderr.startswith("no observer exists")


def test_errors_are_alone_on_standard_error_of_a_real_process(tmp_path: Path) -> None:
    done = process("check", "none.csv", "--json", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == "error: none.csv: there is no such file; check the name and the folder\n"


def test_a_completion_script_is_produced(tmp_path: Path) -> None:
    script = process(cwd=tmp_path, _TRIGPOINT_COMPLETE="source_bash")
    assert script.returncode == 0
    assert "COMPREPLY" in script.stdout
    assert "complete -o default -F _trigpoint_completion trigpoint" in script.stdout
    answer = process(cwd=tmp_path, _TRIGPOINT_COMPLETE="complete_bash", COMP_WORDS="trigpoint rep", COMP_CWORD="1")
    assert answer.stdout.split() == ["report", "reproduce"]


def test_every_command_has_json_and_the_reference_lists_its_keys() -> None:
    text = (Path(__file__).parents[2] / "docs" / "reference" / "json.md").read_text(encoding="utf-8")
    rows = {line.split("`")[1] for line in text.splitlines() if line.startswith("| `")}
    have = {name for name, command in get_command(app).commands.items() if _has_json(command)}
    assert set(get_command(app).commands) == have
    assert rows == have


def _has_json(command: object) -> bool:
    return any("--json" in parameter.opts for parameter in command.params)
