"""``Heterogeneous``: an observer with the network's structure for agents that differ (G16, Theorem 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trigpoint.analysis.heterogeneous import diagnose_heterogeneous
from trigpoint.arrays import frozen
from trigpoint.errors import ArgumentError, MethodError
from trigpoint.linalg.equations import spectral_abscissa
from trigpoint.methods.base import Method
from trigpoint.methods.heterogeneous.assembly import error_spread, programs, targets
from trigpoint.methods.heterogeneous.parts import Part, unstable_parts
from trigpoint.methods.heterogeneous.proof import proved_decay
from trigpoint.methods.heterogeneous.steps import DENSE_LIMIT, Choices, PartDesign, design_part, fixed_mode_verdict
from trigpoint.model import HyperNetwork, NetworkedAgents
from trigpoint.observers.assembled import AssembledObserver

STEPS = ("stable", "marginal", "inequality", "abscissa", "dynamic")
"""What a part of the network may need, in the order of the search; "stable": no correction at all."""

_NAME = "Heterogeneous"
_LISTED = 8
_LARGEST = 4000


@dataclass(frozen=True)
class Heterogeneous(Method):
    """Network-decentralized observer of agents that differ: ``z' = A z + B u + L (C z - y)``, L as sparse as C'.

    1. Each A_i is split by an ordered Schur form; L acts on the unstable parts, and the stable ones ride along. Parts
       that no measurement joins are designed one by one.
    2. Marginal parts (all unstable modes on the axis, semisimple): ``L = -gamma P^{-1} C'`` with the modal P.
    3. Block-diagonal ``P > 0`` with ``A' P + P A - 2 gamma C' C < 0`` and the same L, or the certificate Z that none
       exists: ``0 != Z >= 0``, ``C Z = 0``, ``(A Z + Z A')_ii >= 0`` (needs the extra ``lmi``, else left out).
    4. Nonsmooth minimisation of the spectral abscissa over the structure, from several seeded starts.
    5. A stabiliser with states of its own at one agent, beside static gains.

    Args:
        rate: modes that decay more slowly than this (1/s) are treated as unstable, so that the error decays faster than
            that; 0 asks for stability only.
        gamma: gain of step 2, any positive number; None for the best of a scan.
        only: one of "marginal", "inequality", "abscissa", "dynamic" to try this step alone; None for all in order.
        starts: starting points of step 4.
        seed: of the draws of steps 4 and 5.

    We assume:
        * the network is detectable (for rate > 0: also its modes right of ``-rate``); the agents may differ or be
          equal, and measurements may join any number of them.

    Raises:
        MethodError: another kind of problem, more than 4000 states, an undetectable network (the nodes are named), or
            no observer found; then the message says what each step came to and whether unstable decentralized fixed
            modes stand in the way.
        MissingExtraError: ``only="inequality"`` without its solver.
        ArgumentError: choices that make no sense.

    Guarantee: ``decay_rate`` is proved by a Lyapunov matrix of the whole error (``facts["P"]``), rounding included; it
    is 0 where that fails or beyond 600 states (there a marginal network still converges, by LaSalle's theorem). Steps
    4 and 5 are searches: they may fail although an observer exists. ``facts`` also has the step that each part needed
    ("parts"), notes on those that failed, and Z in the stacked states where there is one.

    Cost: O(n^6) of step 3 up to 60 unstable states that measurements join, O(n^3) a step of 4.
    Source: G16, Theorem 2, Definitions 4 and 5, Lemma 2; 000-16, 000-21, E-000-13; WangDavison1973.
    """

    label: ClassVar[str] = "heterogeneous"

    rate: float = 0.0
    gamma: float | None = None
    only: str | None = None
    starts: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the choices."""
        if not (np.isfinite(self.rate) and self.rate >= 0.0):
            raise ArgumentError(f"rate must be a number of at least 0 (1/s); got {self.rate}")
        if self.gamma is not None and not (np.isfinite(self.gamma) and self.gamma > 0.0):
            raise ArgumentError(f"gamma must be a positive number or None; got {self.gamma}")
        if self.only is not None and self.only not in STEPS[1:]:
            raise ArgumentError(f"only must be None or one of {', '.join(STEPS[1:])}; got {self.only!r}")
        if self.starts < 1:
            raise ArgumentError(f"starts must be at least 1; got {self.starts}")

    def build(self, problem: Any) -> AssembledObserver:
        """Return the observer of ``problem``, or raise ``MethodError``."""
        network = _accepted(problem)
        if network.n_states > _LARGEST:
            raise MethodError(
                _NAME,
                f"at most {_LARGEST} states (the design is dense)",
                f"{network.n_states}",
                "Design parts of the network by themselves; equal agents: LocalKalman().",
            )
        theorem = self._check_detectable(network)
        choices = Choices(self.only, self.gamma, self.starts, self.seed)
        designs = [design_part(part, choices) for part in unstable_parts(network, self.rate)]
        for design in designs:
            if design.step is None:
                raise self._not_found(network, design)
        observer = AssembledObserver(
            self.label,
            problem,
            programs(network, designs, self.rate),
            0.0,
            None,
            {**_facts(network, designs, self.rate), "theorem": theorem},
            targets(network, designs),
        )
        return _judged(observer)

    def _check_detectable(self, network: HyperNetwork) -> str:
        shifted = [agent.A + self.rate * np.eye(agent.n_states) for agent in network.agents]
        judged = network if self.rate == 0.0 else HyperNetwork(shifted, network.measurements, network.names)
        diagnosis = diagnose_heterogeneous(judged)
        if diagnosis.detectable is not True:
            kinds = ("undetectable-mode", "undecided")
            found = [finding for finding in diagnosis.findings if finding.kind in kinds]
            assert found, "a diagnosis says why"
            of = "" if self.rate == 0.0 else f" (modes of A + {self.rate:g} I)"
            raise MethodError(
                _NAME,
                "a detectable network (G16, Theorem 2)" + of,
                " ".join(finding.text for finding in found).rstrip("."),
                found[0].remedy,
            )
        return diagnosis.theorem

    def _not_found(self, network: HyperNetwork, design: PartDesign) -> MethodError:
        tried = "all steps" if self.only is None else f"only step {self.only!r}"
        return MethodError(
            _NAME,
            "gains with the network's structure that stabilise the error",
            f"none for {_names(network, design.part)} with {tried} ({'; '.join(design.notes)}; "
            f"{fixed_mode_verdict(design.part)})",
            "Allow all steps, raise starts, lower rate, or add a measurement.",
        )


def _accepted(problem: Any) -> HyperNetwork:
    if isinstance(problem, HyperNetwork):
        return problem
    if isinstance(problem, NetworkedAgents):
        return HyperNetwork.of_networked(problem)
    raise MethodError(
        _NAME,
        "a HyperNetwork or NetworkedAgents problem",
        type(problem).__name__,
        "Write HyperNetwork(agents, measurements) or NetworkedAgents(graph, agents).",
    )


def _judged(observer: AssembledObserver) -> AssembledObserver:
    """The same with its computed abscissa and its proved rate."""
    if observer.states.total > DENSE_LIMIT:
        facts = {**observer.facts, "proof": f"none: {observer.states.total} states, at most {DENSE_LIMIT}"}
        return _with(observer, 0.0, None, facts)
    H = observer.error_matrix().toarray()
    proved = proved_decay(H, error_spread(observer))
    if proved is None:
        return _with(observer, 0.0, spectral_abscissa(H), {**observer.facts, "proof": "none found"})
    rate, P = proved
    facts = {**observer.facts, "proof": "Lyapunov matrix P of the whole error", "P": frozen(P)}
    return _with(observer, rate, spectral_abscissa(H), facts)


def _with(observer: AssembledObserver, rate: float, abscissa: float | None, facts: dict[str, Any]) -> AssembledObserver:
    return AssembledObserver(observer.method, observer.problem, observer.nodes, rate, abscissa, facts, observer.targets)


def _facts(network: HyperNetwork, designs: list[PartDesign], rate: float) -> dict[str, Any]:
    steps = [design.step or "" for design in designs]
    abscissae = [None if design.abscissa is None else design.abscissa - rate for design in designs]
    facts: dict[str, Any] = {
        "step": max(steps, key=STEPS.index, default=STEPS[0]),
        "parts": tuple(f"{_names(network, d.part)}: {d.step}" for d in designs),
        "notes": tuple(f"{_names(network, d.part)}: {note}" for d in designs for note in d.notes),
        "part_abscissae": tuple(abscissae),
        "schur_residual": max((_schur_residual(network, d.part, rate) for d in designs), default=0.0),
    }
    for key in ("gamma", "modal_residual", "inequality_margin", "inequality_gamma", "starts"):
        if any(key in design.facts for design in designs):
            facts[key] = tuple(design.facts.get(key) for design in designs)
    if any(design.Z is not None for design in designs):
        facts["Z"] = frozen(_stacked_certificate(network, designs))
    return facts


def _stacked_certificate(network: HyperNetwork, designs: list[PartDesign]) -> Any:
    """The parts' Z in the stacked states: C Z = 0 and the diagonal blocks of A Z + Z A' keep their signs."""
    Z = np.zeros((network.n_states, network.n_states))
    for design in designs:
        if design.Z is None:
            continue
        basis = np.zeros((network.n_states, design.part.states.total))
        for k, agent in enumerate(design.part.agents):
            basis[network.states(agent.node), design.part.states.slice(k)] = agent.Q
        Z += basis @ design.Z @ basis.T
    return Z


def _schur_residual(network: HyperNetwork, part: Part, rate: float) -> float:
    """Largest entry of ``(A_i + rate I) Q - Q T``, relative to A_i."""
    largest = 0.0
    for agent in part.agents:
        A = network.agents[agent.node].A + rate * np.eye(agent.Q.shape[0])
        rest = float(np.abs(A @ agent.Q - agent.Q @ agent.T).max())
        largest = max(largest, rest / (float(np.abs(A).max()) or 1.0))
    return largest


def _names(network: HyperNetwork, part: Part) -> str:
    nodes = part.nodes
    more = f" and {len(nodes) - _LISTED} more" if len(nodes) > _LISTED else ""
    return f"node{'' if len(nodes) == 1 else 's'} {', '.join(network.names[k] for k in nodes[:_LISTED])}{more}"
