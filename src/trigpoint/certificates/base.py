"""What every claim is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ProtocolError
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import NetworkObserver


class Claim(ABC):
    """A statement about an observer: ``check`` finds a witness for it, ``verify`` re-evaluates the witness.

    ``verify`` trusts nothing in the record: not its verdict, not its numbers.

    Attributes:
        name: what records call it.
        assumptions: what it takes for granted, in words; a record that says otherwise is refused.
        quantities: the numbers that it speaks of, by name; a record that holds another is refused.
    """

    name: ClassVar[str]
    quantities: ClassVar[tuple[str, ...]]
    assumptions: ClassVar[tuple[str, ...]]

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:  # noqa: ARG004 (most claims concern every observer)
        """True where ``certify`` states the claim of such an ``observer`` unasked."""
        return True

    @abstractmethod
    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """State the claim for this observer, with its witness and verdict."""

    @staticmethod
    @abstractmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:
        """Decide again, from the witness alone."""


def number(record: ClaimRecord, name: str) -> float:
    """A number of the record; a missing one is a ``ProtocolError``."""
    if name not in record.numbers:
        raise ProtocolError(f"the claim {record.claim!r} lacks the number {name!r}")
    return record.numbers[name]


def witness(record: ClaimRecord, name: str, shape: tuple[int, ...]) -> FloatArray:
    """An array of the record's witness with the shape that the problem asks for, else a ``ProtocolError``."""
    if name not in record.witness:
        raise ProtocolError(f"the claim {record.claim!r} lacks the witness {name!r}")
    array = record.witness[name]
    if array.shape != shape or array.dtype != np.float64:
        raise ProtocolError(f"the witness {name!r} must be floats of shape {shape}; got {array.dtype}, {array.shape}")
    return array
