"""``Supervisor``: starts the processes of a run, starts them again when they die, and ends them in order."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.runtime.clock import SystemClock, new_epoch, setting_of
from trigpoint.runtime.codec import Frame, Kind, encode_frame
from trigpoint.runtime.plan import LivePlan
from trigpoint.runtime.topics import node_key
from trigpoint.runtime.transport import Transport

FIRST_WAIT, LONGEST_WAIT, HEALTHY = 0.5, 10.0, 60.0
"""Seconds before the first restart, at most, and after which a process counts as healthy again."""

_PATIENCE = 5.0
GO, PAUSE = 0.0, 1.0


def backoff(failures: int) -> float:
    """Seconds to wait before the restart after this many ``failures`` in a row: 0.5, 1, 2, ... at most 10."""
    return min(LONGEST_WAIT, FIRST_WAIT * 2.0 ** min(failures - 1, 30))


@dataclass
class _Child:
    """One process and what became of it."""

    label: str
    arguments: list[str]
    process: subprocess.Popen[bytes] | None = None
    started: float = 0.0
    due: float | None = 0.0
    failures: int = 0
    restarts: int = 0
    exit_code: int | None = None
    spent: float = 0.0
    cpu: float = 0.0
    memory: float = 0.0
    watched: Any = None
    codes: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Usage:
    """What one process used.

    Attributes:
        label: name of the node, of the first of several, or of the plant.
        cpu: processor seconds so far, earlier lives included.
        memory: resident bytes at the last look.
        restarts: how often it was started again.
        running: whether it runs now.
    """

    label: str
    cpu: float
    memory: float
    restarts: int
    running: bool


class Supervisor:
    """Starts, watches and ends the processes of a plan. Satisfies ``Controls``.

    Every process holds the reading end of a pipe from here as its standard input and ends when it closes: whatever
    happens to this process, SIGKILL included, none of them outlives it. They are in process groups of their own, so
    that Ctrl-C at a terminal reaches this process only, which then ends them in order.

    A process that dies is started again after 0.5 s, then 1 s, 2 s and so on up to 10 s; after a minute of health the
    count begins again. One that was killed through ``kill`` stays dead until ``revive``.

    Args:
        plan: what to run.
        clock: for the waits.
        transport: for orders to nodes, or None where nobody gives any.
    """

    def __init__(self, plan: LivePlan, clock: SystemClock, transport: Transport | None = None) -> None:
        self._plan, self._clock, self._transport = plan, clock, transport
        self._children: list[_Child] = []
        self._group: dict[str, _Child] = {}
        self._epoch, self._sequence = new_epoch(clock), 0
        self._looked = 0.0
        self._lost: tuple[str, ...] | None = None
        self._unwritten = False
        self._lock = threading.RLock()  # orders may come from the page's thread
        self.events: list[tuple[float, str, str]] = []
        self.joined: list[str] = []  # names of nodes that are not ours
        position = 0
        for group in plan.groups:
            files = [str(plan.settings_file(position + k)) for k in range(len(group))]
            child = _Child(group[0].name, ["node", "--tied", *files])
            position += len(group)
            self._children.append(child)
            self._group.update({node.name: child for node in group})
        self._plant = None if plan.plant is None else _Child(plan.plant.name, ["plant", "--tied", str(plan.plant_file)])

    # -- orders -----------------------------------------------------------------------------------------------------
    def start(self) -> None:
        """Write the settings and start everything; the truth begins now.

        Raises:
            MissingExtraError: psutil is not installed.
        """
        _psutil()  # before anything runs
        plan = self._plan
        if plan.plant is not None and plan.plant.origin is None:
            plan = replace(plan, plant=replace(plan.plant, origin=self._clock.now()))
        plan.write()
        (plan.folder / "output").mkdir(exist_ok=True)
        for child in self._everybody():
            self._launch(child)
        self._write_status()

    def tick(self) -> None:
        """Look after the processes: notice who died, start again whose time has come, now and then take measures."""
        with self._lock:
            now, changed = self._clock.now(), False
            for child in self._everybody():
                changed |= self._look_after(child, now)
            if now - self._looked >= 1.0:
                self._measure()
                self._looked = now
            if changed:
                self._write_status()

    def stop(self) -> None:
        """End everybody in order: nodes first, who say goodbye, then the plant; the stubborn are killed."""
        with self._lock:
            self._measure()
            for child in self._everybody():
                if child.process is not None and child.process.poll() is not None:
                    self._buried(child)  # by itself, since the last look
            self._lost = self.dead
            for group in (self._children, [] if self._plant is None else [self._plant]):
                running = [child for child in group if child.process is not None]
                for child in running:
                    _signal(child, signal.SIGTERM)
                limit = self._clock.now() + _PATIENCE
                for child in running:
                    assert child.process is not None  # selected above
                    try:
                        child.process.wait(max(0.1, limit - self._clock.now()))
                    except subprocess.TimeoutExpired:
                        _signal(child, signal.SIGKILL)
                        child.process.wait()
                    self._buried(child, "told to end: ")
                    child.due = None
            self._write_status()

    def pause(self, name: str) -> None:
        """Let the node ``name`` listen only."""
        self._order(name, PAUSE)

    def go(self, name: str) -> None:
        """Let the node ``name`` go on."""
        self._order(name, GO)

    def kill(self, name: str) -> None:
        """Kill the process of the node ``name``, with everybody in it, until it is revived."""
        with self._lock:
            child = self._child(name)
            child.due = None
            if child.process is not None:
                _signal(child, signal.SIGKILL)
                child.process.wait()
                self._buried(child)
            self._note(child, "killed on request")
            self._write_status()

    def revive(self, name: str) -> None:
        """Start the process of the node ``name`` again, if it is dead; at once, whatever it waited for."""
        with self._lock:
            child = self._child(name)
            if child.process is None:
                child.failures = 0
                child.restarts += 1
                self._launch(child)
                self._write_status()

    # -- facts ------------------------------------------------------------------------------------------------------
    @property
    def dead(self) -> tuple[str, ...]:
        """Names of the nodes whose process does not run now."""
        return tuple(name for name, child in self._group.items() if child.process is None)

    @property
    def dead_before_the_end(self) -> tuple[str, ...]:
        """Names of the nodes that did not run when ``stop`` was called (now, before that)."""
        return self.dead if self._lost is None else self._lost

    @property
    def pids(self) -> dict[str, int | None]:
        """Process id of every node; None where it does not run."""
        return {name: _pid(child) for name, child in self._group.items()}

    @property
    def plant_pid(self) -> int | None:
        """Process id of the plant."""
        return None if self._plant is None else _pid(self._plant)

    @property
    def restarts(self) -> int:
        """How often any process was started again."""
        return sum(child.restarts for child in self._everybody())

    def usage(self) -> tuple[Usage, ...]:
        """What every process used, the plant last."""
        return tuple(
            Usage(child.label, child.spent + child.cpu, child.memory, child.restarts, child.process is not None)
            for child in self._everybody()
        )

    @property
    def status_file(self) -> Path:
        """Where the process ids are written."""
        return self._plan.folder / "status.json"

    # -- inside -----------------------------------------------------------------------------------------------------
    def _everybody(self) -> list[_Child]:
        return [*self._children, *([] if self._plant is None else [self._plant])]

    def _child(self, name: str) -> _Child:
        child = self._group.get(name)
        if name in self.joined:
            raise ArgumentError(f"{name!r} joined the run; orders to it are for whoever started it")
        if child is None:
            raise ArgumentError(f"there is no node {name!r}; the nodes are {', '.join(list(self._group)[:12])}")
        return child

    def _launch(self, child: _Child) -> None:
        """Start a process; where the system refuses (no memory, a full disk), try again as if it had died."""
        try:
            with self._output(child).open("ab") as output:
                child.process = subprocess.Popen(
                    [sys.executable, "-m", "trigpoint.runtime", *child.arguments],
                    stdin=subprocess.PIPE,
                    stdout=output,
                    stderr=output,
                    process_group=0,
                    env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **setting_of(self._clock)},
                )
        except OSError as error:
            child.failures += 1
            child.due = self._clock.now() + backoff(child.failures)
            self._note(child, f"ended before it began: {error}")
            return
        child.started, child.due, child.exit_code, child.watched = self._clock.now(), None, None, None
        self._note(child, f"started as process {child.process.pid}")

    def _look_after(self, child: _Child, now: float) -> bool:
        if child.process is None:
            if child.due is None or now < child.due:
                return False
            child.restarts += 1
            self._launch(child)
            return True
        if child.process.poll() is None:
            return False
        child.failures = 1 if now - child.started >= HEALTHY else child.failures + 1
        self._buried(child)
        child.due = now + backoff(child.failures)
        return True

    def _buried(self, child: _Child, why: str = "") -> None:
        """Keep the accounts of a process that has ended; ``why``, where it was not by itself."""
        assert child.process is not None  # only called for one that ended
        child.exit_code = child.process.returncode
        if child.process.stdin is not None:
            child.process.stdin.close()
        child.spent, child.cpu, child.process = child.spent + child.cpu, 0.0, None
        said = self._last_words(child) if child.exit_code else ""
        self._note(child, f"{why}ended with {_words(child.exit_code)}{said}")

    def _output(self, child: _Child) -> Path:
        return self._plan.folder / "output" / f"process-{self._everybody().index(child)}.txt"

    def _last_words(self, child: _Child) -> str:
        """The last line that a process that failed had to say, if it said anything."""
        try:
            with self._output(child).open("rb") as output:
                output.seek(max(0, output.seek(0, os.SEEK_END) - 1000))
                lines = output.read().decode("utf-8", "replace").splitlines()
        except OSError:  # somebody took the file away
            return ""
        return f": {lines[-1]}" if lines and child.exit_code == 2 else ""

    def reason(self, name: str) -> str | None:
        """Why the process of the node ``name`` ended the last time; None where only ``stop`` ended it."""
        label = self._child(name).label
        return next((text for _, who, text in reversed(self.events) if who == label and text.startswith("ended")), None)

    def _note(self, child: _Child, text: str) -> None:
        self.events.append((self._clock.now(), child.label, text))

    def _order(self, name: str, order: float) -> None:
        child = self._child(name)
        if self._transport is None:
            raise ArgumentError("this supervisor has no transport, so it cannot give orders to a node")
        with self._lock:
            number, self._sequence = self._sequence, self._sequence + 1
        frame = Frame(Kind.CONTROL, self._plan.watcher, self._epoch, number, self._clock.now(), (order,))
        self._transport.publish(node_key(self._plan.network, name, "control"), encode_frame(frame))
        self._note(child, "paused" if order == PAUSE else "told to go on")

    def _measure(self) -> None:
        psutil = _psutil()
        for child in self._everybody():
            if child.process is None:
                continue
            try:
                if child.watched is None:
                    child.watched = psutil.Process(child.process.pid)
                times = child.watched.cpu_times()
                child.cpu, child.memory = times.user + times.system, float(child.watched.memory_info().rss)
            except psutil.Error:  # it died between two looks
                continue

    def _write_status(self) -> None:
        nodes = {
            name: {
                "pid": _pid(child),
                "restarts": child.restarts,
                "state": _state(child),
                "exit_code": child.exit_code,
            }
            for name, child in self._group.items()
        }
        over = self._lost is not None
        document = {"supervisor": os.getpid(), "over": over, "plant": self.plant_pid, "nodes": nodes}
        fresh = self.status_file.with_suffix(".new")
        try:
            fresh.write_text(json.dumps(document, indent=1), encoding="utf-8")
            fresh.replace(self.status_file)
        except OSError as error:  # a full disk must not end the run, nor keep its processes from being ended
            if not self._unwritten:
                self.events.append((self._clock.now(), self._plan.watcher, f"cannot write {self.status_file}: {error}"))
            self._unwritten = True
        else:
            self._unwritten = False


def _pid(child: _Child) -> int | None:
    return None if child.process is None else child.process.pid


def _state(child: _Child) -> str:
    if child.process is not None:
        return "running"
    return "dead" if child.due is None else "waiting"


def _signal(child: _Child, number: signal.Signals) -> None:
    if child.process is not None:
        child.process.send_signal(number)


def _words(code: int | None) -> str:
    if code is not None and code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"


def _psutil() -> Any:
    try:
        import psutil
    except ImportError as error:
        raise MissingExtraError("psutil", "live", "the supervisor of a live run") from error
    return psutil
