"""``trigpoint run --readings``: what was recorded instead of what is simulated."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.cli.shelled import process, refused, trigpoint
from tests.machine import until, with_time
from tests.runtime.living import CHAIN, GRID, planned
from trigpoint.cli.recorded import Player, record_of
from trigpoint.errors import FileFormatError
from trigpoint.runtime import MemoryNetwork, ReadingPublisher, SystemClock, read_log

TRUE = {0: 4.5 - 1.5, 1: 2.5 - 4.5, 2: 1.5}  # not what the scenario would simulate
STATES = {"0": 1.5, "1": 4.5, "2": 2.5}


def table(seconds: float, rate: float = 20.0, readings=TRUE) -> str:
    rows = [
        f"{k / rate:.3f},{label},{value}" for k in range(round(seconds * rate)) for label, value in readings.items()
    ]
    return "time,label,value\n" + "\n".join(rows) + "\n"


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(CHAIN, encoding="utf-8")
    return path


def last(path):
    log = read_log(path)
    assert log.complete
    return {name: float(log.estimates[name].values[-1][0]) for name in log.names}


def test_a_table_and_the_log_of_that_run_again(scenario, tmp_path):
    """The nodes find what the record says; the run ends with it; its log is a record as well, replayed faster."""
    with_time(lambda attempt: table_and_log(scenario, tmp_path / f"attempt-{attempt}"))


def table_and_log(scenario, tmp_path):
    tmp_path.mkdir()
    csv = tmp_path / "readings.csv"
    csv.write_text(table(6.0), encoding="utf-8")
    first = process("run", scenario, "--readings", csv, "--out", tmp_path / "one", "--json", cwd=tmp_path)
    assert (first.returncode, first.stderr) == (0, "")
    facts = json.loads(first.stdout)
    assert facts["readings"] == 6 * 20 * 3
    assert facts["seconds"] > 5.95  # from the first reading to the last
    assert (facts["final_error"], facts["decay_rate_measured"], facts["anchored"]) == (None, None, 3)
    assert last(tmp_path / "one" / "run.mcap") == pytest.approx(STATES, abs=0.05)
    log = tmp_path / "one" / "run.mcap"
    second = process(
        "run", scenario, "--readings", log, "--speed", 2, "--for", "200ms", "--out", tmp_path / "two", cwd=tmp_path
    )
    assert second.returncode == 0, second.stderr
    assert "recorded readings" in second.stdout
    assert last(tmp_path / "two" / "run.mcap") == pytest.approx(STATES, abs=0.2)


@pytest.mark.slow
def test_over_links_with_certificates(scenario, tmp_path):
    with_time(lambda attempt: over_links_with_certificates(scenario, tmp_path / f"attempt-{attempt}"))


def over_links_with_certificates(scenario, tmp_path):
    tmp_path.mkdir()
    csv = tmp_path / "readings.csv"
    csv.write_text(table(8.0), encoding="utf-8")
    done = process("run", scenario, "--readings", csv, "--transport", "tls", "--out", tmp_path / "o", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert last(tmp_path / "o" / "run.mcap") == pytest.approx(STATES, abs=0.05)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (table(0.1, readings={0: 1.0, 7: 2.0}), (), ("arc 7, which the network lacks", "0, 1, 2")),
        ("time,label,value\n0,0,1.0,2.0\n", (), ("arc 0 with 2 values", "expected 1")),
        ("time,label,value\n", (), ("holds no readings",)),
        ("time,label,value\n0,0,x\n", (), ("readings.csv:2",)),
        (table(0.1), ("--speed", "0"), ("--speed must be positive",)),
        (table(0.1), ("--speed", "nan"), ("--speed must be positive",)),
        (table(0.1), ("--prepare", "files"), ("--prepare runs nothing",)),
    ],
)
def test_records_that_do_not_fit_are_refused(scenario, tmp_path, text, options, words, monkeypatch):
    monkeypatch.chdir(tmp_path)
    csv = tmp_path / "readings.csv"
    csv.write_text(text, encoding="utf-8")
    refused(trigpoint("run", scenario, "--readings", csv, *options), *words)
    assert not (tmp_path / "run.mcap").exists()


def test_options_without_a_record_and_a_log_on_its_own_readings(scenario, tmp_path):
    refused(trigpoint("run", scenario, "--speed", "2"), "--speed belongs to --readings")
    refused(trigpoint("run", scenario, "--readings", tmp_path / "missing.csv"), "cannot be read")
    refused(trigpoint("run", scenario, "--readings", tmp_path / "run.mcap"), "over its readings")


def test_arcs_without_readings_are_told(tmp_path):
    csv = tmp_path / "readings.csv"
    csv.write_text(table(0.1, readings={0: 1.0, 2: 2.0}), encoding="utf-8")
    with planned(CHAIN, tmp_path) as (_, plan):
        assert record_of(csv, 1.0, plan).silent == (1,)
    with planned(GRID, tmp_path) as (_, plan):
        assert len(record_of(csv, np.inf, plan).silent) == 11
        csv.write_text(table(0.1, readings={13: 1.0}), encoding="utf-8")
        with pytest.raises(FileFormatError, match=r"its arcs are 0, 1, .*, 11, \.\.\."):
            record_of(csv, 1.0, plan)


def test_it_begins_when_the_nodes_are_there_and_a_spoiled_file_ends_it(tmp_path):
    csv = tmp_path / "readings.csv"
    csv.write_text(table(0.1), encoding="utf-8")
    with planned(CHAIN, tmp_path) as (_, plan):
        record = record_of(csv, np.inf, plan)
    link = MemoryNetwork([("plant", "0")]).transport("plant")
    player = Player(record, link, ReadingPublisher(link, "n", "plant", epoch=1), SystemClock())
    assert not player.tick(lambda: False)
    assert player.count == 0
    csv.write_text(table(0.05) + "nonsense\n", encoding="utf-8")
    assert not player.tick(lambda: True)
    with pytest.raises(FileFormatError, match="a row holds"):
        until(lambda: player.tick(lambda: True))
    assert player.count == 3
    player.close()
