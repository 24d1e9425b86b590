"""``NodeSettings``: all that one live node is given, as a value and as a file of JSON. It names its neighbours only."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from trigpoint.arrays import FloatArray, as_floats, decode_array, encode_array
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.observers.local import LocalObserver

KIND = "trigpoint/node-settings"
VERSION = 1
_LARGEST_FILE = 16 * 1024 * 1024

OldPolicy = Literal["propagate", "use"]
Coverage = Literal["every", "nominal"]


@dataclass(frozen=True)
class Identity:
    """PEM files of a node for mutual TLS: the ``authority`` that signed everybody, its ``certificate`` and ``key``."""

    authority: str
    certificate: str
    key: str


@dataclass(frozen=True, eq=False)
class NodeSettings:
    """One live node.

    Attributes:
        network: name of the network, first part of every key.
        program: what the node runs.
        period: seconds between two acts.
        start: (n,) first estimate; zero unless given.
        start_uncertainty: standard deviation that the first estimate is believed to have, in the state's unit.
        deviations: standard deviation of the readings of each arc, by label; 0 where not given.
        models: (n_j, n_j) dynamics of neighbours whose agents differ from the own one, by name.
        input: (m,) own known input, constant; None for none.
        drives: (n_j,) ``B u`` of neighbours that have a known input, by name.
        old: ``propagate`` moves a message to now by its time stamp and the sender's model; ``use`` takes it as it is.
        stale: seconds after which a message or a reading is left out, and its arc with it.
        window: seconds by which a time stamp may lie in the future, and beyond ``stale`` in the past.
        anchor_timeout: seconds after which a node that hears of no anchor says ``relative``.
        coverage: ``every``: the gain is guaranteed for every anchored topology of these nodes; ``nominal``: only while
            no arc is missing.
        rate_limit: frames a second that are taken from one sender; more are dropped and counted.
        status_every: seconds between two statuses.
        ping_every: seconds between two questions for a neighbour's time.
        listen: the address that the node listens on, in the transport's words; empty for none.
        peers: addresses of the neighbours to connect to, by name.
        identity: certificates for TLS and QUIC; None for plain links.
        guests: further names that may connect and what for: ``sensor``, ``monitor``, ``supervisor``.
        decay_rate: the design's rate for this gain, 1/s, to tell people; 0 where none is guaranteed.
        settle_rate: 1/s, what the uncertainty of an estimate of something that moves falls by at most; 0: never.
        overshoot: factor, at least 1, by which such an estimate's error may exceed its first one on the way.
        nodes: how many nodes the network had when these settings were written; 0 where nobody said.
        max_nodes: how many the gain serves; 0 for any number.
    """

    network: str
    program: LocalObserver
    period: float
    start: FloatArray | None = None
    start_uncertainty: float = 1.0
    deviations: Mapping[int, float] = field(default_factory=dict)
    models: Mapping[str, FloatArray] = field(default_factory=dict)
    input: FloatArray | None = None
    drives: Mapping[str, FloatArray] = field(default_factory=dict)
    old: OldPolicy = "propagate"
    stale: float = 0.25
    window: float = 1.0
    anchor_timeout: float = 1.0
    coverage: Coverage = "nominal"
    rate_limit: float = 1000.0
    status_every: float = 0.25
    ping_every: float = 1.0
    listen: str = ""
    peers: Mapping[str, str] = field(default_factory=dict)
    identity: Identity | None = None
    guests: Mapping[str, str] = field(default_factory=dict)
    decay_rate: float = 0.0
    settle_rate: float = 0.0
    overshoot: float = 1.0
    nodes: int = 0
    max_nodes: int = 0

    def __post_init__(self) -> None:
        """Check every number once."""
        if not self.network:
            raise ArgumentError("network must be a name; got an empty text")
        for name in ("period", "stale", "window", "anchor_timeout", "rate_limit", "status_every", "ping_every"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ArgumentError(f"{name} of a node must be a positive number; got {value}")
        for name, least in (("start_uncertainty", 0.0), ("decay_rate", 0.0), ("settle_rate", 0.0), ("overshoot", 1.0)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= least):
                raise ArgumentError(f"{name} of a node must be a number of at least {least:g}; got {value}")
        for name in ("nodes", "max_nodes"):
            number = getattr(self, name)
            if type(number) is not int or number < 0:
                raise ArgumentError(f"{name} of a node must be a whole number of at least 0; got {number!r}")
        for name, choices in (("old", get_args(OldPolicy)), ("coverage", get_args(Coverage))):
            if getattr(self, name) not in choices:
                raise ArgumentError(f"{name} must be {' or '.join(choices)}; got {getattr(self, name)!r}")
        if self.input is not None:
            B = self.program.B
            if B is None or np.shape(self.input) != (B.shape[1],):
                shape = None if B is None else B.shape
                raise ArgumentError(f"input of a node must fit its B {shape}; got {np.shape(self.input)}")
        self._check_neighbours()
        bad = [label for label, value in self.deviations.items() if not (np.isfinite(value) and value >= 0.0)]
        if bad:
            raise ArgumentError(f"deviations must be numbers of at least 0; those of the arcs {bad} are not")

    def _check_neighbours(self) -> None:
        """``models`` and ``drives`` of a neighbour must fit the rows that its estimate is multiplied by."""
        sizes = {name: rows.shape[1] for arc in self.program.arcs for name, rows in arc.heard}
        for what, table, wide in (("models", self.models, 2), ("drives", self.drives, 1)):
            for name, value in table.items():
                expected = (sizes.get(name),) * wide
                if name in sizes and np.shape(value) != expected:
                    raise ArgumentError(f"{what} of {name!r}: got shape {np.shape(value)}, expected {expected}")

    @property
    def name(self) -> str:
        """The node's name."""
        return self.program.name

    @property
    def first_uncertainty(self) -> float:
        """What a node that has just started says: ``start_uncertainty``, and what may come of it on the way."""
        return self.overshoot * self.start_uncertainty

    def to_document(self) -> dict[str, Any]:
        """The settings as a JSON object."""
        return {
            "kind": KIND,
            "version": VERSION,
            "network": self.network,
            "program": self.program.to_document(),
            "period": self.period,
            "start": None if self.start is None else encode_array(self.start),
            "start_uncertainty": self.start_uncertainty,
            "deviations": [[label, value] for label, value in self.deviations.items()],
            "models": {name: encode_array(A) for name, A in self.models.items()},
            "input": None if self.input is None else encode_array(self.input),
            "drives": {name: encode_array(drive) for name, drive in self.drives.items()},
            "old": self.old,
            "stale": self.stale,
            "window": self.window,
            "anchor_timeout": self.anchor_timeout,
            "coverage": self.coverage,
            "rate_limit": self.rate_limit,
            "status_every": self.status_every,
            "ping_every": self.ping_every,
            "listen": self.listen,
            "peers": dict(self.peers),
            "identity": None if self.identity is None else vars(self.identity),
            "guests": dict(self.guests),
            "decay_rate": self.decay_rate,
            "settle_rate": self.settle_rate,
            "overshoot": self.overshoot,
            "nodes": self.nodes,
            "max_nodes": self.max_nodes,
        }

    @staticmethod
    def from_document(document: Any) -> NodeSettings:
        """Read settings; anything that does not fit is a ``ProtocolError`` that names the field."""
        if not isinstance(document, dict) or document.get("kind") != KIND:
            raise ProtocolError(f"these are no node settings: kind must be {KIND!r}")
        if document.get("version") != VERSION:
            raise ProtocolError(f"node settings version {document.get('version')!r} is unknown; this reads {VERSION}")
        given = {key: value for key, value in document.items() if key not in ("kind", "version")}
        unknown = sorted(set(given) - set(NodeSettings.__dataclass_fields__))
        if unknown:
            raise ProtocolError(f"node settings have no {', '.join(map(repr, unknown))}")
        try:
            return NodeSettings(
                **{
                    **given,
                    "network": _text(given, "network"),
                    "program": LocalObserver.from_document(given.get("program")),
                    "period": _number(given, "period"),
                    **{name: _number(given, name) for name in _NUMBERS if name in given},
                    **{name: _texts(given, name) for name in ("peers", "guests") if name in given},
                    "start": None if given.get("start") is None else decode_array(given["start"], "start"),
                    "deviations": _deviations(given.get("deviations", [])),
                    "input": None if given.get("input") is None else decode_array(given["input"], "input"),
                    **{name: _arrays(given, name) for name in ("models", "drives") if name in given},
                    "listen": _text(given, "listen") if "listen" in given else "",
                    "identity": _identity(given.get("identity")),
                }
            )
        except (ArgumentError, AttributeError, TypeError) as error:
            raise ProtocolError(f"node settings: {error}") from error


_NUMBERS = (
    "start_uncertainty", "stale", "window", "anchor_timeout", "rate_limit", "status_every", "ping_every", "decay_rate",
    "settle_rate", "overshoot",
)  # fmt: skip


def write_settings(settings: NodeSettings, path: Path) -> None:
    """Write all that one live node needs (``settings``) to ``path``, for its owner only, whole or not at all."""
    write_all([(settings, path)])


def write_all(pairs: Sequence[tuple[NodeSettings, Path]]) -> None:
    """Write the settings of each of the ``pairs`` to its path: no file is replaced before all have been written."""
    fresh = []
    try:
        for settings, path in pairs:
            half = path.with_name(path.name + ".part")
            fresh.append((half, path))
            half.unlink(missing_ok=True)
            half.touch(mode=0o600)
            half.write_text(json.dumps(settings.to_document(), indent=1), encoding="utf-8")
        for half, path in fresh:
            half.replace(path)
    finally:
        for half, _ in fresh:
            half.unlink(missing_ok=True)


def read_settings(path: Path) -> NodeSettings:
    """Read the settings in ``path``; a damaged file is a ``FileFormatError``."""
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise FileFormatError(path, f"node settings have at most {_LARGEST_FILE} bytes")
        return NodeSettings.from_document(json.loads(path.read_text(encoding="utf-8")))
    except json.JSONDecodeError as error:
        raise FileFormatError(path, "no node settings: got no JSON, expected what run --prepare wrote") from error
    except (OSError, RecursionError, ValueError) as error:  # damaged text and protocol errors are ValueErrors
        raise FileFormatError(path, f"no node settings: {error}") from error


def _number(given: Mapping[str, Any], name: str) -> float:
    value = given.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ProtocolError(f"node settings: {name!r} must be a number; got {value!r}")
    return float(value)


def _text(given: Mapping[str, Any], name: str) -> str:
    value = given.get(name)
    if not isinstance(value, str):
        raise ProtocolError(f"node settings: {name!r} must be a text; got {value!r}")
    return value


def _texts(given: Mapping[str, Any], name: str) -> dict[str, str]:
    value = given.get(name)
    if not isinstance(value, dict) or not all(isinstance(text, str) for text in value.values()):
        raise ProtocolError(f"node settings: {name!r} must map names to texts; got {value!r}")
    return value


def _arrays(given: Mapping[str, Any], name: str) -> dict[str, FloatArray]:
    return {key: decode_array(value, f"{name}.{key}") for key, value in given[name].items()}


def _deviations(value: Any) -> dict[int, float]:
    if not isinstance(value, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in value):
        raise ProtocolError("node settings: 'deviations' must be a list of pairs of label and number")
    labels = [pair[0] for pair in value]
    if not all(type(label) is int for label in labels):
        raise ProtocolError(f"node settings: the labels of 'deviations' must be whole numbers; got {labels}")
    return dict(zip(labels, as_floats("deviations", [pair[1] for pair in value]).tolist(), strict=True))


def _identity(value: Any) -> Identity | None:
    if value is None:
        return None
    if not isinstance(value, dict) or set(value) != {"authority", "certificate", "key"}:
        raise ProtocolError("node settings: 'identity' must hold authority, certificate and key, or be null")
    return Identity(**{name: _text(value, name) for name in value})
