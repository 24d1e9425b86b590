"""How well each pair of neighbours hears each other, from the counters that the nodes publish."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from trigpoint.arrays import FloatArray

if TYPE_CHECKING:
    from trigpoint.runtime import LinkStatus

_MEMORY = 100.0


class LinkBook:
    """Loss, age and traffic of M pairs; each direction is kept by itself and the worse one is told.

    The loss is averaged over about the last 100 messages of a direction. A counter that fell belongs to a node that
    started again, and is counted from zero.

    Args:
        pairs: (M, 2) indices of the nodes.
        names: of the nodes.
    """

    def __init__(self, pairs: Sequence[Sequence[int]], names: Sequence[str]) -> None:
        self._slots: Mapping[tuple[int, str], tuple[int, int]] = {
            key: slot
            for k, (i, j) in enumerate(pairs)
            for key, slot in (((i, names[j]), (k, 0)), ((j, names[i]), (k, 1)))
        }
        shape = (len(pairs), 2)
        self._received, self._lost = np.zeros(shape), np.zeros(shape)
        self._loss, self._age = np.full(shape, np.nan), np.full(shape, np.nan)
        self._total = 0.0

    def update(self, node: int, links: Sequence[LinkStatus]) -> None:
        """Take in what ``node`` says of the ``links`` that it hears by."""
        for link in links:
            slot = self._slots.get((node, link.neighbour))
            if slot is None:
                continue
            received, lost = float(link.received), float(link.lost)
            fresh = received - self._received[slot] if received >= self._received[slot] else received
            gone = lost - self._lost[slot] if lost >= self._lost[slot] else lost
            self._received[slot], self._lost[slot] = received, lost
            self._age[slot] = np.inf if link.age is None else link.age
            self._total += fresh
            if fresh + gone > 0.0:
                share, weight = gone / (fresh + gone), 1.0 - float(np.exp(-(fresh + gone) / _MEMORY))
                before = self._loss[slot]
                self._loss[slot] = share if np.isnan(before) else before + weight * (share - before)

    @property
    def total(self) -> float:
        """Messages received so far, all directions together."""
        return self._total

    @property
    def loss(self) -> FloatArray:
        """(M,) share of lost messages, the worse direction; NaN where no message was counted."""
        worse: FloatArray = np.fmax(self._loss[:, 0], self._loss[:, 1])
        return worse

    @property
    def age(self) -> FloatArray:
        """(M,) age of the last message, seconds, the worse direction; infinite: none yet, NaN: nobody told."""
        worse: FloatArray = np.fmax(self._age[:, 0], self._age[:, 1])
        return worse
