"""One node as a process: ``python -m trigpoint.runtime NODE.json [START]``, frames on standard input and output."""

from __future__ import annotations

import sys
from pathlib import Path

from trigpoint.errors import TrigpointError
from trigpoint.runtime.codec import Kind, read_frame, write_frame
from trigpoint.runtime.node import NodeProgram, read_node_file, start_value


def main(arguments: list[str]) -> int:
    """Announce the first estimate, then answer frames until the stream ends or says stop."""
    if len(arguments) not in (1, 2):
        print("usage: python -m trigpoint.runtime NODE.json [START]", file=sys.stderr)
        return 2
    try:
        program = NodeProgram(read_node_file(Path(arguments[0])), start_value(arguments[1] if arguments[1:] else None))
        source, sink = sys.stdin.buffer, sys.stdout.buffer
        write_frame(sink, program.greeting())
        sink.flush()
        while (frame := read_frame(source)) is not None and frame.kind is not Kind.STOP:
            for answer in program.receive(frame):
                write_frame(sink, answer)
                sink.flush()
    except BrokenPipeError:  # whoever started this node has left
        sys.stdout = None  # nothing is left to flush to
        return 0
    except TrigpointError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
