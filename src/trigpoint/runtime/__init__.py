"""Nodes as real processes: a frame codec, the node's program without input or output, processes on pipes.

Loads NumPy and the standard library only. The step that a process runs is ``LocalObserver.step``, the one that was
simulated.
"""

from trigpoint.runtime.codec import Frame, Kind, decode_frame, encode_frame
from trigpoint.runtime.node import NodeProgram, read_node_file, write_node_file
from trigpoint.runtime.processes import run_processes

__all__ = [
    "Frame",
    "Kind",
    "NodeProgram",
    "decode_frame",
    "encode_frame",
    "read_node_file",
    "run_processes",
    "write_node_file",
]
