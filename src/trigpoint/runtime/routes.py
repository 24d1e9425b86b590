"""Which keys a node listens to, and what may arrive under each."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from trigpoint.observers.local import LocalObserver
from trigpoint.runtime.codec import Kind, frame_size
from trigpoint.runtime.gate import Route, Source
from trigpoint.runtime.settings import NodeSettings
from trigpoint.runtime.topics import node_key, ping_key, reading_key

_SAID = frozenset({Kind.ESTIMATE})
_GREETED = frozenset({Kind.HELLO, Kind.BYE})
_ASKED = frozenset({Kind.PING, Kind.PONG})
_READ = frozenset({Kind.READING})
_ORDERED = frozenset({Kind.CONTROL})


def neighbours(settings: NodeSettings) -> tuple[str, ...]:
    """Everybody whom the node talks with: whom it hears, then further peers of these ``settings``."""
    return tuple(dict.fromkeys([*settings.program.hears, *settings.peers]))


def sizes(settings: NodeSettings) -> dict[str, int]:
    """Length of the estimate of each neighbour that is heard by a node with these ``settings``."""
    return {name: int(rows.shape[1]) for arc in settings.program.arcs for name, rows in arc.heard}


def reading_sizes(program: LocalObserver) -> dict[int, int]:
    """Length of every reading that the ``program`` uses, by label."""
    widths = {label: int(matrix.shape[1]) for label, matrix in program.feedthrough}
    return widths | {arc.label: int(arc.gain.shape[1]) for arc in program.arcs if arc.label is not None}


def guests(settings: NodeSettings, role: str) -> frozenset[str]:
    """Names that these ``settings`` give the ``role``."""
    return frozenset(name for name, one in settings.guests.items() if one == role)


def routes_of(settings: NodeSettings, source: Callable[[str], Source]) -> dict[str, Route]:
    """Every key that the node with these ``settings`` listens to, with what may arrive under it.

    Args:
        settings: of the node.
        source: order and rate of whoever is called so; asked once for each neighbour, clock, reading and for orders.
    """
    network, name, program = settings.network, settings.name, settings.program
    length = sizes(settings)
    routes = {}
    for other in neighbours(settings):
        speaks, clock = source(f"node {other}"), source(f"clock {other}")
        only = frozenset({other})
        if other in length:
            routes[node_key(network, other, "estimate")] = Route(_SAID, only, speaks, length[other])
        routes[node_key(network, other, "hello")] = Route(_GREETED, only, speaks)
        routes[ping_key(network, other, name)] = Route(_ASKED, only, clock)
    sensors = guests(settings, "sensor") | {name}
    for label, width in reading_sizes(program).items():
        routes[reading_key(network, label)] = Route(_READ, sensors, source(f"reading {label}"), width, label)
    routes[node_key(network, name, "control")] = Route(_ORDERED, guests(settings, "supervisor"), source("orders"))
    return routes


def longest_of(routes: Iterable[Route]) -> int:
    """Bytes of the longest frame that one of these ``routes`` lets in."""
    return max((frame_size(name, route.size) for route in routes for name in route.senders), default=0)
