"""``BraschPearson``: the literal construction of W17 with its slips corrected, for very small problems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import networkx as nx
import numpy as np
import scipy.linalg as la

from trigpoint.analysis.pairs import pair_margin
from trigpoint.analysis.proposition1 import channels
from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError, MethodError, MissingExtraError
from trigpoint.linalg.injection import spectrum_error
from trigpoint.methods.base import Method
from trigpoint.methods.cascade.targets import parted
from trigpoint.model import SharedPlant
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver

_NAME = "BraschPearson"
_LARGEST = 6
_DRAWS = 30
_USABLE = 0.5


@dataclass(frozen=True, eq=False)
class BraschPearson(Method):
    """Generic gains everywhere, and one compensator of order m - 1 at agent p that places all m n + m - 1 eigenvalues.

    With drawn ``F_ij``, ``K_i`` every channel (p, q) controls and observes the whole error (Proposition 1); the
    compensator ``w' = A_bar w + B_bar v``, ``u = C_bar w + D_bar v`` acts on z_p, with ``v = C_p z_p - y_p`` for q = p
    (the innovation, not the output: E-002-1) or ``v = z_q - z_p`` (E-002-2). With fixed poles of the compensator's
    basis the targets give a square linear system for its numbers.

    Args:
        eigenvalues: m n + m - 1 numbers, closed under conjugation.
        p: the agent with the compensator; 0 unless given.
        q: the agent it compares with; p itself unless given (its output must not be zero).
        digits: decimal digits for the linear system; None for double precision (extra ``precision`` otherwise).
        seed: of the drawn gains; the best of thirty draws is kept.

    We assume:
        * a strongly connected digraph, a plant that all agents together see, and m n <= 6: beyond that the gains reach
          1e16 and more, and even the exact ones rounded to doubles give a useless spectrum (theory 4.0).

    Raises:
        ArgumentError: a list of the wrong length or not closed under conjugation, agents that do not exist.
        MethodError: a problem that is too large, not strongly connected or not seen, or no draw whose spectrum is
            within half of the targets' distance from the axis; use ``SpectrumAssignment``.
        MissingExtraError: ``digits`` without the extra ``precision``.

    Guarantee: none beyond the measured spectrum, ``facts["spectrum_error"]``; it is there for fidelity and teaching.
    Source: W17, Theorem 1; E-002-1 to E-002-3; theory 4.0.
    """

    label: ClassVar[str] = "brasch-pearson"

    eigenvalues: Sequence[complex]
    p: int = 0
    q: int | None = None
    digits: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the choices that need no problem."""
        values = np.asarray(self.eigenvalues, dtype=np.complex128)
        if values.ndim != 1 or not np.isfinite(values).all() or parted(values.tolist()) is None:
            raise ArgumentError("eigenvalues must be finite numbers, closed under conjugation")
        if self.digits is not None and self.digits < 15:
            raise ArgumentError(f"digits must be at least 15, or None; got {self.digits}")

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer, or raise ``MethodError``."""
        C_pq = self._accepted(problem)
        rng = np.random.default_rng(self.seed)
        best: tuple[float, AssembledObserver] | None = None
        for _ in range(_DRAWS):
            drawn = _Drawn.of(problem, self.p, rng)
            try:
                compensator = _compensator(drawn, C_pq, np.array(self.eigenvalues, dtype=complex), self.digits, rng)
            except (np.linalg.LinAlgError, ZeroDivisionError):
                continue
            observer = self._observer(problem, drawn, compensator)
            H = observer.error_matrix().toarray()
            error = spectrum_error(H, np.array(self.eigenvalues)) if np.isfinite(H).all() else np.inf
            if best is None or error < best[0]:
                best = (error, observer)
        worst = -max(complex(value).real for value in self.eigenvalues)
        if best is None or not best[0] < _USABLE * worst:
            raise MethodError(
                _NAME,
                f"gains whose spectrum comes out within {_USABLE * worst:.3g} of the targets",
                f"an error of {'nothing finite' if best is None else format(best[0], '.3g')} in {_DRAWS} draws "
                "(one channel controls all states: theory 4.0)",
                "Use SpectrumAssignment, or more digits for the linear system.",
            )
        return best[1]

    def _accepted(self, problem: Any) -> FloatArray:
        if not isinstance(problem, SharedPlant):
            raise MethodError(_NAME, "a SharedPlant problem", type(problem).__name__, "Write SharedPlant(A, ...).")
        m, n = problem.n_agents, problem.n_states
        if m * n > _LARGEST:
            raise MethodError(
                _NAME,
                f"at most {_LARGEST} states in all (m n): beyond, its gains are useless in floating point (theory 4.0)",
                f"{m} x {n}",
                "Use SpectrumAssignment.",
            )
        if not nx.is_strongly_connected(problem.digraph()):
            raise MethodError(_NAME, "a strongly connected digraph", "one that is not", "Use SccCascade.")
        if pair_margin(problem.A, problem.stacked_output()).verdict is not True:
            raise MethodError(_NAME, "a plant that all agents together see", "one that is not seen", "Ask diagnose().")
        if len(self.eigenvalues) != m * n + m - 1:
            raise ArgumentError(
                f"eigenvalues must be m n + m - 1 = {m * n + m - 1} numbers; got {len(self.eigenvalues)}"
            )
        known = dict(channels(problem, self.p)) if 0 <= self.p < m else {}
        q = self.p if self.q is None else self.q
        if q not in known:
            raise ArgumentError(
                f"p and q must be an agent and one that it hears (or itself, seeing something); got {self.p}, {q}"
            )
        return known[q]

    def _observer(self, problem: SharedPlant, drawn: _Drawn, found: _Compensator) -> AssembledObserver:
        m, n, p = problem.n_agents, problem.n_states, self.p
        q, order = p if self.q is None else self.q, found.A.shape[0]
        eye, wide = np.eye(n), np.hstack([np.eye(n), np.zeros((n, order))])
        nodes = []
        for agent in range(m):
            own = wide if agent == p else eye
            top = np.vstack([eye, np.zeros((order, n))]) if agent == p else eye
            arcs = [
                LocalArc(None, str(j), 1.0, frozen(top @ drawn.couplings[agent, j]), own, wide if j == p else eye)
                for j in problem.hears[agent]
            ]
            if problem.outputs[agent].shape[0]:
                C = problem.outputs[agent]
                arcs.append(LocalArc(agent, None, 1.0, frozen(top @ drawn.injections[agent]), C @ own, None))
            A, readout = problem.A, None
            if agent == p:
                into = np.vstack([found.D, found.B])
                C = problem.outputs[p]
                if q == p:  # v = C_p z_p - y_p is minus the arc's innovation
                    arcs.append(LocalArc(p, None, 1.0, frozen(-into), C @ wide, None))
                else:
                    arcs.append(LocalArc(None, str(q), 1.0, frozen(into), wide, eye))
                A = np.block([[problem.A, found.C], [np.zeros((order, n)), found.A]])
                readout = wide
            B = (
                problem.B
                if problem.B is None or agent != p
                else np.vstack([problem.B, np.zeros((order, problem.n_inputs))])
            )
            nodes.append(LocalObserver(str(agent), A, B, tuple(arcs), readout))
        targets = tuple(wide.T if agent == p else eye for agent in range(m))
        observer = AssembledObserver(self.label, problem, tuple(nodes), 0.0, None, {}, targets)
        H = observer.error_matrix().toarray()
        facts = {
            "spectrum_error": spectrum_error(H, np.array(self.eigenvalues)) if np.isfinite(H).all() else float("inf"),
            "largest_gain": float(max(np.abs(part).max(initial=0.0) for part in (found.A, found.B, found.C, found.D))),
            "channel": f"({p}, {q})",
            "digits": self.digits,
        }
        abscissa = float(np.linalg.eigvals(H).real.max()) if np.isfinite(H).all() else None
        return AssembledObserver(self.label, problem, tuple(nodes), 0.0, abscissa, facts, targets)


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Generic gains and what they assemble to."""

    couplings: dict[tuple[int, int], FloatArray]
    injections: dict[int, FloatArray]
    H: FloatArray
    B_p: FloatArray

    @staticmethod
    def of(problem: SharedPlant, p: int, rng: np.random.Generator) -> _Drawn:
        m, n = problem.n_agents, problem.n_states
        couplings = {(i, j): rng.normal(size=(n, n)) for i in range(m) for j in problem.hears[i]}
        injections = {i: rng.normal(size=(n, C.shape[0])) for i, C in enumerate(problem.outputs)}
        H = np.zeros((m, n, m, n))
        for i in range(m):
            H[i, :, i, :] += problem.A - injections[i] @ problem.outputs[i]
            for j in problem.hears[i]:
                H[i, :, j, :] += couplings[i, j]
                H[i, :, i, :] -= couplings[i, j]
        return _Drawn(
            couplings,
            injections,
            H.reshape(m * n, m * n),
            np.asarray(np.kron(np.eye(m)[:, [p]], np.eye(n)), dtype=np.float64),
        )


@dataclass(frozen=True, eq=False)
class _Compensator:
    """``w' = A w + B v``, ``u = C w + D v``."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray


def _compensator(
    drawn: _Drawn, C_pq: FloatArray, targets: np.ndarray, digits: int | None, rng: np.random.Generator
) -> _Compensator:
    """Solve ``1 + sum d_j/(l - p_j) - g(l) n_0 - sum g(l) n_j/(l - p_j) = 0`` at all targets l.

    ``g = h C_pq (l I - H)^-1 B_p`` with a drawn row h; d, n_0 and n_j are the compensator's numbers.
    """
    n = drawn.B_p.shape[1]
    order = targets.shape[0] - drawn.H.shape[0]
    h = rng.normal(size=(1, C_pq.shape[0]))
    spread = float(np.abs(targets).max())
    poles = -spread * (1.3 + np.arange(order)) - rng.uniform(0.0, 0.2, order)
    solve = _solved if digits is None else _solved_precisely
    numbers = solve(drawn.H, drawn.B_p, h @ C_pq, targets, poles, digits or 15)
    d, n0, rest = numbers[:order], numbers[order : order + n], numbers[order + n :].reshape(order, n).T
    return _Compensator(
        np.diag(poles) - np.outer(np.ones(order), d),
        np.repeat(h, order, axis=0),
        rest - np.outer(n0, d),
        np.outer(n0, h[0]),
    )


def _solved(
    H: FloatArray, B: FloatArray, row: FloatArray, targets: np.ndarray, poles: FloatArray, _: int
) -> FloatArray:
    eye = np.eye(H.shape[0])
    rows = []
    for target in targets:
        g = (row @ la.solve(target * eye - H, B.astype(complex)))[0]
        share = 1.0 / (target - poles)
        rows.append(np.concatenate([share, -g, -np.outer(share, g).ravel()]))
    return np.asarray(np.linalg.solve(np.array(rows), -np.ones(len(rows), dtype=complex)).real)


def _solved_precisely(
    H: FloatArray, B: FloatArray, row: FloatArray, targets: np.ndarray, poles: FloatArray, digits: int
) -> FloatArray:
    try:
        from flint import acb, acb_mat, ctx
    except ImportError as error:
        raise MissingExtraError("python-flint", "precision", "BraschPearson(digits=...)") from error
    before = ctx.dps
    try:
        ctx.dps = digits
        size = H.shape[0]
        h, b, r = acb_mat(H.tolist()), acb_mat(B.tolist()), acb_mat(row.tolist())
        rows = []
        for target in targets:
            shifted = (
                acb_mat(size, size, [acb(complex(target)) if i % (size + 1) == 0 else 0 for i in range(size * size)])
                - h
            )
            g = (r * shifted.solve(b)).entries()
            share = [1 / (acb(complex(target)) - acb(float(pole))) for pole in poles]
            rows.append([*share, *(-v for v in g), *(-s * v for s in share for v in g)])
        answer = acb_mat(rows).solve(acb_mat([[-1]] * len(rows)))
        return np.array([float(value.real.mid()) for value in answer.entries()])
    finally:
        ctx.dps = before
