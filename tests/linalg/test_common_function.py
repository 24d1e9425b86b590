"""One quadratic function for an interval of matrices: it decreases at both ends, and is found wherever there is one."""

from __future__ import annotations

import numpy as np

from trigpoint.linalg.common_function import common_functions, functions_at


def rate(P: np.ndarray, F: np.ndarray) -> float:
    """At least at which ``e' P e`` decreases along F."""
    root = np.linalg.cholesky(P)
    drift = np.linalg.solve(root, np.linalg.solve(root, -(P @ F + F.T @ P)).T)
    return float(np.linalg.eigvalsh(0.5 * (drift + drift.T))[0]) / 2.0


def small_gain(F: np.ndarray, B: np.ndarray, C: np.ndarray) -> float:
    """Largest norm of ``C (i w I - F)^-1 B`` over many w."""
    values = [np.linalg.norm(C @ np.linalg.solve(1j * w * np.eye(len(F)) - F, B), 2) for w in np.linspace(0, 30, 3001)]
    return float(max(values))


def test_functions_decrease_at_both_ends_and_exist_where_the_gain_is_small() -> None:
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(60):
        n = int(rng.integers(1, 5))
        F, B, C = rng.normal(size=(n, n)) - 1.5 * np.eye(n), rng.normal(size=(n, 1)), rng.normal(size=(1, n))
        C = C * rng.uniform(0.05, 1.0)
        found = common_functions(F, B, C)
        stable = float(np.linalg.eigvals(F).real.max()) < 0.0
        gain = small_gain(F, B, C) if stable else np.inf
        if abs(gain - 1.0) > 1e-3:
            assert bool(found) == (gain < 1.0)
        seen.add(bool(found))
        if found:
            best = max(min(rate(P, F - B @ C), rate(P, F + B @ C)) for P in found)
            assert 0.0 < best <= -float(np.linalg.eigvals(F).real.max()) + 1e-9
    assert seen == {True, False}


def test_a_single_matrix_needs_no_gain_and_nonsense_has_no_function() -> None:
    F = np.array([[0.0, 1.0], [-2.0, -2.0]])
    for B, C in ((np.zeros((2, 1)), np.ones((1, 2))), (np.ones((2, 1)), np.zeros((1, 2)))):
        assert max(rate(P, F) for P in common_functions(F, B, C)) > 0.85
    assert common_functions(-F, np.ones((2, 1)), np.ones((1, 2))) == []
    assert common_functions(np.full((2, 2), np.inf), np.ones((2, 1)), np.ones((1, 2))) == []


def test_functions_of_a_given_rate_decrease_at_it_or_are_none() -> None:
    F, B, C = np.array([[0.0, 1.0], [-2.0, -2.0]]), np.array([[0.0], [1.0]]), np.array([[0.3, 0.1]])
    for wanted in (0.1, 0.5, 0.99):
        found = functions_at(F, B, C, wanted)
        assert all(min(rate(P, F + s * B @ C) for s in (-1.0, 1.0)) >= wanted for P in found)
        assert bool(found) == (wanted < 0.9)
    assert functions_at(F, B, C, 1.5) == []
    assert functions_at(F, 1e300 * B, 1e-8 * C, 0.1) == []
    assert functions_at(np.full((2, 2), np.nan), B, C, 0.1) == []
