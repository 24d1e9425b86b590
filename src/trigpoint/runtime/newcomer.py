"""A node that joins a network that runs, or leaves it for good: its settings and its neighbours', from these alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trigpoint.errors import ArgumentError
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.runtime.endpoints import parse_address
from trigpoint.runtime.settings import Identity, NodeSettings

_ALIKE = ("network", "period", "old", "stale", "window", "coverage", "max_nodes")


@dataclass(frozen=True)
class Newcomer:
    """Who joins.

    Attributes:
        name: its name.
        listen: its address.
        labels: of the reading between each neighbour and itself, one a neighbour; the newcomer is the arc's head.
        anchor_label: of its own absolute reading; None for none.
        deviation: standard deviation of these readings; None for the largest that the neighbours know of.
        sensor: who publishes these readings; None for somebody who is a sensor to the neighbours already.
        nodes: how many nodes the network then has; None for one more than the neighbours know of.
        identity: its certificates, or None.
    """

    name: str
    listen: str
    labels: tuple[int, ...]
    anchor_label: int | None = None
    deviation: float | None = None
    sensor: str | None = None
    nodes: int | None = None
    identity: Identity | None = None


def join(newcomer: Newcomer, neighbours: Sequence[NodeSettings]) -> tuple[NodeSettings, tuple[NodeSettings, ...]]:
    """The settings of the ``newcomer``, and the new ones of its ``neighbours``, in order; nobody else is concerned.

    Model, gain and outputs are those of the neighbours' arcs. The newcomer connects to its neighbours, who get an arc
    each (and the sensor as a guest) and keep their addresses. It begins at zero, and as unsure as the least sure of
    them.

    We assume:
        * the gain was designed for every network of these nodes (``coverage`` is ``every``), up to ``max_nodes``.
        * no other arc of the network has one of these labels, and no other node or guest this name: the neighbours'
          files tell of their own only.

    Raises:
        ArgumentError: the neighbours differ, their gain is for their network alone or for no more nodes than there are,
            or a name, label or address does not fit.
    """
    _check_names(newcomer, neighbours)
    first = neighbours[0]
    _check_alike(neighbours)
    count = _count(newcomer, neighbours)
    pattern = _pattern(neighbours)
    _check_links(newcomer, neighbours)
    labels = [*newcomer.labels, *([] if newcomer.anchor_label is None else [newcomer.anchor_label])]
    known = [value for one in neighbours for value in one.deviations.values()]
    deviation = max(known, default=0.0) if newcomer.deviation is None else newcomer.deviation
    arcs = [
        replace(pattern, label=label, neighbour=one.name, sign=1.0, neighbour_output=pattern.output)
        for label, one in zip(newcomer.labels, neighbours, strict=True)
    ]
    if newcomer.anchor_label is not None:
        arcs.append(replace(pattern, label=newcomer.anchor_label, neighbour=None, sign=1.0, neighbour_output=None))
    sensors = {} if newcomer.sensor is None else {newcomer.sensor: "sensor"}
    program = first.program
    drives = {one.name: program.B @ one.input for one in neighbours if one.input is not None and program.B is not None}
    own = replace(
        first,
        program=LocalObserver(newcomer.name, program.A, program.B, tuple(arcs), exchange=program.exchange),
        start=np.zeros(program.n_states),
        start_uncertainty=max(one.start_uncertainty for one in neighbours),
        deviations=dict.fromkeys(labels, deviation),
        input=None,
        drives=drives,
        anchor_timeout=max(one.anchor_timeout for one in neighbours) + first.period,  # news has one arc further to go
        listen=newcomer.listen,
        peers={one.name: one.listen for one in neighbours},
        identity=newcomer.identity,
        guests={**{name: role for name, role in first.guests.items() if role != "listener"}, **sensors},
        decay_rate=min(one.decay_rate for one in neighbours),
        settle_rate=min(one.settle_rate for one in neighbours),
        overshoot=max(one.overshoot for one in neighbours),
        nodes=count,
    )
    grown = tuple(
        _grown(one, arc, newcomer.name, deviation, sensors, count) for one, arc in zip(neighbours, arcs, strict=False)
    )
    return own, grown


def leave(name: str, neighbours: Sequence[NodeSettings]) -> tuple[NodeSettings, ...]:
    """The new settings of the ``neighbours`` of the node ``name``, which has left for good; in order.

    They lose the arcs to it, with these readings, and its address. A node that comes back needs nobody to be told: as
    long as it is away its arcs are left out anyway.

    We assume:
        * every part of the network that is left has an anchor; where not, its nodes will say ``relative``.

    Raises:
        ArgumentError: nobody is given, one of them does not hear the node, has an arc that joins it and others, or
            would hear nobody and read nothing, or the gain is guaranteed for the present network only.
    """
    if not neighbours:
        raise ArgumentError(f"say who heard {name!r}: got no neighbour")
    return tuple(_shrunk(one, name) for one in neighbours)


def _shrunk(one: NodeSettings, name: str) -> NodeSettings:
    if name not in one.program.hears:
        raise ArgumentError(f"{one.name!r} does not hear {name!r}; it hears {', '.join(one.program.hears) or 'nobody'}")
    if one.coverage != "every":
        raise ArgumentError(
            f"the gain of {one.name!r} is guaranteed for its present network only (coverage is 'nominal'): design the "
            "smaller network anew"
        )
    gone = [arc for arc in one.program.arcs if name in (other for other, _ in arc.heard)]
    kept = tuple(arc for arc in one.program.arcs if name not in (other for other, _ in arc.heard))
    if any(arc.more for arc in gone):
        raise ArgumentError(f"a measurement of {one.name!r} joins {name!r} and others: design the network anew")
    if not kept:
        raise ArgumentError(f"{one.name!r} would hear nobody and read nothing without {name!r}: end it, too")
    labels = {arc.label for arc in gone}
    return replace(
        one,
        program=replace(one.program, arcs=kept, _memo={}),
        deviations={label: value for label, value in one.deviations.items() if label not in labels},
        models={other: A for other, A in one.models.items() if other != name},
        drives={other: drive for other, drive in one.drives.items() if other != name},
        peers={other: where for other, where in one.peers.items() if other != name},
        nodes=max(0, one.nodes - 1),
    )


def _grown(
    one: NodeSettings, arc: LocalArc, name: str, deviation: float, sensors: dict[str, str], count: int
) -> NodeSettings:
    """A neighbour's settings with the other end of ``arc``."""
    assert arc.label is not None  # of a newcomer every arc has a reading
    program = replace(one.program, arcs=(*one.program.arcs, replace(arc, neighbour=name, sign=-1.0)), _memo={})
    return replace(
        one,
        program=program,
        deviations={**one.deviations, arc.label: deviation},
        guests={**one.guests, **sensors},
        nodes=count,
    )


def _check_names(newcomer: Newcomer, neighbours: Sequence[NodeSettings]) -> None:
    names = [one.name for one in neighbours]
    if not neighbours:
        raise ArgumentError("a newcomer needs at least one neighbour; got none")
    if len(newcomer.labels) != len(names):
        raise ArgumentError(
            f"each neighbour needs the label of its reading; got {len(names)} of them and {len(newcomer.labels)} labels"
        )
    if len(set(names)) < len(names):
        raise ArgumentError(f"each neighbour once; got {', '.join(names)}")
    for one in neighbours:
        taken = {one.name, *one.program.hears, *one.peers, *one.guests}
        for new in (newcomer.name, *([newcomer.sensor] if newcomer.sensor else [])):
            if (new in taken and one.guests.get(new) != "sensor") or not new:
                raise ArgumentError(f"the name {new!r} is taken, as {one.name!r} knows; choose another")
    if newcomer.name in (newcomer.sensor, *neighbours[0].guests):
        raise ArgumentError(f"the name {newcomer.name!r} is a sensor's; choose another for the node")
    labels = [*newcomer.labels, *([] if newcomer.anchor_label is None else [newcomer.anchor_label])]
    known = {label for one in neighbours for label in one.program.reads}
    bad = [label for label in labels if label < 0 or label in known or labels.count(label) > 1]
    if bad:
        raise ArgumentError(f"labels of new readings must be numbers of at least 0 that no other has; got {bad[0]}")


def _check_alike(neighbours: Sequence[NodeSettings]) -> None:
    first = neighbours[0]
    for one in neighbours:
        for field in _ALIKE:
            if getattr(one, field) != getattr(first, field):
                raise ArgumentError(
                    f"neighbours must have the same {field}; {first.name!r} has {getattr(first, field)!r} and "
                    f"{one.name!r} {getattr(one, field)!r}"
                )
        mine, yours = one.program, first.program
        same_input = (mine.B is None) == (yours.B is None) and (
            mine.B is None or yours.B is None or np.array_equal(mine.B, yours.B)
        )
        if one.models or not (np.array_equal(mine.A, yours.A) and same_input and mine.exchange == yours.exchange):
            raise ArgumentError(
                f"a newcomer takes its model from its neighbours, whose agents must be equal; {one.name!r} and "
                f"{first.name!r}, or those around, differ: design the network anew"
            )
        if mine.readout is not None or mine.feedthrough or mine.acceleration is not None:
            raise ArgumentError(
                f"the program of {one.name!r} has a readout, a feedthrough or an acceleration, which belong to one "
                "network: design it anew with the newcomer"
            )
    if first.coverage != "every":
        raise ArgumentError(
            "the neighbours' gain is guaranteed for their present network only (coverage is 'nominal'): design with "
            'gain = "worst-case" and max_nodes, then nodes can join'
        )


def _count(newcomer: Newcomer, neighbours: Sequence[NodeSettings]) -> int:
    """How many nodes there are with the newcomer."""
    known, limit = max(one.nodes for one in neighbours), neighbours[0].max_nodes
    if newcomer.nodes is not None and newcomer.nodes <= known:
        raise ArgumentError(
            f"nodes must count the newcomer: more than the {known} that the neighbours know of; got {newcomer.nodes}"
        )
    count = newcomer.nodes or (known + 1 if known else 0)
    if limit and not count:
        raise ArgumentError(f"the gain serves at most {limit} nodes, and the files do not say how many there are: "
                            "say how many with the newcomer (nodes)")  # fmt: skip
    if limit and count > limit:
        raise ArgumentError(
            f"the gain serves at most max_nodes = {limit} nodes, and this would be number {count}: design with more"
        )
    return count


def _pattern(neighbours: Sequence[NodeSettings]) -> LocalArc:
    """The arc that all arcs of the neighbours are like."""
    arcs = [(one.name, arc) for one in neighbours for arc in one.program.arcs]
    if not arcs:
        raise ArgumentError("the neighbours have no arcs to take the gain from")
    pattern = arcs[0][1]
    for name, arc in arcs:
        other = arc.output if arc.neighbour_output is None else arc.neighbour_output
        same = all(
            np.array_equal(mine, yours)
            for mine, yours in ((arc.gain, pattern.gain), (arc.output, pattern.output), (other, arc.output))
        )
        if not same or arc.more or arc.label is None:
            raise ArgumentError(
                f"the arcs of the neighbours must have one gain and one output; those of {name!r} differ (weights, or "
                "measurements of another kind), so that nothing says what a new arc should have"
            )
    return pattern


def _check_links(newcomer: Newcomer, neighbours: Sequence[NodeSettings]) -> None:
    kind = parse_address(newcomer.listen).kind
    for one in neighbours:
        if not one.listen:
            raise ArgumentError(f"{one.name!r} listens nowhere, so that a newcomer cannot connect to it")
        if parse_address(one.listen).kind != kind:
            raise ArgumentError(f"{one.name!r} listens at {one.listen}; got {newcomer.listen}, another kind of link")
        if newcomer.listen == one.listen:
            raise ArgumentError(f"{newcomer.listen} is the address of {one.name!r}; give the newcomer its own")
