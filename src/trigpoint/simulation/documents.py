"""A scenario as a JSON object and back: what a run needs to be run again, bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from trigpoint.arrays import decode_array, encode_array
from trigpoint.errors import ProtocolError, TrigpointError
from trigpoint.simulation.channel import Bursts, Channel, Outage, Trigger
from trigpoint.simulation.clocks import Clocks
from trigpoint.simulation.motion import Bouncing, Trajectory
from trigpoint.simulation.scenario import Noise, Scenario
from trigpoint.simulation.topology import Absence, Topology

_VALUES: dict[str, type] = {
    kind.__name__: kind
    for kind in (Noise, Channel, Bursts, Outage, Trigger, Clocks, Topology, Absence, Trajectory, Bouncing)
}


def scenario_document(scenario: Scenario) -> dict[str, Any]:
    """Every field of ``scenario``; arrays as base64 of little-endian float64."""
    return {field.name: _encoded(getattr(scenario, field.name)) for field in fields(scenario)}


def scenario_from_document(document: Mapping[str, Any]) -> Scenario:
    """Read it back from ``document``; anything that does not fit is a ``ProtocolError``."""
    if not isinstance(document, Mapping) or set(document) != {field.name for field in fields(Scenario)}:
        raise ProtocolError("a scenario's document holds exactly the fields of Scenario")
    try:
        return Scenario(**{name: _decoded(value, name) for name, value in document.items()})
    except (TrigpointError, TypeError, ValueError) as error:
        raise ProtocolError(f"this is no scenario: {error}") from error


def _encoded(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        inner = {field.name: _encoded(getattr(value, field.name)) for field in fields(value)}
        return {"value": type(value).__name__, **inner}
    if isinstance(value, np.ndarray):
        return {"bits": encode_array(value.astype(np.float64))} if value.dtype == np.bool_ else encode_array(value)
    if isinstance(value, tuple):
        return [_encoded(one) for one in value]
    return repr(value) if isinstance(value, float) and not np.isfinite(value) else value


def _decoded(value: Any, name: str) -> Any:
    if isinstance(value, list):
        return tuple(_decoded(one, name) for one in value)
    if value in ("inf", "-inf"):
        return float(value)
    if not isinstance(value, dict):
        return value
    if "bits" in value:
        return decode_array(value["bits"], name) != 0.0
    if "value" not in value:
        return decode_array(value, name)
    kind = value["value"]
    if kind not in _VALUES:
        raise ProtocolError(f"{name!r} names the unknown value {kind!r}")
    return _VALUES[kind](**{key: _decoded(inner, key) for key, inner in value.items() if key != "value"})
