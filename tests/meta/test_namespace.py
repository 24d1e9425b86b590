"""The root is a sorted, lazy table of contents, and a deployed node loads no solver."""

from __future__ import annotations

import importlib
import inspect
import json
import sys

import grimp
import pytest

import trigpoint
from house import PACKAGES, python

AT_MOST = 60
LOADED = "import {name}, sys, json; print(json.dumps(sorted({{m.split('.')[0] for m in sys.modules}})))"

NODE_MODULES = (
    "trigpoint.observers.local",
    "trigpoint.observers.acceleration",
    "trigpoint.observers.arc",
    "trigpoint.observers.node_file",
    "trigpoint.observers.run",
    "trigpoint.runtime",
)
"""What a deployed node may load of the house, besides arrays and errors."""

NODE_PACKAGES = {
    "trigpoint.observers.local": {"numpy"},
    "trigpoint.observers.acceleration": {"numpy"},
    "trigpoint.observers.arc": {"numpy"},
    "trigpoint.observers.node_file": {"numpy"},
    "trigpoint.observers.run": {"numpy", "xarray"},  # xarray only inside Run.dataset
    "trigpoint.runtime": {"numpy", "zenoh", "mcap", "zstandard", "lz4", "cryptography", "psutil"},
}


def loaded_by(name: str) -> set[str]:
    return set(json.loads(python(LOADED.format(name=name))))


def test_all_is_sorted_and_short() -> None:
    assert list(trigpoint.__all__) == sorted(set(trigpoint.__all__))
    assert len(trigpoint.__all__) <= AT_MOST


@pytest.mark.parametrize("name", trigpoint.__all__)
def test_every_name_resolves(name: str) -> None:
    assert getattr(trigpoint, name) is not None
    assert name in dir(trigpoint)


def test_unknown_names_are_attribute_errors() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        trigpoint.no_such_name  # noqa: B018


def test_root_is_lazy() -> None:
    assert not loaded_by("trigpoint") & {"numpy", "scipy", "networkx", "pydantic", "rich", "typer", "matplotlib"}


def test_no_function_is_named_like_a_module() -> None:
    functions = [name for name in trigpoint.__all__ if not inspect.ismodule(getattr(trigpoint, name))]
    assert sorted(set(functions) & set(PACKAGES)) == []


def test_names_mean_the_same_after_every_submodule_is_imported() -> None:
    code = """
import importlib, pkgutil, types, trigpoint
before = {name: getattr(trigpoint, name) for name in trigpoint.__all__}
for found in pkgutil.walk_packages(trigpoint.__path__, "trigpoint."):
    if not found.name.endswith("__main__"):
        importlib.import_module(found.name)
changed = [name for name, value in before.items() if getattr(trigpoint, name) is not value]
print(*changed)
"""
    assert python(code).split() == []


@pytest.mark.parametrize("name", ["trigpoint.runtime", "trigpoint.observers.local"])
def test_a_deployed_node_loads_no_solver(name: str) -> None:
    heavy = {"scipy", "matplotlib", "networkx", "pydantic", "rich", "typer", "pandas", "xarray", "jinja2"}
    assert not loaded_by(name) & heavy


@pytest.mark.parametrize("root", NODE_MODULES)
def test_a_deployed_node_imports_from_a_short_list(root: str) -> None:
    graph = grimp.build_graph("trigpoint", include_external_packages=True, cache_dir=None)
    modules = {root} | graph.find_descendants(root)
    inside = {"trigpoint", "trigpoint.observers", "trigpoint.arrays", "trigpoint.errors"}
    inside |= {f"trigpoint.observers.{module}" for module in ("acceleration", "arc", "node_file")}
    if root == "trigpoint.runtime":
        inside |= {"trigpoint.observers.local", "trigpoint.observers.run"} | modules
    stray = [
        f"{module} imports {imported}"
        for module in sorted(modules)
        for imported in sorted(graph.find_modules_directly_imported_by(module))
        if not _is_allowed(imported, inside, NODE_PACKAGES[root])
    ]
    assert stray == []


def _is_allowed(imported: str, inside: set[str], packages: set[str]) -> bool:
    top = imported.split(".")[0]
    if top == "trigpoint":
        return imported in inside or imported.startswith("trigpoint.arrays.")
    return top in sys.stdlib_module_names or top in packages


def test_every_package_has_a_table_of_contents() -> None:
    """All but ``linalg``, which is used module by module and has no public names."""
    modules = [importlib.import_module(f"trigpoint.{name}") for name in PACKAGES if name != "linalg"]
    without = [m.__name__ for m in modules if hasattr(m, "__path__") and not hasattr(m, "__all__")]
    assert without == []
