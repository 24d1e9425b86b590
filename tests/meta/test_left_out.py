"""Browser tests are never left out in silence: deselected with a line where there is no browser, required in CI."""

from __future__ import annotations

import re
import subprocess

import pytest

from house import ROOT


@pytest.mark.parametrize("target", ["test", "slow"])
def test_make_says_when_browser_tests_are_left_out(target: str) -> None:
    with_one, without = (
        subprocess.run(
            ["make", "-n", target, f"CHROMIUM={found}"], capture_output=True, text=True, cwd=ROOT, check=True
        )
        for found in ("chromium", "")
    )
    assert "not browser" not in with_one.stdout
    assert "LEFT OUT" not in with_one.stdout
    assert re.search(r'-m "(not )?slow and not browser"', without.stdout)
    assert f"{target}: the browser tests are LEFT OUT" in without.stdout


def test_ci_insists_on_a_browser() -> None:
    text = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "install -y -qq --no-install-recommends chromium" in text
    assert re.search(r"command -v chromium >/dev/null \|\| \{[^}]*exit 1", text)


def test_what_drives_the_browser_carries_the_marker() -> None:
    needing = [path for path in (ROOT / "tests").rglob("test_*.py") if "Chromium(" in path.read_text(encoding="utf-8")]
    unmarked = [path.name for path in needing if "pytest.mark.browser" not in path.read_text(encoding="utf-8")]
    assert [path.name for path in needing] != []
    assert unmarked == ["test_left_out.py"] or unmarked == []
