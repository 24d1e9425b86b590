"""``Accelerated``: constants known after sqrt(kappa) instead of kappa exchanges, with neighbours only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from trigpoint.analysis import smallest_eigenvalue
from trigpoint.analysis.modes import largest_eigenvalue_bound
from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.methods.base import Method
from trigpoint.model import NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.observers.network import DiffusiveObserver

Scheme = Literal["heavy-ball", "chebyshev", "second-order"]
_NAME = "Accelerated"
_BELOW = 0.999  # a double root: any rate below the root's is guaranteed, that one itself is not


@dataclass(frozen=True, eq=False)
class Accelerated(Method):
    """Momentum for constants: each node remembers its last value.

    ``heavy-ball``: ``z+ = z + a r + b (z - z_last)``, r the node's sum of innovations,
    ``a = 4 / (sqrt u + sqrt l)^2``, ``b = ((sqrt kappa - 1) / (sqrt kappa + 1))^2``. ``chebyshev``: the semi-iteration
    with ``rho = (u - l) / (u + l)``, its factor known to each node from its own count of exchanges. ``second-order``:
    continuous exchange, ``e'' + 2 sqrt(l) e' + L e = 0``. Here l and u bound the spectrum of L.

    Args:
        scheme: one of the three.
        lambda_min: l; the rigorous lower bound unless given. A wrong l costs speed, never stability.
        lambda_max: u; the largest sum of two neighbouring degrees (a local bound) unless given.
        period: seconds between two exchanges; it only converts exchanges to time.

    We assume:
        * constants (A = 0) measured directly (C = I), scalar weights, a path from every node to an anchor;
        * u is an upper bound: the iteration is then stable for every l (theory 7-H4).

    Raises:
        MethodError: one of these does not hold.

    Guarantee: with l a lower bound, heavy-ball and second-order decay at any rate below ``sqrt b`` an exchange and
    ``sqrt l``; chebyshev obeys ``|e_k| <= |e_0| / T_k(1 / rho)``. With an l above ``lambda_min`` nothing is guaranteed
    but stability. Source: theory 7-H4.
    """

    label: ClassVar[str] = "accelerated"

    scheme: Scheme = "heavy-ball"
    lambda_min: float | None = None
    lambda_max: float | None = None
    period: float = 1.0

    def __post_init__(self) -> None:
        """Check the choices."""
        if self.scheme not in get_args(Scheme):
            raise ArgumentError(f"scheme must be one of {', '.join(get_args(Scheme))}; got {self.scheme!r}")
        for name in ("lambda_min", "lambda_max", "period"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ArgumentError(f"{name} must be a positive number; got {value}")

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer, or raise ``MethodError``."""
        network = _accepted(problem)
        bound, ceiling = smallest_eigenvalue(network.graph), largest_eigenvalue_bound(network.graph)
        if bound.unanchored.size:
            raise MethodError(
                _NAME, "a path from every node to an anchor", "an island", "Add an absolute reading there."
            )
        low = bound.lower if self.lambda_min is None else self.lambda_min
        high = ceiling if self.lambda_max is None else self.lambda_max
        if not low < high:
            raise MethodError(_NAME, "lambda_min below lambda_max", f"{low:g} and {high:g}", "Leave one of them out.")
        rate, facts = self._rate(low, high, honest=low <= bound.lower and high >= ceiling)
        plain = DiffusiveObserver(self.label, network, np.eye(network.n_outputs), 1.0, 0.0, None)
        nodes = tuple(self._program(plain.local(k), low, high) for k in range(network.graph.n_nodes))
        eye = np.eye(network.n_outputs)
        V = np.vstack([eye, np.zeros_like(eye) if self.scheme == "second-order" else eye])
        period = None if self.scheme == "second-order" else self.period
        return AssembledObserver(
            self.label, network, nodes, rate, None, facts, (V,) * network.graph.n_nodes, period
        )  # fmt: skip

    def _rate(self, low: float, high: float, *, honest: bool) -> tuple[float, dict[str, Any]]:
        exchanges = None if self.scheme == "second-order" else predicted_exchanges(self.scheme, low, high)
        contraction = convergence_factor(self.scheme, low, high)
        rate = -np.log(contraction) if self.scheme == "second-order" else -np.log(contraction) / self.period
        facts = {
            "scheme": self.scheme,
            "lambda_min": low,
            "lambda_max": high,
            "exchanges_to_1_percent": exchanges,
            "guarantee": "bounds of the spectrum" if honest else "stability only: the given bounds are not proved",
        }
        return (_BELOW * float(rate) if honest else 0.0), facts

    def _program(self, local: LocalObserver, low: float, high: float) -> LocalObserver:
        n = local.n_states
        eye, zero = np.eye(n), np.zeros((n, n))
        if self.scheme == "second-order":
            A, into = np.block([[zero, eye], [zero, -2.0 * np.sqrt(low) * eye]]), np.vstack([zero, eye])
        elif self.scheme == "heavy-ball":
            a, b = heavy_ball(low, high)
            A, into = np.block([[(1.0 + b) * eye, -b * eye], [eye, zero]]), a * np.vstack([eye, zero])
        else:
            A, into = np.block([[eye, zero], [eye, zero]]), 2.0 / (low + high) * np.vstack([eye, zero])
        arcs = tuple(
            LocalArc(
                arc.label,
                arc.neighbour,
                arc.sign,
                into @ arc.gain,
                _widened(arc.output),
                None if arc.neighbour_output is None else _widened(arc.neighbour_output),
            )
            for arc in local.arcs
        )
        exchange: Any = "held" if self.scheme == "second-order" else "discrete"
        rho = (high - low) / (high + low) if self.scheme == "chebyshev" else None
        return LocalObserver(local.name, A, None, arcs, np.hstack([eye, zero]), (), exchange, rho)


def heavy_ball(low: float, high: float) -> tuple[float, float]:
    """Step a and momentum b for a spectrum between ``low`` and ``high``."""
    root = np.sqrt(high / low)
    return 4.0 / (np.sqrt(high) + np.sqrt(low)) ** 2, float(((root - 1.0) / (root + 1.0)) ** 2)


def convergence_factor(scheme: str, low: float, high: float) -> float:
    """Asymptotic contraction an exchange of the ``scheme`` for a spectrum in [low, high] (second-order: a second)."""
    if scheme == "second-order":
        return float(np.exp(-np.sqrt(low)))
    if scheme == "heavy-ball":
        return float(np.sqrt(heavy_ball(low, high)[1]))
    return float(np.exp(-np.arccosh((high + low) / (high - low))))


def predicted_exchanges(scheme: str, low: float, high: float, level: float = 0.01) -> int:
    """Exchanges of the ``scheme`` after which the slowest mode is below ``level`` of its start.

    Chebyshev: ``arccosh(1 / level) / arccosh(1 / rho)``; heavy ball: the two-term recurrence of the mode at ``low``.
    Source: theory 7-H4.
    """
    if scheme == "chebyshev":
        return int(np.ceil(np.arccosh(1.0 / level) / np.arccosh((high + low) / (high - low))))
    _, b = heavy_ball(low, high)
    # The mode at ``low`` has the double root r = sqrt(b): e_k = (1 + k (1 - r)) r^k for e_0 = e_-1 = 1.
    r, k = np.sqrt(b), 1
    while (1.0 + k * (1.0 - r)) * r**k > level:
        k += 1
    return k


def _widened(rows: FloatArray) -> FloatArray:
    return np.hstack([rows, np.zeros_like(rows)])


def _accepted(problem: Any) -> NetworkedAgents:
    if not isinstance(problem, NetworkedAgents):
        raise MethodError(
            _NAME, "a NetworkedAgents problem", type(problem).__name__, "Write NetworkedAgents(graph, agent)."
        )
    agent = problem.agents[0]
    equal = problem.is_homogeneous and agent.is_static and np.array_equal(agent.C, np.eye(agent.n_states))
    if not equal or problem.graph.dimension > 1:
        raise MethodError(
            _NAME,
            "constants that are measured directly (A = 0, C = I) with scalar weights",
            "other agents or weight blocks",
            "Use LocalKalman(), or Sampled() for moving agents.",
        )
    return problem
