"""Decentralized fixed modes: eigenvalues that no output feedback channel by channel can move (W17, Section V)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from trigpoint.arrays import FloatArray, as_matrix
from trigpoint.errors import ArgumentError, ShapeError

_LOST, _KEPT = 1e-12, 1e-9  # relative, as in pairs.py
_NEAR = 1e-4
_GAINS = 5
_MOST_CHANNELS = 12
_NEWTON_STEPS = 20
_POINTS = 3


@dataclass(frozen=True)
class FixedMode:
    """An eigenvalue of A that decentralized feedback cannot move, or cannot clearly move.

    Attributes:
        value: the eigenvalue, refined; of a conjugate pair the upper one.
        fixed: True where both tests say so; None where they disagree or rounding decides.
        gain_margin: ``max over gains of sigma_min(A + sum B_i K_i C_i - value I)``, relative: zero if no gain moves it.
        subset_margin: ``min over S of sigma_n([A - value I, B_S; C_rest, 0])``, relative: zero if some S loses it; NaN
            above 12 channels, where this test is not made.
        subset: the channels S where it is attained: their inputs, and the outputs of all others, miss the mode.
    """

    value: complex
    fixed: bool | None
    gain_margin: float
    subset_margin: float
    subset: tuple[int, ...]


@dataclass(frozen=True)
class Complementary:
    """One complementary subsystem: inputs of the channels ``subset``, outputs of all others.

    Attributes:
        subset: the channels whose inputs act.
        complete: transfer matrix not zero and pencil of rank at least n; None where rounding decides.
        transfer: largest relative size of the transfer matrix at seeded points; zero if it vanishes.
        margin: smallest ``sigma_n`` of the pencil near the eigenvalues of A, relative.
    """

    subset: tuple[int, ...]
    complete: bool | None
    transfer: float
    margin: float


@dataclass(frozen=True, eq=False)
class _Channels:
    """A with its channels, each B_i and C_i brought to the size of A, and the two together at most n wide."""

    A: FloatArray
    B: tuple[FloatArray, ...]
    C: tuple[FloatArray, ...]
    size: float

    def pencil(self, s: complex, subset: Sequence[int]) -> NDArray[Any]:
        """``[A - s I, B_S; C_rest, 0]``."""
        n = self.A.shape[0]
        B = np.hstack([np.zeros((n, 0)), *(self.B[i] for i in subset)])
        C = np.vstack([np.zeros((0, n)), *(self.C[i] for i in range(len(self.C)) if i not in subset)])
        at = s if s.imag else s.real
        return np.block([[self.A - at * np.eye(n), B], [C, np.zeros((C.shape[0], B.shape[1]))]])


def fixed_modes(
    A: ArrayLike,
    B_list: Sequence[ArrayLike],  # noqa: N803
    C_list: Sequence[ArrayLike],
) -> tuple[FixedMode, ...]:
    """Eigenvalues that ``A`` and ``A + sum_i B_i K_i C_i`` have in common for every choice of the gains ``K_i``.

    Two tests, which must agree, at every eigenvalue s of A (and at the means of clusters, where Jordan blocks are):
        * random gains: is s an eigenvalue for each of five seeded sets of gains?
        * subsets: does ``[A - s I, B_S; C_rest, 0]`` have rank below n for some set S of channels?

    Args:
        A: (n, n) dynamics.
        B_list: one matrix (n, m_i) a channel.
        C_list: one matrix (p_i, n) a channel.

    Returns:
        The modes that are fixed (``fixed`` True) or undecided (None), the rightmost first; modes that both tests find
        movable (relative margin above 1e-9) are left out. Fixed: both below 1e-12.

    We assume:
        * n is small and there are at most 12 channels; above, the subset test is not made, and a mode that no random
          gain moves comes back undecided;
        * units of inputs and outputs do not matter: each B_i and C_i is scaled to the size of A.

    Raises:
        ShapeError: matrices that do not fit together; the message names the channel and both shapes.
        ArgumentError: no channel, NaN or infinity.

    Cost O(2^k n^3) for each eigenvalue and k channels. Source: WangDavison1973; W17, Section V; 002-11.
    """
    channels = _checked(A, B_list, C_list)
    closed = list(_closed_loops(channels))
    found: list[FixedMode] = []
    for start in _candidates(channels):
        mode = _decided(channels, closed, start)
        if mode.fixed is False:
            continue
        twin = next((k for k, other in enumerate(found) if _is_same(channels, mode, other)), None)
        if twin is None:
            found.append(mode)
        elif mode.fixed and found[twin].fixed is None:
            found[twin] = mode  # a clearer look at the same mode
    return tuple(sorted(found, key=lambda mode: (-mode.value.real, mode.value.imag)))


def check_complementary(
    A: ArrayLike,
    B_list: Sequence[ArrayLike],  # noqa: N803
    C_list: Sequence[ArrayLike],
) -> tuple[Complementary, ...]:
    """Completeness of every complementary subsystem ``(C_rest, A, B_S)``, S a nonempty proper set of channels.

    Complete means: ``C_rest (s I - A)^{-1} B_S`` is not zero, and ``[s I - A, B_S; C_rest, 0]`` has rank at least n for
    every complex s. Jointly controllable and observable channels whose complementary subsystems are all complete can be
    made controllable and observable through any one of them by feedback in the others.

    Args:
        A: (n, n) dynamics.
        B_list: one matrix (n, m_i) a channel, at least two channels and at most 12.
        C_list: one matrix (p_i, n) a channel.

    Returns:
        One ``Complementary`` a subset, the smallest subsets first.

    We assume:
        * as ``fixed_modes`` does; a transfer matrix is looked at in three seeded points.

    Raises:
        ShapeError: matrices that do not fit together; the message names the channel and both shapes.
        ArgumentError: fewer than two channels or more than 12, NaN or infinity.

    Cost O(2^k n^4). Source: W17, Section V, equation (15); CorfmatMorse1976; 002-11, 002-12.
    """
    channels = _checked(A, B_list, C_list)
    count = len(channels.B)
    if not 2 <= count <= _MOST_CHANNELS:
        raise ArgumentError(f"check_complementary takes 2 to {_MOST_CHANNELS} channels; got {count}")
    subsets = [subset for size in range(1, count) for subset in combinations(range(count), size)]
    return tuple(_complementary(channels, subset) for subset in subsets)


def _complementary(channels: _Channels, subset: tuple[int, ...]) -> Complementary:
    margin = min(_refined(channels, start, subset)[1] for start in _candidates(channels)) / channels.size
    B = np.hstack([channels.B[i] for i in subset])
    C = np.vstack([channels.C[i] for i in range(len(channels.C)) if i not in subset])
    rng = np.random.default_rng(len(channels.C))
    transfer, n = 0.0, channels.A.shape[0]
    for point in (rng.normal(size=(_POINTS, 2)) @ np.array([1.0, 1.0j]) * 2.0 * channels.size).tolist():
        response = C @ la.solve(point * np.eye(n) - channels.A, B) if B.size and C.size else np.zeros((1, 1))
        transfer = max(transfer, float(np.abs(response).max(initial=0.0)) / channels.size)
    clear = min(margin, transfer)
    complete = True if clear >= _KEPT else (False if clear <= _LOST else None)
    return Complementary(subset, complete, transfer, margin)


def _checked(
    A: ArrayLike,
    B_list: Sequence[ArrayLike],  # noqa: N803
    C_list: Sequence[ArrayLike],
) -> _Channels:
    a = as_matrix("A", A)
    if a.shape[0] != a.shape[1] or a.shape[0] == 0:
        raise ShapeError(f"A must be square with at least one row; got shape {a.shape}")
    if len(B_list) != len(C_list):
        raise ShapeError(f"B_list and C_list must have one matrix a channel each; got {len(B_list)} and {len(C_list)}")
    if not B_list:
        raise ArgumentError("B_list and C_list must hold at least one channel; got none")
    inputs, outputs = [], []
    for channel, (b_given, c_given) in enumerate(zip(B_list, C_list, strict=True)):
        b, c = as_matrix(f"B_list[{channel}]", b_given), as_matrix(f"C_list[{channel}]", c_given)
        if b.shape[0] != a.shape[0]:
            raise ShapeError(f"B_list[{channel}] must have one row a state of A {a.shape}; got shape {b.shape}")
        if c.shape[1] != a.shape[0]:
            raise ShapeError(f"C_list[{channel}] must have one column a state of A {a.shape}; got shape {c.shape}")
        inputs.append(b)
        outputs.append(c)
    size = float(np.linalg.norm(a, 2)) or 1.0
    return _Channels(a, tuple(_scaled(b, size) for b in inputs), tuple(_scaled(c, size) for c in outputs), size)


def _scaled(matrix: FloatArray, size: float) -> FloatArray:
    norm = float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0
    return matrix * (size / norm) if norm else matrix


def _candidates(channels: _Channels) -> list[complex]:
    """Eigenvalues of A in the upper half-plane, and the means of clusters of them."""
    values = la.eigvals(channels.A)
    means = [values[np.abs(values - s) <= _NEAR * channels.size].mean() for s in values]
    clipped = [complex(s.real, s.imag if abs(s.imag) > 1e-14 * channels.size else 0.0) for s in [*means, *values]]
    return list(dict.fromkeys(s for s in clipped if s.imag >= 0.0))


def _closed_loops(channels: _Channels) -> Iterator[FloatArray]:
    """A under seeded random gains that move it by about its own size."""
    rng = np.random.default_rng(1973)
    for _ in range(_GAINS):
        moves = [B @ rng.normal(size=(B.shape[1], C.shape[0])) @ C for B, C in zip(channels.B, channels.C, strict=True)]
        yield channels.A + sum(moves) / channels.size


def _decided(channels: _Channels, closed: list[FloatArray], start: complex) -> FixedMode:
    count, n = len(channels.B), channels.A.shape[0]
    value, least = start, np.nan
    subset: tuple[int, ...] = ()
    if count <= _MOST_CHANNELS:
        least = np.inf
        for size in range(count + 1):
            for trial in combinations(range(count), size):
                s, sigma = _refined(channels, start, trial)
                if sigma < least:
                    value, subset, least = s, trial, sigma
    value = complex(value.real, abs(value.imag))
    moved = max(float(la.svdvals(loop - value * np.eye(n))[-1]) for loop in closed) / channels.size
    least /= channels.size
    if moved <= _LOST and least <= _LOST:
        fixed: bool | None = True
    else:
        fixed = False if moved >= _KEPT and not least < _KEPT else None
    return FixedMode(value, fixed, moved, least, subset)


def _is_same(channels: _Channels, mode: FixedMode, other: FixedMode) -> bool:
    """Cannot the two be told apart: is the rank as good as lost half-way between them, too?"""
    if abs(mode.value - other.value) > _NEAR * channels.size:
        return False
    n, middle = channels.A.shape[0], 0.5 * (mode.value + other.value)
    return bool(la.svdvals(channels.pencil(middle, other.subset))[n - 1] < _KEPT * channels.size)


def _refined(channels: _Channels, start: complex, subset: tuple[int, ...]) -> tuple[complex, float]:
    """``sigma_n`` of the pencil, followed by Newton steps in s while it falls: a Jordan block's eigenvalues are off."""
    n = channels.A.shape[0]
    s, pencil = start, channels.pencil(start, subset)
    sigma = float(la.svdvals(pencil)[n - 1])
    if not _LOST * channels.size < sigma < 1e-3 * channels.size:
        return s, sigma
    for _ in range(_NEWTON_STEPS):
        left, values, right = la.svd(pencil, full_matrices=False)
        slope = left[:n, n - 1].conj() @ right[n - 1, :n].conj()
        if slope == 0.0:
            break
        trial = s + values[n - 1] / slope
        trial = complex(trial.real, trial.imag if s.imag else 0.0)
        moved = channels.pencil(trial, subset)
        lower = float(la.svdvals(moved)[n - 1])
        if not lower < 0.5 * sigma:
            break
        s, pencil, sigma = trial, moved, lower
    return s, sigma
