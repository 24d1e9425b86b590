"""One page as one HTML file: no script, no outside request, readable on screen (light or dark) and on paper."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.report import _engines
from trigpoint.report._text import cell

if TYPE_CHECKING:
    from markupsafe import Markup

_ALIGNMENTS = ("left", "right", "whole")
_FORBIDDEN = ("script", "foreignObject", "iframe", "a")
_TARGET = re.compile(r"url\(\s*[\"']?([^)]*)")


@dataclass(frozen=True)
class Table:
    """Rows under column headings.

    Attributes:
        columns: C headings.
        rows: tuples of C cells: text, numbers (six significant digits; more as text), truth values, None (a dash).
        caption: a line above the table.
        align: ``left``, ``right`` or ``whole`` (left, never broken over lines) a column; None: right where a column
            holds numbers only, else left.
        folded: shown when its caption is clicked; printed in any case.
        notes: numbered lines below the table.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    caption: str = ""
    align: Sequence[str] | None = None
    folded: bool = False
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Every row has one cell a column."""
        for k, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ShapeError(f"row {k} of the table has {len(row)} cells; the columns are {len(self.columns)}")
        if self.align is not None and len(self.align) != len(self.columns):
            raise ShapeError(f"align has {len(self.align)} entries; the columns are {len(self.columns)}")
        if self.folded and not self.caption:
            raise ArgumentError("a folded table needs a caption to click on")
        unknown = [text for text in self.align or () if text not in _ALIGNMENTS]
        if unknown:
            raise ArgumentError(f"align takes 'left', 'right' and 'whole'; got {unknown[0]!r}")

    @property
    def alignments(self) -> tuple[str, ...]:
        """``left``, ``right`` or ``whole`` for each column."""
        if self.align is not None:
            return tuple(self.align)
        return tuple("right" if self._is_numeric(k) else "left" for k in range(len(self.columns)))

    @property
    def texts(self) -> tuple[tuple[str, ...], ...]:
        """The cells as they are printed."""
        return tuple(tuple(cell(value) for value in row) for row in self.rows)

    def _is_numeric(self, column: int) -> bool:
        cells = [row[column] for row in self.rows if row[column] is not None]
        numbers = (int, float, np.integer, np.floating)
        return bool(cells) and all(isinstance(value, numbers) and not isinstance(value, bool) for value in cells)


@dataclass(frozen=True)
class Figure:
    """A picture as ``svg`` text, and what it shows (``caption``). It must be self-contained and free of scripts."""

    svg: str
    caption: str

    def __post_init__(self) -> None:
        """Refuse what a page must not carry, since the SVG is written into it as it is."""
        _check_svg(self.svg)

    @property
    def markup(self) -> Markup:
        """The checked SVG, exempt from escaping."""
        from markupsafe import Markup

        return Markup(self.svg)


@dataclass(frozen=True)
class Section:
    """A heading (``title``), paragraphs (``text``, parted by blank lines), then tables and figures (``items``)."""

    title: str
    text: str = ""
    items: Sequence[Table | Figure] = ()

    @property
    def paragraphs(self) -> tuple[str, ...]:
        """The text's paragraphs, without empty ones."""
        blocks = "\n".join(line.rstrip() for line in self.text.splitlines()).split("\n\n")
        return tuple(block.strip() for block in blocks if block.strip())


@dataclass(frozen=True)
class Page:
    """A whole page: ``title``, ``subtitle`` and ``sections``; a table of ``contents`` leads to each of them."""

    title: str
    subtitle: str
    sections: Sequence[Section]
    contents: bool = False


def render(page: Page) -> str:
    """Return the page as one self-contained HTML document.

    Every text is escaped. The page holds its own style, asks nothing of any host and forbids it (content security
    policy), and runs no script. Equal pages give equal text.

    Raises ``MissingExtraError`` where jinja2 is not installed.
    """
    return _engines.page_template().render(page=page)


def _check_svg(svg: str) -> None:
    if "<!DOCTYPE" in svg or "<!ENTITY" in svg:
        raise ArgumentError(
            "a figure's SVG must begin with <svg: it has a DOCTYPE or an entity, which names other files"
        )
    if "<?" in svg:
        raise ArgumentError("a figure's SVG must begin with <svg: it has a processing instruction (<?...?>)")
    try:
        root = ElementTree.fromstring(svg)
    except ElementTree.ParseError as error:
        raise ArgumentError(f"a figure's SVG must be well-formed XML ({error})") from error
    if _local(root.tag) != "svg":
        raise ArgumentError(f"a figure must be an <svg> element; got <{_local(root.tag)}>")
    for element in root.iter():
        tag = _local(element.tag)
        if tag in _FORBIDDEN:
            raise ArgumentError(f"a figure's SVG must not contain <{tag}>")
        if tag == "style":
            _check_style(element.text or "")
        for name, value in element.attrib.items():
            _check_attribute(_local(name), value)


def _check_attribute(name: str, value: str) -> None:
    if name.lower().startswith("on"):
        raise ArgumentError(f"a figure's SVG must not contain the event handler {name!r}")
    if name in ("href", "src") and not value.strip().startswith(("#", "data:image/png")):
        raise ArgumentError(f"a figure's SVG must refer to nothing outside itself; got {name}={value!r}")
    _check_style(value if "url(" in value else "")


def _check_style(text: str) -> None:
    outside = [target for target in _TARGET.findall(text) if not target.startswith("#")]
    if outside or "@import" in text:
        raise ArgumentError(f"a figure's SVG must refer to nothing outside itself; got the style {text[:60]!r}")


def _local(tag: object) -> str:
    return str(tag).rpartition("}")[2]
