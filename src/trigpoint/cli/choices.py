"""From the words of a ``[design]`` table or the command line to a design method: one row a method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from trigpoint.errors import ArgumentError
from trigpoint.io.sections import DesignSection
from trigpoint.methods import (
    Fixed,
    FromGraph,
    GainRule,
    LocalKalman,
    Method,
    WorstCase,
)
from trigpoint.model import NetworkedAgents, SharedPlant

_GAIN = ("gain", "margin", "max_nodes")
_COVARIANCES = ("process", "measurement")
_EVERYWHERE = {"method", "weights"}


@dataclass(frozen=True)
class Row:
    """How the table's keys make one method, and which keys it takes."""

    make: Callable[[DesignSection], Method]
    keys: tuple[str, ...]


def _local_kalman(design: DesignSection) -> Method:
    return LocalKalman(gain=gain_rule(design), process=design.process, measurement=design.measurement)


ROWS: dict[str, Row] = {
    "local-kalman": Row(_local_kalman, (*_GAIN, *_COVARIANCES)),
}


def method_of(design: DesignSection, problem: Any) -> Method:
    """The design method that a scenario or the command line asks for; by default the one that fits the ``problem``."""
    label = label_of(design, problem)
    if label not in ROWS:
        raise ArgumentError(f"no design method is called {label!r}; known are {', '.join(ROWS)}")
    row = ROWS[label]
    for key in sorted(design.model_fields_set - _EVERYWHERE):
        if key not in row.keys and getattr(design, key) is not None:
            raise ArgumentError(f"{key!r} does not belong to the method {label!r}; it takes {', '.join(row.keys)}")
    return row.make(design)


def label_of(design: DesignSection, problem: Any) -> str:
    """The method's name: the given one, or the one that fits the ``problem``."""
    if design.method is not None:
        return design.method
    if isinstance(problem, SharedPlant):
        return "spectrum-assignment"
    equal = isinstance(problem, NetworkedAgents) and problem.is_homogeneous
    return "local-kalman" if equal else "heterogeneous"


def gain_rule(design: DesignSection) -> GainRule:
    """The rule for the coupling gain."""
    margin = 1.05 if design.margin is None else design.margin
    if design.gain == "from-graph":
        return FromGraph(margin)
    if design.gain == "worst-case":
        if design.max_nodes is None:
            raise ArgumentError("gain 'worst-case' needs max_nodes (--max-nodes): the largest network it must serve")
        return WorstCase(design.max_nodes, margin)
    return Fixed(float(design.gain))
