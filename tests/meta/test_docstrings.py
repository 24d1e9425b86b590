"""Docstrings: everything public has one, every parameter stands in it, every source can be looked up."""

from __future__ import annotations

import enum
import inspect
import re
from collections.abc import Callable, Iterator

from house import ROOT, docstrings, listing, public_objects

BIB_KEY = re.compile(r"^@\w+\{([^,\s]+),", re.MULTILINE)
CITED = re.compile(r"\bkeys? ([A-Z]\w+(?:(?:,| and) [A-Z]\w*\d\w*)*)")
PAPER = re.compile(r"\b([A-Z]\d{2})\b(?=,|:| \d| Theorem| Section| Remark|'s)")
SOURCE = re.compile(r"Source:\s*(.+?)(?:\n\s*\n|\Z)", re.DOTALL)
RESULT = re.compile(r"\b(E-\d{3}-\d+[a-z]?|theory \d+[a-z]?-[A-Z]\d+|\d{3}-\d{2})\b")


def parameters(function: Callable[..., object]) -> list[str]:
    names = inspect.signature(function).parameters
    return [name for name in names if name not in ("self", "cls") and not name.startswith("_")]


def members(label: str, kind: type) -> Iterator[tuple[str, object]]:
    for name, member in vars(kind).items():
        inner = member.__func__ if isinstance(member, staticmethod | classmethod) else member
        if isinstance(inner, property):
            inner = inner.fget
        if not name.startswith("_") and inspect.isfunction(inner) and inner.__module__.startswith("trigpoint"):
            yield f"{label}.{name}", inner


def public_callables(*, with_members: bool = True) -> Iterator[tuple[str, object]]:
    """Every public class, function and public method of ours, once each."""
    seen: set[int] = set()
    for label, value in public_objects():
        if not (inspect.isclass(value) or inspect.isfunction(value)) or not value.__module__.startswith("trigpoint"):
            continue
        if id(value) in seen:
            continue
        seen.add(id(value))
        yield label, value
        if with_members and inspect.isclass(value):
            yield from members(label, value)


def own_docstring(value: object) -> str:
    text = getattr(value, "__doc__", None) or ""
    automatic = inspect.isclass(value) and text.startswith(f"{value.__name__}(")
    return "" if automatic else text


def is_error_or_enum(value: object) -> bool:
    """True for classes that nobody calls with arguments of their own: protocols, too."""
    named = getattr(value, "_is_protocol", False)
    return inspect.isclass(value) and (named or issubclass(value, BaseException | enum.Enum))


def test_everything_public_has_a_docstring() -> None:
    without = [label for label, value in public_callables() if not own_docstring(value).strip()]
    assert not without, listing(without)


def test_every_parameter_is_mentioned() -> None:
    """As an entry under ``Args:`` or in a sentence or formula; a class's docstring speaks of its constructor's."""
    failures = []
    for label, value in public_callables(with_members=False):
        known = set(re.findall(r"\w+", own_docstring(value)))
        missing = [] if is_error_or_enum(value) else [name for name in parameters(value) if name not in known]
        if missing:
            failures.append(f"{label}: say what {', '.join(missing)} is (`name` in the text, or an entry under Args)")
    assert not failures, listing(failures)


def test_every_cited_key_stands_in_the_bibliography() -> None:
    known = set(BIB_KEY.findall((ROOT / "docs" / "references.bib").read_text(encoding="utf-8")))
    failures = []
    for place, text in docstrings():
        cited = {key for group in CITED.findall(text) for key in re.findall(r"[A-Z]\w*\d\w*", group)}
        cited |= set(PAPER.findall(text))
        failures += [f"{place}: {key} is not in docs/references.bib" for key in sorted(cited - known)]
    assert not failures, listing(failures)


def test_every_source_names_a_key_or_a_result() -> None:
    keys = BIB_KEY.findall((ROOT / "docs" / "references.bib").read_text(encoding="utf-8"))
    failures = []
    for place, text in docstrings():
        failures += [
            f"{place}: 'Source: {source.splitlines()[0]}' names no key of docs/references.bib and no numbered result"
            for source in SOURCE.findall(text)
            if not RESULT.search(source) and not any(re.search(rf"\b{key}\b", source) for key in keys)
        ]
    assert not failures, listing(failures)


def test_every_numbered_result_is_explained() -> None:
    """Numbers such as E-000-1, theory 8-G1 or 000-10 in a docstring stand on a page of docs/explanation."""
    pages = sorted((ROOT / "docs" / "explanation").glob("*.md"))
    explained = set(RESULT.findall(" ".join(page.read_text(encoding="utf-8") for page in pages)))
    failures = [
        f"{place}: {number} is on no page of docs/explanation"
        for place, text in docstrings()
        for number in sorted(set(RESULT.findall(text)) - explained)
    ]
    assert not failures, listing(failures)
