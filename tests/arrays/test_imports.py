"""A deployed node loads NumPy only: no file of the two lowest layers imports SciPy or networkx, at any depth."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import trigpoint

PACKAGE = Path(trigpoint.__file__).parent
LOWEST = [PACKAGE / "errors.py", *sorted((PACKAGE / "arrays").glob("*.py"))]
HEAVY = {"scipy", "networkx", "pydantic", "rich", "typer", "matplotlib", "hypothesis"}


def imported_packages(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").split(".")[0])
    return names


@pytest.mark.parametrize("path", LOWEST, ids=lambda path: path.name)
def test_no_file_of_arrays_or_errors_imports_a_heavy_package(path) -> None:
    assert not imported_packages(path) & HEAVY


def test_importing_arrays_loads_no_heavy_package() -> None:
    code = "import sys, trigpoint.arrays, trigpoint.errors; print(*sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & HEAVY
