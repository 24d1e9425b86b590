"""Who may say and hear what: derived from a node's settings, nothing beyond."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trigpoint.errors import ArgumentError
from trigpoint.observers.local import LocalArc, LocalObserver
from trigpoint.runtime import ROLES, Access, AccessRules, NodeSettings, guest_rules, node_rules

ONE = np.eye(1)
ARCS = (LocalArc(4, "b", 1.0, ONE, ONE, ONE), LocalArc(7, None, 1.0, ONE, ONE, None))
SETTINGS = NodeSettings(
    "net", LocalObserver("a", ONE, None, ARCS), 0.1, peers={"c d": "tls/localhost:1"},
    guests={"s": "sensor", "m": "monitor", "boss": "supervisor", "l": "listener"},
)  # fmt: skip
OWN = ("trigpoint/net/node/a/**",)
ALL = ("trigpoint/net/**",)


def test_a_node_says_its_own_and_hears_its_neighbours() -> None:
    others = node_rules(SETTINGS).others
    assert others["b"] == Access(says=("trigpoint/net/node/b/**",), hears=OWN)
    assert others["c%20d"] == Access(says=("trigpoint/net/node/c%20d/**",), hears=OWN)
    assert others["s"] == Access(says=("trigpoint/net/reading/4", "trigpoint/net/reading/7"))
    assert others["m"] == Access(hears=OWN, asks=ALL)
    assert others["boss"] == Access(says=("trigpoint/net/node/a/control",), hears=OWN, asks=ALL)
    assert others["l"] == Access(hears=OWN)
    assert set(others) == {"b", "c%20d", "s", "m", "boss", "l"}


def test_guests_that_cannot_be_are_refused() -> None:
    with pytest.raises(ArgumentError, match="a guest's role must be sensor"):
        node_rules(replace(SETTINGS, guests={"x": "king"}))
    for taken in ("a", "b"):
        with pytest.raises(ArgumentError, match="has the name of a node it hears"):
            node_rules(replace(SETTINGS, guests={taken: "monitor"}))


def test_guests_take_from_each_node_its_own_keys_only() -> None:
    others = guest_rules("net", "supervisor", {"a": "node", "plant": "sensor", "m": "monitor"}).others
    assert others["a"] == Access(says=OWN, hears=("trigpoint/net/node/a/control",), asked=ALL)
    assert others["plant"] == Access(says=("trigpoint/net/reading/*", "trigpoint/net/truth/*"), asked=ALL)
    assert others["m"] == Access()
    plant = guest_rules("net", "sensor", {"a": "node", "m": "monitor"}).others
    assert plant["a"] == Access(hears=("trigpoint/net/reading/*",))
    assert plant["m"] == Access(hears=("trigpoint/net/reading/*", "trigpoint/net/truth/*"), asks=ALL)
    assert guest_rules("net", "listener", {"a": "node"}).others["a"] == Access(says=OWN)


@pytest.mark.parametrize(("role", "others"), [("king", {}), ("monitor", {"a": "king"})])
def test_guests_of_unknown_roles_are_refused(role, others) -> None:
    with pytest.raises(ArgumentError, match="got 'king'"):
        guest_rules("net", role, others)


def test_the_rules_deny_what_they_do_not_list() -> None:
    document = AccessRules(
        {"b": Access(says=("x",), hears=("y",), asks=("z",), asked=("w",)), "c": Access()}
    ).to_zenoh()
    assert (document["enabled"], document["default_permission"]) == (True, "deny")
    assert document["subjects"] == [{"id": "b", "cert_common_names": ["b"]}]
    flows = {(rule["flows"][0], word): rule["key_exprs"] for rule in document["rules"] for word in rule["messages"]}
    assert flows["ingress", "put"] == ["x"]
    assert flows["egress", "put"] == ["y"]
    assert flows["ingress", "declare_subscriber"] == ["y", "z"]
    assert flows["egress", "declare_subscriber"] == ["x", "w"]
    assert {rule["permission"] for rule in document["rules"]} == {"allow"}
    assert document["policies"] == [{"rules": [rule["id"] for rule in document["rules"]], "subjects": ["b"]}]


def test_every_role_is_one_that_a_node_accepts() -> None:
    for role in ROLES:
        assert "guest" in node_rules(replace(SETTINGS, guests={"guest": role})).others
