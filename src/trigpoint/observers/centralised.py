"""``CentralisedObserver``: one observer at one place, in the form of all others (W17, section III)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trigpoint.arrays import FloatArray, as_matrix, frozen
from trigpoint.errors import ArgumentError, ShapeError
from trigpoint.model.control_systems import control_package, require_continuous
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.observers.network import DesignResiduals

_RANK = 1e-10


@dataclass(frozen=True, eq=False)
class CentralisedObserver:
    """``z' = H z + K y + V B u``, ``estimate = M z + N y``: z follows ``V x``.

    Args:
        H: (n_z, n_z) dynamics of the error ``z - V x``, 1/s.
        K: (n_z, p) gain on the readings.
        M: (n, n_z) readout.
        N: (n, p) what of the readings enters the estimate directly.
        V: (n_z, n) what of the state z follows.

    Raises:
        ShapeError: the five do not fit together.
        ArgumentError: NaN or infinity.

    Source: W17, section III; 002-03.
    """

    H: FloatArray
    K: FloatArray
    M: FloatArray
    N: FloatArray
    V: FloatArray

    def __init__(self, H: ArrayLike, K: ArrayLike, M: ArrayLike, N: ArrayLike, V: ArrayLike) -> None:
        h = as_matrix("H", H)
        v = as_matrix("V", V, h.shape[0])
        k = as_matrix("K", K, h.shape[0])
        if h.shape[1] != h.shape[0]:
            raise ShapeError(f"H must be square; got shape {h.shape}")
        for name, value in (
            ("H", h),
            ("K", k),
            ("M", as_matrix("M", M, v.shape[1], h.shape[0])),
            ("N", as_matrix("N", N, v.shape[1], k.shape[1])),
            ("V", v),
        ):
            object.__setattr__(self, name, value)

    @staticmethod
    def full_state(A: ArrayLike, C: ArrayLike, K: ArrayLike) -> CentralisedObserver:
        """The observer of order n: ``H = A - K C``, ``M = V = I``, ``N = 0``.

        Args:
            A: (n, n) dynamics.
            C: (p, n) output.
            K: (n, p) gain.

        Source: W17, section III (full-state observers).
        """
        a, c = _pair(A, C)
        k = as_matrix("K", K, a.shape[0], c.shape[0])
        identity = np.eye(a.shape[0])
        return CentralisedObserver(a - k @ c, k, identity, np.zeros_like(k), identity)

    @staticmethod
    def reduced_order(A: ArrayLike, C: ArrayLike, G: ArrayLike) -> CentralisedObserver:
        """The observer of least order ``n - rank C``: what C shows is taken from the reading itself.

        With orthonormal bases R of C's rows and Z of its null space, ``V = Z' - G R'``,
        ``H = Z' A Z - G R' A Z``, ``K = V A (R + Z G) (C R)^+``, ``M = Z`` and ``N = (R + Z G) (C R)^+``.

        Args:
            A: (n, n) dynamics.
            C: (p, n) output; dependent rows are allowed.
            G: (n - rank C, rank C) gain in the coordinates of ``reduced_pair(A, C)``.

        Source: W17, section III (reduced state observers, after Luenberger).
        """
        a, c = _pair(A, C)
        rows, null = _coordinates(c)
        g = as_matrix("G", G, null.shape[1], rows.shape[1])
        V, inverse = null.T - g @ rows.T, np.linalg.pinv(c @ rows)
        lift = rows + null @ g
        return CentralisedObserver(V @ a @ null, V @ a @ lift @ inverse, null, lift @ inverse, V)

    @staticmethod
    def extended(
        A: ArrayLike, C: ArrayLike, a_bar: ArrayLike, b_bar: ArrayLike, c_bar: ArrayLike, d_bar: ArrayLike
    ) -> CentralisedObserver:
        """The observer of order ``n + n_bar`` whose innovation drives a dynamic system.

        ``H = [A + d_bar C, c_bar; b_bar C, a_bar]``, ``K = -[d_bar; b_bar]``, ``M = [I 0] = V'``, ``N = 0``: both
        design equations hold whatever the four matrices are, which remain to make H stable.

        Args:
            A: (n, n) dynamics.
            C: (p, n) output.
            a_bar: (n_bar, n_bar).
            b_bar: (n_bar, p).
            c_bar: (n, n_bar).
            d_bar: (n, p).

        Source: W17, section III (extended state observers).
        """
        a, c = _pair(A, C)
        inner = as_matrix("a_bar", a_bar)
        size = inner.shape[0]
        if inner.shape[1] != size:
            raise ShapeError(f"a_bar must be square; got shape {inner.shape}")
        n, p = a.shape[0], c.shape[0]
        b, k, d = (
            as_matrix("b_bar", b_bar, size, p),
            as_matrix("c_bar", c_bar, n, size),
            as_matrix("d_bar", d_bar, n, p),
        )
        V = np.eye(n + size, n)
        return CentralisedObserver(
            np.block([[a + d @ c, k], [b @ c, inner]]), -np.vstack([d, b]), V.T, np.zeros((n, p)), V
        )

    @property
    def order(self) -> int:
        """Number n_z of its states."""
        return int(self.H.shape[0])

    def residuals(self, A: ArrayLike, C: ArrayLike) -> DesignResiduals:
        """Violation of ``V A = H V + K C`` (relative to the largest entry of A, H) and of ``I = M V + N C``.

        Args:
            A: (n, n) dynamics.
            C: (p, n) output.

        Source: W17, equations (5) and (8) for one agent.
        """
        a, c = _pair(A, C)
        size = max(float(np.abs(matrix).max(initial=0.0)) for matrix in (a, self.H)) or 1.0
        dynamics, output = self.V @ a - self.H @ self.V - self.K @ c, np.eye(a.shape[0]) - self.M @ self.V - self.N @ c
        return DesignResiduals(float(np.abs(dynamics).max(initial=0.0)) / size, float(np.abs(output).max(initial=0.0)))

    def program(self, C: ArrayLike, B: ArrayLike | None = None, name: str = "0", label: int = 0) -> LocalObserver:
        """The observer as the program of one node that reads ``y = C x``.

        Args:
            C: (p, n) output.
            B: (n, q) known input of the plant; None for none.
            name: the node's name.
            label: key of the reading.

        ``K y - K C M z`` is the correction, so that without a reading the full and the extended observer go on by the
        plant's model. Source: W17, equation (3).
        """
        c = as_matrix("C", C, self.K.shape[1], self.V.shape[1])
        output = c @ self.M
        arcs = (LocalArc(label, None, 1.0, self.K, frozen(output), None),) if self.K.any() else ()
        drive = None if B is None else frozen(self.V @ as_matrix("B", B, self.V.shape[1]))
        plain = self.order == self.V.shape[1] and np.array_equal(self.M, np.eye(self.order))
        feedthrough = ((label, self.N),) if self.N.any() else ()
        return LocalObserver(
            name, frozen(self.H + self.K @ output), drive, arcs, None if plain else self.M, feedthrough
        )  # fmt: skip

    def to_control(self, B: ArrayLike | None = None) -> Any:
        """``control.StateSpace`` from (y, u) to the estimate; u only where ``B`` (n, q) is given.

        Raises ``MissingExtraError`` where python-control is not installed. Source: W17, section III.
        """
        package = control_package("CentralisedObserver.to_control")
        n = self.V.shape[1]
        b = np.zeros((n, 0)) if B is None else as_matrix("B", B, n)
        direct = np.hstack([self.N, np.zeros((n, b.shape[1]))])
        return package.StateSpace(self.H, np.hstack([self.K, self.V @ b]), self.M, direct)

    @staticmethod
    def from_control(system: Any, V: ArrayLike, n_outputs: int) -> CentralisedObserver:
        """The observer behind a ``control.StateSpace`` whose first inputs are the readings.

        Args:
            system: from (y, u) to the estimate, continuous time.
            V: (n_z, n) what its states follow.
            n_outputs: how many of its inputs are readings y; the rest is u and taken to enter by ``V B``.

        Raises:
            ArgumentError, ShapeError: no continuous StateSpace, or one that does not fit.
            MissingExtraError: python-control is not installed.

        Source: W17, section III.
        """
        require_continuous(system)
        if type(n_outputs) is not int or not 0 <= n_outputs <= system.ninputs:
            raise ArgumentError(f"n_outputs must be 0 to {system.ninputs}, the system's inputs; got {n_outputs!r}")
        return CentralisedObserver(system.A, system.B[:, :n_outputs], system.C, system.D[:, :n_outputs], V)


def reduced_pair(A: ArrayLike, C: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """``(Z' A Z, R' A Z)``: the pair whose gain G the observer of least order needs.

    Args:
        A: (n, n) dynamics.
        C: (p, n) output; R and Z are orthonormal bases of its rows and of its null space.

    Source: W17, section III.
    """
    a, c = _pair(A, C)
    rows, null = _coordinates(c)
    return np.asarray(null.T @ a @ null), np.asarray(rows.T @ a @ null)


def _coordinates(C: FloatArray) -> tuple[FloatArray, FloatArray]:
    _, values, right = np.linalg.svd(C)
    rank = int(np.sum(values > _RANK * values.max(initial=0.0)))
    return right[:rank].T, right[rank:].T


def _pair(A: ArrayLike, C: ArrayLike) -> tuple[FloatArray, FloatArray]:
    a = as_matrix("A", A)
    if a.shape[0] != a.shape[1]:
        raise ShapeError(f"A must be square; got shape {a.shape}")
    return a, as_matrix("C", C, None, a.shape[0])
