"""The rate that a live run shows beside the one that was predicted for the same start and the same samples."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tests.runtime.living import GRID, planned
from trigpoint.cli.live import rates_of
from trigpoint.observers import Run
from trigpoint.observers.aged import aged_error_norms

AGE = 0.004  # on the way; half a period comes to it


class Heard:
    """A monitor of which every frame is as late."""

    began = 0.0

    def __init__(self, age: float) -> None:
        self.age = age

    def lateness(self, *_):
        return self.age

    def link_age(self, *_):
        return self.age + 0.01


def shown(plan, age=AGE):
    """What ``rates_of`` asks a run for: its plan, and how late frames come."""
    return SimpleNamespace(plan=plan, monitor=Heard(age))


def recorded(programs, seconds: float, seed: int = 3) -> Run:
    """Errors with the norms that follow from a drawn start."""
    rng, period = np.random.default_rng(seed), 0.02
    n = programs.nodes[0].n_states
    first = rng.normal(size=(len(programs.nodes), n))
    age = AGE + 0.5 * period
    norms = aged_error_norms(programs, period, age, age, first, round(seconds / period))
    error = first * (norms / norms[0])[:, None, None]
    shape = error.shape[:2]
    return Run(period * np.arange(shape[0]), np.zeros(error.shape), error, np.zeros(shape, dtype=np.int64),
               np.full(shape, "anchored"), programs.names, "live")  # fmt: skip


@pytest.mark.parametrize("seconds", [7.0, 10.0, 25.0])
def test_the_expected_rate_is_that_of_the_start_and_not_the_last_one(tmp_path, seconds):
    with planned(GRID, tmp_path) as (found, plan):
        run = recorded(found.programs, seconds)
        rates = rates_of(shown(plan), run, found.programs)
    assert rates["decay_rate_expected"] == pytest.approx(rates["decay_rate_measured"], rel=1e-3)
    assert abs(rates["decay_rate_measured"] / rates["decay_rate_predicted"] - 1.0) > 0.01  # near-by modes part slowly


def test_a_run_too_short_for_a_rate_says_none(tmp_path):
    with planned(GRID, tmp_path) as (found, plan):
        rates = rates_of(shown(plan), recorded(found.programs, 4.0), found.programs)
        assert (rates["decay_rate_measured"], rates["decay_rate_expected"]) == (None, None)
        assert rates["decay_rate_predicted"] > 0.2
        assert rates_of(shown(plan), None, found.programs)["decay_rate_measured"] is None
        rates = rates_of(shown(plan, 1.0), recorded(found.programs, 10.0), found.programs)
        assert rates["decay_rate_measured"] is not None
        assert (rates["decay_rate_expected"], rates["decay_rate_predicted"]) == (None, None)
    with planned(GRID + "old = 'use'\n", tmp_path) as (found, plan):  # a floor is left, so no rate is expected
        assert rates_of(shown(plan), recorded(found.programs, 10.0), found.programs)["decay_rate_expected"] is None
