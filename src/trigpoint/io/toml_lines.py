"""Lines of the keys of a TOML text, which the standard reader does not tell. The text has already been read once."""

from __future__ import annotations

import re
import tomllib

KeyPath = tuple[str | int, ...]

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_STRING = re.compile(r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'', re.DOTALL)
_SCALAR = re.compile(r"[^,\]}\n#]+")
_FILLER = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BLANKS = re.compile(r"[ \t]*")


def key_lines(text: str) -> dict[KeyPath, int]:
    """Line of every table, key and array element, by its path such as ``("network", "arcs", 2, "value")``.

    We assume:
        * ``tomllib`` accepts the text.
    """
    scanner = _Scanner(text)
    scanner.document()
    return scanner.lines


def line_of(lines: dict[KeyPath, int], path: KeyPath) -> int | None:
    """Line of ``path``, or of the nearest table or key around it."""
    for length in range(len(path), 0, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return None


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0
        self.lines: dict[KeyPath, int] = {}
        self._counted = (0, 1)
        self._array_tables: dict[KeyPath, int] = {}

    def document(self) -> None:
        table: KeyPath = ()
        while True:
            self._skip(_FILLER)
            if self.position >= len(self.text):
                return
            if self._at("["):
                table = self._header()
            else:
                self._pair(table)

    def _header(self) -> KeyPath:
        double = self._at("[[")
        self.position += 2 if double else 1
        path: KeyPath = ()
        keys = self._keys()
        for key in keys[:-1]:
            path = (*path, key)
            self._note(path)
            if path in self._array_tables:
                path = (*path, self._array_tables[path])
        path = (*path, keys[-1])
        self._note(path)
        if double:
            self._array_tables[path] = self._array_tables.get(path, -1) + 1
            path = (*path, self._array_tables[path])
            self._note(path)
        self.position += 2 if double else 1
        return path

    def _pair(self, table: KeyPath) -> None:
        path = table
        start = self.position
        for key in self._keys():
            path = (*path, key)
            self._note(path, start)
        self.position += 1  # the equals sign
        self._value(path)

    def _keys(self) -> list[str]:
        keys = []
        while True:
            self._skip(_BLANKS)
            word = self._take(_BARE_KEY) or self._take(_STRING)
            keys.append(word if word[:1] not in ("'", '"') else str(tomllib.loads(f"k = {word}")["k"]))
            self._skip(_BLANKS)
            if not self._at("."):
                return keys
            self.position += 1

    def _value(self, path: KeyPath) -> None:
        self._skip(_BLANKS)
        if self._at("["):
            self._array(path)
        elif self._at("{"):
            self._inline_table(path)
        elif not self._take(_STRING):
            self._take(_SCALAR)

    def _array(self, path: KeyPath) -> None:
        self.position += 1
        count = 0
        while True:
            self._skip(_FILLER)
            if self._at("]"):
                self.position += 1
                return
            self._note((*path, count))
            self._value((*path, count))
            count += 1
            self._skip(_FILLER)
            if self._at(","):
                self.position += 1

    def _inline_table(self, path: KeyPath) -> None:
        self.position += 1
        while True:
            self._skip(_FILLER)
            if self._at("}"):
                self.position += 1
                return
            self._pair(path)
            self._skip(_FILLER)
            if self._at(","):
                self.position += 1

    def _note(self, path: KeyPath, position: int | None = None) -> None:
        where = self.position if position is None else position
        counted, line = self._counted
        line += self.text.count("\n", counted, where)
        self._counted = (where, line)
        self.lines.setdefault(path, line)

    def _at(self, mark: str) -> bool:
        return self.text.startswith(mark, self.position)

    def _take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.position)
        if match is None:
            return ""
        self.position = match.end()
        return match[0]

    def _skip(self, pattern: re.Pattern[str]) -> None:
        self._take(pattern)
