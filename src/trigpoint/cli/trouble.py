"""From the tables of ``[simulate]`` to the values of a ``Scenario``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trigpoint.cli.places import PlacedError
from trigpoint.errors import FileFormatError
from trigpoint.graphs import MeasurementGraph
from trigpoint.io.sections import SimulateSection
from trigpoint.io.text import nearest, read_text, shown
from trigpoint.io.toml_lines import KeyPath
from trigpoint.io.trouble_sections import ChannelSection, MotionSection, TopologySection
from trigpoint.simulation import (
    Absence,
    Bouncing,
    Bursts,
    Channel,
    Clocks,
    Outage,
    Topology,
    Trajectory,
    Trigger,
    within_reach,
)


def trouble_of(
    section: SimulateSection, path: Path, names: Sequence[str], graph: MeasurementGraph | None, states: int
) -> dict[str, Any]:
    """Keyword arguments of ``Scenario``: what goes wrong, and how the agents move.

    Args:
        section: the table.
        path: the scenario's file; a motion's file is looked up beside it.
        names: the nodes' names.
        graph: the arcs that a topology switches; None where there are none.
        states: states of one node.
    """
    position = {name: k for k, name in enumerate(names)}
    channel = _channel(section.channel, position) if section.channel else None
    if section.loss:
        channel = Channel(section.loss)
    clocks = section.clocks
    absences = [
        Absence(
            _index(one.node, position, (*_ABSENCES, k, "node")), one.start, np.inf if one.stop is None else one.stop
        )
        for k, one in enumerate(section.absences)
    ]
    trigger = section.trigger
    motion = _motion(section.motion, path, len(names), states) if section.motion else None
    return {
        "channel": channel,
        "clocks": None if clocks is None else Clocks(**clocks.model_dump()),
        "topology": _topology(section.topology, graph, section, motion) if section.topology else None,
        "absences": absences,
        "trigger": None if trigger is None else Trigger(trigger.size, trigger.rate),
        "gossip": section.gossip,
        "motion": motion,
    }


_ABSENCES: KeyPath = ("simulate", "absences")
_TOPOLOGY: KeyPath = ("simulate", "topology")
_OUTAGES: KeyPath = ("simulate", "channel", "outages")


def _index(name: Any, position: dict[str, int], at: KeyPath) -> int:
    if not isinstance(name, str | int) or isinstance(name, bool):
        raise PlacedError(at, f"[simulate]: got {shown(name)}, expected the name of a node")
    if str(name) not in position:
        known = ", ".join(list(position)[:12]) + (", ..." if len(position) > 12 else "")
        hint = nearest(str(name), position)
        raise PlacedError(at, f"[simulate] names the node {str(name)!r}; the nodes are {known}{hint}")
    return position[str(name)]


def _channel(section: ChannelSection, position: dict[str, int]) -> Channel:
    outages = []
    for k, one in enumerate(section.outages):
        links, at = None, (*_OUTAGES, k, "links")
        if one.links is not None:
            if not all(len(link) == 2 for link in one.links):
                raise PlacedError(at, f"links of an outage must be pairs [sender, receiver]; got {one.links}")
            links = tuple((_index(a, position, at), _index(b, position, at)) for a, b in one.links)
        outages.append(Outage(one.start, one.stop, links))
    plain = section.model_dump(exclude={"bursts", "outages", "axes"})
    bursts = None if section.bursts is None else Bursts(**section.bursts.model_dump())
    return Channel(**plain, bursts=bursts, outages=tuple(outages), axes=tuple(section.axes))


def _topology(
    section: TopologySection,
    graph: MeasurementGraph | None,
    whole: SimulateSection,
    motion: Trajectory | Bouncing | None,
) -> Topology:
    if graph is None:
        raise PlacedError(
            _TOPOLOGY, "a topology switches a network's arcs; a shared plant has none: use outages of links"
        )
    if section.radius is not None:
        end = _end_of(whole)
        if not isinstance(motion, Bouncing):
            raise PlacedError(_TOPOLOGY, "a topology by radius belongs to bouncing agents: add motion = {side = ...}")
        return within_reach(motion, graph, section.radius, end)
    if section.drawn is not None:
        return Topology.random(graph.n_arcs, *section.drawn, _end_of(whole), section.seed)
    return Topology.schedule(graph, [(one.time, one.arcs) for one in section.changes])


def _end_of(section: SimulateSection) -> float:
    instants = section.instants
    if instants is None:
        raise PlacedError(_TOPOLOGY, "a random topology, or one by radius, needs a horizon or times")
    return float(instants[-1])


def _motion(section: MotionSection, path: Path, count: int, states: int) -> Trajectory | Bouncing:
    if section.side is not None:
        if states != 4:
            text = f"bouncing agents have 4 states (place and velocity in a plane); got {states}"
            raise PlacedError(("simulate", "motion"), text)
        speeds = (section.speeds[0], section.speeds[1])
        return Bouncing.drawn(count, section.side, speeds, np.random.default_rng(section.seed), known=section.known)
    file = path.parent / str(section.file)
    return trajectory_from_csv(file, count, states, section.known)


def trajectory_from_csv(path: Path, count: int, states: int, known: bool = True) -> Trajectory:
    """A table of motion: each line the time and then ``count`` times ``states`` numbers; # lines are comments.

    Args: ``path`` of the file; ``known`` as in ``Trajectory``.
    """
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            rows.append([float(part) for part in line.split(",")])
        except ValueError:
            if rows:
                raise FileFormatError(
                    path, f"got {line[:60]!r}, expected numbers separated by commas", number
                ) from None
            continue  # a header
        if len(rows[-1]) != 1 + count * states:
            wanted = f"the time and {count} x {states} states"
            raise FileFormatError(path, f"got {len(rows[-1])} numbers, expected {wanted}", number)
    if not rows:
        raise FileFormatError(path, "holds no row of numbers")
    table = np.array(rows)
    return Trajectory(table[:, 0], table[:, 1:].reshape(len(rows), count, states), known)
