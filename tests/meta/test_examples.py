"""Examples are tests: short, run, with an asserted number, by public names only; so are the reproduced papers."""

from __future__ import annotations

import ast
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from house import EXAMPLES, PACKAGE, PACKAGES, ROOT, listing

LINES = 100
SECONDS = 600
COMPOSERS = [*EXAMPLES, *sorted((PACKAGE / "papers").rglob("*.py"))]


def test_there_are_examples() -> None:
    assert EXAMPLES, "examples/ holds no example"


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_example_is_short_and_asserts(example: Path) -> None:
    text = example.read_text(encoding="utf-8")
    assert len(text.splitlines()) < LINES
    assert any(isinstance(node, ast.Assert) for node in ast.walk(ast.parse(text)))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_example_runs(example: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONWARNINGS": "error"}
    command = [sys.executable, str(example)]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert done.returncode == 0, done.stderr


def is_public(module_name: str, name: str) -> bool:
    """True when ``name`` may be imported from ``module_name``: the root or a package directly below it."""
    if module_name != "trigpoint" and module_name.removeprefix("trigpoint.") not in PACKAGES:
        return False
    module = importlib.import_module(module_name)
    if module_name == "trigpoint" and name in PACKAGES:
        return True
    return name in getattr(module, "__all__", [entry for entry in vars(module) if not entry.startswith("_")])


def is_private(node: ast.Attribute) -> bool:
    """True for ``thing._name``, unless a class speaks of itself."""
    own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
    return node.attr.startswith("_") and not node.attr.startswith("__") and not own


def private_uses(path: Path) -> list[str]:
    found = []
    within = path.is_relative_to(PACKAGE)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "trigpoint":
            module = node.module or ""
            if within and module.startswith("trigpoint.papers"):
                continue
            names = [alias.name for alias in node.names if not is_public(module, alias.name)]
            found += [f"{path.relative_to(ROOT)}:{node.lineno} from {module} import {name}" for name in names]
        elif isinstance(node, ast.Import):
            deep = [
                alias.name for alias in node.names if alias.name.startswith("trigpoint.") and alias.name.count(".") > 1
            ]
            found += [f"{path.relative_to(ROOT)}:{node.lineno} import {name}" for name in deep]
        elif isinstance(node, ast.Attribute) and is_private(node):
            found.append(f"{path.relative_to(ROOT)}:{node.lineno} .{node.attr}")
    return found


def test_only_public_names_are_used() -> None:
    failures = [use for path in COMPOSERS for use in private_uses(path)]
    assert not failures, listing(failures)
