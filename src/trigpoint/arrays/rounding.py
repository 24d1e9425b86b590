"""Bounds as text: rounded to the safe side, so that a reader is never told more than was proved."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

DIGITS = 12
"""Significant digits of a printed bound."""


def at_least(value: float, digits: int = DIGITS) -> str:
    """A lower bound ``value`` as text of at most ``digits`` significant digits, rounded down.

    A number whose shortest text has no more digits is printed as that text, which reads back as the same number.
    """
    return _directed(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int = DIGITS) -> str:
    """An upper bound ``value`` as text of at most ``digits`` significant digits, rounded up, as ``at_least`` down."""
    return _directed(value, digits, ROUND_CEILING)


def exactly(value: float) -> str:
    """``value`` as the shortest text that reads back as the same number: for what is no bound."""
    text = repr(float(value) + 0.0)
    return text.removesuffix(".0")


def _directed(value: float, digits: int, rounding: str) -> str:
    shortest = Decimal(repr(float(value) + 0.0))  # never -0
    if not shortest.is_finite():
        return f"{value:g}"
    number = shortest.normalize()
    if len(number.as_tuple().digits) > digits:
        number = Context(prec=digits, rounding=rounding).plus(Decimal(float(value))).normalize()
    return format(number, "f" if -5 <= number.adjusted() < 16 else "e")
