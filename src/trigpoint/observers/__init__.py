"""Observers as pure values. Loaded lazily, since a deployed node imports ``observers.local`` and nothing else."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trigpoint.observers.arc import LocalArc as LocalArc
    from trigpoint.observers.assembled import AssembledObserver as AssembledObserver
    from trigpoint.observers.centralised import CentralisedObserver as CentralisedObserver
    from trigpoint.observers.local import LocalObserver as LocalObserver
    from trigpoint.observers.local import LocalState as LocalState
    from trigpoint.observers.local import Message as Message
    from trigpoint.observers.network import DesignResiduals as DesignResiduals
    from trigpoint.observers.network import DiffusiveObserver as DiffusiveObserver
    from trigpoint.observers.network import GeneralForm as GeneralForm
    from trigpoint.observers.network import NetworkObserver as NetworkObserver
    from trigpoint.observers.projected import ProjectedConsensusObserver as ProjectedConsensusObserver
    from trigpoint.observers.projection import ProjectionProgram as ProjectionProgram
    from trigpoint.observers.run import Run as Run

_HOME = {
    "AssembledObserver": "assembled",
    "CentralisedObserver": "centralised",
    "DesignResiduals": "network",
    "DiffusiveObserver": "network",
    "GeneralForm": "network",
    "LocalArc": "arc",
    "LocalObserver": "local",
    "LocalState": "local",
    "Message": "local",
    "NetworkObserver": "network",
    "ProjectedConsensusObserver": "projected",
    "ProjectionProgram": "projection",
    "Run": "run",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"trigpoint.observers.{_HOME[name]}"), name)
    raise AttributeError(f"module 'trigpoint.observers' has no attribute {name!r}")
