"""The demonstration keeps its promises."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from tests.cli.shelled import json_of, process, trigpoint
from tests.machine import effort


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path, float]:
    folder = tmp_path_factory.mktemp("demo") / "new" / "folder"
    with effort() as spent:
        result = trigpoint("demo", "--json", "--out", folder)
    assert result.exit_code == 0
    return json_of(result), folder, spent.units


def test_the_network_is_the_published_one(demo: tuple[dict[str, Any], Path, float]) -> None:
    facts, _, _ = demo
    assert (facts["nodes"], facts["arcs"], facts["anchors"], facts["estimating_nodes"]) == (14, 25, 5, 9)
    assert facts["lambda_min"]["value"] == pytest.approx(0.25044, abs=5e-6)
    assert facts["lambda_min"]["lower"] <= facts["lambda_min"]["value"] <= facts["lambda_min"]["upper"]
    assert facts["lambda_min_estimating"] == pytest.approx(0.55051, abs=5e-6)
    assert facts["gain_bound"] == pytest.approx(1.0 / 0.2504383, rel=1e-6)


def test_the_heights_are_the_published_ones(demo: tuple[dict[str, Any], Path, float]) -> None:
    facts, _, _ = demo
    assert 0.0 < facts["largest_difference_to_published"] < 1e-8
    assert facts["largest_sigma_difference_to_published"] < 1e-5


def test_the_observer_reaches_them_when_the_eigenvalue_says(demo: tuple[dict[str, Any], Path, float]) -> None:
    facts, _, _ = demo
    assert facts["certificate"] == {"verdict": "certified"}
    assert facts["fixed_point_distance"] < 1e-9
    assert facts["time_to_1_percent"] == pytest.approx(facts["time_to_1_percent_predicted"], rel=0.01)
    assert facts["time_to_tenth_millimetre"] == pytest.approx(facts["time_to_tenth_millimetre_predicted"], rel=0.01)
    assert facts["decay_rate_measured"] == pytest.approx(facts["decay_rate"], rel=1e-6)
    assert facts["node_by_node_difference"] < 1e-10


def test_unit_weights_miss_them_by_what_the_issue_says(demo: tuple[dict[str, Any], Path, float]) -> None:
    facts, _, _ = demo
    assert 1e3 * facts["unit_weight_distance_with_readings"] == pytest.approx(0.28, abs=0.005)
    assert 1e3 * facts["unit_weight_distance"] == pytest.approx(0.17, abs=0.005)


def test_the_report_needs_nothing_from_outside(demo: tuple[dict[str, Any], Path, float]) -> None:
    facts, folder, _ = demo
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert facts["report"] == str(folder / "report.html")
    assert page.startswith("<!DOCTYPE html>")
    assert "<svg" in page or "data:image" in page
    assert not re.search(r"<script|<link|<iframe|@import", page, re.IGNORECASE)
    assert not re.findall(r"""(?:src|href|action|url)\s*[=(]\s*["']?(?!#|data:)[^"'\s)>]+""", page)
    addresses = set(re.findall(r"https?://[^\s\"'<>)]+", page))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}, addresses  # names, not links


def test_the_folder_holds_the_report_and_the_data_and_nothing_half_written(
    demo: tuple[dict[str, Any], Path, float],
) -> None:
    _, folder, _ = demo
    assert sorted(p.name for p in folder.iterdir()) == ["baumann.csv", "baumann_published.csv", "report.html"]
    again = json_of(trigpoint("check", folder / "baumann.csv", "--json"))
    assert (again["nodes"], again["arcs"], again["anchors"]) == (14, 25, 5)


def test_it_takes_well_under_a_minute(demo: tuple[dict[str, Any], Path, float]) -> None:
    """Half of one on a machine of our own, where a unit takes 10 ms."""
    assert demo[2] < 3000.0


def test_it_tells_its_story_to_people(tmp_path: Path) -> None:
    done = process("demo", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    for part in (
        "1. The network",
        "2. The gain it needs",
        "3. The best static answer",
        "4. The observer",
        "5. The rep",
    ):
        assert part in done.stdout
    assert "missed" not in done.stdout
    assert "0.17 mm; by 0.28 mm" in done.stdout
    assert "certified" in done.stdout
    assert (tmp_path / "trigpoint-demo" / "report.html").as_uri() in done.stdout
