"""Live nodes: a frame codec, the node's protocol without input or output, transports, processes, logs.

Loads NumPy and the standard library only; transport, log and certificates are loaded where they are used. The step that
a process runs is ``LocalObserver.step``, the one that was simulated.
"""

from trigpoint.runtime.access import ROLES, Access, AccessRules, guest_rules, node_rules
from trigpoint.runtime.codec import FACTS, Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.endpoints import ADDRESS_KINDS, Address, is_local, parse_address, require_safe
from trigpoint.runtime.keys import GUESTS, find_identity, make_keys
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings, write_settings
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable, Sink, Transport
from trigpoint.runtime.zenoh_link import ZenohTransport, open_transport

__all__ = [
    "ADDRESS_KINDS",
    "FACTS",
    "GUESTS",
    "ROLES",
    "Access",
    "AccessRules",
    "Address",
    "BestEffort",
    "Delivery",
    "Frame",
    "Identity",
    "Kind",
    "NodeSettings",
    "Reliable",
    "Sink",
    "Transport",
    "ZenohTransport",
    "decode_frame",
    "encode_frame",
    "find_identity",
    "guest_rules",
    "is_local",
    "make_keys",
    "node_rules",
    "open_transport",
    "parse_address",
    "read_settings",
    "require_safe",
    "write_settings",
]
