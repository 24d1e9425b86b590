"""The log of a live run: 200 nodes at 10 Hz for 60 s, with their truth and one reading each; 360 000 messages."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from trigpoint.runtime import Frame, Kind, LogWriter, read_log, read_run

NODES, ROUNDS, PERIOD = 200, 600, 0.1


def write(path: Path) -> None:
    rng, start = np.random.default_rng(0), 1.7e9
    names = [f"n{k}" for k in range(NODES)]
    with LogWriter(path, network="bench", names=names, attributes={}) as log:
        for k in range(ROUNDS):
            now = start + PERIOD * k
            for label, (name, x) in enumerate(zip(names, rng.normal(size=(NODES, 3)), strict=True)):
                log.write(Frame(Kind.ESTIMATE, name, 1, k, now, (2.0, now, 0.0, 0.1), x[:2]), now)
                log.write(Frame(Kind.TRUTH, name, 1, k, now, (), x[1:]), now)
                log.write(Frame(Kind.READING, "plant", 1, k, now, (float(label),), x[:1]), now)


def peak(path: Path) -> float:
    """MiB that reading the log adds to a fresh process."""
    code = (
        "import sys; from pathlib import Path; from trigpoint.runtime import read_log; import mcap.records, zstandard;"
        "peak = lambda: int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0]);"
        "before = peak(); read_log(sys.argv[1]); print((peak() - before) / 1024)"
    )
    return float(subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, check=True).stdout)


def main() -> None:
    count = 3 * NODES * ROUNDS
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        marks = [time.process_time()]
        for act in (write, read_log, read_run):
            act(path)
            marks.append(time.process_time())
        size = path.stat().st_size
        written, read, run = np.diff(marks)
        print(f"{count} messages, {size / 1e6:.1f} MB, {size / count:.0f} bytes a message")
        print(f"written: {count / written:.0f} messages/s ({1e6 * written / count:.1f} us each, frames made)")
        print(f"read: {count / read:.0f} messages/s ({read:.1f} s); as a run: {run:.1f} s; {peak(path):.0f} MiB")


if __name__ == "__main__":
    main()
