"""Where things are: shared by the tests of the house."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import trigpoint

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "trigpoint"
SOURCES = sorted(PACKAGE.rglob("*.py"))
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PACKAGES = sorted(found.name for found in pkgutil.iter_modules(trigpoint.__path__))


def every_module() -> list[str]:
    """Dotted names of all modules of the package, ``__main__`` excepted."""
    found = pkgutil.walk_packages(trigpoint.__path__, "trigpoint.")
    return sorted(entry.name for entry in found if not entry.name.endswith("__main__"))


def docstrings() -> Iterator[tuple[str, str]]:
    """Place (``file:line name``) and text of every docstring in the source."""
    for path in SOURCES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node)
                if text:
                    name = getattr(node, "name", "module")
                    yield f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)} {name}", text


def public_objects() -> Iterator[tuple[str, object]]:
    """Every name in the ``__all__`` of the root and of each package below it, with what it stands for."""
    for module_name in ("trigpoint", *(f"trigpoint.{name}" for name in PACKAGES)):
        module = importlib.import_module(module_name)
        for name in getattr(module, "__all__", ()):
            yield f"{module_name}.{name}", getattr(module, name)


def python(code: str, cwd: Path = ROOT) -> str:
    """Standard output of ``code`` in a fresh interpreter; an error fails the test with its message."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=cwd, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def listing(failures: list[str]) -> str:
    """The failures, a line each, for an assertion message."""
    return "\n" + "\n".join(failures)
