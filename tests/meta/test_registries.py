"""What is registered is exported and documented: a format, a method or a claim cannot be forgotten."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterable, Iterator, Mapping

import pytest

from house import ROOT, listing
from trigpoint.cli.commands import app

REGISTRIES = {
    "io": ("FORMATS", "formats.md"),
    "methods": ("METHODS", "methods.md"),
    "certificates": ("CLAIMS", "claims.md"),
    "runtime": ("ADDRESS_KINDS", "transports.md"),
}


def entries(registry: Mapping[str, object] | Iterable[object]) -> Iterator[tuple[str, object]]:
    """Name and object of each entry: the registry maps names, or lists objects that carry a ``label`` or ``name``."""
    if isinstance(registry, Mapping):
        yield from registry.items()
        return
    for value in registry:
        names = [getattr(value, attribute, None) for attribute in ("label", "name", "__name__")]
        yield next((name for name in names if isinstance(name, str)), type(value).__name__), value


def exported_as(value: object) -> set[str]:
    """Names under which the package may export an entry: its own, or its class's."""
    own = value if inspect.isclass(value) or inspect.isroutine(value) else type(value)
    return {own.__name__}


@pytest.mark.parametrize("package", REGISTRIES)
def test_registry_is_public_and_filled(package: str) -> None:
    module = importlib.import_module(f"trigpoint.{package}")
    name = REGISTRIES[package][0]
    assert name in module.__all__
    assert list(entries(getattr(module, name)))


@pytest.mark.parametrize("package", REGISTRIES)
def test_every_entry_is_exported(package: str) -> None:
    module = importlib.import_module(f"trigpoint.{package}")
    registry = getattr(module, REGISTRIES[package][0])
    failures = [
        f"trigpoint.{package}: {name!r} is registered, {' or '.join(sorted(exported_as(value)))} is not in __all__"
        for name, value in entries(registry)
        if not exported_as(value) & set(module.__all__)
    ]
    assert not failures, listing(failures)


@pytest.mark.parametrize("package", REGISTRIES)
def test_every_entry_is_documented(package: str) -> None:
    module = importlib.import_module(f"trigpoint.{package}")
    attribute, page = REGISTRIES[package]
    text = (ROOT / "docs" / "reference" / page).read_text(encoding="utf-8")
    failures = [
        f"docs/reference/{page}: `{name}` is registered and not in the page"
        for name, _ in entries(getattr(module, attribute))
        if f"`{name}`" not in text
    ]
    assert not failures, listing(failures)


def test_the_commands_are_the_documented_ones() -> None:
    text = (ROOT / "docs" / "reference" / "cli.md").read_text(encoding="utf-8")
    documented = re.findall(r"^\| `([a-z]+)(?=[ `])", text, re.MULTILINE)
    assert sorted(documented) == sorted(command.name or "" for command in app.registered_commands)


def test_every_experiment_is_documented() -> None:
    """By its name and by every option of it."""
    text = (ROOT / "docs" / "reference" / "experiments.md").read_text(encoding="utf-8")
    rows = {
        row.split("|")[1].strip(): row for row in text.partition("## Outcome")[0].splitlines() if row.startswith("|")
    }
    experiments = importlib.import_module("trigpoint.papers").EXPERIMENTS
    failures = [name for name in experiments if f"`{name}`" not in rows]
    failures += [
        f"{name}: {option}"
        for name, run in experiments.items()
        for option in inspect.signature(run).parameters
        if f"`{option}`" not in rows.get(f"`{name}`", "")
    ]
    assert not failures, listing(failures)
