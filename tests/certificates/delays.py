"""Oracle: delays at which the error of late innovations loses its stability, to fifty digits; agents of one output."""

from __future__ import annotations

import mpmath

from tests.certificates.oracle import DIGITS, eigenvalues, matrix
from trigpoint.observers.network import DiffusiveObserver

Polynomial = list[mpmath.mpf]


def _polynomials(observer: DiffusiveObserver) -> tuple[Polynomial, Polynomial]:
    """``det(s I - A)`` and ``det(s I - A + K C) - det(s I - A)``, highest power first (up to two states)."""
    A, pull = matrix(observer.agent.A), matrix(observer.injection) * matrix(observer.agent.C)

    def characteristic(M: mpmath.matrix) -> Polynomial:
        if M.rows == 1:
            return [mpmath.mpf(1), -M[0, 0]]
        return [mpmath.mpf(1), -(M[0, 0] + M[1, 1]), mpmath.det(M)]

    d, whole = characteristic(A), characteristic(A - pull)
    return d, [a - b for a, b in zip(whole, d, strict=True)]


def _squared(p: Polynomial) -> Polynomial:
    """``|p(i w)|^2`` in ``x = w^2``, highest power first (up to the square of w)."""
    padded = [mpmath.mpf(0)] * (3 - len(p)) + p
    a, b, c = padded
    return [a * a, b * b - 2 * a * c, c * c]


def crossings(observer: DiffusiveObserver) -> list[tuple[mpmath.mpf, mpmath.mpf, int]]:
    """(first delay, period of its repetitions, +1 to the right or -1 back) of every crossing of every mode."""
    found = []
    with mpmath.workdps(DIGITS):
        d, n = _polynomials(observer)
        for value in eigenvalues(observer.graph):
            g = mpmath.mpf(observer.gain) * value
            size = [a - g * g * b for a, b in zip(_squared(d), _squared(n), strict=True)]
            for x in _positive_roots(*size):
                w = mpmath.sqrt(x)
                turn = -_at(d, 1j * w) / (g * _at(n, 1j * w))  # e^(-i w delay)
                first = mpmath.fmod(-mpmath.arg(turn) + 2 * mpmath.pi, 2 * mpmath.pi) / w
                slope = 2 * size[0] * x + size[1]
                found.append((first, 2 * mpmath.pi / w, 1 if slope > 0 else -1))
    return found


def _at(p: Polynomial, s: mpmath.mpc) -> mpmath.mpc:
    total = mpmath.mpc(0)
    for coefficient in p:
        total = total * s + coefficient
    return total


def _positive_roots(a: mpmath.mpf, b: mpmath.mpf, c: mpmath.mpf) -> Polynomial:
    """Of ``a x^2 + b x + c``."""
    if a == 0:
        return [-c / b] if b != 0 and -c / b > 0 else []
    square = b * b - 4 * a * c
    if square < 0:
        return []
    return [x for x in ((-b - mpmath.sqrt(square)) / (2 * a), (-b + mpmath.sqrt(square)) / (2 * a)) if x > 0]


def is_stable_with(found: list[tuple[mpmath.mpf, mpmath.mpf, int]], delay: float) -> bool:
    """Is the error stable with this delay, being stable without one? More crossings to the right than back: no."""
    with mpmath.workdps(DIGITS):
        late = mpmath.mpf(delay)
        counts = [
            direction * (int(mpmath.floor((late - first) / period)) + 1)
            for first, period, direction in found
            if first < late
        ]
    return sum(counts) <= 0
