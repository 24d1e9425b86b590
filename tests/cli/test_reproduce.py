"""``trigpoint reproduce``: the list, one experiment, all of them, their page, and the exit codes."""

from __future__ import annotations

import re
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from tests.cli.shelled import json_of, process, refused, trigpoint
from trigpoint.cli import reproducing, results_page
from trigpoint.papers import EXPERIMENTS, Cell, Reproduction, g16_worst_case
from trigpoint.report import render

QUICK = ("g16-example1", "g16-riccati", "g16-altitude", "r23-cycles", "r23-tracking", "w17-components")
CELL = {"at", "paper", "ours", "error", "verdict"}
OUTSIDE = re.compile(r"""(?:src|href)\s*=\s*["'](?!#|data:)|@import|url\((?!#)""")


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """--all over the quick experiments only."""
    chosen = MappingProxyType({name: EXPERIMENTS[name] for name in QUICK})
    monkeypatch.setattr(reproducing, "EXPERIMENTS", chosen)
    return QUICK


def test_the_list_of_experiments() -> None:
    names = json_of(trigpoint("reproduce", "--json"))["experiments"]
    assert names == list(EXPERIMENTS)
    lines = trigpoint("reproduce").stdout.splitlines()
    assert [line.split()[0] for line in lines] == names
    assert all(len(line.split()) > 4 for line in lines), "each says what it is"
    refused(trigpoint("reproduce", "g16-tabel1"), "no experiment is called 'g16-tabel1'; did you mean 'g16-table1'?")
    refused(trigpoint("reproduce", "zzz"), "trigpoint reproduce lists them")


@pytest.mark.parametrize("name", QUICK)
def test_one_experiment_as_json(name: str) -> None:
    result = trigpoint("reproduce", name, "--json")
    facts = json_of(result)
    assert result.exit_code == 0
    assert facts["name"] == name
    assert all(cell.keys() == CELL for cell in facts["cells"])
    assert all((cell["paper"] is None) == (cell["error"] is None) for cell in facts["cells"])


def test_one_experiment_as_a_table() -> None:
    text = trigpoint("reproduce", "g16-altitude").stdout
    assert text.startswith("G16, Section 5.2, Figs. 3 and 4\n")
    for word in ("agrees", "erratum", "not specified", "yes", "(E-000-9)"):
        assert word in text
    assert "erratum" in trigpoint("reproduce", "g16-riccati").stdout


def test_a_number_that_differs_gives_exit_code_1(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(g16_worst_case, "PRINTED_8", 29.38)
    page = tmp_path / "w.html"
    result = trigpoint("reproduce", "g16-worst-case", "--json", "--out", page)
    assert result.exit_code == 1
    assert json_of(result)["cells"][0]["verdict"] == "differs"
    assert "✗ differs" in page.read_text(encoding="utf-8")


def test_numbers_that_are_not_finite_are_null(monkeypatch: pytest.MonkeyPatch) -> None:
    strange = Reproduction("x", "G16", "Text.", (Cell("a", 1.0, np.nan, np.nan, "differs"),))
    monkeypatch.setattr(reproducing, "reproduce", lambda _: strange)
    result = trigpoint("reproduce", "g16-example1", "--json")
    assert json_of(result)["cells"] == [{"at": "a", "paper": 1.0, "ours": None, "error": None, "verdict": "differs"}]
    assert result.exit_code == 1


def test_all_experiments_make_one_page(few: tuple[str, ...], tmp_path: Path) -> None:
    result = trigpoint("reproduce", "--all", "--out", tmp_path / "pages")
    assert result.exit_code == 0
    text = (tmp_path / "pages" / "reproduce.html").read_text(encoding="utf-8")
    for name in few:
        assert f">{name}: " in text
        assert name in result.stdout
    assert text.count("<svg") >= 5
    assert "✓ agrees" in text
    assert "⚠ erratum" in text
    assert "· not specified" in text
    assert text.count('<li><a href="#section-') == len(few) + 1
    assert not OUTSIDE.search(text)
    assert "<script" not in text
    assert [path.name for path in (tmp_path / "pages").iterdir()] == ["reproduce.html"]


def test_all_experiments_as_json(few: tuple[str, ...], tmp_path: Path) -> None:
    page = tmp_path / "all.html"
    facts = json_of(trigpoint("reproduce", "--all", "--json", "--out", page))
    assert [one["name"] for one in facts["results"]] == list(few)
    assert page.is_file()


def test_one_experiment_makes_its_own_page(tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    assert f"written to {page}" in trigpoint("reproduce", "g16-altitude", "--out", page).stdout
    text = page.read_text(encoding="utf-8")
    assert "Summary" not in text
    assert text.count("<image") == 6  # the truth and five frames


def test_a_remark_that_belongs_to_many_claims_stands_once() -> None:
    cells = tuple(Cell(f"claim {k}", None, 1.0, None, "not specified", "square is ours") for k in range(9))
    other = Cell("last", 1.0, 1.0, 0.0, "agrees", "as printed")
    page = results_page.results_page(
        [Reproduction("x", "G16", "Text.", (*cells, other, Cell("bare", 1.0, 1.0, 0.0, "agrees")))]
    )
    text = render(page)
    assert text.count("square is ours") == 1
    (table,) = page.sections[0].items
    assert [row[-1] for row in table.rows] == ["1"] * 9 + ["2", ""]
    assert list(table.notes) == ["square is ours", "as printed"]


def test_a_long_table_is_folded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "s.html"
    trigpoint("reproduce", "g16-riccati", "--out", page)
    assert "<details>" not in page.read_text(encoding="utf-8")
    monkeypatch.setattr(results_page, "_LONG", 2)
    trigpoint("reproduce", "g16-riccati", "--out", page)
    assert "<summary>all 3 numbers</summary>" in page.read_text(encoding="utf-8")


def test_the_users_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, object] = {}

    def recorded(name: str, **options: object) -> Reproduction:
        seen.update(options)
        return Reproduction(name, "R23", "Text.", ())

    monkeypatch.setattr(reproducing, "reproduce", recorded)
    picture = tmp_path / "p.pgm"
    assert trigpoint("reproduce", "r23-image", "--image", picture).exit_code == 0
    assert seen == {"image": picture}


def test_misuse_is_refused(tmp_path: Path) -> None:
    refused(trigpoint("reproduce", "g16"), "'g16'", "trigpoint reproduce lists them")
    refused(trigpoint("reproduce", "g16-example1", "--all"), "either an experiment or --all")
    refused(trigpoint("reproduce", "g16-example1", "--image", tmp_path / "a.png"), "--image belongs to r23-image")
    refused(trigpoint("reproduce", "--image", tmp_path / "a.png"), "need an experiment")
    refused(trigpoint("reproduce", "--out", tmp_path / "a.html"), "need an experiment")
    refused(trigpoint("reproduce", "g16-example1", "--out", tmp_path / "a.pdf"), "a.pdf", ".html")
    refused(trigpoint("reproduce", "--all", "--out", tmp_path / "a.pdf"), "a.pdf", ".html")
    refused(trigpoint("reproduce", "r23-image", "--image", tmp_path / "none.png"), "none.png", "no such file")
    assert not list(tmp_path.iterdir())


def test_nothing_but_the_result_is_printed_to_a_pipe(tmp_path: Path) -> None:
    done = process("reproduce", "g16-riccati", "--json", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr == ""


@pytest.mark.slow
def test_every_experiment_on_one_page(tmp_path: Path) -> None:
    page = tmp_path / "all.html"
    result = trigpoint("reproduce", "--all", "--json", "--out", page)
    assert result.exit_code == 0
    assert [one["name"] for one in json_of(result)["results"]] == list(EXPERIMENTS)
    text = page.read_text(encoding="utf-8")
    assert "0 of them differ" in text
    assert not OUTSIDE.search(text)
    assert text.count("<image") == 6 + 7
