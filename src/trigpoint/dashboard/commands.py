"""What the page may ask for, checked strictly. Commands are JSON objects of at most 4096 characters::

{"type": "play"} | {"type": "pause"} | {"type": "seek", "frame": k} | {"type": "speed", "value": s}   replays only
{"type": "select", "node": i or null}    answered by the history of node i, then by its details with every frame
{"type": "order", "order": "pause" | "go" | "kill" | "revive", "node": i}    only where the feed has controls
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from trigpoint.errors import ProtocolError

LONGEST = 4096
_KEYS: dict[str, set[str]] = {
    "play": set(),
    "pause": set(),
    "seek": {"frame"},
    "speed": {"value"},
    "select": {"node"},
    "order": {"order", "node"},
}


def decode_command(text: str) -> dict[str, Any]:
    """Read one command from ``text``; anything else is a ``ProtocolError`` that says why."""
    if len(text) > LONGEST:
        raise ProtocolError(f"a command has at most {LONGEST} characters; got {len(text)}")
    try:
        command = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"a command must be JSON ({error})") from error
    kind = command.get("type") if isinstance(command, dict) else None
    if not isinstance(kind, str) or kind not in _KEYS:
        raise ProtocolError(f"a command must be an object of type {', '.join(_KEYS)}")
    if set(command) != {"type", *_KEYS[kind]}:
        raise ProtocolError(f"the command {kind} has the keys {', '.join(['type', *sorted(_KEYS[kind])])}, no other")
    return dict(command)


def whole(command: Mapping[str, Any], key: str, count: int) -> int:
    """Return the whole number ``key`` of ``command``, at least 0 and below ``count``."""
    value = command[key]
    if type(value) is not int or not 0 <= value < count:
        raise ProtocolError(f"{key} must be a whole number, 0 <= {key} < {count}; got {str(value)[:40]}")
    return value


def selected(command: Mapping[str, Any], count: int) -> int | None:
    """Return the node of ``count`` that a select ``command`` names, or None."""
    return None if command["node"] is None else whole(command, "node", count)


def ordered(command: Mapping[str, Any], orders: tuple[str, ...], count: int) -> tuple[str, int]:
    """Return the order, one of ``orders``, and the node of ``count`` that it is for."""
    order = command["order"]
    if not isinstance(order, str) or order not in orders:
        known = ", ".join(orders) if orders else "none: this page can only look"
        raise ProtocolError(f"an order must be one of {known}; got {str(order)[:40]}")
    return order, whole(command, "node", count)
