"""Characteristic polynomials of stored matrices in fractions, and what a polynomial is at least on an interval."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.linalg.verified import gam

Polynomial = list[Fraction]
"""Coefficients, the constant first."""

_SMALLEST, _LARGEST = 1e-280, 1e280


def transfer(A: FloatArray, b: FloatArray, c: FloatArray) -> tuple[Polynomial, Polynomial]:
    """``det(s I - A)`` and ``c adj(s I - A) b``, exactly.

    ``det(s I - A + z b c) = det(s I - A) + z c adj(s I - A) b`` for every z. By Faddeev's and LeVerrier's recursion.

    Args: ``A`` (n, n), ``b`` (n,), ``c`` (n,). Cost: n^4 products of fractions.
    """
    n = A.shape[0]
    a = [[Fraction(v) for v in row] for row in A.tolist()]
    column, row = [Fraction(v) for v in b.tolist()], [Fraction(v) for v in c.tolist()]
    M = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    d, numerator = [Fraction(1)], []
    for k in range(1, n + 1):
        numerator.append(sum((row[i] * M[i][j] * column[j] for i in range(n) for j in range(n)), Fraction(0)))
        moved = [[sum((a[i][t] * M[t][j] for t in range(n)), Fraction(0)) for j in range(n)] for i in range(n)]
        d.append(-sum((moved[i][i] for i in range(n)), Fraction(0)) / k)
        M = [[moved[i][j] + (d[-1] if i == j else 0) for j in range(n)] for i in range(n)]
    return d[::-1], numerator[::-1]


def times(p: Polynomial, q: Polynomial) -> Polynomial:
    """The product."""
    result = [Fraction(0)] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            result[i + j] += a * b
    return result


def plus(p: Polynomial, q: Polynomial, factor: Fraction) -> Polynomial:
    """``p + factor q``."""
    size = max(len(p), len(q))
    padded = [[*poly, *[Fraction(0)] * (size - len(poly))] for poly in (p, q)]
    return [a + factor * b for a, b in zip(*padded, strict=True)]


def on_the_axis(p: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Real and imaginary part of ``p(i w)``, polynomials in w."""
    sign = (1, 0, -1, 0)
    real = [a * sign[k % 4] for k, a in enumerate(p)]
    imaginary = [a * sign[(k - 1) % 4] for k, a in enumerate(p)]
    return real, imaginary


@dataclass(frozen=True, eq=False)
class Stored:
    """A polynomial with coefficients rounded to floats (at most 1 part in 2^53 each)."""

    a: FloatArray

    @staticmethod
    def of(p: Polynomial) -> Stored | None:
        """None where a coefficient is beyond what floats hold with all their digits."""
        if any(v != 0 and not _SMALLEST < abs(v) < _LARGEST for v in p):
            return None
        return Stored(np.array([float(v) for v in p]))

    def around(self, middle: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value and slope at ``middle`` >= 0, and how far the line through them is off within ``radius`` at most.

        The distance counts the curvature, and the rounding of the coefficients and of this evaluation. Args: (m,) each.
        """
        size, order = np.abs(self.a), np.arange(self.a.shape[0], dtype=np.float64)
        slopes, bends = (order * self.a)[1:], (order * (order - 1.0) * size)[2:]
        most = (middle + radius) * (1.0 + 1e-12)
        value, slope = _horner(self.a, middle), _horner(slopes, middle)
        rounded = float(gam(40.0 * (self.a.shape[0] + 1.0) ** 2)) * _horner(size, most)
        off = 0.5 * radius * radius * _horner(bends, most) * (1.0 + 1e-12) + rounded + 2.0**-1000
        return value, slope, np.asarray(off)


def _horner(a: FloatArray, x: FloatArray) -> FloatArray:
    total = np.zeros_like(x)
    for coefficient in a[::-1].tolist():
        total = total * x + coefficient
    return np.asarray(total)


def turned(angle: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Cosine and sine of angles from 0 to 6.5 by their series, and a bound of the error of both.

    The terms left out are below 6.5^48 / 48!; the others' sizes add up to at most e^6.5 = 666, each with 144 roundings.
    """
    cosine, sine, term = np.ones_like(angle), np.zeros_like(angle), np.ones_like(angle)
    for k in range(1, 48):
        term = term * angle / k
        part = term if k % 4 in (0, 1) else -term
        cosine, sine = (cosine + part, sine) if k % 2 == 0 else (cosine, sine + part)
    return cosine, sine, 2e-11
