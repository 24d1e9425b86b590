"""Observers as JSON documents (kind ``trigpoint/observer``), with the problem they belong to."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from trigpoint.arrays import decode_array, encode_array
from trigpoint.errors import ProtocolError
from trigpoint.model.documents import problem_document, read_problem
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

KIND = "trigpoint/observer"
VERSION = 1


def observer_document(observer: NetworkObserver) -> dict[str, Any]:
    """The observer as a JSON object: form, gains, rates, facts, and its problem."""
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


def read_observer(document: Mapping[str, Any]) -> DiffusiveObserver:
    """Read ``observer_document``; what does not fit is a ``ProtocolError``."""
    if not isinstance(document, Mapping):
        raise ProtocolError(f"an observer document is an object; got {type(document).__name__}")
    if document.get("kind") != KIND or document.get("version") != VERSION or document.get("form") != "diffusive":
        raise ProtocolError(f"expected kind {KIND!r}, version {VERSION}, form 'diffusive'")
    try:
        problem = read_problem(document["problem"])
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
    return encode_array(value) if isinstance(value, np.ndarray) else value


def _value(name: str, value: Any) -> Any:
    return decode_array(value, name) if isinstance(value, dict) else value
