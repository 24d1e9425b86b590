"""A node's arcs, and what some of them make of its value, messages and readings. NumPy only: live nodes use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trigpoint.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class LocalArc:
    """One arc as the node at one of its ends sees it.

    The arc corrects the node's value by ``gain @ (sign * y + neighbour_output @ z_neighbour - output @ z_own)``; a
    measurement of more than two nodes adds ``rows @ z`` for each pair in ``more``.

    Attributes:
        label: the measurement's number in the network: the key of its reading y; None where no reading belongs to the
            arc, which then couples the node to what its neighbour says.
        neighbour: name of the other end; None for the environment (then there is no ``z_neighbour``).
        sign: +1 where the node is the arc's head, -1 where it is the tail.
        gain: (n, p) correction gain, 1/s, the arc's weight included.
        output: (p, n) own output rows.
        neighbour_output: (p, n_j) the neighbour's output rows; None for the environment.
        more: further neighbours of a measurement on more than two nodes, each with its (p, n_k) rows.
    """

    label: int | None
    neighbour: str | None
    sign: float
    gain: FloatArray
    output: FloatArray
    neighbour_output: FloatArray | None
    more: tuple[tuple[str, FloatArray], ...] = ()

    @property
    def heard(self) -> tuple[tuple[str, FloatArray], ...]:
        """Everybody whose message the arc uses, each with the rows that it is multiplied by."""
        if self.neighbour is None or self.neighbour_output is None:
            return self.more
        return ((self.neighbour, self.neighbour_output), *self.more)


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
