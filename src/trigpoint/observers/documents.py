"""Observers as JSON documents (kind ``trigpoint/observer``), with the problem they belong to."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from trigpoint.arrays import decode_array, encode_array
from trigpoint.errors import ProtocolError
from trigpoint.model import NetworkedAgents
from trigpoint.model.documents import problem_document, read_problem
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalObserver
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

KIND = "trigpoint/observer"
VERSION = 1


def observer_document(observer: NetworkObserver) -> dict[str, Any]:
    """The observer as a JSON object: form, gains or programs, rates, facts, and its problem."""
    if isinstance(observer, AssembledObserver):
        return _assembled_document(observer)
    if not isinstance(observer, DiffusiveObserver):
        raise ProtocolError(f"no document form for {type(observer).__name__}")
    return {
        "kind": KIND,
        "version": VERSION,
        "form": "diffusive",
        "method": observer.method,
        "gain": observer.gain,
        "injection": encode_array(observer.injection),
        "decay_rate": observer.decay_rate,
        "spectral_abscissa": observer.spectral_abscissa,
        "facts": {key: _plain(value) for key, value in observer.facts.items()},
        "problem": problem_document(observer.problem),
    }


def _assembled_document(observer: AssembledObserver) -> dict[str, Any]:
    return {
        "kind": KIND,
        "version": VERSION,
        "form": "programs",
        "method": observer.method,
        "decay_rate": observer.decay_rate,
        "spectral_abscissa": observer.spectral_abscissa,
        "period": observer.period,
        "nodes": [node.to_document() for node in observer.nodes],
        "targets": None if observer.targets is None else [encode_array(target) for target in observer.targets],
        "facts": {key: _plain(value) for key, value in observer.facts.items()},
        "problem": problem_document(observer.problem),
    }


def _read_assembled(document: Mapping[str, Any]) -> AssembledObserver:
    try:
        targets = document["targets"]
        rate, abscissa, period = document["decay_rate"], document["spectral_abscissa"], document["period"]
        if not (_is_number(rate) and all(value is None or _is_number(value) for value in (abscissa, period))):
            raise ProtocolError(f"decay_rate must be a number, got {rate!r}; spectral_abscissa and period may be null")
        return AssembledObserver(
            str(document["method"]),
            read_problem(document["problem"]),
            tuple(LocalObserver.from_document(node) for node in document["nodes"]),
            float(rate),
            abscissa,
            {name: _value(name, value) for name, value in dict(document["facts"]).items()},
            None if targets is None else tuple(decode_array(target, "targets") for target in targets),
            period,
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise ProtocolError(f"the observer document does not fit: {error}") from error


def read_observer(document: Mapping[str, Any]) -> DiffusiveObserver | AssembledObserver:
    """Read ``observer_document``; what does not fit is a ``ProtocolError``."""
    if not isinstance(document, Mapping):
        raise ProtocolError(f"an observer document is an object; got {type(document).__name__}")
    form = document.get("form")
    if document.get("kind") != KIND or document.get("version") != VERSION or form not in ("diffusive", "programs"):
        raise ProtocolError(f"expected kind {KIND!r}, version {VERSION}, form 'diffusive' or 'programs'")
    if form == "programs":
        return _read_assembled(document)
    try:
        problem = read_problem(document["problem"])
        if not isinstance(problem, NetworkedAgents):
            raise ProtocolError("a diffusive observer belongs to a network of equal agents")
        injection = decode_array(document["injection"], "injection")
        gain, rate, abscissa = document["gain"], document["decay_rate"], document["spectral_abscissa"]
        method = document["method"]
        facts = {name: _value(name, value) for name, value in dict(document["facts"]).items()}
        expected = (problem.agent.n_states, problem.n_outputs)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ProtocolError(f"the observer document does not fit: {error}") from error
    if injection.shape != expected:
        raise ProtocolError(f"injection must have shape (n, p) = {expected}; got {injection.shape}")
    if not (_is_number(gain) and _is_number(rate)) or gain <= 0:
        raise ProtocolError(f"gain must be a positive number and decay_rate a number; got {gain!r}, {rate!r}")
    if not (abscissa is None or _is_number(abscissa)):
        raise ProtocolError(f"spectral_abscissa must be a number or null; got {abscissa!r}")
    if not isinstance(method, str):
        raise ProtocolError(f"method must be a text; got {method!r}")
    return DiffusiveObserver(method, problem, injection, float(gain), float(rate), abscissa, facts)


def _is_number(value: Any) -> bool:
    """A finite number that a float can hold; JSON also has whole numbers that none can."""
    return type(value) in (float, int) and abs(value) <= sys.float_info.max


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return encode_array(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value if isinstance(value, str | float | int | None) else str(value)


def _value(name: str, value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_value(name, entry) for entry in value)
    return decode_array(value, name) if isinstance(value, dict) else value
