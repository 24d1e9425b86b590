"""A matrix exponential for agents, in NumPy alone, so that a live node can use it."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from trigpoint.arrays.core import FloatArray, require_finite
from trigpoint.errors import ArgumentError

_PADE_13 = (
    64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0,
    129060195264000.0, 10559470521600.0, 670442572800.0, 33522128640.0,
    1323241920.0, 40840800.0, 960960.0, 16380.0, 182.0, 1.0,
)  # fmt: skip
_PADE_13_RADIUS = 5.371920351148152  # Higham (2005), Table 2.3: 1-norm for which degree 13 reaches unit roundoff
_EXPM_LIMIT = 64
_LONGEST_SERIES = 50.0
_ORDERS = np.arange(19.0)  # 1 / 19! is 8e-18


def expm(A: FloatArray) -> FloatArray:
    """Matrix exponential by scaling and squaring with the Pade approximant of degree 13.

    exp(A) = r_13(A / 2^s)^(2^s), A of shape (n, n) or a stack (..., n, n), n <= 64; cost O(n^3 (10 + s)) a matrix.
    Those of a stack that take the same s are computed at once.

    We assume:
        * A is finite and small (an agent's model, not a network's).

    Raises ``ArgumentError`` for a larger matrix: use ``scipy.linalg.expm`` there.
    Source: Higham, *The scaling and squaring method for the matrix exponential revisited* (2005), key Higham2005.
    """
    A = np.asarray(A, dtype=np.float64)
    if A.ndim < 2 or A.shape[-1] != A.shape[-2] or A.shape[-1] > _EXPM_LIMIT:
        raise ArgumentError(f"expm takes square matrices of at most {_EXPM_LIMIT} rows; got shape {A.shape}")
    require_finite("A", A)
    return _scaled_and_squared(A) if A.ndim == 2 else _stacked(A)


def _stacked(A: FloatArray) -> FloatArray:
    """Each matrix with its own number of squarings: more than it needs would cost its small entries."""
    matrices = A.reshape(-1, *A.shape[-2:])
    norms = np.abs(matrices).sum(axis=1).max(axis=1, initial=0.0)
    squarings = np.array([_halvings(norm) for norm in norms.tolist()], dtype=int)
    result = np.empty_like(matrices)
    for count in np.unique(squarings).tolist():
        chosen = squarings == count
        powers = _pade_13(matrices[chosen] / 2.0**count)
        for _ in range(count):
            powers = powers @ powers
        result[chosen] = powers
    return result.reshape(A.shape)


def _scaled_and_squared(A: FloatArray) -> FloatArray:
    n = A.shape[0]
    norm = float(np.abs(A).sum(axis=0).max()) if n else 0.0
    squarings = _halvings(norm)
    result: FloatArray = _pade_13(A / 2.0**squarings)
    for _ in range(squarings):
        result = np.asarray(result @ result, dtype=np.float64)
    return result


def _pade_13(A: FloatArray) -> FloatArray:
    b = _PADE_13
    identity = np.eye(A.shape[-1])
    A2 = A @ A
    A4 = A2 @ A2
    A6 = A4 @ A2
    odd = A @ (A6 @ (b[13] * A6 + b[11] * A4 + b[9] * A2) + b[7] * A6 + b[5] * A4 + b[3] * A2 + b[1] * identity)
    even = A6 @ (b[12] * A6 + b[10] * A4 + b[8] * A2) + b[6] * A6 + b[4] * A4 + b[2] * A2 + b[0] * identity
    return np.asarray(np.linalg.solve(even - odd, even + odd), dtype=np.float64)


def transition_and_integral(A: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
    """Return ``exp(A h)`` and ``integral_0^h exp(A s) ds``, both (n, n).

    One exponential of a 2n matrix over a short step d, then doubling: ``I(2d) = I(d) + T(d) I(d)``, ``T(2d) = T(d)^2``.
    Squaring the 2n matrix itself would raise the rounding error of its unit block to the power h / d.

    Read-only: the last ones are kept, since many nodes have equal models and periods.
    """
    n = A.shape[0]
    if A.ndim != 2 or A.shape[1] != n or n > _EXPM_LIMIT:
        raise ArgumentError(f"A must be a square matrix of at most {_EXPM_LIMIT} rows; got shape {A.shape}")
    return _transition_and_integral(np.asarray(A, dtype=np.float64).tobytes(), n, float(h))


@lru_cache(maxsize=256)
def _transition_and_integral(data: bytes, n: int, h: float) -> tuple[FloatArray, FloatArray]:
    both = _both(np.frombuffer(data, dtype=np.float64).reshape(n, n), h)
    for each in both:
        each.setflags(write=False)
    return both


def _both(A: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
    n = A.shape[0]
    if not A.any():  # exact, so that a static truth stays where it is to the last bit
        return np.eye(n), h * np.eye(n)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n] = A * h
    require_finite("A h", block)
    doublings = _halvings(float(np.abs(block).sum(axis=0).max()))
    block /= 2.0**doublings
    # The integral is linear in its unit, so that the step itself need not enter the matrix: (I / d) stays well scaled.
    block[:n, n:] = np.eye(n)
    exponential = _scaled_and_squared(block)
    transition, integral = exponential[:n, :n], exponential[:n, n:] * (h / 2.0**doublings)
    for _ in range(doublings):
        integral = integral + transition @ integral
        transition = np.asarray(transition @ transition, dtype=np.float64)
    return transition, np.asarray(integral, dtype=np.float64)


def propagate(A: FloatArray, value: FloatArray, duration: float, drive: FloatArray | None = None) -> FloatArray:
    """``e^{A t} z + int_0^t e^{A s} ds b`` (n,) for t = ``duration``, z = ``value``, b = ``drive`` (None: 0).

    The Taylor series with the powers of A (n, n) kept between calls, in pieces of ``|A| |t| <= 1`` (Frobenius norm): a
    few products, where ``transition_and_integral`` has to factorize. A negative t goes back in time.

    We assume:
        * A, z, b and t are finite.
    """
    data, n = A.tobytes(), A.shape[0]
    size = _norm(data) * abs(duration)
    if size == 0.0:
        return value if drive is None else value + duration * drive
    if size > _LONGEST_SERIES:
        sign = math.copysign(1.0, duration)
        transition, integral = transition_and_integral(sign * A, abs(duration))
        moved = transition @ value
        return np.asarray(moved if drive is None else moved + sign * (integral @ drive), dtype=np.float64)
    pieces = max(1, math.ceil(size))
    transition = _series(data, n, duration / pieces)
    gained = None if drive is None else _integral_series(data, n, duration / pieces) @ drive
    for _ in range(pieces):
        value = transition @ value if gained is None else transition @ value + gained
    return value


@lru_cache(maxsize=256)
def _norm(data: bytes) -> float:
    entries = np.frombuffer(data, dtype=np.float64)
    return math.sqrt(float(np.vdot(entries, entries)))


@lru_cache(maxsize=256)  # messages of one instant are equally old
def _series(data: bytes, n: int, duration: float) -> FloatArray:
    return np.asarray((duration**_ORDERS @ _powers(data, n)).reshape(n, n))


@lru_cache(maxsize=256)
def _integral_series(data: bytes, n: int, duration: float) -> FloatArray:
    weights = duration * (duration**_ORDERS / (_ORDERS + 1.0))
    return np.asarray((weights @ _powers(data, n)).reshape(n, n))


@lru_cache(maxsize=128)
def _powers(data: bytes, n: int) -> FloatArray:
    """(orders, n n): ``A^k / k!``, a row each."""
    A = np.frombuffer(data, dtype=np.float64).reshape(n, n)
    rows = [np.eye(n)]
    for order in range(1, _ORDERS.shape[0]):
        rows.append(rows[-1] @ A / order)
    return np.stack(rows).reshape(-1, n * n)


def _halvings(norm: float) -> int:
    return max(0, int(np.ceil(np.log2(norm / _PADE_13_RADIUS)))) if norm > _PADE_13_RADIUS else 0
