"""``Viewer``: a monitor that joins a run from outside: by the files in the run's folder, as a guest that only hears."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trigpoint.arrays import FloatArray, decode_array, encode_array
from trigpoint.errors import ArgumentError, FileFormatError, MissingExtraError, ProtocolError
from trigpoint.runtime.access import guest_rules
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings
from trigpoint.runtime.zenoh_link import ZenohTransport

KIND = "trigpoint/viewer"
VERSION = 2
VIEWER_FILE = Path("settings") / "viewer.json"
"""Where a run writes it, in its folder."""


@dataclass(frozen=True, eq=False)
class Viewer:
    """Who may watch a run from outside.

    Attributes:
        network: name of the network.
        name: its own name, a guest of every node with the role ``monitor``.
        sensor: name of the plant.
        source: address of the plant, who tells its guests readings and truth.
        motions: by node, the dynamics of what it estimates.
        identity: its certificates, or None.
    """

    network: str
    name: str
    sensor: str
    source: str
    motions: Mapping[str, FloatArray]
    identity: Identity | None = None

    def to_document(self) -> dict[str, Any]:
        """The viewer as a JSON object."""
        return {
            "kind": KIND,
            "version": VERSION,
            "network": self.network,
            "name": self.name,
            "sensor": self.sensor,
            "source": self.source,
            "motions": {name: encode_array(A) for name, A in self.motions.items()},
            "identity": None if self.identity is None else vars(self.identity),
        }

    @staticmethod
    def from_document(document: Any) -> Viewer:
        """Read one; anything that does not fit is a ``ProtocolError``."""
        if not isinstance(document, dict) or document.get("kind") != KIND or document.get("version") != VERSION:
            raise ProtocolError(f"this is no viewer: expected kind {KIND!r}, version {VERSION}")
        try:
            motions = {name: decode_array(A, f"motions.{name}") for name, A in document["motions"].items()}
            identity = document["identity"]
            network, name, sensor, source = texts = [document[key] for key in ("network", "name", "sensor", "source")]
            if not all(isinstance(text, str) for text in texts):
                raise ProtocolError(f"network, name, sensor and source of a viewer must be texts; got {texts}")
            return Viewer(network, name, sensor, source, motions, None if identity is None else Identity(**identity))
        except (AttributeError, KeyError, TypeError) as error:
            raise ProtocolError(f"a viewer: {error!r}") from error


def write_viewer(viewer: Viewer, path: Path) -> None:
    """Write the ``viewer`` to ``path``, readable by its owner only."""
    path.touch(mode=0o600)
    path.write_text(json.dumps(viewer.to_document()), encoding="utf-8")


def read_viewer(path: Path) -> Viewer:
    """Read the viewer in ``path``; a damaged file is a ``FileFormatError``."""
    try:
        return Viewer.from_document(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, RecursionError, ValueError) as error:
        raise FileFormatError(path, f"tells no viewer: {error}") from error


def running(folder: Path) -> bool:
    """Whether the run that keeps its files in ``folder`` goes on, by its ``status.json``.

    A run that was killed could not say that it is over; its process is gone, or is one that began later.

    Raises:
        FileFormatError: the file is damaged.
        MissingExtraError: psutil is not installed.
    """
    path = folder / "status.json"
    try:
        written = path.stat().st_mtime
        document = json.loads(path.read_text(encoding="utf-8"))
        over, number = document["over"], int(document["supervisor"])
    except FileNotFoundError:
        return False
    except (KeyError, OSError, RecursionError, TypeError, ValueError) as error:
        raise FileFormatError(path, f"is no status of a run ({error!r})") from error
    if over:
        return False
    try:
        import psutil
    except ImportError as error:
        raise MissingExtraError("psutil", "live", "watching a run that goes on") from error
    try:
        return bool(psutil.Process(number).create_time() <= written + 1.0)
    except psutil.Error:
        return False


def nodes_in(folder: Path) -> tuple[NodeSettings, ...]:
    """The settings of the nodes of the run in ``folder``, in their order; those that joined later are not there."""
    files = sorted((folder / "settings").glob("node-*.json"), key=lambda file: (len(file.name), file.name))
    if not files:
        raise FileFormatError(folder, "holds no settings of nodes: run with --out writes them")
    return tuple(read_settings(file) for file in files)


def view_transport(viewer: Viewer, nodes: tuple[NodeSettings, ...]) -> ZenohTransport:
    """The links of a ``viewer`` to the ``nodes`` and to the plant, over which it hears and says nothing.

    It listens nowhere, so that there may be any number of them at once.

    Raises:
        ArgumentError: the links need certificates and the viewer has none.
    """
    secured = nodes[0].identity is not None
    if secured and viewer.identity is None:
        raise ArgumentError(
            f"the run's links need a certificate for {viewer.name!r}: make one with 'trigpoint keys --guest "
            f"{viewer.name}=monitor' before it starts"
        )
    roles = {**dict.fromkeys((one.name for one in nodes), "node"), viewer.sensor: "sensor"}
    rules = guest_rules(viewer.network, "monitor", roles) if secured else None
    addresses = [one.listen for one in nodes]
    return ZenohTransport("", [*addresses, viewer.source], identity=viewer.identity, rules=rules)
