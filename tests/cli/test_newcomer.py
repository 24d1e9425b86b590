"""What a newcomer does wrong first, and what would surprise: each is said in words."""

import re
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trigpoint as tp
from trigpoint import cli
from trigpoint.cli import app

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def problem():
    return tp.NetworkedAgents(tp.graphs.chain(3), tp.LinearAgent.static())


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (lambda: tp.methods.LocalKalman(gain=5.0), r"got 5.0; write Fixed\(5.0\)"),
        (lambda: tp.methods.LocalKalman(gain=tp.FromGraph), r"write FromGraph\(\), with parentheses"),
        (lambda: tp.Scenario([1.0], period=0.1, noise=0.01), r"noise must be Noise.*got 0.01"),
        (lambda: tp.Scenario([1.0], period=0.1, channel=0.1), r"channel must be Channel.*got 0.1"),
        (lambda: tp.Scenario([1.0], seed=-1), "seed must be a whole number of at least 0; got -1"),
        (lambda: tp.NetworkedAgents(tp.LinearAgent.static(), tp.graphs.chain(2)), "graph must be a MeasurementGraph"),
        (lambda: tp.gain_bound(problem()), "graph must be a MeasurementGraph, such as problem.graph"),
        (lambda: tp.design(problem(), "local-kalman"), r"got 'local-kalman'; write LocalKalman\(\)"),
        (lambda: tp.simulate(problem(), None, [0, 1]), "simulate takes a problem.*got .*list"),
    ],
)
def test_common_mistakes_in_python_are_named(mistake, words):
    with pytest.raises(tp.ArgumentError, match=words):
        mistake()


def test_results_print_in_one_line():
    observer = tp.design(problem(), tp.methods.LocalKalman())
    scenario = tp.Scenario([0.0, 1.0])
    shown = tp.simulate(problem(), observer, scenario)
    answer = tp.estimate(tp.graphs.chain(3), [1.0, 1.0, 0.0])
    network = tp.Network(tp.graphs.chain(3), [1.0, 1.0, 0.0])
    for value in (shown, scenario, answer, network, problem(), observer):
        assert "\n" not in repr(value)
        assert repr(value).startswith(type(value).__name__)
    assert "1: 1 +- " in answer.summary()
    assert "0 degrees of freedom" in repr(answer)
    assert "and 10 more" in tp.estimate(tp.graphs.chain(60), np.zeros(60)).summary()


def test_a_sampled_run_carries_no_guarantee():
    observer = tp.design(problem(), tp.methods.LocalKalman())
    assert tp.simulate(problem(), observer, tp.Scenario([1.0])).attributes["guaranteed_rate"] == observer.decay_rate
    assert tp.simulate(problem(), observer, tp.Scenario([1.0], period=0.1)).attributes["guaranteed_rate"] is None
    said = run("simulate", EXAMPLES / "oscillators.toml")
    assert "for continuous exchange only" in said.stdout


def test_unit_weights_on_weighted_data_are_explained():
    said = run("simulate", EXAMPLES / "levelling.csv")
    assert "--weights precision removes this" in said.stderr
    assert "removes this" not in run("simulate", EXAMPLES / "levelling.csv", "--weights", "precision").stderr


def test_values_that_moving_agents_cannot_use_are_mentioned(tmp_path):
    scenario = tmp_path / "moving.toml"
    arcs = (EXAMPLES / "levelling.csv").as_posix()
    scenario.write_text(f'[network]\narcs = "{arcs}"\n[agent]\nA = [[0, 1], [0, 0]]\nC = [[1, 0]]\n')
    assert "are not used: the agents move" in run("simulate", scenario).stderr


def test_a_gain_below_the_bound_is_advised_against():
    said = run("design", EXAMPLES / "oscillators.toml", "--gain", "0.5", "--certify")
    assert said.exit_code == 3
    assert "no decay is guaranteed at gain 0.5; every gain above 1/lambda_min = 14.1594" in said.stderr
    assert "no decay could be proved" in said.stdout


def test_constants_need_no_gain_above_the_bound():
    """G16, Proposition 6: any positive gain serves them, so that nothing is advised against."""
    said = run("design", EXAMPLES / "levelling.csv", "--gain", "0.1", "--certify")
    assert said.exit_code == 0
    assert "guaranteed" not in said.stderr


def test_assumed_sigmas_are_said(tmp_path):
    bare = tmp_path / "bare.csv"
    bare.write_text("from,to,value\n,A,0\nA,B,1\n")
    assert "sigma 1 is assumed" in run("estimate", bare).stdout
    assert '"sigma_assumed": true' in run("estimate", bare, "--json").stdout


def test_verify_takes_the_folder_and_wrong_kinds_are_in_plain_words(tmp_path):
    out = tmp_path / "design"
    assert run("design", EXAMPLES / "oscillators.toml", "--certify", "--out", out).exit_code == 0
    assert run("verify", out).exit_code == 0
    assert "holds an observer; expected a certificate" in run("verify", out / "observer.json").stderr
    assert "holds a certificate; expected an observer" in run("certify", out / "certificate.json").stderr
    assert "holds an observer; this command needs a network" in run("design", out / "observer.json").stderr
    again = run("design", EXAMPLES / "oscillators.toml", "--out", out)
    assert "belongs to an earlier design" in again.stderr
    assert "is a folder, expected a file" in run("check", tmp_path).stderr
    assert ".npz holds recorded runs" in run("convert", EXAMPLES / "levelling.csv", tmp_path / "a.npz").stderr
    assert (
        "ending in .npz or .nc or .zarr or .html"
        in run("simulate", EXAMPLES / "levelling.csv", "--out", tmp_path / "r.csv").stderr
    )


def test_check_names_what_must_not_fail_and_what_to_add():
    said = run("check", EXAMPLES / "levelling.csv", "--recommend", "1", "--what-if")
    assert said.exit_code == 0
    assert "anchor environment -> A is critical: without it 4 float" in said.stdout
    assert "1. environment -> B" in said.stdout
    assert "without environment -> A: lambda_min 0" in said.stdout
    assert '"single_anchor_components": [' in run("check", EXAMPLES / "levelling.csv", "--json").stdout


def test_a_plant_that_one_agent_cannot_know_is_explained():
    said = run("check", EXAMPLES / "thermal_pair.toml")
    assert said.exit_code == 1
    assert "Let agent 1 hear agent 0." in said.stdout
    assert '"known_dimensions"' in run("check", EXAMPLES / "thermal_pair.toml", "--json").stdout
    refused = run("simulate", EXAMPLES / "thermal_pair.toml")
    assert refused.exit_code == 2
    assert "agents that can all know the state" in refused.stderr
    estimated = run("estimate", EXAMPLES / "thermal_pair.toml")
    assert estimated.exit_code == 2
    assert "this command needs a [network]" in estimated.stderr
    converted = run("convert", EXAMPLES / "thermal_pair.toml", "plant.csv")
    assert converted.exit_code == 2
    assert "no network to convert" in converted.stderr


def test_outputs_have_the_ending_of_what_they_hold(tmp_path):
    network = EXAMPLES / "levelling.csv"
    assert "ending in .csv" in run("estimate", network, "--out", tmp_path / "x.json").stderr
    assert run("simulate", network, "--out", tmp_path / "r.npz").exit_code == 0
    assert "ending in .html" in run("report", tmp_path / "r.npz", "--out", tmp_path / "zz").stderr
    assert [path.name for path in tmp_path.iterdir()] == ["r.npz"]


def test_a_margin_beside_a_given_gain_is_refused():
    said = run("design", EXAMPLES / "oscillators.toml", "--gain", "20", "--margin", "2")
    assert said.exit_code == 2
    assert "a given gain is taken as it is" in said.stderr


def test_printed_bounds_claim_no_more_than_was_proved(tmp_path):
    """Numbers are read back from the text and compared with the certificate's own."""
    out = tmp_path / "design"
    said = run("design", EXAMPLES / "oscillators.toml", "--certify", "--out", out)
    numbers = [record.numbers for record in tp.load(out / "certificate.json").records]
    low, rate = Fraction(numbers[0]["lower"]), Fraction(numbers[1]["rate"])
    for shown in (said, run("verify", out)):
        found = re.search(r"lower ([\d.]+), upper ([\d.]+)|([\d.]+) <= lambda_min <= ([\d.]+)", shown.stdout)
        lower, upper = (text for text in found.groups() if text)
        assert Fraction(1, 10**12) > low - Fraction(lower) >= 0
        assert Fraction(upper) >= Fraction(numbers[0]["upper"])
        decay = re.search(r"(?:decays at least at|\(rate) ([\d.]+)", shown.stdout)[1]
        assert Fraction(1, 10**11) > rate - Fraction(decay) >= 0
    promised = re.search(r"guaranteed decay rate +([\d.]+) /s", said.stdout)[1]
    assert Fraction(promised) <= Fraction(tp.load(out / "observer.json").decay_rate)
    noisy = run("certify", out / "observer.json", "--process", "1", "--max-nodes", "9", "--out", out / "c.json")
    worst = next(record.numbers for record in tp.load(out / "c.json").records if "worst" in record.numbers)
    assert Fraction(re.search(r"\|e_i\|\^2 <= ([\d.]+)", noisy.stdout)[1]) >= Fraction(worst["worst"])
    refuted = run("certify", out / "observer.json", "--rate", "5")
    assert refuted.exit_code == 1
    assert "slower than 5 /s" in refuted.stdout
    run("certify", out / "observer.json", "--rate", "5", "--out", out / "certificate.json")
    assert "refuted: convergence (rate 5, lambda_floor 0.0706243294514)" in run("verify", out).stdout
    checked = re.search(r"bounds +\[([\d.]+), ([\d.]+)\]", run("check", EXAMPLES / "oscillators.toml").stdout)
    assert Fraction(checked[1]) <= low
    assert Fraction(checked[2]) >= low


def test_help_is_wrapped_to_the_terminal():
    text = run("simulate", "--help").stdout
    assert "least-squares answer" in " ".join(text.split())


def test_an_interruption_while_the_program_loads_shows_no_traceback(monkeypatch, capsys) -> None:
    class Loading:
        def __getattr__(self, name: str) -> None:
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "trigpoint.cli.commands", Loading())
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 130
    assert capsys.readouterr().err == "Aborted!\n"


def test_the_command_line_has_no_other_names() -> None:
    with pytest.raises(AttributeError, match="no attribute 'apples'"):
        _ = cli.apples
