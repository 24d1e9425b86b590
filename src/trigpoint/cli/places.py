"""Errors about a scenario's own values begin with its file and line, also those found after reading."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager

from trigpoint.cli.compose import Given, Stated
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.io.toml_lines import KeyPath, line_of


class PlacedError(ArgumentError):
    """An ``ArgumentError`` about the value at a known place of a scenario file.

    Attributes:
        at: the place, such as ``("design", "method")``.
    """

    def __init__(self, at: KeyPath, text: str) -> None:
        self.at = at
        super().__init__(text)


@contextmanager
def placed(given: Given | Stated, table: str, options: Collection[str] = ()) -> Iterator[None]:
    """Give errors about a ``table`` of the file ``given`` the line of the key that they are about.

    The key is the error's own place, else the first key of the table that the message names, else the table. What
    ``options`` names came from the command line and has no line; nor has anything of a file without that table.
    """
    try:
        yield
    except ArgumentError as error:
        at = error.at if isinstance(error, PlacedError) else (table, *_named(given, table, str(error)))
        known = given.lines.get(at[:2])
        by_option = str(at[1]) in options if len(at) > 1 else bool(options)
        if known is None or by_option:
            raise
        raise FileFormatError(given.path, str(error), line_of(dict(given.lines), at)) from error


def _named(given: Given | Stated, table: str, text: str) -> tuple[str, ...]:
    keys = {str(path[1]) for path in given.lines if len(path) == 2 and path[0] == table}
    return next(((word,) for word in re.findall(r"\w+", text) if word in keys), ())
