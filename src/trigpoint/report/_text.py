"""Names and numbers as readers see them."""

from __future__ import annotations

import math
import re

import numpy as np

_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

NOTHING = "\u2013"
"""What stands where there is no number."""


def printable(text: str) -> str:
    """Replace what neither XML nor UTF-8 can carry (control characters, lone surrogates) by U+FFFD."""
    return _UNPRINTABLE.sub("\ufffd", text)


def shortened(text: str, length: int) -> str:
    """One printable line of at most ``length`` characters, an ellipsis telling that there was more."""
    line = " ".join(printable(text).split())
    return line if len(line) <= length else line[: length - 1] + "…"


def number(value: float, digits: int = 6) -> str:
    """As many significant digits as asked for with a true minus sign; whole numbers in full; a dash for NaN."""
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f").replace("-", "\u2212")
    if math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else "\u2212∞"
    return f"{value:.{digits}g}".replace("-", "\u2212")


def cell(value: object) -> str:
    """One table cell: text as it is, numbers by :func:`number`, yes or no, a dash for None."""
    if value is None:
        return NOTHING
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (int, np.integer)):
        return number(int(value))
    if isinstance(value, (float, np.floating)):
        return number(float(value))
    return printable(str(value))
