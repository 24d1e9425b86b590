"""Who may say and hear what: the rules that a node's links obey, by the name in the other end's certificate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from trigpoint.errors import ArgumentError
from trigpoint.runtime.routes import neighbours
from trigpoint.runtime.settings import NodeSettings
from trigpoint.runtime.topics import ROOT, everything, node_key, reading_key, written

ROLES: dict[str, str] = {
    "sensor": "publishes readings (a simulated plant also the truth)",
    "monitor": "hears everything and says nothing",
    "supervisor": "gives orders and hears everything",
    "listener": "hears the node as a neighbour does, and says nothing to it",
}
"""What a guest of a network may do. A node's settings name its guests."""


@dataclass(frozen=True)
class Access:
    """What one other may do on a link with us; patterns of keys.

    Attributes:
        says: what it may publish to us.
        hears: what we may publish to it, and it may subscribe to.
        asks: wider patterns that it may subscribe to; still only ``hears`` is sent.
        asked: wider patterns that we may subscribe to; still only ``says`` is taken.
    """

    says: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    asked: tuple[str, ...] = ()


@dataclass(frozen=True)
class AccessRules:
    """What is allowed on a session's links; everything else is refused, in both directions.

    Attributes:
        others: by the ``written`` name in the other's certificate, what it may do.
    """

    others: Mapping[str, Access] = field(default_factory=dict)

    def to_zenoh(self) -> dict[str, Any]:
        """The rules in the words of Zenoh's access control."""
        rules, subjects, policies = [], [], []
        for name, access in self.others.items():
            given = [rule for rule in _rules(name, access) if rule["key_exprs"]]
            if given:
                rules += given
                subjects.append({"id": name, "cert_common_names": [name]})
                policies.append({"rules": [rule["id"] for rule in given], "subjects": [name]})
        return {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": subjects,
            "policies": policies,
        }


def _rules(name: str, access: Access) -> list[dict[str, Any]]:
    """What the other says comes in and our wish for it goes out; what it hears goes out and its wish comes in."""
    wishes = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    words = ["put", "liveliness_token"]
    return [
        {"id": f"{name} {what}", "permission": "allow", "messages": said, "flows": [flow], "key_exprs": list(keys)}
        for what, said, flow, keys in (
            ("says", words, "ingress", access.says),
            ("is asked", wishes, "egress", (*access.says, *access.asked)),
            ("hears", words, "egress", access.hears),
            ("asks", wishes, "ingress", (*access.hears, *access.asks)),
        )
    ]


def node_rules(settings: NodeSettings) -> AccessRules:
    """The rules of the node of ``settings``: own keys go out, neighbours' keys come in, guests do what their role says.

    Raises:
        ArgumentError: a guest's role is unknown, or a guest has a neighbour's name.
    """
    network, name = settings.network, settings.name
    own = (node_key(network, name, "**"),)
    others = {
        written(other): Access(says=(node_key(network, other, "**"),), hears=own)
        for other in neighbours(settings)
        if other not in settings.guests and other != name
    }
    for guest, role in settings.guests.items():
        if guest in settings.program.hears or guest == name:
            raise ArgumentError(f"node {name!r}: the guest {guest!r} has the name of a node it hears; rename the guest")
        others[written(guest)] = _of_guest(settings, role)
    return AccessRules(others)


def _of_guest(settings: NodeSettings, role: str) -> Access:
    network, name = settings.network, settings.name
    own, order = (node_key(network, name, "**"),), node_key(network, name, "control")
    if role == "sensor":
        return Access(says=tuple(reading_key(network, label) for label in settings.program.reads))
    if role == "monitor":
        return Access(hears=own, asks=(everything(network),))
    if role == "supervisor":
        return Access(says=(order,), hears=own, asks=(everything(network),))
    if role == "listener":
        return Access(hears=own)
    raise ArgumentError(f"node {name!r}: a guest's role must be {', '.join(ROLES)}; got {role!r}")


def guest_rules(network: str, role: str, others: Mapping[str, str]) -> AccessRules:
    """The rules of a guest's own links.

    Args:
        network: name of the network.
        role: what the guest is, one of ``ROLES``.
        others: names of those it links with, and the role of each; ``node`` for nodes.

    Raises:
        ArgumentError: a role is unknown.
    """
    if role not in ROLES:
        raise ArgumentError(f"a guest's role must be {', '.join(ROLES)}; got {role!r}")
    readings, truth = f"{ROOT}/{written(network)}/reading/*", f"{ROOT}/{written(network)}/truth/*"
    watching = (everything(network),)
    rules = {}
    for other, its in others.items():
        own = node_key(network, other, "**")
        if its == "node" and role == "sensor":
            access = Access(hears=(readings,))
        elif its == "node":
            orders = (node_key(network, other, "control"),) if role == "supervisor" else ()
            access = Access(says=(own,), hears=orders, asked=() if role == "listener" else watching)
        elif its in ("monitor", "supervisor") and role == "sensor":
            access = Access(hears=(readings, truth), asks=watching)
        elif its == "sensor" and role in ("monitor", "supervisor"):
            access = Access(says=(readings, truth), asked=watching)
        elif its in ROLES:
            access = Access()
        else:
            raise ArgumentError(f"the role of {other!r} must be node, {', '.join(ROLES)}; got {its!r}")
        rules[written(other)] = access
    return AccessRules(rules)
