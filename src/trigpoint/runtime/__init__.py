"""Live nodes: a frame codec, the node's protocol without input or output, transports, processes, logs.

Loads NumPy and the standard library only; transport, log and certificates are loaded where they are used. The step that
a process runs is ``LocalObserver.step``, the one that was simulated.
"""

from trigpoint.runtime.codec import FACTS, Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.gate import REASONS, Counters
from trigpoint.runtime.knowledge import Knowledge
from trigpoint.runtime.links import TABLE, Event, State
from trigpoint.runtime.machine import GO, PAUSE, NodeMachine, Outgoing
from trigpoint.runtime.memory import MemoryNetwork
from trigpoint.runtime.plants import LinearPlant, Plant
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings, write_settings
from trigpoint.runtime.status import LINK_FIELDS, STATUS_FIELDS, LinkStatus, NodeStatus, node_status
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable, Sink, Transport
from trigpoint.runtime.virtual import SENSOR, Down, Mute, Trouble, run_virtual

__all__ = [
    "FACTS",
    "GO",
    "LINK_FIELDS",
    "PAUSE",
    "REASONS",
    "SENSOR",
    "STATUS_FIELDS",
    "TABLE",
    "BestEffort",
    "Counters",
    "Delivery",
    "Down",
    "Event",
    "Frame",
    "Identity",
    "Kind",
    "Knowledge",
    "LinearPlant",
    "LinkStatus",
    "MemoryNetwork",
    "Mute",
    "NodeMachine",
    "NodeSettings",
    "NodeStatus",
    "Outgoing",
    "Plant",
    "Reliable",
    "Sink",
    "State",
    "Transport",
    "Trouble",
    "decode_frame",
    "encode_frame",
    "node_status",
    "read_settings",
    "run_virtual",
    "write_settings",
]
