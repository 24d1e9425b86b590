"""The guard against silent skips, on a run of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from house import ROOT

SKIPPING = "import pytest\n\ndef test_a():\n    pytest.skip('no time today')\n"
WITHOUT_MODULE = "import pytest\n\npytest.importorskip('no_such_module_anywhere')\n\ndef test_a():\n    pass\n"
WITH_DATA = "def test_a(shared_data):\n    assert shared_data.is_dir()\n"
PASSING = "def test_b():\n    pass\n"


def run(folder: Path, test: str, workers: int, **environment: str) -> subprocess.CompletedProcess[str]:
    """A pytest run in ``folder`` under our conftest, without the reference data."""
    shutil.copy(ROOT / "tests" / "conftest.py", folder / "conftest.py")
    (folder / "pytest.ini").write_text("[pytest]\nmarkers =\n    shared_data: data\n", encoding="utf-8")
    (folder / "test_it.py").write_text(test, encoding="utf-8")
    (folder / "test_other.py").write_text(PASSING, encoding="utf-8")
    inherited = {k: v for k, v in os.environ.items() if k != "CI" and not k.startswith(("PYTEST", "TRIGPOINT"))}
    settings = {**inherited, "TRIGPOINT_SHARED_DATA": str(folder / "absent"), **environment}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", str(workers), str(folder)]
    return subprocess.run(command, cwd=folder, env=settings, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("workers", [0, 1])
@pytest.mark.parametrize("test", [SKIPPING, WITHOUT_MODULE], ids=["skip", "importorskip"])
def test_an_unexpected_skip_fails_the_run(tmp_path: Path, test: str, workers: int) -> None:
    done = run(tmp_path, test, workers)
    assert done.returncode == 1, done.stdout
    assert "reason that is not allowed" in done.stdout


def test_absent_data_is_an_allowed_skip(tmp_path: Path) -> None:
    done = run(tmp_path, WITH_DATA, 0)
    assert done.returncode == 0, done.stdout
    assert "1 passed, 1 skipped" in done.stdout


def test_absent_data_fails_in_ci(tmp_path: Path) -> None:
    done = run(tmp_path, WITH_DATA, 0, CI="true")
    assert done.returncode == 1, done.stdout
    assert "reference data folder is absent" in done.stdout
