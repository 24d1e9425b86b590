"""Matrix equations: residuals of the defining equation, and the published solution of G16, Section 5.3."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from trigpoint.linalg.equations import filter_riccati, filter_riccati_residual, spectral_abscissa
from trigpoint.linalg.sparse import factorize

DOUBLE = np.array([[0.0, 1.0], [0.0, 0.0]])


def test_the_planar_double_integrator_of_g16() -> None:
    A, C = np.kron(DOUBLE, np.eye(2)), np.hstack([np.eye(2), np.zeros((2, 2))])
    printed = filter_riccati(A, C, np.diag([0.0, 0.0, 1.0, 1.0]), np.eye(2))
    root = np.sqrt(2.0)
    np.testing.assert_allclose(printed, np.kron([[root, 1.0], [1.0, root]], np.eye(2)), atol=1e-13)
    full = filter_riccati(A, C, np.eye(4), np.eye(2))  # E-000-4: the identity gives sqrt(3), not the printed 1.41
    np.testing.assert_allclose(np.diag(full), np.sqrt(3.0), atol=1e-13)


@pytest.mark.parametrize("seed", range(8))
def test_the_riccati_solution_solves_its_equation_and_stabilizes(seed) -> None:
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 6)), int(rng.integers(1, 3))
    A, C, E, V = rng.normal(size=(n, n)), rng.normal(size=(p, n)), rng.normal(size=(n, n)), rng.normal(size=(p, p))
    process, measurement = E @ E.T, V @ V.T + np.eye(p)
    before = [x.copy() for x in (A, C, process, measurement)]
    Q = filter_riccati(A, C, process, measurement)
    assert all(np.array_equal(x, y) for x, y in zip((A, C, process, measurement), before, strict=True))
    assert np.array_equal(Q, Q.T)
    assert filter_riccati_residual(A, C, process, measurement, Q) < 1e-11
    assert filter_riccati_residual(A, C, process, measurement, 1.1 * Q) > 1e-3
    assert spectral_abscissa(A - Q @ C.T @ np.linalg.solve(measurement, C)) < 0


@pytest.mark.parametrize(
    ("A", "C", "process"),
    [
        (np.zeros((1, 1)), np.ones((1, 1)), np.zeros((1, 1))),
        (DOUBLE, np.eye(2)[:1], np.zeros((2, 2))),
        (DOUBLE, np.eye(2)[:1], np.diag([1.0, 0.0])),
        (np.array([[0.0, 1.0], [-1.0, 0.0]]), np.eye(2)[:1], np.zeros((2, 2))),
        (np.diag([0.0, -1.0]), np.ones((1, 2)), np.diag([0.0, 1.0])),
        (DOUBLE, np.eye(2)[1:], np.eye(2)),
    ],
)
def test_a_mode_on_the_axis_that_noise_or_output_does_not_reach_has_no_solution(A, C, process) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        filter_riccati(A, C, process, np.eye(1))


def test_the_residual_of_zero_terms_is_zero() -> None:
    zero, one = np.zeros((1, 1)), np.ones((1, 1))
    assert filter_riccati_residual(zero, one, zero, one, zero) == 0.0


def test_spectral_abscissa_of_one_matrix_and_of_a_stack() -> None:
    assert spectral_abscissa(np.array([[0.0, 1.0], [-1.0, -1.0]])) == pytest.approx(-0.5)
    assert spectral_abscissa(np.stack([-np.eye(2), 3 * np.eye(2)])) == pytest.approx(3.0)


def test_factorize_solves_for_vectors_and_matrices() -> None:
    n = 50
    matrix = sp.diags_array([np.full(n, 2.5), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], offsets=[0, 1, -1])
    rhs = np.random.default_rng(0).normal(size=(n, 3))
    factor = factorize(matrix)
    np.testing.assert_allclose(matrix @ factor.solve(rhs), rhs, atol=1e-13)
    np.testing.assert_allclose(matrix @ factor.solve(rhs[:, 0]), rhs[:, 0], atol=1e-13)
