"""XML read event by event, with line numbers, and nothing fetched or expanded: document types are refused."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Protocol
from xml.parsers import expat

from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.io.text import shown


class XmlHandler(Protocol):
    """What a format does with the events; element names come without their namespace prefix."""

    def start(self, name: str, attributes: Mapping[str, str], line: int, /) -> None:
        """An element opens at ``line``."""

    def end(self, name: str, text: str, /) -> None:
        """An element closes; ``text`` is the character data directly inside it."""


def parse_xml(path: object, data: bytes, handler: XmlHandler) -> None:
    """Feed one document to ``handler``.

    Raises:
        FileFormatError: not well-formed, or a DOCTYPE (hence any entity), with the line.
    """
    parser = expat.ParserCreate()
    parser.buffer_text = True
    texts: list[list[str]] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        texts.append([])
        handler.start(local_name(name), attributes, parser.CurrentLineNumber)

    def end(name: str) -> None:
        handler.end(local_name(name), "".join(texts.pop()))

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = lambda text: texts[-1].append(text)
    parser.StartDoctypeDeclHandler = lambda *_: _refuse_doctype(path, parser.CurrentLineNumber)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise FileFormatError(path, f"this is no well-formed XML ({reason}); correct the file", error.lineno) from None
    except (ValueError, LookupError) as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(path, f"the XML cannot be read ({error}); save it as UTF-8") from error


def _refuse_doctype(path: object, line: int) -> None:
    text = "got a DOCTYPE, which is not read (no entity is fetched or expanded); delete it and write the text itself"
    raise FileFormatError(path, text, line)


def local_name(name: str) -> str:
    """Element name without its namespace prefix."""
    return name.rpartition(":")[2]


def root_name(path: object, data: bytes) -> str:
    """Name of the outermost element."""
    found: list[str] = []

    class First:
        def start(self, name: str, _attributes: Mapping[str, str], _line: int) -> None:
            if not found:
                found.append(name)

        def end(self, _name: str, _text: str) -> None:
            """Nothing to do: the first start says it all."""

    parse_xml(path, data, First())
    return found[0]


def escape(text: str, what: str = "the text", also: Collection[str] = ()) -> str:
    """Text for an attribute or element; what XML cannot hold is an ``ArgumentError``."""
    for mark in text:
        code = ord(mark)
        if (code < 32 and mark not in "\t\n\r") or 0xD800 <= code <= 0xDFFF or code in (0xFFFE, 0xFFFF) or mark in also:
            raise ArgumentError(f"{what} {shown(text)} holds {mark!r}, which the file cannot hold; rename it")
    table = {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
    return "".join(table.get(mark, mark) for mark in text)
