"""``SccCascade``: any digraph, component by component: sources design for themselves, everybody else follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import networkx as nx
import numpy as np

from trigpoint.analysis.shared_plant import diagnose_shared_plant
from trigpoint.arrays import FloatArray, frozen
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.methods.base import Method
from trigpoint.methods.coupling_gain import CouplingGain
from trigpoint.methods.heterogeneous.assembly import error_spread
from trigpoint.methods.heterogeneous.proof import proved_decay
from trigpoint.methods.spectrum_assignment import SpectrumAssignment
from trigpoint.model import SharedPlant
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver

_NAME = "SccCascade"
_FASTER = 1.25
_DENSE = 600


@dataclass(frozen=True)
class SccCascade(Method):
    """Distributed observer on a digraph that need not be strongly connected.

    Every source component (one that hears nobody outside) designs for itself with ``inner``. Every other agent follows
    one agent that it hears: ``F = A - S`` with S normal and its eigenvalues strictly left of those upstream, faster by
    a quarter at each step away from the source (equal ones would cost powers of t: E-002-7).

    Args:
        rate: decay asked for, 1/s.
        inner: for the source components: ``spectrum-assignment`` (real eigenvalues from ``-2 rate`` to ``-rate``) or
            ``coupling-gain``.

    We assume:
        * each source component sees the whole plant by itself (W17, Corollary 1: necessary).

    Raises:
        ArgumentError: a rate that is not positive, an unknown inner method.
        MethodError: another kind of problem, or a source component that does not see the plant (named, with what it
            lacks).

    Guarantee: ``decay_rate`` is proved by a Lyapunov matrix of the whole error up to 600 states, else 0; the block
    spectrum is that of the components. Source: W17, Section IV-B, Corollary 1; theory 4.5.
    """

    label: ClassVar[str] = "scc-cascade"

    rate: float
    inner: Literal["spectrum-assignment", "coupling-gain"] = "spectrum-assignment"

    def __post_init__(self) -> None:
        """Check the choices."""
        if not (np.isfinite(self.rate) and self.rate > 0.0):
            raise ArgumentError(f"rate must be a positive number of 1/s; got {self.rate!r}")
        if self.inner not in ("spectrum-assignment", "coupling-gain"):
            raise ArgumentError(f"inner must be 'spectrum-assignment' or 'coupling-gain'; got {self.inner!r}")

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer, or raise ``MethodError``."""
        if not isinstance(problem, SharedPlant):
            raise MethodError(
                _NAME, "a SharedPlant problem", type(problem).__name__, "Write SharedPlant(A, outputs, ...)."
            )
        graph = problem.digraph()
        sources = [sorted(part) for part in nx.strongly_connected_components(graph) if _is_source(graph, part)]
        programs: dict[int, LocalObserver] = {}
        block_errors = [0.0]
        for part in sorted(sources):
            designed = self._source(problem, part)
            block_errors.append(float(designed.facts.get("block_spectrum_error", 0.0)))
            programs |= {agent: _renamed(designed.local(k), part, agent) for k, agent in enumerate(part)}
        depth = nx.multi_source_dijkstra_path_length(graph, {agent for part in sources for agent in part}, weight=None)
        for agent in sorted(set(range(problem.n_agents)) - set(programs), key=lambda a: (depth[a], a)):
            leader = min((depth[other], other) for other in problem.hears[agent])[1]
            programs[agent] = _follower(problem, agent, leader, self.rate * _FASTER ** depth[agent])
        nodes = tuple(programs[agent] for agent in range(problem.n_agents))
        facts = {
            "sources": tuple(", ".join(map(str, part)) for part in sorted(sources)),
            "inner": self.inner,
            "block_spectrum_error": max(block_errors),
            "depth": max(depth.values()),
        }
        return _judged(AssembledObserver(self.label, problem, nodes, 0.0, None, facts))

    def _source(self, problem: SharedPlant, part: list[int]) -> AssembledObserver:
        inside = {agent: k for k, agent in enumerate(part)}
        hears = {k: [inside[other] for other in problem.hears[agent]] for agent, k in inside.items()}
        own = SharedPlant(problem.A, [problem.outputs[agent] for agent in part], hears, problem.B)
        if diagnose_shared_plant(own).observable is not True:
            findings = diagnose_shared_plant(problem).findings[:3]
            text, remedy = (" ".join(getattr(f, what) for f in findings) for what in ("text", "remedy"))
            raise MethodError(
                _NAME,
                "source components that see the whole plant (W17, Corollary 1); "
                f"agents {', '.join(map(str, part))} do not",
                text.removesuffix("."),
                remedy,
            )
        if self.inner == "coupling-gain":
            return CouplingGain(self.rate).build(own)
        count = own.n_agents * own.n_states
        return SpectrumAssignment(np.linspace(-2.0 * self.rate, -self.rate, count).tolist()).build(own)


def _is_source(graph: nx.DiGraph, part: set[int]) -> bool:
    return all(other in part for agent in part for other in graph.predecessors(agent))


def _renamed(local: LocalObserver, part: list[int], agent: int) -> LocalObserver:
    """The program of a component's own numbering in that of the whole."""
    arcs = tuple(
        LocalArc(
            None if arc.label is None else part[arc.label],
            None if arc.neighbour is None else str(part[int(arc.neighbour)]),
            arc.sign,
            arc.gain,
            arc.output,
            arc.neighbour_output,
        )
        for arc in local.arcs
    )
    return LocalObserver(str(agent), local.A, local.B, arcs)


def _follower(problem: SharedPlant, agent: int, leader: int, rate: float) -> LocalObserver:
    """``z' = A z + B u + (A - S)(z_leader - z)``: the error moves by S, eigenvalues from ``-1.2 rate`` to ``-rate``."""
    eye: FloatArray = np.eye(problem.n_states)
    S = np.diag(np.linspace(-1.2 * rate, -rate, problem.n_states))
    arc = LocalArc(None, str(leader), 1.0, frozen(problem.A - S), eye, eye)
    return LocalObserver(str(agent), problem.A, problem.B, (arc,))


def _judged(observer: AssembledObserver) -> AssembledObserver:
    total = observer.states.total
    if total > _DENSE:
        facts, rate, abscissa = {**observer.facts, "proof": f"none: more than {_DENSE} states"}, 0.0, None
    else:
        H = observer.error_matrix().toarray()
        proved, abscissa = proved_decay(H, error_spread(observer)), spectral_abscissa(H)
        rate = 0.0 if proved is None else proved[0]
        facts = dict(observer.facts) if proved is None else {**observer.facts, "P": frozen(proved[1])}
    return AssembledObserver(observer.method, observer.problem, observer.nodes, rate, abscissa, facts)
