"""From the parts' gains to one program a node."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la

from trigpoint.arrays import FloatArray, frozen
from trigpoint.linalg.verified import gam
from trigpoint.methods.heterogeneous.parts import Unstable
from trigpoint.methods.heterogeneous.steps import PartDesign
from trigpoint.model import HyperNetwork
from trigpoint.observers.assembled import AssembledObserver
from trigpoint.observers.local import LocalArc, LocalObserver


def programs(network: HyperNetwork, designs: Sequence[PartDesign], rate: float) -> tuple[LocalObserver, ...]:
    """One program a node of ``network``, with one arc for each measurement that names it: gain ``-L_ij``.

    The node that carries a compensator of one of the ``designs`` has its w below its z: the design was made for
    ``A + rate I``, so that w moves by ``D - rate I``; its neighbours leave w aside.
    """
    gains = _gains(designs)
    extra = _extra_states(designs)
    carried = {d.part.agents[d.compensator.agent].node: d for d in designs if d.compensator is not None}
    made = []
    for node, name in enumerate(network.names):
        arcs = []
        for label, blocks in enumerate(network.measurements):
            if node in blocks:
                gain = gains.get((node, label), np.zeros((network.agents[node].n_states, blocks[node].shape[0])))
                if node in carried:
                    gain = np.vstack([gain, _inserted(carried[node], label, gain.shape[1])])
                arcs.append(_arc(network, node, label, -gain, extra))
        made.append(_program(network, node, name, tuple(arcs), carried.get(node), rate))
    return tuple(made)


def targets(network: HyperNetwork, designs: Sequence[PartDesign]) -> tuple[FloatArray, ...] | None:
    """``V_i = [I; 0]`` for the nodes of ``network`` that carry a compensator of ``designs``; None without any."""
    extra = _extra_states(designs)
    if not extra:
        return None
    return tuple(frozen(np.eye(a.n_states + extra.get(k, 0), a.n_states)) for k, a in enumerate(network.agents))


def error_spread(observer: AssembledObserver) -> FloatArray:
    """Bound of the rounding error in each entry of the ``observer``'s error matrix."""
    total, states = observer.states.total, observer.states
    size, terms = np.zeros((total, total)), np.ones(total)
    position = {name: k for k, name in enumerate(observer.names)}
    for k, node in enumerate(observer.nodes):
        own = states.slice(k)
        size[own, own] += np.abs(node.A)
        for arc in node.arcs:
            terms[own] += arc.gain.shape[1] + 2
            size[own, own] += np.abs(arc.gain) @ np.abs(arc.output)
            for name, rows in arc.heard:
                size[own, states.slice(position[name])] += np.abs(arc.gain) @ np.abs(rows)
    return np.asarray(gam(4.0 * terms + 32.0)[:, None] * size)


def _extra_states(designs: Sequence[PartDesign]) -> dict[int, int]:
    """Number of further states of each node that carries a compensator."""
    return {d.part.agents[d.compensator.agent].node: d.compensator.D.shape[0] for d in designs if d.compensator}


def _gains(designs: Sequence[PartDesign]) -> dict[tuple[int, int], FloatArray]:
    """``L_ij`` in the agents' own states, for each node and measurement."""
    gains = {}
    for design in designs:
        part = design.part
        for k, agent in enumerate(part.agents):
            for j, label in enumerate(part.labels):
                if part.mask[part.states.slice(k), part.readings.slice(j)].any():
                    gains[agent.node, label] = agent.Q @ design.gain[part.states.slice(k), part.readings.slice(j)]
    return gains


def _inserted(design: PartDesign, label: int, rows: int) -> FloatArray:
    """What measurement ``label`` puts into the compensator: columns of G, in units."""
    made, part = design.compensator, design.part
    assert made is not None
    if label not in part.labels:
        return np.zeros((made.D.shape[0], rows))
    return part.unscaled(made.G)[:, part.readings.slice(part.labels.index(label))]


def _arc(network: HyperNetwork, node: int, label: int, gain: FloatArray, extra: dict[int, int]) -> LocalArc:
    blocks = {k: np.pad(block, ((0, 0), (0, extra.get(k, 0)))) for k, block in network.measurements[label].items()}
    others = tuple((network.names[k], frozen(-block)) for k, block in blocks.items() if k != node)
    neighbour, rows = others[0] if others else (None, None)
    return LocalArc(label, neighbour, 1.0, frozen(gain), frozen(blocks[node]), rows, others[1:])


def _program(
    network: HyperNetwork, node: int, name: str, arcs: tuple[LocalArc, ...], carried: PartDesign | None, rate: float
) -> LocalObserver:
    agent = network.agents[node]
    if carried is None:
        return LocalObserver(name, agent.A, agent.B, arcs)
    made, size = carried.compensator, carried.part.size
    assert made is not None
    own: Unstable = carried.part.agents[made.agent]
    n, m = agent.n_states, made.D.shape[0]
    A = la.block_diag(agent.A, size * made.D - rate * np.eye(m))
    A[:n, n:] = own.Q @ (size * made.F)
    B = None if agent.B is None else frozen(np.vstack([agent.B, np.zeros((m, agent.B.shape[1]))]))
    return LocalObserver(name, frozen(A), B, arcs, frozen(np.eye(n, n + m)))
