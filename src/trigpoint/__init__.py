"""Distributed state estimation from relative measurements.

The table of contents: every public name, loaded when it is first used (``import trigpoint`` alone loads nothing).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "EXTERNAL": "graphs",
    "MeasurementGraph": "graphs",
}

_MODULES = ("graphs",)

__all__ = sorted([*_HOME, *_MODULES, "__version__"])

if TYPE_CHECKING:
    from trigpoint import graphs as graphs
    from trigpoint.graphs import EXTERNAL as EXTERNAL
    from trigpoint.graphs import MeasurementGraph as MeasurementGraph


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"trigpoint.{name}")
    if name in _HOME:
        return getattr(importlib.import_module(f"trigpoint.{_HOME[name]}"), name)
    raise AttributeError(f"module 'trigpoint' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
