"""Array aliases, freezing, shape checks and a small matrix exponential: NumPy only, so a live node can use it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trigpoint.errors import ArgumentError, ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_PADE_13 = (
    64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0,
    129060195264000.0, 10559470521600.0, 670442572800.0, 33522128640.0,
    1323241920.0, 40840800.0, 960960.0, 16380.0, 182.0, 1.0,
)  # fmt: skip
_PADE_13_RADIUS = 5.371920351148152  # Higham (2005), Table 2.3: 1-norm for which degree 13 reaches unit roundoff
_EXPM_LIMIT = 64


def frozen(value: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """Return a read-only copy of ``value``; the caller's array stays untouched and unshared."""
    array = np.array(value, dtype=dtype, copy=True)
    array.setflags(write=False)
    return array


def require_finite(name: str, array: NDArray[Any]) -> None:
    """Refuse NaN and infinity where they enter, naming the argument and the first bad position."""
    bad = ~np.isfinite(array)
    if bad.any():
        position = tuple(int(k) for k in np.argwhere(bad)[0])
        where = position[0] if len(position) == 1 else position
        raise ArgumentError(f"{name} must be finite; got {array[bad][0]} at position {where}")


def as_floats(name: str, value: ArrayLike) -> FloatArray:
    """Return a read-only float copy of ``value``, refusing text, ragged lists, NaN and infinity."""
    try:
        array: FloatArray = frozen(value)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name} must be an array of real numbers; got {type(value).__name__} ({error})") from error
    require_finite(name, array)
    return array


def as_matrix(name: str, value: ArrayLike, rows: int | None = None, columns: int | None = None) -> FloatArray:
    """Return ``value`` as a read-only finite matrix; a scalar is 1 x 1, a vector is refused (row or column?)."""
    array = as_floats(name, value)
    if array.ndim == 0:
        array = frozen(array.reshape(1, 1))
    expected = f"({'any' if rows is None else rows}, {'any' if columns is None else columns})"
    if array.ndim != 2:
        raise ShapeError(f"{name} must be a matrix of shape {expected}; got an array of shape {array.shape}")
    if (rows is not None and array.shape[0] != rows) or (columns is not None and array.shape[1] != columns):
        raise ShapeError(f"{name} must have shape {expected}; got {array.shape}")
    return array


def as_indices(name: str, value: ArrayLike, low: int, high: int) -> IntArray:
    """Return ``value`` as a read-only vector of whole numbers ``low <= k < high``."""
    raw = np.asarray(value)
    if raw.size == 0:
        raw = raw.astype(np.int64)
    if raw.ndim != 1 or not np.issubdtype(raw.dtype, np.integer):
        raise ArgumentError(
            f"{name} must be a one-dimensional array of node indices; got dtype {raw.dtype}, shape {raw.shape}"
        )
    array: IntArray = frozen(raw, np.int64)
    outside = (array < low) | (array >= high)
    if outside.any():
        position = int(np.flatnonzero(outside)[0])
        raise ArgumentError(
            f"{name}[{position}] = {array[position]} is no node index; expected {low} <= index < {high}"
        )
    return array


def expm(A: FloatArray) -> FloatArray:
    """Matrix exponential by scaling and squaring with the Pade approximant of degree 13.

    exp(A) = r_13(A / 2^s)^(2^s), A of shape (n, n), n <= 64; cost O(n^3 (10 + s)).

    We assume:
        * A is finite and small (an agent's model, not a network's).

    Raises ``ArgumentError`` for a larger matrix: use ``scipy.linalg.expm`` there.
    Source: Higham, *The scaling and squaring method for the matrix exponential revisited* (2005), key Higham2005.
    """
    A = np.asarray(A, dtype=np.float64)
    n = A.shape[0]
    if A.ndim != 2 or A.shape[1] != n or n > _EXPM_LIMIT:
        raise ArgumentError(f"expm takes a square matrix of at most {_EXPM_LIMIT} rows; got shape {A.shape}")
    require_finite("A", A)
    norm = float(np.abs(A).sum(axis=0).max()) if n else 0.0
    squarings = max(0, int(np.ceil(np.log2(norm / _PADE_13_RADIUS)))) if norm > _PADE_13_RADIUS else 0
    result: FloatArray = _pade_13(A / 2.0**squarings)
    for _ in range(squarings):
        result = result @ result
    return result


def _pade_13(A: FloatArray) -> FloatArray:
    b = _PADE_13
    identity = np.eye(A.shape[0])
    A2 = A @ A
    A4 = A2 @ A2
    A6 = A4 @ A2
    odd = A @ (A6 @ (b[13] * A6 + b[11] * A4 + b[9] * A2) + b[7] * A6 + b[5] * A4 + b[3] * A2 + b[1] * identity)
    even = A6 @ (b[12] * A6 + b[10] * A4 + b[8] * A2) + b[6] * A6 + b[4] * A4 + b[2] * A2 + b[0] * identity
    solution: FloatArray = np.linalg.solve(even - odd, even + odd)
    return solution


def transition_and_integral(A: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
    """Return ``exp(A h)`` and ``integral_0^h exp(A s) ds``, both (n, n), from one exponential of a 2n matrix."""
    n = A.shape[0]
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n] = A * h
    block[:n, n:] = np.eye(n) * h
    exponential = expm(block)
    return exponential[:n, :n], exponential[:n, n:]
