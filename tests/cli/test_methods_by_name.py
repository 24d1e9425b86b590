"""Every design method by its name in a scenario file: design, certify, verify, simulate; keys that do not belong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.shelled import trigpoint as run
from trigpoint.cli.choices import ROWS
from trigpoint.methods import METHODS

EXAMPLES = Path(__file__).parents[2] / "examples"

GRID = '[network]\ngallery = { kind = "grid", rows = 3, cols = 3, anchors = [0, 8] }\n'
STATIC = "[agent]\nA = [[0]]\nC = [[1]]\n"
DOUBLE = "[agent]\nA = [[0, 1], [0, 0]]\nC = [[1, 0]]\n"
SLOW = "[agent]\nA = [[1.02]]\nC = [[1]]\n"
PLANT = (EXAMPLES / "shared_plant.toml").read_text(encoding="utf-8").split("[design]")[0]
CHAIN = PLANT.replace("[[3], [0], [1], [2]]", "[[2], [0], [1], [2]]")

PAIR = "[plant]\nA = [[0, 1], [-1, 0]]\noutputs = [[[1, 0]], [[0, 1]]]\nneighbours = [[1], [0]]\n"

CASES = {
    "local-kalman": (GRID + DOUBLE, ""),
    "integrator": (GRID + STATIC, 'arc_weights = "optimal"\nanchor_gain = 3.0\n'),
    "sampled": (GRID + DOUBLE, 'period = 0.005\nscheme = "innovation-held"\n'),
    "discrete-kalman": (GRID + SLOW, "period = 0.5\n"),
    "accelerated": (GRID + STATIC, 'scheme = "chebyshev"\n'),
    "heterogeneous": (GRID + DOUBLE, "rate = 0.1\n"),
    "spectrum-assignment": (PLANT, "rate = 1.0\n"),
    "coupling-gain": (PLANT, "rate = 0.5\n"),
    "projected-consensus": (PLANT, "rate = 0.5\nperiod = 0.5\nrounds = 60\n"),
    "scc-cascade": (CHAIN, "rate = 1.0\n"),
    "brasch-pearson": (PAIR, "eigenvalues = [-1.0, -1.4, -1.8, -2.2, -2.6]\n"),
    "centralised": (PLANT, "rate = 1.0\n"),
}
ELSEWHERE = {"projected-consensus"}  # its observer has no document and no run of this command


def scenario(tmp_path: Path, text: str, method: str, keys: str) -> Path:
    path = tmp_path / "scenario.toml"
    path.write_text(f'{text}[design]\nmethod = "{method}"\n{keys}[simulate]\nhorizon = 5.0\nsamples = 11\n', "utf-8")
    return path


def test_every_method_has_a_row() -> None:
    assert set(ROWS) | {"weighted"} == {kind.label for kind in METHODS}
    assert set(CASES) == set(ROWS)


@pytest.mark.parametrize("method", CASES)
def test_designed_by_name(method, tmp_path) -> None:
    said = run("design", scenario(tmp_path, *CASES[method][:1], method, CASES[method][1]), "--json")
    assert said.exit_code == 0, said.stderr
    assert json.loads(said.stdout)["method"] == method


@pytest.mark.parametrize("method", sorted(set(CASES) - ELSEWHERE))
def test_certified_written_verified_and_simulated(method, tmp_path) -> None:
    file = scenario(tmp_path, *CASES[method][:1], method, CASES[method][1])
    said = run("design", file, "--certify", "--out", tmp_path / "out")
    assert said.exit_code in (0, 3), said.stderr
    again = run("verify", tmp_path / "out", "--json")
    assert again.exit_code == said.exit_code
    assert json.loads(again.stdout)["verdict"] == ("certified" if said.exit_code == 0 else "inconclusive")
    assert run("certify", tmp_path / "out" / "observer.json").exit_code == said.exit_code
    period = ["--period", "0.5"] if method == "discrete-kalman" else []
    simulated = run("simulate", file, "--json", *period)
    assert simulated.exit_code == 0, simulated.stderr
    answer = json.loads(simulated.stdout)
    assert answer["final_error"] < answer["initial_error"]


@pytest.mark.parametrize("method", sorted(ELSEWHERE))
def test_what_these_commands_cannot_do_is_one_line(method, tmp_path) -> None:
    file = scenario(tmp_path, *CASES[method][:1], method, CASES[method][1])
    for command in (["simulate", file], ["design", file, "--certify"], ["design", file, "--out", tmp_path / "out"]):
        said = run(*command)
        assert said.exit_code == 2
        assert said.stderr.startswith("error: ")
        assert len(said.stderr.strip().splitlines()) == 1


def test_the_example_converges_and_is_certified(tmp_path) -> None:
    file = EXAMPLES / "shared_plant.toml"
    assert run("design", file, "--certify", "--out", tmp_path / "out").exit_code == 0
    answer = json.loads(run("simulate", file, "--json").stdout)
    assert answer["final_error"] < 1e-4
    assert answer["decay_rate_measured"] >= 0.95


def test_keys_of_other_methods_are_refused(tmp_path) -> None:
    said = run("design", scenario(tmp_path, GRID + DOUBLE, "local-kalman", "rate = 1.0\n"))
    assert said.exit_code == 2
    assert "'rate' does not belong to the method 'local-kalman'" in said.stderr
    needs = run("design", scenario(tmp_path, PLANT, "coupling-gain", ""))
    assert needs.exit_code == 2
    assert "needs 'rate' in [design] (or --rate)" in needs.stderr
    option = run("design", scenario(tmp_path, PLANT, "coupling-gain", ""), "--rate", "0.5", "--json")
    assert json.loads(option.stdout)["decay_rate"] == 0.5
    assert "is called 'magic'" in run("design", scenario(tmp_path, PLANT, "magic", "")).stderr


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("eigenvalues = [[1, 2, 3]]\n", "expected numbers or pairs"),
        ('arc_weights = "best"\n', "expected 'optimal', a number, or one number an arc"),
        ("rate = -1.0\n", "greater than 0"),
    ],
)
def test_malformed_choices_name_the_line(keys, words, tmp_path) -> None:
    said = run("design", scenario(tmp_path, PLANT, "spectrum-assignment", keys))
    assert said.exit_code == 2
    assert words in said.stderr
    assert "scenario.toml" in said.stderr


def test_a_plant_has_no_precisions(tmp_path) -> None:
    said = run("design", scenario(tmp_path, PLANT, "coupling-gain", "rate = 1.0\n"), "--weights", "precision")
    assert said.exit_code == 2
    assert "states no measured network" in said.stderr


def test_complex_eigenvalues_are_pairs_in_a_file(tmp_path) -> None:
    values = ", ".join(f"[{-1 - 0.1 * k}, {s}]" for k in range(8) for s in ("1.0", "-1.0"))
    said = run("design", scenario(tmp_path, PLANT, "spectrum-assignment", f"eigenvalues = [{values}]\n"), "--json")
    assert said.exit_code == 0, said.stderr
    assert json.loads(said.stdout)["facts"]["block_spectrum_error"] < 1e-9
