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
from trigpoint.runtime.keys import GUESTS, find_identity, make_keys
from trigpoint.runtime.knowledge import Knowledge
from trigpoint.runtime.links import TABLE, Event, State
from trigpoint.runtime.log import LogWriter
from trigpoint.runtime.log_read import Log, LogEvent, Series, read_log
from trigpoint.runtime.log_run import read_run, restarts, run_of
from trigpoint.runtime.machine import GO, PAUSE, NodeMachine, Outgoing
from trigpoint.runtime.memory import MemoryNetwork
from trigpoint.runtime.monitor import Controls, Monitor, Snapshot
from trigpoint.runtime.newcomer import Newcomer, join, leave
from trigpoint.runtime.plan import TRANSPORTS, LivePlan, free_addresses, linked
from trigpoint.runtime.plant import PlantSettings, SimulatedPlant
from trigpoint.runtime.replay import read_readings
from trigpoint.runtime.sensors import Pace, Reading, ReadingPublisher, publish_measured, replay_readings
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings, write_settings
from trigpoint.runtime.status import LINK_FIELDS, STATUS_FIELDS, LinkStatus, NodeStatus, node_status
from trigpoint.runtime.supervisor import Supervisor, Usage
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable, Sink, Transport
from trigpoint.runtime.truth import Instrument, LinearPlant, Part, Plant
from trigpoint.runtime.virtual import SENSOR, Down, Mute, Trouble, run_virtual
from trigpoint.runtime.zenoh_link import ZenohTransport, open_transport

__all__ = [
    "ADDRESS_KINDS",
    "FACTS",
    "GO",
    "GUESTS",
    "LINK_FIELDS",
    "PAUSE",
    "REASONS",
    "ROLES",
    "SENSOR",
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
    "Down",
    "Event",
    "Frame",
    "Host",
    "Identity",
    "Instrument",
    "Kind",
    "Knowledge",
    "LinearPlant",
    "LinkStatus",
    "LivePlan",
    "Log",
    "LogEvent",
    "LogWriter",
    "Member",
    "MemoryNetwork",
    "Monitor",
    "Mute",
    "Newcomer",
    "NodeMachine",
    "NodeSettings",
    "NodeStatus",
    "Outgoing",
    "Pace",
    "Part",
    "Plant",
    "PlantSettings",
    "Reading",
    "ReadingPublisher",
    "Reliable",
    "Series",
    "SimulatedPlant",
    "Sink",
    "Snapshot",
    "State",
    "Supervisor",
    "SystemClock",
    "Transport",
    "Trouble",
    "Usage",
    "ZenohTransport",
    "decode_frame",
    "encode_frame",
    "find_identity",
    "free_addresses",
    "guest_rules",
    "is_local",
    "join",
    "leave",
    "linked",
    "make_keys",
    "node_rules",
    "node_status",
    "open_transport",
    "parse_address",
    "publish_measured",
    "read_log",
    "read_readings",
    "read_run",
    "read_settings",
    "replay_readings",
    "require_safe",
    "restarts",
    "run_of",
    "run_virtual",
    "write_settings",
]
