"""Live nodes: a frame codec, the node's protocol without input or output, transports, processes, logs.

Loads NumPy and the standard library only; transport, log and certificates are loaded where they are used. The step that
a process runs is ``LocalObserver.step``, the one that was simulated.
"""

from trigpoint.runtime.access import ROLES, Access, AccessRules, guest_rules, node_rules
from trigpoint.runtime.clock import Clock, SystemClock
from trigpoint.runtime.codec import FACTS, Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.endpoints import ADDRESS_KINDS, Address, is_local, parse_address, require_safe
from trigpoint.runtime.gate import REASONS, Counters
from trigpoint.runtime.host import Host, Member
from trigpoint.runtime.knowledge import Knowledge
from trigpoint.runtime.links import TABLE, State
from trigpoint.runtime.links import Event as LinkEvent
from trigpoint.runtime.log import LogWriter
from trigpoint.runtime.log_read import Event, Log, Series, read_log
from trigpoint.runtime.log_run import read_run, restarts, run_of
from trigpoint.runtime.machine import GO, PAUSE, NodeMachine, Outgoing
from trigpoint.runtime.monitor import Controls, Monitor, Snapshot
from trigpoint.runtime.plan import TRANSPORTS, LivePlan
from trigpoint.runtime.plant import Instrument, Part, Plant, PlantSettings
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings, write_settings
from trigpoint.runtime.status import LINK_FIELDS, STATUS_FIELDS, LinkStatus, NodeStatus, node_status
from trigpoint.runtime.supervisor import Supervisor, Usage
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable, Sink, Transport
from trigpoint.runtime.zenoh_link import ZenohTransport, open_transport

__all__ = [
    "ADDRESS_KINDS",
    "FACTS",
    "GO",
    "LINK_FIELDS",
    "PAUSE",
    "REASONS",
    "ROLES",
    "STATUS_FIELDS",
    "TABLE",
    "TRANSPORTS",
    "Access",
    "AccessRules",
    "Address",
    "BestEffort",
    "Clock",
    "Controls",
    "Counters",
    "Delivery",
    "Event",
    "Frame",
    "Host",
    "Identity",
    "Instrument",
    "Kind",
    "Knowledge",
    "LinkEvent",
    "LinkStatus",
    "LivePlan",
    "Log",
    "LogWriter",
    "Member",
    "Monitor",
    "NodeMachine",
    "NodeSettings",
    "NodeStatus",
    "Outgoing",
    "Part",
    "Plant",
    "PlantSettings",
    "Reliable",
    "Series",
    "Sink",
    "Snapshot",
    "State",
    "Supervisor",
    "SystemClock",
    "Transport",
    "Usage",
    "ZenohTransport",
    "decode_frame",
    "encode_frame",
    "guest_rules",
    "is_local",
    "node_rules",
    "node_status",
    "open_transport",
    "parse_address",
    "read_log",
    "read_run",
    "read_settings",
    "require_safe",
    "restarts",
    "run_of",
    "write_settings",
]
