"""The verb ``design`` and the list of methods."""

from __future__ import annotations

from typing import Any

from trigpoint.errors import ArgumentError
from trigpoint.methods.base import Method
from trigpoint.methods.local_kalman import LocalKalman
from trigpoint.observers.network import NetworkObserver

METHODS: tuple[type[Method], ...] = (LocalKalman,)


def design(problem: Any, method: Any) -> NetworkObserver:
    """Design the observer of ``problem`` with ``method``.

    Args:
        problem: what is estimated, for example ``NetworkedAgents``.
        method: one of ``METHODS``, with its choices.

    Raises:
        MethodError: the method does not accept the problem; the message names the requirement, got and the remedy.
        ArgumentError: ``method`` is no method.
    """
    if not isinstance(method, Method):
        known = ", ".join(kind.__name__ for kind in METHODS)
        hint = f"; write {method.__name__}()" if isinstance(method, type) and issubclass(method, Method) else ""
        raise ArgumentError(f"method must be one of {known}; got {type(method).__name__}{hint}")
    return method.build(problem)
