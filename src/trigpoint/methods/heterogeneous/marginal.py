"""Step 2: agents that neither grow nor die out by themselves: ``L = -gamma P^{-1} C'`` for any gamma."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
from scipy.optimize import minimize_scalar

from trigpoint.analysis.invariant import Piece
from trigpoint.arrays import FloatArray
from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.methods.heterogeneous.parts import Part, Unstable

_DENSE_LIMIT = 600
_ROUNDING, _EQUAL, _SKEW = 1e-12, 1e-8, 1e-3
_GRID = np.geomspace(1e-3, 1e3, 25)


def is_marginal(part: Part) -> bool:
    """Are all eigenvalues of the ``part`` on the imaginary axis and semisimple?"""
    return all(_is_semisimple(piece, agent.scale) for agent in part.agents for piece in agent.pieces)


def _is_zero(piece: Piece, scale: float) -> bool:
    return piece.size <= _ROUNDING * scale


def _is_semisimple(piece: Piece, scale: float) -> bool:
    """``T = 0`` or ``T^2 + b^2 I = 0``, as far as an agent of norm ``scale`` shows it."""
    if _is_zero(piece, scale):
        return True
    frequency, size = _frequency(piece), piece.size
    rest = piece.T @ piece.T + frequency**2 * np.eye(piece.T.shape[0])
    return bool(frequency > _SKEW * size and np.linalg.norm(rest) <= size * (_EQUAL * size + _ROUNDING * scale))


def _frequency(piece: Piece) -> float:
    return float(np.abs(piece.values.imag).mean())


def modal_inverse(agent: Unstable) -> FloatArray:
    """``P^{-1}`` of the ``agent``'s modal inner product: P > 0 with ``T' P + P T = 0``.

    On a piece where ``T = 0`` it is I, and where ``T^2 + b^2 I = 0`` it is ``(I + T'T / b^2) / 2``; so a rotation has
    P = I. Source: theory 000-21.
    """
    basis = np.hstack([agent.Q.T @ piece.Q for piece in agent.pieces])
    inverse = la.block_diag(*[la.inv(_piece_metric(piece, agent.scale)) for piece in agent.pieces])
    result = basis @ inverse @ basis.T
    return np.asarray(0.5 * (result + result.T))


def _piece_metric(piece: Piece, scale: float) -> FloatArray:
    eye = np.eye(piece.T.shape[0])
    if _is_zero(piece, scale):
        return eye
    return np.asarray(0.5 * (eye + piece.T.T @ piece.T / _frequency(piece) ** 2))


def marginal_gain(part: Part, gamma: float | None) -> tuple[FloatArray, dict[str, Any]]:
    """``L = -gamma P^{-1} C'`` with the modal P, and what is known of it.

    With a given gamma C is taken as it is. Without, each measurement of the ``part`` is first brought to norm one, and
    gamma is the best of a scan (up to 600 states; above, the size of A).

    We assume:
        * the part is marginal and (A, C) is detectable: then ``A + L C`` is Hurwitz for every gamma > 0 (LaSalle),
          without any absolute reading, and with shared eigenvalues too.

    Source: G16, Theorem 2; 000-21.
    """
    inverse = part.block_diagonal([modal_inverse(agent) for agent in part.agents])
    balance = part.A @ inverse + inverse @ part.A.T
    facts = {"modal_residual": float(np.abs(balance).max(initial=0.0)) / (part.size * float(np.abs(inverse).max()))}
    if gamma is not None:
        return -gamma * inverse @ part.C.T, {**facts, "gamma": gamma}
    A, C = part.scaled()
    pull = inverse @ C.T
    best = _best_factor(A, pull @ C) if A.shape[0] <= _DENSE_LIMIT else 1.0
    return part.unscaled(-best * pull), {**facts, "gamma": best * part.size}


def _best_factor(A: FloatArray, pull: FloatArray) -> float:
    """The factor g > 0 that brings the spectrum of ``A - g pull`` furthest to the left, on a grid and then near it."""

    def abscissa(logarithm: float) -> float:
        return spectral_abscissa(A - np.exp(logarithm) * pull)

    values = [abscissa(float(np.log(g))) for g in _GRID]
    k = int(np.argmin(values))
    low, high = np.log(_GRID[max(k - 1, 0)]), np.log(_GRID[min(k + 1, _GRID.shape[0] - 1)])
    found = minimize_scalar(abscissa, bounds=(low, high), method="bounded", options={"maxiter": 40})
    return float(np.exp(found.x) if found.fun < values[k] else _GRID[k])
