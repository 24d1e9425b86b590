"""Trigpoint's own documents as JSON: problems, observers, certificates, node files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from trigpoint.model import HyperNetwork, NetworkedAgents, SharedPlant
from trigpoint.model.documents import KIND as PROBLEM
from trigpoint.model.documents import problem_document, read_problem
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.certificate import KIND as CERTIFICATE
from trigpoint.observers.certificate import Certificate, certificate_document, read_certificate
from trigpoint.observers.documents import KIND as OBSERVER
from trigpoint.observers.documents import observer_document, read_observer
from trigpoint.observers.local import KIND as NODE
from trigpoint.observers.local import LocalObserver
from trigpoint.observers.network import DiffusiveObserver

READERS: Mapping[str, Callable[[dict[str, Any]], object]] = {
    CERTIFICATE: read_certificate,
    NODE: LocalObserver.from_document,
    OBSERVER: read_observer,
    PROBLEM: read_problem,
}
"""Readers of JSON documents by their ``kind``."""


def _as_text(document: Mapping[str, Any]) -> str:
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


WRITERS: Mapping[type, Callable[[Any], str]] = {
    AssembledObserver: lambda value: _as_text(observer_document(value)),
    Certificate: lambda value: _as_text(certificate_document(value)),
    DiffusiveObserver: lambda value: _as_text(observer_document(value)),
    HyperNetwork: lambda value: _as_text(problem_document(value)),
    LocalObserver: lambda value: _as_text(value.to_document()),
    NetworkedAgents: lambda value: _as_text(problem_document(value)),
    SharedPlant: lambda value: _as_text(problem_document(value)),
}
"""Writers of objects to JSON text by exact type."""
