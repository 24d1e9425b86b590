"""Polynomials of stored matrices: exact coefficients, and enclosures that hold."""

from __future__ import annotations

from fractions import Fraction

import flint
import mpmath
import numpy as np

from trigpoint.linalg.characteristic import Stored, on_the_axis, plus, times, transfer, turned


def rational(matrix: np.ndarray) -> flint.fmpq_mat:
    return flint.fmpq_mat([[flint.fmpq(*float(v).as_integer_ratio()) for v in row] for row in matrix.tolist()])


def test_both_polynomials_are_those_of_the_stored_matrices() -> None:
    """``det(s I - A + z b c) = d(s) + z n(s)``, coefficient by coefficient."""
    rng = np.random.default_rng(0)
    for n in range(1, 7):
        A, b, c = rng.normal(size=(n, n)), rng.normal(size=n), rng.normal(size=n)
        d, numerator = transfer(A, b, c)
        A_, b_, c_ = rational(A), rational(b[:, None]), rational(c[None, :])
        for z in (0, 1, -3):
            whole = plus(d, numerator, Fraction(z))
            expected = (A_ - b_ * c_ * flint.fmpq(z)).charpoly().coeffs()
            assert [flint.fmpq(v.numerator, v.denominator) for v in whole] == list(expected)


def test_on_the_axis_and_products() -> None:
    p = [Fraction(k) for k in (3, -2, 5, 7)]
    real, imaginary = on_the_axis(p)
    w = Fraction(2, 3)
    at = sum((complex(a) * (1j * complex(w)) ** k for k, a in enumerate(p)), 0j)
    for part, value in ((real, at.real), (imaginary, at.imag)):
        assert abs(float(sum(a * w**k for k, a in enumerate(part))) - value) < 1e-12
    assert times([Fraction(1), Fraction(2)], [Fraction(-1), Fraction(3)]) == [-1, 1, 6]


def test_an_interval_is_enclosed_with_its_roundings() -> None:
    """Coefficients that cancel: ``(x - 1)^6`` near 1, where floats know nothing."""
    rng = np.random.default_rng(1)
    power = [Fraction(1)]
    for _ in range(6):
        power = times(power, [Fraction(-1), Fraction(1)])
    for p in (power, [Fraction(float(v)) for v in rng.normal(size=9)], [Fraction(1, 3), Fraction(-1, 7)]):
        stored = Stored.of(p)
        assert stored is not None
        for middle, radius in ((1.0, 1e-3), (0.0, 0.0), (3.0, 2.0), (1.0 + 1e-9, 0.0)):
            value, slope, off = (v.item() for v in stored.around(np.array([middle]), np.array([radius])))
            for x in (middle - radius, middle, middle + 0.7 * radius, middle + radius):
                truth = sum((a * Fraction(x) ** k for k, a in enumerate(p)), Fraction(0))
                line = Fraction(value) + Fraction(slope) * (Fraction(x) - Fraction(middle))
                assert abs(truth - line) <= Fraction(off)
    assert Stored.of([Fraction(10) ** 300]) is None
    assert Stored.of([Fraction(1, 10**300), Fraction(1)]) is None


def test_turns_are_enclosed() -> None:
    angles = np.linspace(0.0, 6.5, 400)
    cosine, sine, error = turned(angles)
    for angle, c, s in zip(angles.tolist(), cosine.tolist(), sine.tolist(), strict=True):
        assert abs(mpmath.cos(angle) - c) < error
        assert abs(mpmath.sin(angle) - s) < error
