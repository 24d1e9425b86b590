"""Settings of one node: back from their file, and refused with the field's name where they do not fit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.given import OSCILLATOR, case
from trigpoint.errors import ArgumentError, FileFormatError, ProtocolError
from trigpoint.runtime import Identity, NodeSettings, read_settings, write_settings

FULL = replace(
    case(OSCILLATOR, told=True).settings()[4],
    deviations={0: 0.1, 3: 0.0},
    models={"1": np.array([[0.0, 2.0], [-2.0, 0.0]])},
    old="use",
    coverage="every",
    listen="tcp/127.0.0.1:7000",
    peers={"1": "tcp/127.0.0.1:7001"},
    identity=Identity("ca.pem", "one.pem", "one.key"),
    decay_rate=0.3,
    settle_rate=0.2,
    overshoot=1.5,
    nodes=9,
    max_nodes=12,
)


def test_settings_come_back_from_their_file(tmp_path) -> None:
    path = tmp_path / "node.json"
    write_settings(FULL, path)
    assert path.stat().st_mode & 0o077 == 0
    found = read_settings(path)
    assert found.to_document() == FULL.to_document()
    assert found.name == "4"
    np.testing.assert_array_equal(found.drives["1"], FULL.drives["1"])


def test_settings_name_the_neighbours_only() -> None:
    text = json.dumps(FULL.to_document())
    for stranger in ("0", "2", "6", "8"):
        assert f'"{stranger}"' not in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"network": ""}, "network must be a name"),
        ({"period": 0.0}, "period of a node must be a positive number"),
        ({"status_every": -1.0}, "status_every"),
        ({"ping_every": np.inf}, "ping_every"),
        ({"start_uncertainty": -1.0}, "at least 0"),
        ({"nodes": -1}, "nodes of a node must be a whole number"),
        ({"max_nodes": 2.0}, "max_nodes of a node must be a whole number"),
        ({"settle_rate": -1.0}, "settle_rate of a node must be a number of at least 0"),
        ({"overshoot": 0.5}, "overshoot of a node must be a number of at least 1"),
        ({"old": "drop"}, "old must be propagate or use"),
        ({"coverage": "some"}, "coverage must be"),
        ({"input": np.zeros(3)}, "input of a node must fit its B"),
        ({"deviations": {1: np.nan}}, "deviations must be numbers"),
        ({"models": {"1": np.eye(3)}}, r"models of '1': got shape \(3, 3\), expected \(2, 2\)"),
        ({"drives": {"1": np.eye(2)}}, r"drives of '1': got shape \(2, 2\), expected \(2,\)"),
    ],
)
def test_bad_settings_are_refused(changes, message) -> None:
    with pytest.raises(ArgumentError, match=message):
        replace(FULL, **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "x"}, "kind must be"),
        ({"version": 9}, "version 9 is unknown"),
        ({"colour": 1}, "have no 'colour'"),
        ({"period": "fast"}, "'period' must be a number"),
        ({"period": True}, "'period' must be a number"),
        ({"network": 3}, "'network' must be a text"),
        ({"listen": 3}, "'listen' must be a text"),
        ({"peers": {"1": 2}}, "'peers' must map names to texts"),
        ({"guests": []}, "'guests' must map names to texts"),
        ({"deviations": {}}, "list of pairs"),
        ({"deviations": [["a", 1.0]]}, "whole numbers"),
        ({"deviations": [[1, "a"]]}, "deviations"),
        ({"identity": {"key": "k"}}, "authority, certificate and key"),
        ({"models": 3}, "node settings"),
        ({"drives": {"1": 3}}, "drives.1"),
        ({"input": {}}, "input"),
        ({"program": {}}, "node file"),
        ({"stale": -1.0}, "stale of a node"),
        ({"old": []}, "node settings"),
    ],
)
def test_a_damaged_document_is_a_protocol_error_that_names_the_field(changes, message) -> None:
    with pytest.raises(ProtocolError, match=message):
        NodeSettings.from_document(FULL.to_document() | changes)


def test_a_file_that_cannot_be_read_is_named(tmp_path) -> None:
    for name, text in (("none.json", None), ("bad.json", "{"), ("deep.json", "[" * 100_000)):
        path = tmp_path / name
        if text is not None:
            path.write_text(text, encoding="utf-8")
        with pytest.raises(FileFormatError, match=name):
            read_settings(path)
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate(16 * 1024 * 1024 + 1)
    with pytest.raises(FileFormatError, match="at most"):
        read_settings(large)
