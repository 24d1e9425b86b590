"""How much some rounds of projected averaging shrink what agents do not see: the numbers behind the hybrid observer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray
from trigpoint.linalg.blocks import Blocks
from trigpoint.linalg.stationary import stationary_vector

_SHARED = 1e-12


class Contraction:
    """Norms of ``E (P (S (x) I) P)^q`` for a family of averaging matrices S, in norms common to all of them.

    Args:
        move: (n, n) ``e^{A period}``, the diagonal block of E.
        projections: m orthogonal projections ``P_i`` (n, n) onto what agent i does not see.
        averages: the matrices S (m, m): rows sum to 1, positive diagonal.

    In each norm used one round is no expansion, so that the bound falls with q:
        * ``max_i sum_j ||block_ij||_2``;
        * ``||R^{1/2} . R^{-1/2}||_2`` with ``r' S = r'``, where all S share r (Jensen's inequality).

    We assume:
        * A maps each unseen subspace into itself, so that only unseen parts are left to shrink.

    Source: theory 4b-B3.
    """

    def __init__(self, move: FloatArray, projections: Sequence[FloatArray], averages: Sequence[FloatArray]) -> None:
        n, m = move.shape[0], len(projections)
        self.blocks = Blocks(m, n)
        unseen = la.block_diag(*projections)
        self.moves = unseen @ la.block_diag(*[move] * m) @ unseen
        self.rounds = [unseen @ np.kron(S, np.eye(n)) @ unseen for S in averages]
        r = stationary_vector(averages[0])
        shared = all(float(np.abs(r @ S - r).max()) <= _SHARED for S in averages)
        self.weights = np.repeat(np.sqrt(r), n) if shared else None

    @cached_property
    def one_round(self) -> float:
        """Norm of one round without the motion, the largest over the family, in the norm where it is smallest."""
        return min(max(norm(round_) for round_ in self.rounds) for norm in self._norms())

    @cached_property
    def spectral_radius(self) -> float:
        """Largest spectral radius of one round over the family."""
        return max(float(np.abs(la.eigvals(round_)).max()) for round_ in self.rounds)

    def norm(self, rounds: int) -> float:
        """Norm of motion and ``rounds`` rounds: the largest over the family, in the norm where that is smallest."""
        return self._norm_of([np.linalg.matrix_power(round_, rounds) for round_ in self.rounds])

    def rate(self, rounds: int, period: float) -> float:
        """``-ln(norm) / period`` for so many ``rounds`` every ``period`` seconds; inf where nothing is left over."""
        norm = self.norm(rounds)
        return -float(np.log(norm)) / period if norm > 0.0 else np.inf

    def rounds_for(self, rate: float, period: float, most: int) -> int | None:
        """Fewest rounds that reach ``rate`` [1/s] at this ``period``, at least 1; None above ``most``.

        Bisection over the powers of two of each round matrix. Cost O((m n)^3 log(rounds)).
        """
        goal = float(np.exp(-rate * period))
        squares = [self.rounds]
        while self._norm_of(squares[-1]) > goal:
            if 1 << len(squares) > most:
                return None
            squares.append([power @ power for power in squares[-1]])
        if len(squares) == 1:
            return 1
        found, powers = 1 << (len(squares) - 2), squares[-2]
        for k in range(len(squares) - 3, -1, -1):
            further = [power @ step for power, step in zip(powers, squares[k], strict=True)]
            if self._norm_of(further) > goal:
                found, powers = found + (1 << k), further
        return found + 1

    def _norm_of(self, powers: Sequence[FloatArray]) -> float:
        return min(max(norm(self.moves @ power) for power in powers) for norm in self._norms())

    def _norms(self) -> list[Callable[[FloatArray], float]]:
        return [self._row_sum] if self.weights is None else [self._row_sum, self._weighted]

    def _row_sum(self, matrix: FloatArray) -> float:
        m, n = self.blocks.count, self.blocks.size
        table = matrix.reshape(m, n, m, n).transpose(0, 2, 1, 3)
        return float(np.linalg.norm(table, 2, axis=(2, 3)).sum(axis=1).max())

    def _weighted(self, matrix: FloatArray) -> float:
        weights = np.ones(self.blocks.total) if self.weights is None else self.weights
        return float(np.linalg.norm(weights[:, None] * matrix / weights, 2))
