"""``SpectrumAssignment``: estimators of the whole plant with a chosen spectrum, by the multi-tree cascade."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import networkx as nx
import numpy as np
import scipy.linalg as la

from trigpoint.analysis.shared_plant import diagnose_shared_plant
from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.injection import spectrum_error
from trigpoint.linalg.precise import precise_eigenvalues
from trigpoint.linalg.transient import transient_peak
from trigpoint.methods.base import Method
from trigpoint.methods.cascade.design import Cascade, cascade, structural_residual
from trigpoint.methods.cascade.newton import refine_spectrum
from trigpoint.methods.cascade.splitting import split_by_agents
from trigpoint.methods.cascade.targets import matrix_with, parted
from trigpoint.methods.heterogeneous.assembly import error_spread
from trigpoint.methods.heterogeneous.proof import proved_decay
from trigpoint.model import SharedPlant
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import Exchange, LocalObserver

_NAME = "SpectrumAssignment"
_EXACT = 1e-8
_COARSER = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 5e-2)
_LARGE_GAIN = 100.0
_DENSE = 600
_PRECISE = 120
_SENSITIVE = 1e8
_REFINED = 150
_APART = 0.1
_REFINED_ERROR = 1e-8
_OF_THE_CASCADE = ("block_spectrum_error", "structural_residual", "split_residual", "roots", "blocks", "depth")


@dataclass(frozen=True, eq=False)
class SpectrumAssignment(Method):
    """Distributed observer of a shared plant whose error has the given eigenvalues: order n an agent, no high gain.

    The states are split by an orthogonal T so that one agent, the block's root, sees block k once the earlier ones are
    known; the others copy it from a parent in a tree below the root. The error is block triangular, and its diagonal
    blocks get the eigenvalues. Agents that sense nothing follow; arcs that are not needed carry nothing.

    Args:
        eigenvalues: m n numbers (m agents, n states), closed under conjugation; m n + m - 1 with
            ``order="theorem-1"``, which adds the m - 1 states of W17, Theorem 1, at the last agent.
        order: ``static`` or ``theorem-1``.
        tolerance: directions that an agent sees more weakly than this are left to others; None: 1e-8, or a coarser one
            where gains above 100 fall tenfold by it (the split is then inexact, and ``structural_residual`` says how).
        refine: None, or ``newton``: all gains are then moved by Gauss-Newton until the spectrum of H itself is the list
            (theory 4.2), from a cascade with its real parts; for lists that cannot be dealt, up to 150 states.
        discrete: the plant is ``x+ = A x + B u``; eigenvalues belong into the unit disc, all zero is deadbeat.

    We assume:
        * all agents together see the plant, and agents that reach everybody see it, too (a strongly connected digraph
          always does); else ``SccCascade``;
        * the list can be dealt: a real eigenvalue for each agent and each block of odd size.

    Raises:
        ArgumentError: a list that is not closed under conjugation, or of the wrong length.
        MethodError: another kind of problem, agents that cannot know the state (named, with what they lack), a list
            that cannot be dealt (the nearest one that can is offered).

    Guarantee: the *block* spectrum is the list to rounding. For deep trees the spectrum of the stored matrix is
    sensitive (theory 4.3b): ``decay_rate`` is what a Lyapunov matrix proves of it, 0 where none does or beyond 600
    states. ``facts``: block spectrum error, structural residual, true spectrum error in 600 bits (up to 120 states
    with the extra ``precision``), eigenvalue condition, transient peak, largest gain, depth, bytes a message.
    Cost: O(m n^3) and the trees; dense facts O((m n)^3). Source: theory 4.1, 4.3b, 4.4; W17, Theorem 1.
    """

    label: ClassVar[str] = "spectrum-assignment"

    eigenvalues: Sequence[complex]
    order: Literal["static", "theorem-1"] = "static"
    tolerance: float | None = None
    refine: Literal["newton"] | None = None
    discrete: bool = False

    def __post_init__(self) -> None:
        """Check the choices that need no problem."""
        if self.refine not in (None, "newton") or (self.refine and self.order != "static"):
            raise ArgumentError(f"refine must be None or 'newton' (with order 'static'); got {self.refine!r}")
        if self.order not in ("static", "theorem-1"):
            raise ArgumentError(f"order must be 'static' or 'theorem-1'; got {self.order!r}")
        if self.tolerance is not None and not 0.0 < self.tolerance < 1.0:
            raise ArgumentError(f"tolerance must be between 0 and 1; got {self.tolerance}")
        values = np.asarray(self.eigenvalues, dtype=np.complex128)
        if values.ndim != 1 or not np.isfinite(values).all():
            raise ArgumentError("eigenvalues must be a list of finite numbers")
        if parted(values.tolist()) is None:
            raise ArgumentError("eigenvalues must be closed under conjugation: every pair a + bj, a - bj")

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer, or raise ``MethodError``."""
        if not isinstance(problem, SharedPlant):
            raise MethodError(
                _NAME, "a SharedPlant problem", type(problem).__name__, "Write SharedPlant(A, outputs, ...)."
            )
        if self.refine == "newton":
            return self._refined(problem)
        values, extra = self._lists(problem)
        designed = self._cascade(problem, values)
        exchange: Exchange = "discrete" if self.discrete else "held"
        nodes = designed.gains.programs(problem, exchange)
        targets = None
        if extra:
            nodes = (*nodes[:-1], _with_extra(nodes[-1], extra))
            eye = np.eye(problem.n_states)
            targets = (*(eye for _ in nodes[:-1]), np.vstack([eye, np.zeros((len(extra), problem.n_states))]))
        observer = AssembledObserver(self.label, problem, nodes, 0.0, None, {}, targets)
        return judged(observer, designed, [*values, *extra], problem)

    def _refined(self, problem: SharedPlant) -> AssembledObserver:
        values, _ = self._lists(problem)
        if len(values) > _REFINED:
            raise MethodError(
                _NAME, f"at most {_REFINED} states in all for refine='newton'", f"{len(values)}", "Leave it out."
            )
        reach = max(abs(value) for value in values) or 1.0
        # Both numbers of a pair become real, a little apart: the eigenvectors of the start must be independent.
        designed = self._cascade(problem, [complex(value.real + _APART * value.imag) for value in values])
        found = refine_spectrum(problem, designed.gains, values)
        if not found.error <= _REFINED_ERROR * reach:
            raise MethodError(
                _NAME,
                f"a list that Gauss-Newton reaches to {_REFINED_ERROR:g} of its size",
                f"an error of {found.error:.3g} after {found.steps} steps",
                "Leave refine out with a list that can be dealt, or ask for CouplingGain(rate).",
            )
        exchange: Exchange = "discrete" if self.discrete else "held"
        observer = AssembledObserver(self.label, problem, found.gains.programs(problem, exchange), 0.0, None, {})
        refined = replace(designed, gains=found.gains)
        known = judged(observer, refined, values, problem)
        facts = {key: value for key, value in known.facts.items() if key not in _OF_THE_CASCADE}
        return replace(known, facts={**facts, "refined_error": found.error, "steps": found.steps})

    def _lists(self, problem: SharedPlant) -> tuple[list[complex], list[complex]]:
        """The eigenvalues of the cascade, and the m - 1 further ones of Theorem 1."""
        total = problem.n_agents * problem.n_states
        further = problem.n_agents - 1 if self.order == "theorem-1" else 0
        if len(self.eigenvalues) != total + further:
            raise ArgumentError(
                f"eigenvalues must be {total + further} numbers ({problem.n_agents} agents x {problem.n_states} states"
                + (f" + {further}" if further else "")
                + f"); got {len(self.eigenvalues)}"
            )
        split = parted(self.eigenvalues)
        assert split is not None
        reals, pairs = split
        extra: list[complex] = []
        while further - len(extra) >= 2 and pairs:
            top = pairs.pop()
            extra += [top, top.conjugate()]
        extra += [complex(reals.pop()) for _ in range(further - len(extra))]
        return [*map(complex, reals), *(v for p in pairs for v in (p, p.conjugate()))], extra

    def _cascade(self, problem: SharedPlant, values: list[complex]) -> Cascade:
        lists = parted(values)
        assert lists is not None
        roots = possible_roots(problem)
        found: list[Cascade] = []
        for tolerance in (_EXACT, *_COARSER) if self.tolerance is None else (self.tolerance,):
            split = split_by_agents(problem.A, problem.outputs, roots, tolerance)
            if split is None:
                break
            found.append(cascade(problem, split, *lists))
            if self.tolerance is None and found[0].gains.largest <= _LARGE_GAIN:
                break
        if not found:
            raise _unknowable(problem)
        least = min(each.gains.largest for each in found)
        if found[0].gains.largest <= 10.0 * least:
            return found[0]
        return next(each for each in found if each.gains.largest <= 2.0 * least)


def possible_roots(problem: SharedPlant) -> list[int]:
    """Agents that reach everybody, those nearest to all the others first."""
    graph, reached = problem.digraph(), []
    for agent in range(problem.n_agents):
        levels = nx.single_source_shortest_path_length(graph, agent)
        if len(levels) == problem.n_agents:
            reached.append((max(levels.values()), agent))
    return [agent for _, agent in sorted(reached)]


def judged(
    observer: AssembledObserver, designed: Cascade, values: Sequence[complex], problem: SharedPlant
) -> AssembledObserver:
    """The observer with its facts, its computed abscissa and its proved rate."""
    facts: dict[str, Any] = {
        "block_spectrum_error": designed.block_error,
        "split_residual": designed.split.residual,
        "largest_gain": designed.gains.largest,
        "depth": max(designed.depth.values()),
        "roots": designed.split.roots,
        "blocks": tuple(designed.split.blocks.size(k) for k in range(designed.split.blocks.count)),
        "arcs_used": len(designed.gains.couplings),
        "bytes_per_message": 8 * problem.n_states,
    }
    if observer.states.total > _DENSE:
        return replace(observer, facts={**facts, "proof": f"none: more than {_DENSE} states"})
    H = observer.error_matrix().toarray()
    if observer.targets is None:
        facts["structural_residual"] = structural_residual(H, designed, problem.n_states)
    spectrum, right = la.eig(H)
    condition = _eigenvalue_condition(right)
    facts |= {
        "dense_spectrum_error": spectrum_error(H, np.array(values)),
        "eigenvalue_condition": condition,
        "dense_spectrum": "sensitive" if condition > _SENSITIVE else "sound",
        "true_spectrum_error": _true_error(H, values),
    }
    if observer.is_discrete:
        radius = float(np.abs(spectrum).max(initial=0.0))
        facts["spectral_radius"] = radius
        return replace(observer, facts=facts)
    facts["transient_peak"] = transient_peak(H)
    proved = proved_decay(H, error_spread(observer))
    rate = 0.0 if proved is None else proved[0]
    if proved is not None:
        facts["P"] = frozen(proved[1])
    return replace(observer, decay_rate=rate, spectral_abscissa=float(spectrum.real.max()), facts=facts)


def _eigenvalue_condition(right: np.ndarray) -> float:
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return float("inf")
    return float((np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=0)).max())


def _true_error(H: FloatArray, values: Sequence[complex]) -> float | None:
    if H.shape[0] > _PRECISE:
        return None
    exact = precise_eigenvalues(H)
    if exact is None:
        return None
    return spectrum_error(np.diag(exact), np.array(values))


def _with_extra(node: LocalObserver, extra: list[complex]) -> LocalObserver:
    """The node with further states that nobody hears (Theorem 1 has them; nothing needs them: E-002-10)."""
    n, more = node.n_states, len(extra)
    A = la.block_diag(node.A, matrix_with(extra, joined=False))
    B = None if node.B is None else np.vstack([node.B, np.zeros((more, node.B.shape[1]))])
    pad = np.zeros((more, 1))
    arcs = tuple(
        replace(
            arc,
            gain=np.vstack([arc.gain, np.repeat(pad, arc.gain.shape[1], axis=1)]),
            output=np.hstack([arc.output, np.zeros((arc.output.shape[0], more))]),
        )
        for arc in node.arcs
    )
    readout = np.hstack([np.eye(n), np.zeros((n, more))])
    return LocalObserver(node.name, A, B, arcs, readout, node.feedthrough, node.exchange)


def _unknowable(problem: SharedPlant) -> MethodError:
    diagnosis = diagnose_shared_plant(problem)
    if diagnosis.findings and diagnosis.observable is not True:
        findings = diagnosis.findings[:3]
        text, remedy = (" ".join(getattr(f, part) for f in findings) for part in ("text", "remedy"))
        return MethodError(_NAME, "agents that can all know the state", text.removesuffix("."), remedy)
    return MethodError(
        _NAME,
        "agents that reach everybody and together see the plant",
        "several source components, each of which sees it",
        "Use SccCascade(rate), component by component.",
    )
