"""Ball matrices against fifty digits: the true value lies inside, and the radius is small."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from trigpoint.linalg.balls import Ball, contracts, transition_and_integral


@pytest.mark.parametrize("scale", [1e-6, 0.3, 4.0, 40.0])
def test_exponentials_and_their_integrals_are_enclosed(scale) -> None:
    rng = np.random.default_rng(3)
    for _ in range(12):
        n = int(rng.integers(1, 5))
        A, h = scale * rng.standard_normal((n, n)), float(rng.uniform(0.1, 1.0))
        transition, integral = transition_and_integral(Ball.exact(A), h)
        with mpmath.workdps(60):
            block = mpmath.zeros(2 * n)
            for i in range(n):
                block[i, n + i] = mpmath.mpf(h)
                for j in range(n):
                    block[i, j] = mpmath.mpf(float(A[i, j])) * mpmath.mpf(h)
            truth = mpmath.expm(block, method="taylor")
            for ball, offset in ((transition, 0), (integral, n)):
                for i in range(n):
                    for j in range(n):
                        gap = abs(truth[i, offset + j] - mpmath.mpf(float(ball.middle[i, j])))
                        assert gap <= mpmath.mpf(float(ball.radius[i, j]))
                assert ball.radius.max() <= 1e-9 * max(1.0, float(np.abs(ball.middle).max())) * np.exp(2.0 * scale * h)


def test_contraction_is_proved_near_one_and_not_beyond() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        M = rng.standard_normal((4, 4))
        M /= np.linalg.norm(M, 2)
        assert contracts(np.eye(4), Ball.exact(M), 1.0 + 1e-10)
        assert not contracts(np.eye(4), Ball.exact(M), 1.0 - 1e-10)
        wide = Ball(M, np.full((4, 4), 1e-3))
        assert not contracts(np.eye(4), wide, 1.0 + 1e-4)


def test_a_norm_beyond_all_squarings_leaves_everything_unknown() -> None:
    for scale, duration in ((1e3, 1e308), (1.0, 1e13), (1e300, 1e300)):
        for ball in transition_and_integral(Ball.exact(scale * np.eye(2)), duration):
            assert np.isinf(ball.radius).all()


def test_products_of_balls_stay_inside_under_every_operation() -> None:
    """A chain of sums, products and Kronecker products against fractions drawn inside the balls."""
    rng = np.random.default_rng(11)
    for _ in range(60):
        A, B = (Ball(rng.standard_normal((3, 3)), 10.0 ** rng.uniform(-12, -1) * rng.random((3, 3))) for _ in range(2))
        with mpmath.workdps(40):
            inside = [
                mpmath.matrix((ball.middle + 0.999 * ball.radius * rng.choice([-1.0, 1.0], (3, 3))).tolist())
                for ball in (A, B)
            ]
            found = ((A @ B.T).times(0.3) - B).kron(A)
            flat = inside[0] * inside[1].T * mpmath.mpf(0.3) - inside[1]
            for i in range(9):
                for j in range(9):
                    truth = flat[i // 3, j // 3] * inside[0][i % 3, j % 3]
                    gap = abs(truth - mpmath.mpf(float(found.middle[i, j])))
                    assert gap <= mpmath.mpf(float(found.radius[i, j]))
