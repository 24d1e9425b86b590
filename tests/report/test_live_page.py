"""The page of a live run says what its log says, and no name or text in it does harm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.report.test_report_page import HOSTILE, read
from tests.runtime.logged import EPOCH, START, estimate, reading, status, truth
from trigpoint.errors import ArgumentError
from trigpoint.report import live_page, render
from trigpoint.report.page import Figure, Page, Table
from trigpoint.runtime import LINK_FIELDS, STATUS_FIELDS, LogWriter, read_log, read_run, run_of

FIXED = dict(
    zip(
        STATUS_FIELDS,
        [1, 1, 0, 2, 0.25, 0.1, 60, 3, 41.5, 0, 0.1, 0.004, 0.5, 9, 100, 0, 4, 1, 0, 0, 0, 0],
        strict=True,
    )
)
LINK = dict(zip(LINK_FIELDS, [2, 0.01, 95, 5, 0.002, -0.004], strict=True))


def logged(path: Path, names: tuple[str, ...] = ("a", "b"), with_truth: bool = True, rounds: int = 60) -> Path:
    """The first node is silent for a while and comes back as a new process; the others go on."""
    attributes = {"guaranteed_rate": 0.5, "note": HOSTILE, "hears": {name: ["x"] for name in names[:1]}}
    with LogWriter(path, network="net", names=names, attributes=attributes) as log:
        for k in range(rounds):
            now = START + 0.1 * k
            for name in names:
                if with_truth:
                    log.write(truth(name, k, now, [1.0, 2.0]), now)
                if name != names[0] or k < 20 or k >= 40:
                    error = np.exp(-0.5 * 0.1 * k) * np.array([1.0, 0.5]) + [1.0, 2.0]
                    epoch = EPOCH + (name == names[0] and k >= 40)
                    log.write(estimate(name, k, now, error, epoch=epoch, evidence=now - 0.1), now)
                log.write(status(name, k, now, [*FIXED.values(), *LINK.values()]), now)
            log.write(reading(0, k, now, [0.5]), now)
        log.event(f"killed {HOSTILE}", names[0], time=START + 2.0)
    return path


def page_of(path: Path) -> Page:
    log = read_log(path)
    return live_page(log, run_of(log), title="Live", unit="m")


def section(page: Page, title: str) -> tuple[str, list[Table]]:
    (found,) = [one for one in page.sections if one.title == title]
    return found.text, [item for item in found.items if isinstance(item, Table)]


def test_the_page_tells_what_the_log_tells(tmp_path: Path) -> None:
    page = page_of(logged(tmp_path / "run.mcap"))
    summary = dict(section(page, "Summary")[1][0].rows)
    first, last = np.sqrt(2 * 1.25), np.sqrt(2 * 1.25) * np.exp(-0.5 * 5.9)
    assert summary["error norm, first sample [m]"] == f"{first:.4g}"
    assert float(str(summary["error norm, last sample [m]"])) == pytest.approx(last, rel=1e-3)
    assert (summary["restarts"], summary["nodes anchored at the end"], summary["nodes away at the end"]) == (1, 2, 0)
    assert (summary["estimates in the log"], summary["readings in the log"]) == (100, 60)
    assert summary["designed decay rate, exchange without delay [1/s]"] == 0.5
    assert not {"hears", "guaranteed_rate"} & set(summary)
    links = section(page, "Links")[1][0].rows
    assert links[0] == ("a", "x", "live", 95, 5, "2", "\u22124")
    assert links[1][:2] == ("b", "#1")  # nobody told the name
    assert section(page, "Links")[0].count("synchronize the clocks") == 2
    events = section(page, "Events")[1][0].rows
    assert [(row[0], row[1]) for row in events] == [("2", "a"), ("4", "a")]
    assert "new process" in events[1][2]
    nodes = section(page, "Nodes at the last sample")[1][0].rows
    assert nodes[0][3:] == ("anchored", 2, 40, 1, 5, 3, "41.5")
    assert nodes[1][6] == 0


def test_the_page_is_one_safe_file(tmp_path: Path) -> None:
    names = (HOSTILE, "$x_2^", "", "µ" * 300, "a/b")
    page = page_of(logged(tmp_path / "run.mcap", names, with_truth=False, rounds=30))
    reader = read(render(page))
    assert len(reader.all("figure")) == 3
    assert any("no truth" in text for text in reader.text)


def test_a_log_that_was_cut_says_so(tmp_path: Path) -> None:
    path = logged(tmp_path / "run.mcap")
    path.write_bytes(path.read_bytes()[:-100])
    assert "is not complete" in section(page_of(path), "Summary")[0]


def test_messages_of_a_wrong_size_are_told(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap", network="n", names=["a"], attributes={}) as log:
        log.write(estimate("a", 0, START, [1.0]), START)
        log.write(estimate("a", 1, START + 1.0, [1.0, 2.0]), START)
    page = page_of(tmp_path / "run.mcap")
    assert "1 messages of a wrong size" in section(page, "Summary")[0]
    assert section(page, "Links") == ("No node told anything of its links.", [])
    assert section(page, "Events") == ("Nothing was noted, and no node was started again.", [])


def test_long_tables_end_and_say_so(tmp_path: Path) -> None:
    names = tuple(f"n{k}" for k in range(205))
    page = page_of(logged(tmp_path / "run.mcap", names, rounds=2))
    for title in ("Links", "Nodes at the last sample"):
        text, (table,) = section(page, title)
        assert len(table.rows) == 200
        assert "5 more are not" in text


def test_a_node_that_never_came_hides_no_error(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap", network="n", names=["a", "never"], attributes={}) as log:
        for k in range(5):
            log.write(truth("a", k, START + k, [0.0]), START)
            log.write(truth("never", k, START + k, [0.0]), START)
            log.write(estimate("a", k, START + k, [3.0]), START)
    page = page_of(tmp_path / "run.mcap")
    summary = dict(section(page, "Summary")[1][0].rows)
    assert summary["error norm, first sample [m]"] == "3"
    assert summary["nodes away at the end"] == 1


def test_numbers_at_the_end_of_the_range_are_drawn(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap", network="n", names=["a"], attributes={"guaranteed_rate": 1e300}) as log:
        for k in range(5):
            log.write(truth("a", k, START + k, [-1.7e308]), START)
            log.write(estimate("a", k, START + k, [1.7e308 if k else 1e150]), START)
    read(render(page_of(tmp_path / "run.mcap")))


def test_an_empty_run_is_refused(tmp_path: Path) -> None:
    log = read_log(logged(tmp_path / "run.mcap"))
    with pytest.raises(ArgumentError, match="no samples"):
        live_page(log, run_of(log, times=[]), title="x")


def figures(page: Page, title: str) -> list[Figure]:
    (found,) = [one for one in page.sections if one.title == title]
    return [item for item in found.items if isinstance(item, Figure)]


def test_the_rate_that_is_drawn_is_called_what_it_is(tmp_path: Path) -> None:
    """Nothing is certified in a live run: the design's rate holds without delay; a predicted one goes before it."""
    (designed,) = figures(page_of(logged(tmp_path / "run.mcap")), "Error over time")
    name = "designed rate, exchange without delay (slope only)"
    assert f"{name}, 0.5 1/s" in designed.svg
    assert name in designed.caption
    assert "certified" not in designed.svg + designed.caption
    attributes = {"guaranteed_rate": 0.5, "decay_rate_predicted": 0.4}
    with LogWriter(tmp_path / "aged.mcap", network="n", names=["a"], attributes=attributes) as log:
        for k in range(5):
            log.write(truth("a", k, START + k, [0.0]), START)
            log.write(estimate("a", k, START + k, [0.5**k]), START)
    (predicted,) = figures(page_of(tmp_path / "aged.mcap"), "Error over time")
    assert "predicted rate, 0.4 1/s" in predicted.svg


def test_what_nodes_say_of_themselves_stands_beside_what_was(tmp_path: Path) -> None:
    _, stated = figures(page_of(logged(tmp_path / "run.mcap")), "Whom to trust")
    for name in ("largest, stated", "median, stated", "largest, true", "median, true", "error of a state [m]"):
        assert name in stated.svg
    assert "a bound for constants; for agents that move a figure" in stated.caption
    assert "standard deviation" not in stated.caption
    _, blind = figures(page_of(logged(tmp_path / "blind.mcap", with_truth=False)), "Whom to trust")
    assert "largest, stated" in blind.svg
    assert "largest, true" not in blind.svg


def test_the_page_begins_when_every_node_is_known(tmp_path: Path) -> None:
    """The second node speaks 0.7 s after the first; what part of the network did before is no error of the whole."""
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["early", "late"], attributes={}) as log:
        for k in range(40):
            now = START + 0.1 * k
            for name in ("early", "late"):
                log.write(truth(name, k, now, [0.0]), now)
                if name == "early" or k >= 7:
                    log.write(estimate(name, k, now, [8.0 * 0.5**k if name == "early" else 3.0]), now)
        log.event("started", "late", time=START + 0.2)
    run = read_run(path)
    page = page_of(path)
    summary = dict(section(page, "Summary")[1][0].rows)
    assert run.attributes["start"] == pytest.approx(START + 0.7)
    assert (run.status != "away").all()
    assert run.error_norm[0] == pytest.approx(np.hypot(8.0 * 0.5**7, 3.0))
    assert summary["error norm, first sample [m]"] == f"{run.error_norm[0]:.4g}"
    assert summary["first estimate before time 0 [s]"] == "0.7"
    assert "before every node was known" in section(page, "Events")[0]
    assert "0.7 s after the first estimate" in figures(page, "Error over time")[0].caption
