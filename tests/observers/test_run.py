"""``Run``: shapes, times to a level, measured slopes, series by name, the dataset."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from trigpoint.errors import ArgumentError, MissingExtraError, ShapeError
from trigpoint.observers import Run


def make(times, norms, **changes) -> Run:
    """A run of two nodes with two states whose error norm is ``norms``."""
    times = np.asarray(times, dtype=float)
    truth = np.ones((len(times), 2, 2))
    estimate = truth + np.asarray(norms)[:, None, None] / 2.0
    fields = {
        "times": times,
        "truth": truth,
        "estimate": estimate,
        "messages": np.zeros((len(times), 2), dtype=np.int64),
        "status": np.full((len(times), 2), "anchored"),
        "names": ("a", "b"),
        "path": "stacked",
        "attributes": {"gain": 2.0},
    }
    return Run(**{**fields, **changes})


def test_the_error_is_estimate_minus_truth() -> None:
    run = make([0, 1], [4.0, 1.0])
    assert np.array_equal(run.error, run.estimate - run.truth)
    np.testing.assert_allclose(run.error_norm, [4.0, 1.0], rtol=1e-15)


@pytest.mark.parametrize("name", ["error", "estimate", "messages", "status", "truth"])
def test_series_by_name(name) -> None:
    run = make([0, 1], [4.0, 1.0])
    assert np.array_equal(run[name], getattr(run, name))


@pytest.mark.parametrize("name", ["times", "names", "Error", "", "__init__"])
def test_other_names_are_refused(name) -> None:
    with pytest.raises(ArgumentError, match=r"a run holds bytes, delivered, error, .*, truth; got"):
        make([0, 1], [4.0, 1.0])[name]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"estimate": np.zeros((2, 2, 1))}, r"truth \(2, 2, 2\) and estimate \(2, 2, 1\) must both be \(T, N, n\)"),
        ({"truth": np.zeros((2, 2)), "estimate": np.zeros((2, 2))}, r"must both be \(T, N, n\)"),
        ({"names": ("a",)}, r"truth must begin with the shape \(T, N\) = \(2, 1\); got \(2, 2, 2\)"),
        ({"messages": np.zeros((3, 2), dtype=np.int64)}, r"messages must begin .*got \(3, 2\)"),
        ({"status": np.full((2, 3), "x")}, r"status must begin .*got \(2, 3\)"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(changes, words) -> None:
    with pytest.raises(ShapeError, match=words):
        make([0, 1], [4.0, 1.0], **changes)


def test_time_to_is_exact_for_an_exponential() -> None:
    times = np.array([0.0, 0.7, 1.1, 3.0, 4.5])
    run = make(times, 5.0 * np.exp(-1.3 * times))
    for level in (4.9, 2.0, 0.5, 0.05):
        assert run.time_to(level) == pytest.approx(np.log(5.0 / level) / 1.3, rel=1e-13)


def test_time_to_takes_the_last_crossing() -> None:
    run = make([0, 1, 2, 3], [8.0, 1.0, 4.0, 1.0])
    assert run.time_to(2.0) == pytest.approx(2.5, rel=1e-14)
    assert run.time_to(1.0) == 3.0, "at the level is not above it"


def test_an_error_that_vanishes_has_a_time() -> None:
    run = make([0, 1, 2], [1e3, 1e3, 0.0])
    reached = run.time_to(10.0)
    assert reached is not None
    assert 1.0 < reached < 1.1


def test_a_level_that_is_never_reached_has_no_time() -> None:
    run = make([0, 1, 2], [4.0, 2.0, 1.0])
    assert run.time_to(0.5) is None
    assert run.time_to(0.0) is None
    assert run.time_to(-1.0) is None


def test_a_level_already_held_has_the_first_time() -> None:
    assert make([0.25, 1, 2], [1.0, 0.9, 0.1]).time_to(1.0) == 0.25


def test_an_error_that_vanishes_reaches_every_level() -> None:
    run = make([0, 1, 2], [1.0, 0.5, 0.0])
    assert run.time_to(0.0) == 2.0
    assert 1.0 < run.time_to(1e-3) < 2.0


def test_the_measured_rate_is_the_slope_of_the_later_half() -> None:
    times = np.linspace(0, 10, 101)
    run = make(times, np.exp(-0.8 * times) + 3 * np.exp(-9 * times))
    assert run.measured_decay_rate() == pytest.approx(0.8, abs=1e-9)
    assert make(times, np.exp(0.3 * times)).measured_decay_rate() == pytest.approx(-0.3, abs=1e-9)


def test_the_floor_does_not_count() -> None:
    times = np.linspace(0, 40, 401)
    settled = np.exp(-2.0 * times) + 1e-4
    assert make(times, settled).measured_decay_rate() == pytest.approx(2.0, rel=1e-9)
    rounding = np.maximum(np.exp(-2.0 * times), 1e-15)
    assert make(times, rounding).measured_decay_rate() == pytest.approx(2.0, rel=1e-4)


@pytest.mark.parametrize(("times", "norms"), [([0.0], [1.0]), ([0, 1, 2], [1, 0.5, 0.25]), ([0, 1, 2, 3], np.zeros(4))])
def test_too_few_samples_have_no_slope(times, norms) -> None:
    assert make(times, norms).measured_decay_rate() is None


def test_the_dataset_has_names_and_times() -> None:
    run = make([0.5, 2.0], [4.0, 1.0])
    data = run.dataset
    assert dict(data.sizes) == {"time": 2, "node": 2, "state": 2}
    assert data["node"].values.tolist() == ["a", "b"]
    assert data["time"].values.tolist() == [0.5, 2.0]
    assert np.array_equal(data["error"].values, run.error)
    assert np.array_equal(data["messages"].values, run.messages)
    assert np.array_equal(data["status"].values, run.status)
    assert data.attrs == {"path": "stacked", "gain": 2.0}
    assert data["estimate"].sel(node="b", state=1).values.tolist() == run.estimate[:, 1, 1].tolist()


def test_the_dataset_says_which_extra_it_needs(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(MissingExtraError, match=r"run\.dataset needs the package 'xarray'.*trigpoint\[data\]"):
        _ = make([0, 1], [1.0, 1.0]).dataset
