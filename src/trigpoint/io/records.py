"""Records of comma- or tab-separated text: quoted fields over several lines, comments, exact line numbers.

Written out here because the standard reader cannot tell a quoted field from a bare one: blanks around a bare field are
dropped, blanks inside quotes are part of the name.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from trigpoint.errors import FileFormatError
from trigpoint.io.text import shown

LARGEST_FIELD = 1_000_000
"""Characters in one field; more is a missing quote, not a name."""

DIRECTIVE = "#@"
"""A comment that begins so says something about the network, see ``edge_list``."""


class Record(NamedTuple):
    """One record: its first line and fields, or its comment (with the fields of a directive). A tuple, for speed."""

    line: int
    fields: list[str]
    comment: str | None = None
    is_directive: bool = False


def read_records(path: object, text: str, delimiter: str) -> Iterator[Record]:
    """Yield the records of ``text``; blank lines are left out.

    Raises:
        FileFormatError: a quote that is never closed, text after a closing quote, a field over 1 MB.
    """
    lines = split_lines(text)
    position, count = 0, len(lines)
    while position < count:
        line = lines[position]
        number = position + 1
        if line.startswith("#") or line.lstrip(" ").startswith("#"):
            bare = line.lstrip(" ")
            if bare.startswith(DIRECTIVE):
                start = len(line) - len(bare) + len(DIRECTIVE)
                fields, position = _quoted_record(path, lines, position, " ", start)
                yield Record(number, [field for field in fields if field], "", True)
                continue
            position += 1
            yield Record(number, [], bare[1:].removesuffix("\r"))
        elif '"' in line:
            fields, position = _quoted_record(path, lines, position, delimiter, 0)
            yield Record(number, fields)
        else:
            position += 1
            if line and not line.isspace():
                fields = [field.strip() for field in line.split(delimiter)]
                if len(line) > LARGEST_FIELD and max(map(len, fields)) > LARGEST_FIELD:
                    raise _too_large(path, number)
                yield Record(number, fields)


def split_lines(text: str) -> list[str]:
    """Lines as editors count them: ended by LF or CR LF (the CR stays), or by CR alone where there is no LF."""
    return (text if "\n" in text else text.replace("\r", "\n")).split("\n")


def plain_columns(lines: list[str], delimiter: str, width: int) -> list[list[str]] | None:
    """Columns of lines without quotes, comments or blank lines, each of ``width`` fields; None if they are not so.

    The fast path of ``read_records``: no object a row.
    """
    if not lines or max(map(len, lines)) > LARGEST_FIELD or any(map(str.isspace, lines)):
        return None
    if {line.count(delimiter) for line in lines} != {width - 1}:
        return None
    joined = delimiter.join(lines)
    if '"' in joined or "#" in joined:
        return None
    flat = list(map(str.strip, joined.split(delimiter)))
    return [flat[k::width] for k in range(width)]


def quote(text: str, delimiter: str) -> str:
    """Write one field so that ``read_records`` gives it back, in quotes only where needed."""
    plain = text == text.strip() and not text.startswith("#")
    if plain and not any(mark in text for mark in (delimiter, '"', "\n", "\r")):
        return text
    return '"' + text.replace('"', '""') + '"'


def _quoted_record(path: object, lines: list[str], k: int, delimiter: str, start: int) -> tuple[list[str], int]:
    fields: list[str] = []
    blanks = " \t".replace(delimiter, "")
    position = start
    while True:
        line = lines[k]
        while position < len(line) and line[position] in blanks:
            position += 1
        if line.startswith('"', position):
            field, k, position = _quoted_field(path, lines, k, position + 1)
            line = lines[k]
            stop = line.find(delimiter, position)
            rest = line[position : stop if stop >= 0 else len(line)].strip()
            if rest:
                raise FileFormatError(
                    path,
                    f"got {shown(rest)} after a closing quote, expected {delimiter!r} or the end of the line; "
                    'write a quote inside a quoted field twice ("")',
                    k + 1,
                )
        else:
            stop = line.find(delimiter, position)
            field = line[position : stop if stop >= 0 else len(line)].strip()
            if len(field) > LARGEST_FIELD:
                raise _too_large(path, k + 1)
        fields.append(field)
        if stop < 0:
            return fields, k + 1
        position = stop + 1


def _quoted_field(path: object, lines: list[str], k: int, position: int) -> tuple[str, int, int]:
    opened, parts, size = k, [], 0
    while True:
        line = lines[k]
        end = line.find('"', position)
        part = line[position:] + "\n" if end < 0 else line[position:end]
        parts.append(part)
        size += len(part)
        if size > LARGEST_FIELD:
            raise _too_large(path, opened + 1)
        if end < 0:
            k, position = k + 1, 0
            if k == len(lines):
                raise FileFormatError(
                    path,
                    "a quote opens here and is never closed; close it, or write it twice inside quotes",
                    opened + 1,
                )
        elif line.startswith('"', end + 1):
            parts.append('"')
            position = end + 2
        else:
            return "".join(parts), k, end + 1


def _too_large(path: object, line: int) -> FileFormatError:
    return FileFormatError(
        path, "got a field of over 1 MB; is a closing quote missing, or is this no text table?", line
    )
