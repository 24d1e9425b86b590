"""A checker cannot share a bug with what it judges."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import trigpoint.certificates

FOLDER = Path(trigpoint.certificates.__file__).parent
FORBIDDEN = {"methods", "estimation", "simulation", "runtime", "io", "cli", "papers", "report", "dashboard", "testing"}


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide where a name comes from"
            names |= {node.module or ""} | {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.name)
def test_no_certificate_imports_a_design_method_or_a_neighbouring_package(path: Path) -> None:
    packages = {name.split(".")[1] for name in imported(path) if name.startswith("trigpoint.")}
    assert not packages & FORBIDDEN
    assert "trigpoint" not in imported(path), "the root names everything, the methods too"


def test_the_claims_are_listed_once_each() -> None:
    names = [kind.name for kind in trigpoint.certificates.CLAIMS]
    assert len(set(names)) == len(names) == 10
