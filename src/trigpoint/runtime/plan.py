"""``LivePlan``: all that a supervisor needs to run a network, made by who designed it; who gets which address."""

from __future__ import annotations

import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.runtime.plant import PlantSettings, write_plant
from trigpoint.runtime.settings import Identity, NodeSettings, write_settings
from trigpoint.runtime.status import require_frames
from trigpoint.runtime.viewer import VIEWER_FILE, Viewer, write_viewer

TransportKind = Literal["unixsock", "tcp", "udp", "tls", "quic"]
TRANSPORTS: tuple[TransportKind, ...] = ("unixsock", "tcp", "udp", "tls", "quic")
"""Kinds of links that ``trigpoint run`` can make."""


@dataclass(frozen=True, eq=False)
class LivePlan:
    """A network about to run.

    Attributes:
        network: its name.
        nodes: settings of every node.
        plant: what simulates the truth, or None where the readings come from elsewhere.
        folder: where the processes' settings, their messages and ``status.json`` go.
        watcher: name of the monitor and supervisor, a guest of every node.
        listen: address of the monitor, which the plant connects to.
        identity: the monitor's certificates, or None.
        agents_per_process: how many nodes share a process.
        motions: by node, the dynamics of what it estimates (for the monitor only).
        sensor: name of the guest of every node that publishes the readings, where there is no plant.
        viewer: who may watch the run from outside, or None.
    """

    network: str
    nodes: tuple[NodeSettings, ...]
    plant: PlantSettings | None
    folder: Path
    watcher: str
    listen: str
    identity: Identity | None
    agents_per_process: int
    motions: Mapping[str, FloatArray]
    sensor: str = ""
    viewer: Viewer | None = None

    def __post_init__(self) -> None:
        """Refuse an empty plan, impossible groups, and nodes that no frame can speak for."""
        if not self.nodes:
            raise ArgumentError("a plan needs at least one node; got none")
        if self.agents_per_process < 1:
            raise ArgumentError(f"agents_per_process must be at least 1; got {self.agents_per_process}")
        for node in self.nodes:
            require_frames(node.program)

    @property
    def names(self) -> tuple[str, ...]:
        """The nodes' names."""
        return tuple(node.name for node in self.nodes)

    @property
    def groups(self) -> tuple[tuple[NodeSettings, ...], ...]:
        """The nodes of each process."""
        size = self.agents_per_process
        return tuple(self.nodes[k : k + size] for k in range(0, len(self.nodes), size))

    def settings_file(self, index: int) -> Path:
        """Where the settings of node ``index`` are written; names may hold anything, so files are numbered."""
        return self.settings_folder / f"node-{index}.json"

    @property
    def settings_folder(self) -> Path:
        """Where all settings are written; those of nodes that join the run come there, too."""
        return self.folder / "settings"

    @property
    def plant_file(self) -> Path:
        """Where the plant's settings are written."""
        return self.settings_folder / "plant.json"

    def write(self) -> None:
        """Write one file a node, and the plant's: a node's process is given its own file and no other."""
        self.settings_folder.mkdir(parents=True, exist_ok=True)
        for index, node in enumerate(self.nodes):
            write_settings(node, self.settings_file(index))
        if self.plant is not None:
            write_plant(self.plant, self.plant_file)
        if self.viewer is not None:
            write_viewer(self.viewer, self.folder / VIEWER_FILE)


def free_addresses(
    kind: TransportKind, names: Sequence[str], folder: Path, given: Mapping[str, str] | None = None
) -> dict[str, str]:
    """An address on this machine for each name, unless it is ``given`` one.

    Args:
        kind: of the links.
        names: who needs one.
        folder: for socket files; its path must be short.
        given: addresses by name that somebody chose.

    Raises:
        ArgumentError: a given address belongs to nobody, or is of another kind.
    """
    chosen = {} if given is None else dict(given)
    unknown = sorted(set(chosen) - set(names))
    if unknown:
        raise ArgumentError(f"addresses names {', '.join(unknown[:5])}; the nodes are {', '.join(list(names)[:12])}")
    prefix = "unixsock-stream/" if kind == "unixsock" else f"{kind}/"
    for name, address in chosen.items():
        if not address.startswith(prefix):
            raise ArgumentError(f"the address of {name!r} must begin with {prefix!r}, as the transport is {kind}; "
                                f"got {address!r}")  # fmt: skip
    open_names = [name for name in names if name not in chosen]
    if kind == "unixsock":
        found = [f"{prefix}{folder}/{number}.sock" for number in range(len(open_names))]
    else:
        ports = _free_ports(len(open_names), socket.SOCK_DGRAM if kind in ("udp", "quic") else socket.SOCK_STREAM)
        found = [f"{prefix}127.0.0.1:{port}" for port in ports]
    return {**dict(zip(open_names, found, strict=True)), **chosen}


def _free_ports(count: int, kind: socket.SocketKind) -> list[int]:
    """Ports that nobody listens on now; another program may still take one before we do, which fails loudly."""
    held = [socket.socket(socket.AF_INET, kind) for _ in range(count)]
    try:
        for one in held:
            one.bind(("127.0.0.1", 0))
        return [int(one.getsockname()[1]) for one in held]
    finally:
        for one in held:
            one.close()


def linked(nodes: Sequence[NodeSettings], addresses: Mapping[str, str]) -> tuple[NodeSettings, ...]:
    """The nodes with their addresses: of two that exchange messages, the later one connects to the earlier.

    Args:
        nodes: in order.
        addresses: where each listens.

    A node that is heard by another, but does not hear it, takes it for a guest with the role ``listener``.
    """
    position = {node.name: k for k, node in enumerate(nodes)}
    heard_by: dict[str, set[str]] = {node.name: set() for node in nodes}
    for node in nodes:
        for other in node.program.hears:
            heard_by[other].add(node.name)
    found = []
    for k, node in enumerate(nodes):
        hears = set(node.program.hears)
        others = sorted(hears | heard_by[node.name], key=position.__getitem__)
        peers = {other: addresses[other] for other in others if position[other] < k}
        listeners = {other: "listener" for other in others if other not in hears}
        guests = {**node.guests, **listeners}
        found.append(replace(node, listen=addresses[node.name], peers=peers, guests=guests))
    return tuple(found)
