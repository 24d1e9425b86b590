"""What some of a node's arcs make of its value, messages and readings, as one matrix. NumPy only: live nodes use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from trigpoint.arrays import FloatArray

if TYPE_CHECKING:
    from trigpoint.observers.local import LocalArc


@dataclass(frozen=True, eq=False)
class Correction:
    """``matrix @ (own value, messages, readings)``, stacked in this order.

    Attributes:
        names: whose messages, each once, in the order of the arcs.
        labels: which readings.
        matrix: (n, n + the messages' and the readings' lengths).
    """

    names: tuple[str, ...]
    labels: tuple[int, ...]
    matrix: FloatArray


def correction_of(arcs: Sequence[LocalArc], n_states: int) -> Correction:
    """The sum over the ``arcs`` of ``gain (sign y + sum of rows z_k - output z)``, z of ``n_states``."""
    messages = {name: rows.shape[1] for arc in arcs for name, rows in arc.heard}
    readings = {arc.label: arc.gain.shape[1] for arc in arcs if arc.label is not None}
    starts = np.cumsum([n_states, *messages.values(), *readings.values()]).tolist()
    places = {key: slice(*ends) for key, *ends in zip((*messages, *readings), starts, starts[1:], strict=False)}
    matrix = np.zeros((n_states, starts[-1]))
    for arc in arcs:
        matrix[:, :n_states] -= arc.gain @ arc.output
        for name, rows in arc.heard:
            matrix[:, places[name]] += arc.gain @ rows
        if arc.label is not None:
            matrix[:, places[arc.label]] += arc.sign * arc.gain
    return Correction(tuple(messages), tuple(readings), matrix)
