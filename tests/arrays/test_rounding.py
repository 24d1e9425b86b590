"""Bounds as text never claim more than the number."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trigpoint.arrays import at_least, at_most


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(1, 15))
def test_the_text_lies_on_the_safe_side_and_is_the_nearest_there(value, digits) -> None:
    low, high = at_least(value, digits), at_most(value, digits)
    if low == high and float(low) == value:
        return  # the number itself, as everybody writes it
    assert Fraction(low) <= Fraction(value) <= Fraction(high)
    step = Fraction(high) - Fraction(low)
    assert step <= Fraction(10) ** (1 - digits) * max(abs(Fraction(low)), abs(Fraction(high)))


@pytest.mark.parametrize(
    ("value", "low", "high"),
    [
        (0.29446278496335493, "0.294462784963", "0.294462784964"),
        (0.3, "0.3", "0.3"),
        (200.0, "200", "200"),
        (-0.0, "0", "0"),
        (-1.0 / 3.0, "-0.333333333334", "-0.333333333333"),
        (1e-320, "1e-320", "1e-320"),
        (1.23456789012345e20, "1.23456789012e+20", "1.23456789013e+20"),
        (1.23456789012345e-7, "1.23456789012e-7", "1.23456789013e-7"),
        (float("inf"), "inf", "inf"),
        (float("nan"), "nan", "nan"),
    ],
)
def test_known_texts(value, low, high) -> None:
    assert (at_least(value), at_most(value)) == (low, high)
