"""Claim: constants are estimated in mean square although arcs lose their exchanges at random (theory 6-F4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from trigpoint.arrays import FloatArray, exactly
from trigpoint.certificates.base import Claim, number, witness
from trigpoint.certificates.statics import largest_eigenvalue_upper, static_pull
from trigpoint.errors import ArgumentError
from trigpoint.linalg.verified import gam, is_positive_definite, up
from trigpoint.observers.assembled import Problem
from trigpoint.observers.certificate import ClaimRecord, Outcome
from trigpoint.observers.network import DiffusiveObserver, NetworkObserver

_ASSUMPTIONS = (
    "Euler exchanges e+ = e - period gain L_k e of static scalar states; at every exchange each arc works with the "
    "stated probability, for both its ends, independently of all others and of the past",
)
_EXACT, _MOST_ARCS = 50, 5000
_SMALLEST, _LARGEST = 2.0**-900, 2.0**100  # beyond them a product might be lost before a large weight multiplies it


@dataclass(frozen=True)
class MeanSquareStability(Claim):
    """``E |e_k|^2 -> 0`` when each arc arrives with probability ``arrival`` at each exchange.

    The second moment moves by ``S(X) = M X M + s^2 p (1 - p) sum w_k^2 g_k g_k' X g_k g_k'``, ``M = I - s p L``,
    ``s = period gain k c``, a positive map: ``X > 0`` with ``X - S(X) > 0`` proves its spectral radius below 1, with
    ``S(X) - X > 0`` above 1. Both are verified up to 50 nodes and 5000 arcs; above,
    ``s (p lambda_max + 2 max w (1 - p)) < 2``.

    Args:
        arrival: probability p that an arc works, 0 < p <= 1.
        period: seconds between two exchanges.

    Source: theory 6-F4; Rump (2006), key Rump2006.
    """

    arrival: float = 1.0
    period: float = 0.0
    name: ClassVar[str] = "mean-square-stability"
    quantities: ClassVar[tuple[str, ...]] = ("arrival", "period")
    assumptions: ClassVar[tuple[str, ...]] = _ASSUMPTIONS

    @staticmethod
    def concerns(observer: NetworkObserver) -> bool:  # noqa: ARG004
        """Stated on request."""
        return False

    def check(self, problem: Problem, observer: NetworkObserver) -> ClaimRecord:
        """Find X by conjugate gradients (S is self-adjoint) or by power iteration."""
        if not 0.0 < self.arrival <= 1.0 or not (np.isfinite(self.period) and self.period > 0.0):
            raise ArgumentError(
                f"arrival must be a probability, period positive seconds; got {self.arrival} and {self.period}"
            )
        numbers = {"arrival": self.arrival, "period": self.period}
        step = _step(observer, self.period)
        if step is None or not isinstance(observer, DiffusiveObserver):
            text = "known for static scalar agents only (A = 0, one state), and for steps that floats can hold"
            return ClaimRecord(self.name, "inconclusive", numbers, _ASSUMPTIONS, text, {})
        arrays: dict[str, FloatArray] = {}
        if observer.graph.n_nodes <= _EXACT and observer.graph.n_arcs <= _MOST_ARCS:
            arrays["X"] = _witness(_Moment.of(observer, step[1], self.arrival))
        record = ClaimRecord(self.name, "inconclusive", numbers, _ASSUMPTIONS, "", arrays)
        verdict = self.verify(record, problem, observer)
        words = {"certified": "vanishes", "refuted": "does not vanish", "inconclusive": "is undecided"}[verdict]
        text = f"the mean square {words} when arcs work with probability {exactly(self.arrival)}"
        text += f" every {exactly(self.period)} s"
        return ClaimRecord(self.name, verdict, numbers, _ASSUMPTIONS, text, arrays)

    @staticmethod
    def verify(record: ClaimRecord, problem: Problem, observer: NetworkObserver) -> Outcome:  # noqa: ARG004
        """Evaluate S(X) again with a bound of its rounding error, or the sufficient bound."""
        arrival, period = number(record, "arrival"), number(record, "period")
        step = _step(observer, period)
        if step is None or not isinstance(observer, DiffusiveObserver) or not 0.0 < arrival <= 1.0:
            return "inconclusive"
        graph = observer.graph
        if not graph.is_externally_connected:
            return "inconclusive"
        heaviest = float(graph.arc_weights.max())
        load = arrival * largest_eigenvalue_upper(graph) + 2.0 * heaviest * (1.0 - arrival)
        if up(step[1] * load * (1.0 + 1e-9)) < 2.0:
            return "certified"
        if graph.n_nodes > _EXACT or graph.n_arcs > _MOST_ARCS or "X" not in record.witness:
            return "inconclusive"
        X = witness(record, "X", (graph.n_nodes, graph.n_nodes))
        if not (is_positive_definite(X) and 1.0 / _LARGEST < float(np.abs(X).max()) < _LARGEST):
            return "inconclusive"
        if not (step[0] * arrival > _SMALLEST and step[1] * load < _LARGEST):
            return "inconclusive"
        image, error = _Moment.of(observer, step[1], arrival).with_error(X, (step[1] - step[0]) / step[1])
        rest = X - 0.5 * (image + image.T)
        radius = error + gam(4.0) * (np.abs(X) + np.abs(image))
        if is_positive_definite(rest, radius):
            return "certified"
        return "refuted" if is_positive_definite(-rest, radius) else "inconclusive"


def _step(observer: NetworkObserver, period: float) -> tuple[float, float] | None:
    """Bounds of ``period gain k c``."""
    if not isinstance(observer, DiffusiveObserver) or not (
        np.isfinite(period) and period > 0.0 and observer.gain > 0.0
    ):
        return None
    pull = static_pull(observer)
    if pull is None or observer.agent.n_states != 1:
        return None
    together = period * observer.gain
    low, high = together * pull[0] * (1.0 - 1e-14), together * pull[1] * (1.0 + 1e-14)
    return (low, high) if together > _SMALLEST and low > _SMALLEST and np.isfinite(high) else None


@dataclass(frozen=True, eq=False)
class _Moment:
    """The map S, with G (N, M), the weights and the step."""

    G: FloatArray
    weight: FloatArray
    step: float
    arrival: float

    @staticmethod
    def of(observer: DiffusiveObserver, step: float, arrival: float) -> _Moment:
        return _Moment(observer.graph.incidence().toarray(), observer.graph.arc_weights, step, arrival)

    def apply(self, X: FloatArray) -> FloatArray:
        """S(X)."""
        G, p = self.G, self.arrival
        M = np.eye(G.shape[0]) - self.step * p * (G * self.weight) @ G.T
        spread = p * (1.0 - p) * (self.step * self.weight) ** 2
        return np.asarray(M @ X @ M + (G * (spread * np.einsum("ik,ij,jk->k", G, X, G, optimize=True))) @ G.T)

    @np.errstate(over="ignore", invalid="ignore")
    def with_error(self, X: FloatArray, relative: float) -> tuple[FloatArray, FloatArray]:
        """S(X), and a bound of its error from rounding and a ``relative`` error of the step."""
        N, arcs = self.G.shape
        G, p, size = np.abs(self.G), self.arrival, np.abs(X)
        M = np.eye(N) + self.step * p * (G * self.weight) @ G.T
        spread = p * (1.0 - p) * (self.step * self.weight) ** 2
        bound = M @ size @ M + (G * (spread * np.einsum("ik,ij,jk->k", G, size, G, optimize=True))) @ G.T
        share = gam(8.0 * N + 4.0 * arcs + 64.0) + 4.0 * relative
        return self.apply(X), np.asarray(share * bound * (1.0 + 1e-6) + 1e-60)  # 1e-60: whatever underflowed


def _witness(moment: _Moment) -> FloatArray:
    N = moment.G.shape[0]
    operator = LinearOperator(
        (N * N, N * N), matvec=lambda x: x - moment.apply(np.reshape(x, (N, N))).ravel(), dtype=np.float64
    )
    solution, _ = cg(operator, np.eye(N).ravel(), rtol=1e-9, maxiter=3000)
    X = _normalised(np.reshape(solution, (N, N)))
    if is_positive_definite(X) and is_positive_definite(X - _normalised(moment.apply(X), scale=False)):
        return X
    X = np.eye(N)
    for _ in range(3000):
        X = _normalised(moment.apply(X))
    return X


def _normalised(X: FloatArray, scale: bool = True) -> FloatArray:
    X = 0.5 * (X + X.T)
    largest = float(np.abs(X).max())
    return np.asarray(X / largest if scale and np.isfinite(largest) and largest > 0.0 else X)
