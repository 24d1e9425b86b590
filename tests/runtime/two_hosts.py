"""Two hosts made of network namespaces and a cable: loss, partition, and processes that talk over it."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from trigpoint.runtime import Identity

ADDRESSES = ("10.201.77.1", "10.201.77.2")
LOSS_RULE = """
table inet trouble {{
  chain input {{
    type filter hook input priority 0
    numgen random mod 100 < {} drop
  }}
}}
"""

TALKER = """
import json, sys, threading, time
from trigpoint.runtime import Identity, ZenohTransport

listen, connect, identity = json.loads(sys.argv[1])
transport = ZenohTransport(listen, connect, identity=Identity(**identity) if identity else None)
lock, got, presence = threading.Lock(), [], []
transport.announce("alive/listener" if listen else "alive/connector")
transport.watch("alive/*", lambda key, here: presence.append(here))

def echo(key, data):
    transport.publish("echo", data)

def take(key, data):
    with lock:
        got.append((int.from_bytes(data[:4], "little"), time.monotonic()))

transport.subscribe("ask", echo)
transport.subscribe("echo", take)

def ask(count, interval, patience):
    sent = {}
    with lock:
        got.clear()
    for number in range(count):
        sent[number] = time.monotonic()
        transport.publish("ask", number.to_bytes(4, "little") * 40)
        time.sleep(interval)
    end = time.monotonic() + patience
    while len(got) < count and time.monotonic() < end:
        time.sleep(0.01)
    with lock:
        trips = sorted(at - sent[number] for number, at in got)
        order = [number for number, _ in got]
    p95 = trips[len(trips) * 95 // 100] if trips else None
    return {"sent": count, "order": order, "p95": p95, "presence": list(presence)}

for line in sys.stdin:
    word, *given = json.loads(line)
    if word == "ask":
        answer = ask(*given)
    elif word == "linked":
        answer = transport.linked
    else:
        answer = list(presence)
    print(json.dumps(answer), flush=True)
transport.close()
"""


def run(*command: str, text: str | None = None) -> None:
    """A system command; its error output is the exception's text."""
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"{' '.join(command)}: {done.stderr.strip()}")


@dataclass(frozen=True)
class Host:
    """One namespace, its end of the cable and its address."""

    space: str
    device: str
    address: str

    def within(self, *command: str, text: str | None = None) -> None:
        run("ip", "netns", "exec", self.space, *command, text=text)

    def cable(self, state: str) -> None:
        """``up`` or ``down``."""
        self.within("ip", "link", "set", self.device, state)

    def lose(self, percent: int) -> str:
        """Drop so many of the packets that arrive; how it was done: ``nft``, ``tbf`` or ``nothing``."""
        with contextlib.suppress(OSError):
            self.within("nft", "-f", "-", text=LOSS_RULE.format(percent))
            return "nft"
        with contextlib.suppress(OSError):
            limits = ("rate", "100kbit", "burst", "1600", "limit", "3000")
            self.within("tc", "qdisc", "add", "dev", self.device, "root", "tbf", *limits)
            return "tbf"
        return "nothing"


def _remove(space: str) -> None:
    with contextlib.suppress(OSError):
        run("ip", "netns", "del", space)


@contextlib.contextmanager
def hosts() -> Iterator[tuple[Host, Host] | str]:
    """Two hosts, or the reason why this machine does not allow them."""
    with contextlib.ExitStack() as stack:
        ends = [Host(f"tp{os.getpid()}{side}", f"tp{os.getpid()}{side}", ADDRESSES[k]) for k, side in enumerate("ab")]
        try:
            if shutil.which("ip") is None:
                raise OSError("there is no program ip (iproute2)")
            for end in ends:
                run("ip", "netns", "add", end.space)
                stack.callback(_remove, end.space)
            run("ip", "link", "add", ends[0].device, "netns", ends[0].space, "type", "veth",
                "peer", "name", ends[1].device, "netns", ends[1].space)  # fmt: skip
            for end in ends:
                end.within("ip", "addr", "add", f"{end.address}/24", "dev", end.device)
                end.within("ip", "link", "set", "lo", "up")
                end.cable("up")
        except OSError as error:
            reason = str(error)
        else:
            reason = ""
        yield reason or (ends[0], ends[1])


class Talker:
    """A process on a host that asks, echoes, and says who is linked."""

    def __init__(self, host: Host, listen: str, connect: list[str], identity: Identity | None) -> None:
        given = json.dumps([listen, connect, None if identity is None else vars(identity)])
        command = ["ip", "netns", "exec", host.space, sys.executable, "-c", TALKER, given]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __call__(self, *words: object) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(words) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        try:
            self._process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
            raise
