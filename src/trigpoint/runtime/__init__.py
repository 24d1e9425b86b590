"""Live nodes: a frame codec, the node's protocol without input or output, transports, processes, logs.

Loads NumPy and the standard library only; transport, log and certificates are loaded where they are used. The step that
a process runs is ``LocalObserver.step``, the one that was simulated.
"""

from trigpoint.runtime.codec import FACTS, Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.log import LogWriter
from trigpoint.runtime.log_read import Event, Log, Series, read_log
from trigpoint.runtime.log_run import read_run, restarts, run_of
from trigpoint.runtime.settings import Identity, NodeSettings, read_settings, write_settings
from trigpoint.runtime.transport import BestEffort, Delivery, Reliable, Sink, Transport

__all__ = [
    "FACTS",
    "BestEffort",
    "Delivery",
    "Event",
    "Frame",
    "Identity",
    "Kind",
    "Log",
    "LogWriter",
    "NodeSettings",
    "Reliable",
    "Series",
    "Sink",
    "Transport",
    "decode_frame",
    "encode_frame",
    "read_log",
    "read_run",
    "read_settings",
    "restarts",
    "run_of",
    "write_settings",
]
