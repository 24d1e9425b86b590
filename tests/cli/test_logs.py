"""The log of a live run on the command line: reported, converted, and named where something else is expected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trigpoint as tp
from tests.cli.shelled import trigpoint
from tests.runtime.logged import START, estimate, small_log
from trigpoint.errors import FileFormatError
from trigpoint.runtime import LogWriter, read_run


def test_report_writes_the_page_beside_the_log(tmp_path: Path) -> None:
    path = small_log(tmp_path / "run.mcap")
    assert trigpoint("report", path).exit_code == 0
    page = (tmp_path / "run.live.html").read_text(encoding="utf-8")
    assert not (tmp_path / "run.html").exists()  # that is the page of run.npz
    assert "Whom to trust" in page
    path.write_bytes(path.read_bytes()[:-40])
    assert trigpoint("report", path, "--out", tmp_path / "other.html").exit_code == 0
    assert "is not complete" in (tmp_path / "other.html").read_text(encoding="utf-8")


def test_convert_makes_a_recorded_run(tmp_path: Path) -> None:
    path = small_log(tmp_path / "run.MCAP")
    assert trigpoint("convert", path, tmp_path / "run.npz").exit_code == 0
    run, direct = tp.load(tmp_path / "run.npz"), read_run(path)
    np.testing.assert_array_equal(run.estimate, direct.estimate)
    np.testing.assert_array_equal(run.status, direct.status)
    assert (run.names, run.path) == (("a", "b/c"), "live")
    assert trigpoint("report", tmp_path / "run.npz").exit_code == 0
    refused = trigpoint("convert", path, tmp_path / "run.csv")
    assert refused.exit_code == 2
    assert "holds a recorded run: convert writes it as .npz, .nc, .zarr" in refused.stderr


def test_load_says_how_a_log_is_read(tmp_path: Path) -> None:
    path = small_log(tmp_path / "run.mcap")
    with pytest.raises(FileFormatError, match="trigpoint convert"):
        tp.load(path)
    refused = trigpoint("check", path)
    assert refused.exit_code == 2
    assert "log of a live run" in refused.stderr


@pytest.mark.parametrize("command", ["report", "convert"])
@pytest.mark.parametrize("content", [b"", b"junk", None])
def test_a_bad_log_is_one_line(tmp_path: Path, command: str, content: bytes | None) -> None:
    path = tmp_path / "run.mcap"
    if content is not None:
        path.write_bytes(content)
    done = trigpoint(command, path, *([tmp_path / "x.npz"] if command == "convert" else []))
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {path}")
    assert done.stderr.count("\n") == 1


def test_a_log_without_a_truth_is_reported_and_converted(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a", "b"], attributes={}) as log:
        for k in range(5):
            log.write(estimate("a", k, START + k, [1.0]), START + k)
    assert trigpoint("report", path).exit_code == 0
    assert trigpoint("convert", path, tmp_path / "run.npz").exit_code == 0
    assert trigpoint("report", tmp_path / "run.npz").exit_code == 0
