"""Where a frame is published: keys of text, one folder a network, names written so that any text fits.

==============================================  ==========================================================
key                                             who publishes what
==============================================  ==========================================================
``trigpoint/NET/node/NAME/estimate``            a node its estimate, to its neighbours
``trigpoint/NET/node/NAME/status``              a node its status
``trigpoint/NET/node/NAME/hello``               a node that it starts, and (``bye``) that it stops
``trigpoint/NET/node/NAME/ping/OTHER``          a node asks (and answers) another for the time
``trigpoint/NET/node/NAME/control``             the supervisor an order to a node
``trigpoint/NET/reading/LABEL``                 a sensor the reading of one arc
``trigpoint/NET/truth/NAME``                    a simulated plant the true state of a node, for the monitor only
==============================================  ==========================================================
"""

from __future__ import annotations

from urllib.parse import quote, unquote

ROOT = "trigpoint"


def written(name: str) -> str:
    """``name`` as one part of a key: letters, digits and ``-_.~`` stay, everything else becomes ``%XX``."""
    return quote(name, safe="-_.~")


def name_of(part: str) -> str:
    """The name that ``written`` made this part of a key from."""
    return unquote(part)


def node_key(network: str, name: str, channel: str) -> str:
    """Key of what the node ``name`` publishes on ``channel`` (estimate, status, hello, control)."""
    return f"{ROOT}/{written(network)}/node/{written(name)}/{channel}"


def ping_key(network: str, name: str, other: str) -> str:
    """Key of what the node ``name`` asks or answers the node ``other``."""
    return f"{node_key(network, name, 'ping')}/{written(other)}"


def reading_key(network: str, label: int) -> str:
    """Key of the readings of the arc ``label``."""
    return f"{ROOT}/{written(network)}/reading/{label}"


def truth_key(network: str, name: str) -> str:
    """Key of the true state of the node ``name``."""
    return f"{ROOT}/{written(network)}/truth/{written(name)}"


def everything(network: str) -> str:
    """Pattern of all keys of a network."""
    return f"{ROOT}/{written(network)}/**"
