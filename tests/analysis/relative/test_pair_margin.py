"""The refined margin on many planted and many random pairs."""

from __future__ import annotations

import numpy as np
import pytest

from tests.analysis.relative.drawn import planted_pair
from trigpoint.analysis.pairs import pair_margin


def angle(v, w) -> float:
    """Sine of the angle between two directions, complex phases aside."""
    v, w = v / np.linalg.norm(v), w / np.linalg.norm(w)
    return float(np.linalg.norm(v - w * (w.conj() @ v)))


@pytest.mark.parametrize("count", [500, pytest.param(10_000, marks=pytest.mark.slow)])
def test_planted_unobservable_pairs_are_found_in_their_direction(count) -> None:
    rng = np.random.default_rng(20)
    verdicts, worst = [], 0.0
    for _ in range(count):
        A, C, hidden = planted_pair(rng)
        found = pair_margin(A, C)
        verdicts.append(found.verdict)
        if found.verdict is False:
            worst = max(worst, angle(found.direction, hidden))
    print(f"undecided {verdicts.count(None)} of {count}; worst direction {worst:.1e}")
    assert verdicts.count(True) == 0
    assert verdicts.count(None) < 0.01 * count
    assert worst < 1e-6


@pytest.mark.parametrize("count", [500, pytest.param(10_000, marks=pytest.mark.slow)])
def test_random_pairs_are_observable(count) -> None:
    rng = np.random.default_rng(21)
    verdicts = []
    while len(verdicts) < count:
        n = int(rng.integers(3, 9))
        found = pair_margin(rng.normal(size=(n, n)), rng.normal(size=(int(rng.integers(1, 3)), n)))
        if found.margin > 1e-8:
            verdicts.append(found.verdict)
        else:
            assert found.verdict is not False
    assert verdicts == [True] * count


def test_a_complex_mode_hidden_from_real_shifts() -> None:
    A = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    found = pair_margin(A, np.array([[0.0, 0.0, 1.0]]))
    assert found.verdict is False
    assert abs(found.mode) == pytest.approx(1.0)
    assert found.mode.real == pytest.approx(0.0, abs=1e-12)
