"""Reading text and numbers: what every format has in common."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import FileFormatError

Fail = Callable[[int, str], FileFormatError]
"""Makes the error for row k: it knows the file and the row's line."""


LARGEST_FILE = 4 * 1024**3
"""Bytes: ten million arcs with their certificate fit; a file that claims more is refused before it is read."""


def read_bytes(path: str | Path) -> bytes:
    """Return the whole file; a missing, oversized or unreadable file, or a folder, is a ``FileFormatError``."""
    try:
        size = Path(path).stat().st_size
        if size > LARGEST_FILE:
            raise FileFormatError(path, f"got {size} bytes; files of at most {LARGEST_FILE} bytes are read")
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise FileFormatError(path, "there is no such file; check the name and the folder") from None
    except IsADirectoryError:
        raise FileFormatError(path, "this is a folder; name a file in it") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise FileFormatError(path, f"cannot be read ({reason})") from error


def read_text(path: str | Path) -> str:
    """Return the file as text (UTF-8, byte-order mark dropped); binary content is a ``FileFormatError``."""
    return decode(read_bytes(path), path)


def decode(data: bytes, path: object) -> str:
    """Decode UTF-8 without its byte-order mark; NUL bytes and other encodings are a ``FileFormatError``."""
    nul = data.find(b"\0")
    if nul >= 0:
        raise FileFormatError(
            path,
            "got a NUL byte: this is no UTF-8 text (binary, or UTF-16?); save it as UTF-8 text",
            _line_at(data, nul),
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(
            path,
            f"got the byte 0x{data[error.start]:02x}, which is no UTF-8 text (binary, or an older encoding?); "
            "save the file as UTF-8",
            _line_at(data, error.start),
        ) from None


def _line_at(data: bytes, position: int) -> int:
    return data.count(b"\n", 0, position) + 1


def shown(value: object) -> str:
    """``repr`` of a value, cut to a readable length, for messages."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]}... ({len(text)} characters)"


def nearest(word: str, known: Iterable[str]) -> str:
    """``; did you mean 'x'?`` for the nearest known word, or nothing."""
    choices = list(known)
    close = difflib.get_close_matches(word, choices, n=1, cutoff=0.5)
    if not close:
        lower = {choice.casefold(): choice for choice in choices}
        close = [lower[word.casefold()]] if word.casefold() in lower else []
    return f"; did you mean {close[0]!r}?" if close else ""


def parse_number(text: str) -> float:
    """Read one finite decimal number, blanks around it allowed; anything else is a ``ValueError`` with a message."""
    stripped = text.strip()
    if not stripped:
        raise ValueError("got nothing, expected a number")
    try:
        number = float(stripped) if "_" not in stripped else None
    except ValueError:
        number = None
    if number is None:
        hint = ", and a decimal point instead of the comma" if "," in stripped else ""
        raise ValueError(f"got {shown(stripped)}, expected a number such as 12.5 or 3e-4{hint}")
    if not np.isfinite(number):
        raise ValueError(f"got {shown(stripped)}, expected a finite number; leave the measurement out")
    return number


def parse_column(name: str, texts: Sequence[str], fail: Fail) -> FloatArray:
    """Read a column of finite numbers, shape (len(texts),); the first bad cell raises ``fail(row, message)``."""
    try:
        numbers = np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
    except ValueError:
        numbers = None
    if numbers is not None and np.isfinite(numbers).all() and "_" not in "".join(texts):
        return numbers
    for row, text in enumerate(texts):
        try:
            parse_number(text)
        except ValueError as error:
            raise fail(row, f"column {name!r}: {error}") from None
    raise AssertionError("unreachable: a bad column has a bad cell")  # pragma: no cover


def number_text(value: float) -> str:
    """Shortest decimal text that reads back as the same number."""
    return repr(float(value))
