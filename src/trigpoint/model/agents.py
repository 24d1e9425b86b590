"""One agent: a small linear system with a relative output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_matrix
from trigpoint.errors import ShapeError


@dataclass(frozen=True, eq=False)
class LinearAgent:
    """One agent ``x' = A x + B u + E v`` whose relative output ``C x`` enters the measurements of its arcs.

    An arc from i to j measures ``C x_j - C x_i``, an external arc of j measures ``C x_j``.

    Args:
        A: (n, n) dynamics, 1/s.
        C: (p, n) relative output.
        B: (n, m) input known to the agent; None for none.
        E: (n, q) entry of the process noise v (unit intensity); None for none known.

    Raises:
        ShapeError: the shapes do not fit together; the message names both.
        ArgumentError: NaN or infinity.

    Source: G16, Section 3 and Assumption 1.
    """

    A: FloatArray
    C: FloatArray
    B: FloatArray | None
    E: FloatArray | None

    def __init__(self, A: ArrayLike, C: ArrayLike, B: ArrayLike | None = None, E: ArrayLike | None = None) -> None:
        a = as_matrix("A", A)
        n = a.shape[0]
        if a.shape[1] != n or n == 0:
            raise ShapeError(f"A must be square with at least one row; got shape {a.shape}")
        c = as_matrix("C", C)
        if c.shape[1] != n or c.shape[0] == 0:
            raise ShapeError(f"C must have one column a state of A {a.shape} and at least one row; got shape {c.shape}")
        object.__setattr__(self, "A", a)
        object.__setattr__(self, "C", c)
        object.__setattr__(self, "B", _entry("B", B, n))
        object.__setattr__(self, "E", _entry("E", E, n))

    @property
    def n_states(self) -> int:
        """Number n of states of the agent."""
        return int(self.A.shape[0])

    @property
    def n_outputs(self) -> int:
        """Number p of relative outputs, hence of numbers in one arc's measurement."""
        return int(self.C.shape[0])

    @property
    def n_inputs(self) -> int:
        """Number m of known inputs; 0 without B."""
        return 0 if self.B is None else int(self.B.shape[1])

    @property
    def is_static(self) -> bool:
        """True when nothing moves by itself (``A = 0``): positions, heights, clock offsets, potentials."""
        return not self.A.any()

    @staticmethod
    def static(dimension: int = 1) -> LinearAgent:
        """The unknown constant of ``dimension`` numbers, measured directly: ``A = 0_d``, ``C = I_d``."""
        return LinearAgent(np.zeros((dimension, dimension)), np.eye(dimension))

    def __repr__(self) -> str:
        return f"LinearAgent({self.n_states} states, {self.n_outputs} outputs, {self.n_inputs} inputs)"


def _entry(name: str, value: ArrayLike | None, n: int) -> FloatArray | None:
    if value is None:
        return None
    matrix = as_matrix(name, value)
    if matrix.shape[0] != n:
        raise ShapeError(f"{name} must have one row a state of A ({n}, {n}); got shape {matrix.shape}")
    return matrix
