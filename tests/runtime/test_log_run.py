"""A log as a run: the error of a node is the one that it had, not that of the sampling."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.runtime.logged import EPOCH, START, estimate, small_log, truth
from trigpoint.errors import ArgumentError
from trigpoint.runtime import LogWriter, log_run, read_log, read_run, restarts

NAMES = ["a", "b"]


def circle(time: np.ndarray | float) -> np.ndarray:
    t = np.asarray(time, dtype=float) - START
    return np.stack([np.cos(t), -np.sin(t)], axis=-1)


def moving(path: Path, period: float = 0.05, seconds: float = 6.0, rate: float = 0.8, scale: float = 1.0) -> Path:
    """Oscillators whose estimates have the error ``scale e^{-rate t}``, at instants of their own that jitter."""
    rng = np.random.default_rng(4)
    with LogWriter(path, network="n", names=NAMES, attributes={"anchor_timeout": 1.0}) as log:
        for k in range(round(seconds / period)):
            for j, name in enumerate(NAMES):
                now = START + period * k
                log.write(truth(name, k, now, circle(now)), now)
                own = now + period * (0.3 * (j + 1) + 0.2 * rng.random())
                error = scale * np.exp(-rate * (own - START)) * np.array([1.0, 0.5])
                log.write(estimate(name, k, own, circle(own) + error, evidence=own - 0.02), own)
    return path


def test_the_error_of_moving_agents_is_their_own(tmp_path: Path) -> None:
    """Holding the last estimate would show up to ``period |A x|`` = 0.05; the cubic's rest is of order period^3."""
    run = read_run(moving(tmp_path / "run.mcap"))
    t = run.times[1:-1] + 0.05  # the first instant of the plant was before the first estimate
    expected = np.exp(-0.8 * t)[:, None, None] * np.array([1.0, 0.5])
    assert run.status.tolist() == [["anchored"] * 2] * (t.shape[0] + 2)
    np.testing.assert_allclose(run.error[1:-1], np.broadcast_to(expected, run.error[1:-1].shape), atol=2e-4)
    assert run.measured_decay_rate() == pytest.approx(0.8, rel=0.01)
    held = np.abs(run.truth[1:] - run.truth[:-1]).max()
    assert held > 0.04


def test_the_tables_have_the_truths_instants(tmp_path: Path) -> None:
    run = read_run(moving(tmp_path / "run.mcap"))
    np.testing.assert_allclose(run.times, 0.05 * np.arange(119), atol=1e-6)
    np.testing.assert_allclose(run.truth[:, 0], circle(START + 0.05 + run.times), atol=1e-6)
    assert (run.path, run.names, run.attributes["network"]) == ("live", ("a", "b"), "n")
    assert run.attributes["start"] == START + 0.05  # nobody had spoken at the instant before
    assert run.messages[-1].tolist() == [119, 119]


def test_the_end_is_when_the_first_of_those_that_are_left_falls_silent(tmp_path: Path) -> None:
    """Nodes are stopped one by one while the plant goes on; one was lost long before."""
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["lost", "early", "late"], attributes={}) as log:
        for k in range(50):
            now = START + 0.1 * k
            for name, until in (("lost", 10), ("early", 30), ("late", 33)):
                log.write(truth(name, k, now, [1.0]), now)
                if 5 <= k <= until:
                    log.write(estimate(name, k, now, [2.0]), now)
    run = read_run(path)
    assert run.times.shape == (26,)
    assert run.error_norm[[0, -1]].tolist() == [np.sqrt(3.0), np.sqrt(2.0)]
    assert run.status[-1].tolist() == ["away", "relative", "relative"]


def test_a_run_begins_when_every_node_that_ever_speaks_is_known(tmp_path: Path) -> None:
    """The same rule for tables of one's own instants, which keep what was before."""
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a", "late", "never"], attributes={}) as log:
        for k in range(30):
            now = START + 0.1 * k
            for name in ("a", "late"):
                if name == "a" or k >= 12:
                    log.write(truth(name, k, now, [1.0]), now)
                if name == "a" or k >= 9:
                    log.write(estimate(name, k, now, [2.0]), now)
    run = read_run(path)
    assert run.attributes["start"] == pytest.approx(START + 1.2)  # its truth, too, must be known
    assert run.times[0] == 0.0
    assert log_run.first_known(run) == 0
    whole = read_run(path, times=START + 0.1 * np.arange(30))
    assert whole.times.shape == (30,)
    assert log_run.first_known(whole) == 12
    assert log_run.first_known(read_run(path, times=[])) is None


def test_a_truth_that_ended_before_the_first_estimate_is_shown_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a"], attributes={}) as log:
        log.write(truth("a", 0, START, [1.0]), START)
        log.write(estimate("a", 0, START + 1.0, [1.0]), START)
    assert read_run(path).status.tolist() == [["away"]]


def test_estimates_at_the_truths_instants_come_back_as_they_are(tmp_path: Path) -> None:
    run = read_run(small_log(tmp_path / "run.mcap"))
    assert run.estimate[:, 0].tolist() == [[1.5, float(k)] for k in range(6)]
    assert run.error[:, :, 0].tolist() == [[0.5, 0.5]] * 6
    assert run.messages[:, 1].tolist() == [1, 2, 3, 4, 5, 6]


def restarted(path: Path) -> Path:
    """The node a is silent from 2 s to 4 s, and comes back as another process from zero; b goes on, unanchored."""
    with LogWriter(path, network="n", names=[*NAMES, "never"], attributes={}) as log:
        for k in range(60):
            now = START + 0.1 * k
            for name in NAMES:
                log.write(truth(name, k, now, [3.0]), now)
            log.write(estimate("b", k, now, [2.0], evidence=START), now)
            if k < 20 or k >= 40:
                log.write(estimate("a", k % 40, now, [3.0 * (k < 20)], epoch=EPOCH + (k >= 40), evidence=now), now)
    return path


def test_a_node_that_is_silent_is_away_and_does_not_count(tmp_path: Path) -> None:
    path = restarted(tmp_path / "run.mcap")
    run = read_run(path)
    assert run.names == ("a", "b", "never")
    assert run.status[:, 2].tolist() == ["away"] * 60
    assert run.status[:20, 0].tolist() == ["anchored"] * 20
    assert run.status[25:40, 0].tolist() == ["away"] * 15  # five periods after the last
    assert run.estimate[:24, 0, 0].tolist() == [3.0] * 24  # held, not led to the next process's estimate
    assert np.isnan(run.estimate[25:40, 0]).all()
    assert run.status[40:, 0].tolist() == ["anchored"] * 20
    assert run.status[:, 1].tolist() == ["anchored"] * 11 + ["relative"] * 49
    np.testing.assert_allclose(run.error_norm[25:40], 1.0)
    np.testing.assert_allclose(run.error_norm[40:], np.sqrt(1.0 + 9.0))
    assert restarts(read_log(path).estimates["a"]) == [START + 4.0]
    assert restarts(read_log(path).estimates["b"]) == []


def test_the_silence_that_counts_can_be_given(tmp_path: Path) -> None:
    path = restarted(tmp_path / "run.mcap")
    status = read_run(path, away_after=3.0).status[:, 0]
    assert status[:29].tolist() == ["anchored"] * 29  # its last words, at 1.9 s, count for the timeout of 1 s
    assert status[30:40].tolist() == ["relative"] * 10
    assert status[40:].tolist() == ["anchored"] * 20
    with pytest.raises(ArgumentError, match="away_after"):
        read_run(path, away_after=0.0)


def test_without_a_truth_there_are_estimates_and_no_error(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=NAMES, attributes={"anchor_timeout": "soon"}) as log:
        for k in range(30):
            for name in NAMES:
                log.write(estimate(name, k, START + 0.1 * k, [k, 1.0]), START + 0.1 * k)
    run = read_run(path)
    assert run.times.shape == (30,)
    assert np.isnan(run.truth).all()
    assert np.isnan(run.error_norm).all()
    assert (run.measured_decay_rate(), run.time_to(1.0)) == (None, None)
    np.testing.assert_allclose(run.estimate[:, 0, 0], np.arange(30), atol=1e-5)
    assert (run.status == "relative").all()
    assert "30 times, 2 nodes" in repr(run)


def test_a_truth_that_was_lost_is_unknown_there(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=NAMES, attributes={}) as log:
        for k in range(20):
            now = START + 0.1 * k
            for name in NAMES:
                log.write(estimate(name, k, now, [1.0 + 0.5**k]), now)
                if (name, k) != ("a", 7):
                    log.write(truth(name, k, now, [1.0]), now)
    run = read_run(path)
    assert np.flatnonzero(np.isnan(run.error_norm)).tolist() == [7]
    assert run.time_to(0.5) == pytest.approx(0.1 * np.log2(np.sqrt(2.0) / 0.5))
    assert run.measured_decay_rate() == pytest.approx(10.0 * np.log(2.0), rel=1e-6)


def test_nodes_of_different_sizes_share_a_table(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["small", "large", "mapped"], attributes={}) as log:
        for k in range(4):
            now = START + 0.1 * k
            for name, size in (("small", 1), ("large", 3), ("mapped", 2)):
                log.write(estimate(name, k, now, [2.0] * size), now)
                log.write(truth(name, k, now, [1.0] * (1 if name == "mapped" else size)), now)
    run = read_run(path)
    assert run.error[0, :2].tolist() == [[1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    assert np.isnan(run.error[:, 2]).all()


def test_the_grid_can_be_given(tmp_path: Path) -> None:
    path = moving(tmp_path / "run.mcap")
    run = read_run(path, times=START + np.array([1.0, 1.025, 2.0]))
    np.testing.assert_allclose(run.times, [0.0, 0.025, 1.0], atol=1e-6)
    assert np.isnan(run.truth[1]).all()  # between two instants of the plant
    expected = circle(START + 1.025) + np.exp(-0.82) * np.array([1.0, 0.5])
    np.testing.assert_allclose(run.estimate[1], [expected, expected], atol=2e-4)
    for times in ([[1.0]], [2.0, 1.0], [np.nan]):
        with pytest.raises(ArgumentError, match="times"):
            read_run(path, times=times)


def test_estimates_that_overtook_each_other_are_put_in_order(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a"], attributes={}) as log:
        for k in (0, 2, 1, 3, 3):
            log.write(estimate("a", k, START + k, [float(k)]), START + k)
            log.write(truth("a", k, START + k, [0.0]), START + k)
    assert read_run(path).estimate[:, 0, 0].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_a_long_run_is_thinned_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_run, "MOST_NUMBERS", 40)
    run = read_run(moving(tmp_path / "run.mcap"))
    np.testing.assert_allclose(run.times, 0.6 * np.arange(10), atol=1e-6)


def test_numbers_at_the_end_of_the_range_make_no_noise(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, network="n", names=["a"], attributes={}) as log:
        for k in range(6):
            log.write(estimate("a", k, START + k, [1.7e308 * (-1) ** k]), START + k)
    assert read_run(path).times.shape == (6,)
