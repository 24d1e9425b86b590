"""How fast this machine is, and whether it had time for us: what tests of live processes and of effort go by."""

from __future__ import annotations

import atexit
import os
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

PATIENCE = 60.0
"""Seconds after which a test gives up; no test claims that anything takes less."""

OTHERS, LATE = 0.1, 0.01
"""Share of all cores that others took, and of wakes that came too late, from which on a machine was busy."""

WITNESS = """
import sys, threading, time
ended, wakes, late = threading.Event(), 0, 0
threading.Thread(target=lambda: (sys.stdin.readline(), ended.set()), daemon=True).start()
due = time.monotonic()
while not ended.is_set():
    due += 0.01
    time.sleep(max(0.0, due - time.monotonic()))
    over = time.monotonic() - due
    wakes += 1
    late += over > 0.01
    due += 0.01 * int(over / 0.01)
print(wakes, late, flush=True)
"""


def until(done: Callable[[], object], act: Callable[[], object] = lambda: None, within: float = PATIENCE) -> bool:
    """Act and look again and again until ``done``; whether it came true before we gave up."""
    end = time.monotonic() + within
    while not done():
        if time.monotonic() > end:
            return False
        act()
        time.sleep(0.005)
    return True


# -- ports -------------------------------------------------------------------------------------------------------------
_claims: list[socket.socket] = []
atexit.register(lambda: [claim.close() for claim in _claims])


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    """A port for this test process alone.

    It is none of those that the system gives to whoever connects or asks for any port, and claimed, for as long as
    this process lives, from other processes that run tests.
    """
    first_given = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text(encoding="ascii").split()[0])
    for port in range(first_given - 1, 1024, -1):
        claim, probe = socket.socket(socket.AF_UNIX), socket.socket(socket.AF_INET, kind)
        try:
            claim.bind(f"\0trigpoint-tests-{port}")
            _claims.append(claim)
            probe.bind(("127.0.0.1", port))
        except OSError:  # somebody else's
            claim.close()
        else:
            return port
        finally:
            probe.close()
    raise AssertionError(f"no port below {first_given} is free")


def listening() -> set[tuple[str, int]]:
    """Addresses, in the hexadecimal digits of the system, and ports at which this process waits for connections."""
    inodes = set()
    for name in os.listdir("/proc/self/fd"):
        with suppress(FileNotFoundError):  # closed meanwhile
            inodes.add(os.readlink(f"/proc/self/fd/{name}"))
    lines = [Path(f"/proc/net/{table}").read_text(encoding="ascii").splitlines()[1:] for table in ("tcp", "tcp6")]
    rows = [line.split() for table in lines for line in table]
    places = [row[1].split(":") for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in inodes]  # 0A: listens
    return {(host, int(port, 16)) for host, port in places}


# -- effort ------------------------------------------------------------------------------------------------------------
@dataclass
class Effort:
    """Processor time of a block, in units of a fixed piece of work on the same machine at the same time."""

    units: float = float("nan")


def unit() -> float:
    """Processor seconds that a fixed piece of work takes now, part of it in Python and part in NumPy: some 10 ms."""
    begun = time.process_time()
    found: dict[int, int] = {}
    for k in range(60_000):
        found[k % 997] = found.get(k % 997, 0) + k
    np.sort(np.random.default_rng(0).normal(size=60_000))
    return time.process_time() - begun


@contextmanager
def effort() -> Iterator[Effort]:
    """Measure what the block takes, whatever the machine is and whoever else uses it."""
    found, before, begun = Effort(), unit(), time.process_time()
    yield found
    spent = time.process_time() - begun
    found.units = spent / max(before, unit())


# -- who else is there -------------------------------------------------------------------------------------------------
def _taken() -> float:
    """Processor seconds that this machine has spent on anybody, waited for its disk, or was kept from by its host."""
    times = psutil.cpu_times()
    return sum(times) - times.idle - getattr(times, "guest", 0.0) - getattr(times, "guest_nice", 0.0)


def _ours() -> float:
    """Processor seconds of this process, and of those of its children that have ended."""
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(used.ru_utime + used.ru_stime for used in map(resource.getrusage, who))


class Witness:
    """Sees whether the machine is busy with others: by the system's accounts, and by a process that only wakes up.

    All children of the block must have ended in it, else theirs counts as the work of others.
    """

    def __enter__(self) -> Witness:
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-c", WITNESS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._begun, self._taken, self._own = time.monotonic(), _taken(), _ours()
        return self

    def __exit__(self, *_: object) -> None:
        told, _ = self._process.communicate("\n", timeout=PATIENCE)
        wakes, late = map(int, told.split())
        others = _taken() - self._taken - (_ours() - self._own)
        self.others = others / (time.monotonic() - self._begun) / (os.cpu_count() or 1)
        self.late = late / max(wakes, 1)

    @property
    def busy(self) -> bool:
        """Whether somebody else took processor time that a run of ours may have lacked."""
        return self.others > OTHERS or self.late > LATE

    def __str__(self) -> str:
        return f"others took {100 * self.others:.0f} % of all cores, {100 * self.late:.1f} % of wakes came late"


def settle(patience: float = PATIENCE) -> None:
    """Wait for a second in which the machine is not busy, as long as there is hope."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        with Witness() as witness:
            time.sleep(1.0)
        if not witness.busy:
            return


def with_time(run: Callable[[int], None], most: int = 5) -> None:
    """``run`` (given the number of the attempt) must hold on a machine that has time for it.

    An attempt that fails counts, unless others kept the machine busy meanwhile: then the run is repeated, ``most``
    times in all; the last one counts whatever the machine does.
    """
    for attempt in range(most):
        with Witness() as witness:
            failed = _failure(run, attempt)
        if failed is None:
            return
        print(f"attempt {attempt + 1}: {witness}: {failed}")
        if not witness.busy or attempt + 1 == most:
            raise failed
        settle()


def _failure(run: Callable[[int], None], attempt: int) -> AssertionError | None:
    try:
        run(attempt)
    except AssertionError as error:
        return error
    return None
