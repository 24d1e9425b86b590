"""Links over Zenoh on this machine: seconds to open, to link and to notice a kill; round trips; frames a second
(published; datagrams may drop some of such a rush).

The other end is a process of its own that echoes. Frames of 150 bytes, both ends in Python.
Run: python benchmarks/links.py [kind ...]
"""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from trigpoint.runtime import ADDRESS_KINDS, ZenohTransport, make_keys

OTHER = """
import sys
from trigpoint.runtime import ZenohTransport, find_identity
from pathlib import Path
address, keys = sys.argv[1:]
end = ZenohTransport(address, [], identity=find_identity(Path(keys), "b") if keys else None)
end.announce("alive")
end.subscribe("ask", lambda key, data: end.publish("answer", data))
end.subscribe("rush", lambda key, data: data[:1] == b"!" and end.publish("last", data))
print("ready", flush=True)
sys.stdin.read()
"""
TRIPS, RUSH, FRAME = 2000, 20_000, bytes(150)


def waited(done):
    start = time.perf_counter()
    while not done():
        time.sleep(0.0002)
    return time.perf_counter() - start


def measure(kind, address, keys, identity):
    command = [sys.executable, "-c", OTHER, address, keys if identity else ""]
    other = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    other.stdout.readline()
    start = time.perf_counter()
    end = ZenohTransport("", [address], identity=identity)
    opened = time.perf_counter() - start
    seen, answer, last = [], threading.Event(), threading.Event()
    end.watch("alive", lambda _, here: seen.append(here))
    end.subscribe("answer", lambda *_: answer.set())
    end.subscribe("last", lambda *_: last.set())
    linked = opened + waited(lambda: seen)
    while not answer.wait(0.01):
        end.publish("ask", FRAME)
    trips = []
    for _ in range(TRIPS):
        answer.clear()
        start = time.perf_counter()
        end.publish("ask", FRAME)
        if answer.wait(1.0):
            trips.append(time.perf_counter() - start)
        time.sleep(0.0002)
    start = time.perf_counter()
    for _ in range(RUSH):
        end.publish("rush", FRAME)
    while not last.wait(0.005):
        end.publish("rush", b"!")
    rush = RUSH / (time.perf_counter() - start)
    os.kill(other.pid, signal.SIGKILL)
    killed = waited(lambda: len(seen) > 1)
    other.communicate()
    end.close()
    trips.sort()
    p50, p95 = (1e6 * trips[len(trips) * part // 100] for part in (50, 95))
    print(
        f"{kind:16s} {1e3 * opened:9.1f} {1e3 * linked:9.1f} {p50:9.0f} {p95:9.0f} {rush:12.0f} {1e3 * killed:9.1f}",
        flush=True,
    )


def main(kinds):
    print("kind               open ms   link ms   trip us    p95 us     frames/s   kill ms")
    with tempfile.TemporaryDirectory() as folder:
        identities = make_keys(Path(folder) / "keys", ["a", "b"])
        for number, kind in enumerate(kinds):
            place = f"{folder}/s" if kind == "unixsock-stream" else f"127.0.0.1:{17440 + number}"
            secured = kind in ("tls", "quic")
            measure(kind, f"{kind}/{place}", f"{folder}/keys", identities["a"] if secured else None)


if __name__ == "__main__":
    main(sys.argv[1:] or list(ADDRESS_KINDS))
