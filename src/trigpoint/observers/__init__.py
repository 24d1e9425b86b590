"""Observers as pure values. Loaded lazily, since a deployed node imports ``observers.local`` and nothing else."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trigpoint.observers.run import Run as Run

_HOME = {"Run": "run"}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"trigpoint.observers.{_HOME[name]}"), name)
    raise AttributeError(f"module 'trigpoint.observers' has no attribute {name!r}")
