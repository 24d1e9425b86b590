"""Dealing a self-conjugate list of eigenvalues to the blocks of a cascade, and matrices that have them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trigpoint.arrays import FloatArray

_REAL = 1e-12


def parted(values: Sequence[complex]) -> tuple[list[float], list[complex]] | None:
    """Real numbers and upper halves of conjugate pairs, each ascending; None where the list is not self-conjugate."""
    reals = sorted(v.real for v in map(complex, values) if abs(v.imag) <= _REAL * max(1.0, abs(v)))
    upper = sorted((v for v in map(complex, values) if v.imag > _REAL * max(1.0, abs(v))), key=_key)
    lower = sorted((v.conjugate() for v in map(complex, values) if v.imag < -_REAL * max(1.0, abs(v))), key=_key)
    matched = len(upper) == len(lower) and np.allclose(upper, lower, rtol=1e-9, atol=1e-12)
    return (reals, upper) if matched else None


def deal(sizes: Sequence[int], reals: Sequence[float], pairs: Sequence[complex]) -> list[list[complex]] | None:
    """Self-conjugate sublists of the given ``sizes``, dealt in the slots' order; None where there are too few reals.

    A slot of odd size needs a real number: the list splits exactly when there are at least as many as odd slots.
    """
    odd = sum(size % 2 for size in sizes)
    if len(reals) < odd:
        return None
    alone, rest = list(reals[:odd]), list(reals[odd:])
    twos = [[p, p.conjugate()] for p in pairs] + [
        [complex(a), complex(b)] for a, b in zip(rest[::2], rest[1::2], strict=True)
    ]
    twos.sort(key=lambda two: _key(two[0]))
    dealt: list[list[complex]] = []
    for size in sizes:
        slot = [complex(alone.pop(0))] if size % 2 else []
        while len(slot) < size:
            slot += twos.pop(0)
        dealt.append(slot)
    return dealt


def nearest_list(reals: Sequence[float], pairs: Sequence[complex], needed: int) -> list[complex]:
    """The list with the pairs nearest to the real axis moved onto it, until there are ``needed`` real numbers."""
    kept, real = sorted(pairs, key=lambda p: p.imag), list(reals)
    while len(real) < needed and kept:
        moved = kept.pop(0)
        real += [moved.real, moved.real]
    return [complex(r) for r in sorted(real)] + [v for p in kept for v in (p, p.conjugate())]


def matrix_with(values: Sequence[complex], *, joined: bool) -> FloatArray:
    """Real matrix with the self-conjugate ``values``: normal, or with ``joined`` blocks (non-derogatory)."""
    n = len(values)
    S, k = np.zeros((n, n)), 0
    for value in sorted(values, key=_key):
        if value.imag < -_REAL * max(1.0, abs(value)):
            continue
        if value.imag > _REAL * max(1.0, abs(value)):
            S[k : k + 2, k : k + 2] = [[value.real, value.imag], [-value.imag, value.real]]
            k += 2
        else:
            S[k, k] = value.real
            k += 1
    if joined:
        step = max(1.0, float(np.abs(S).max(initial=0.0)))
        for row in range(n - 1):
            if S[row + 1, row] == 0.0 and S[row, row + 1] == 0.0:
                S[row, row + 1] = step
    return S


def _key(value: complex) -> tuple[float, float]:
    return (round(value.real, 12), value.imag)
