"""``Arrivals``: who joined a run while it goes on, by the files in its folder, heard over links of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from trigpoint.errors import FileFormatError, TrigpointError
from trigpoint.runtime.access import guest_rules
from trigpoint.runtime.monitor import Monitor
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings
from trigpoint.runtime.transport import Transport
from trigpoint.runtime.zenoh_link import ZenohTransport

LOOK_EVERY = 1.0
"""Seconds between two looks into the folder."""

Opener = Callable[[NodeSettings], Transport]


def opener(role: str, identity: Identity | None) -> Opener:
    """Opens links to a newcomer, as a guest with this ``role`` and ``identity``."""

    def link(newcomer: NodeSettings) -> Transport:
        rules = None if identity is None else guest_rules(newcomer.network, role, {newcomer.name: "node"})
        return ZenohTransport("", [newcomer.listen], identity=identity, rules=rules)

    return link


class Arrivals:
    """Newcomers of one run: found in its folder, linked to, and told to the monitor. Peers do not forward.

    A newcomer's file stands beside its neighbours' (``trigpoint node --new``), and one of theirs names it: a file that
    an earlier run left behind, or of a node that has left for good, is nobody's.

    Args:
        folder: where the settings of the run's nodes lie, ``node-0.json`` and so on.
        nodes: those settings, in this order.
        monitor: who shall hear the newcomers.
        link: opens links to one.
    """

    def __init__(self, folder: Path, nodes: Sequence[NodeSettings], monitor: Monitor, link: Opener) -> None:
        self._folder, self._monitor, self._link = folder, monitor, link
        self._network = nodes[0].network
        self._files = {node.name: folder / f"node-{k}.json" for k, node in enumerate(nodes)}
        self._hears = {node.name: list(node.program.hears) for node in nodes}
        self._anchors = [node.name for node in nodes if any(not arc.heard for arc in node.program.arcs)]
        self._seen: dict[Path, float] = {}
        self._links: list[Transport] = []
        self._looked = -LOOK_EVERY
        self.joined: tuple[NodeSettings, ...] = ()
        self.failures: list[str] = []

    @property
    def hears(self) -> Mapping[str, list[str]]:
        """By node, whom it hears, newcomers included, as of the last arrival."""
        return self._hears

    @property
    def anchors(self) -> list[str]:
        """Names of the nodes that have a reading of their own state alone."""
        return self._anchors

    def look(self, now: float) -> tuple[NodeSettings, ...]:
        """Those who joined since the last look, from now on heard by the monitor; at most one look a second."""
        if now - self._looked < LOOK_EVERY:
            return ()
        self._looked = now
        found = []
        for written, path in self._changed():
            settings = self._newcomer(written, path)
            if settings is not None and self._let_in(settings):
                found.append(settings)
        return tuple(found)

    def close(self) -> None:
        """End the links."""
        for link in self._links:
            link.close()
        self._links.clear()

    def _changed(self) -> list[tuple[float, Path]]:
        """Time and place of files that were written since the last look and may be a newcomer's, by age."""
        known = {*self._files.values()}
        found: list[tuple[float, Path]] = []
        for path in self._folder.glob("*.json"):
            try:
                written = path.stat().st_mtime
            except OSError:  # gone meanwhile
                continue
            if path not in known and self._seen.get(path) != written:
                found.append((written, path))
        return sorted(found)

    def _newcomer(self, written: float, path: Path) -> NodeSettings | None:
        """The settings ``written`` to ``path`` then, if of a node that one of its neighbours names, too."""
        try:
            settings = read_settings(path)
        except FileFormatError:  # the plant's, the viewer's, or what somebody put there
            settings = None
        if settings is None or settings.network != self._network or settings.name in self._files:
            self._seen[path] = written
            return None
        if not any(self._names(other, settings.name) for other in settings.program.hears):
            return None  # its neighbours' files may come a moment later
        self._seen[path] = written
        self._files[settings.name] = path
        return settings

    def _names(self, other: str, name: str) -> bool:
        path = self._files.get(other)
        if path is None:
            return False
        try:
            return name in read_settings(path).program.hears
        except FileFormatError:
            return False

    def _let_in(self, newcomer: NodeSettings) -> bool:
        """Link to it and let the monitor hear it; what does not work out is kept in ``failures``."""
        hears = {**self._hears, newcomer.name: list(newcomer.program.hears)}
        for other in newcomer.program.hears:
            if newcomer.name not in hears.get(other, [newcomer.name]):
                hears[other] = [*hears[other], newcomer.name]
        try:
            link = self._link(newcomer)
        except TrigpointError as error:
            self.failures.append(f"{newcomer.name!r} joined, but cannot be heard: {error}")
            return False
        self._links.append(link)
        self._hears = hears
        if any(not arc.heard for arc in newcomer.program.arcs):
            self._anchors = [*self._anchors, newcomer.name]
        self.joined = (*self.joined, newcomer)
        self._monitor.join(newcomer.program, link, hears)
        return True
