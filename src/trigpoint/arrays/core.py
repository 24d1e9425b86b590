"""Array aliases, freezing and shape checks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trigpoint.errors import ArgumentError, ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def frozen(value: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """Return a read-only copy of ``value`` as ``dtype``; the caller's array stays untouched and unshared."""
    array = np.array(value, dtype=dtype, copy=True)
    array.setflags(write=False)
    return array


def require_finite(name: str, array: NDArray[Any]) -> None:
    """Refuse NaN and infinity in ``array`` where they enter, naming the argument (``name``) and the first position."""
    bad = ~np.isfinite(array)
    if bad.any():
        position = tuple(int(k) for k in np.argwhere(bad)[0])
        where = position[0] if len(position) == 1 else position
        raise ArgumentError(f"{name} must be finite; got {array[bad][0]} at position {where}")


def as_floats(name: str, value: ArrayLike) -> FloatArray:
    """Return a read-only float copy of ``value``; text, ragged lists, NaN and infinity are errors that say ``name``."""
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "biufO":
            raise TypeError(f"dtype {raw.dtype}")
        array: FloatArray = frozen(raw)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name} must be an array of real numbers; got {type(value).__name__} ({error})") from error
    require_finite(name, array)
    return array


def as_matrix(name: str, value: ArrayLike, rows: int | None = None, columns: int | None = None) -> FloatArray:
    """Return ``value`` as a read-only finite matrix, (``rows``, ``columns``) where given; ``name`` is for the error.

    A scalar is 1 x 1; a vector is refused, since nobody knows whether it is a row or a column.
    """
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
    """Return ``value`` as a read-only vector of whole numbers ``low <= k < high``; errors say ``name``."""
    raw = np.asarray(value)
    if raw.size == 0:
        raw = raw.astype(np.int64)
    if raw.ndim != 1 or not np.issubdtype(raw.dtype, np.integer):
        raise ArgumentError(
            f"{name} must be a one-dimensional array of node indices; got dtype {raw.dtype}, shape {raw.shape}"
        )
    outside = (raw < low) | (raw >= high)  # before the cast: a large unsigned number would wrap to a negative one
    if outside.any():
        position = int(np.flatnonzero(outside)[0])
        raise ArgumentError(f"{name}[{position}] = {raw[position]} is no index; expected {low} <= index < {high}")
    array: IntArray = frozen(raw, np.int64)
    return array
