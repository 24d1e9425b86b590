"""A live run while it goes on, and what is said about it afterwards."""

from __future__ import annotations

import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from trigpoint.cli.recorded import Player, Record
from trigpoint.cli.recorder import Recorder
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.observers import AssembledObserver, Run
from trigpoint.observers.aged import aged_decay_rate, aged_error_norms
from trigpoint.runtime.__main__ import plant_transport
from trigpoint.runtime.access import guest_rules
from trigpoint.runtime.arrivals import Arrivals, opener
from trigpoint.runtime.clock import SystemClock, new_epoch
from trigpoint.runtime.codec import Kind
from trigpoint.runtime.log import LogWriter
from trigpoint.runtime.log_format import JOINED
from trigpoint.runtime.monitor import Monitor, Snapshot
from trigpoint.runtime.plan import LivePlan
from trigpoint.runtime.sensors import ReadingPublisher
from trigpoint.runtime.supervisor import Supervisor, Usage
from trigpoint.runtime.zenoh_link import ZenohTransport

_TICK = 0.02
_TICK_A_NODE = 5e-4  # a snapshot moves the truth of every node: with many nodes the monitor would do little else
_MOST_STEPS = 20_000  # exchanges that a prediction follows
_TOLD = ("decay_rate_predicted", "decay_rate_expected", "message_age", "reading_age")  # to the log, at the end
_DURATION = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*(ms|s|min|h)")
_UNITS = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}


def seconds_of(text: str) -> float:
    """``text`` such as 20s, 500ms, 2min or 1.5h in seconds."""
    found = _DURATION.fullmatch(text.strip())
    value = float(found[1]) * _UNITS[found[2]] if found else 0.0
    if not (np.isfinite(value) and value > 0.0):
        raise ArgumentError(
            f"got {text!r} for a duration; expected a positive number and ms, s, min or h: 20s, 500ms, 2min"
        )
    return value


@dataclass(eq=False)
class LiveRun:
    """Everything that belongs to one run in this process.

    Attributes:
        plan: what runs.
        log: where every frame goes, or None.
        player: publishes recorded readings, where there is no plant.
        observer: the programs, for the rates that the log is told at the end; None: it is not told.
    """

    plan: LivePlan
    log: LogWriter | None
    player: Player | None = None
    observer: AssembledObserver | None = None
    clock: SystemClock = field(default_factory=SystemClock)
    trouble: str | None = None
    closing: bool = False
    rates: dict[str, float | None] | None = None

    def __post_init__(self) -> None:
        """Open the links; nothing runs yet."""
        plan = self.plan
        roles = dict.fromkeys(plan.names, "node")
        sensor = plan.sensor if plan.plant is None else plan.plant.name
        if sensor:
            roles[sensor] = "sensor"
        rules = None if plan.identity is None else guest_rules(plan.network, "supervisor", roles)
        self.transport = ZenohTransport(
            plan.listen, [node.listen for node in plan.nodes], identity=plan.identity, rules=rules
        )
        programs = [node.program for node in plan.nodes]
        self.monitor = Monitor(self.transport, plan.network, programs, self.clock, plan.motions)
        self.supervisor = Supervisor(plan, self.clock, self.transport)
        link = opener("supervisor", plan.identity)
        self.arrivals = Arrivals(plan.settings_folder, plan.nodes, self.monitor, link)
        self.recorder = Recorder(plan.names)
        self._told = 0
        if self.log is not None:
            self.keep(self.log)

    def keep(self, log: LogWriter) -> None:
        """Write every frame and event to ``log`` from now on."""
        self.log = log
        self.monitor.hooks.append(self._write)

    def follow(self, duration: float | None, show: Callable[[Snapshot], None]) -> Snapshot:
        """Start everything, run for ``duration`` seconds or until a signal, end everything; the last snapshot.

        With recorded readings the run ends with them, or ``duration`` seconds later. ``show`` is called ten times a
        second or so.
        """
        with ended_by_signals() as ended:
            try:
                self.supervisor.start()
                limit = None if duration is None or self.player is not None else self.clock.now() + duration
                shown, tick = 0.0, max(_TICK, _TICK_A_NODE * len(self.plan.nodes))
                while not ended.is_set() and (limit is None or self.clock.now() < limit):
                    began = time.monotonic()
                    self.step()
                    snapshot = self.monitor.snapshot()
                    self.recorder.take(snapshot)
                    if self.player is not None and self.player.tick(self.heard) and limit is None:
                        limit = self.clock.now() + (duration or 0.0)
                    if snapshot.time - shown >= 0.1:
                        show(snapshot)
                        shown = snapshot.time
                    ended.wait(max(0.0, began + tick - time.monotonic()))
                self.step()
                return self.monitor.snapshot()
            finally:
                self.close()

    def heard(self) -> bool:
        """Whether an estimate of every node was heard within the last second."""
        return bool((self.monitor.snapshot().age[: len(self.plan.nodes)] < 1.0).all())

    def step(self) -> None:
        """Take in what has arrived and look after the processes."""
        self.monitor.poll()
        self.supervisor.tick()
        self._welcome()
        self._log_events()

    def close(self) -> None:
        """End the processes, then the links, then the log, which gets the goodbyes, too."""
        self.closing = True
        if self.player is not None:
            self.player.close()
        self.supervisor.stop()
        self.monitor.poll()
        self._log_events()
        self.transport.close()
        self.arrivals.close()
        if self.log is not None:
            try:
                self._tell_rates(self.log)
                self.log.close()
            except FileFormatError as error:
                self.trouble = self.trouble or str(error)

    def _tell_rates(self, log: LogWriter) -> None:
        """What only the end knows: the rates for the ages that messages and readings had."""
        if self.observer is not None and log.failure is None and self.rates is None:
            self.rates = rates_of(self, self.recorder.run(), self.observer)
            log.tell({name: self.rates[name] for name in _TOLD if self.rates[name] is not None})

    def _welcome(self) -> None:
        """Nodes that joined since the last look: the log gets their names and links."""
        arrivals, now = self.arrivals, self.clock.now()
        fresh = arrivals.look(now)
        self.supervisor.events += [(now, self.plan.watcher, text) for text in arrivals.failures]
        arrivals.failures.clear()
        if not fresh:
            return
        self.supervisor.joined = [node.name for node in arrivals.joined]
        self.supervisor.events += [(now, node.name, "joined the run") for node in fresh]
        if self.log is None or self.trouble is not None:
            return
        try:
            self.log.tell({JOINED: self.supervisor.joined, "hears": arrivals.hears, "anchors": arrivals.anchors})
        except FileFormatError as error:
            self.trouble = str(error)

    def _write(self, frame: Any, received: float) -> None:
        """A log that fails ends the logging, not the run."""
        if self.log is None or self.trouble is not None:
            return
        try:
            self.log.write(frame, received)
        except FileFormatError as error:
            self.trouble = str(error)

    def _log_events(self) -> None:
        events = self.supervisor.events
        while self._told < len(events):
            moment, node, text = events[self._told]
            self._told += 1
            if self.log is None or self.trouble is not None:
                continue
            try:
                self.log.event(text, node, time=moment)
            except FileFormatError as error:
                self.trouble = str(error)


def replayed(record: Record, plan: LivePlan) -> LiveRun:
    """A run of the ``plan`` with the ``record`` instead of its plant."""
    assert plan.plant is not None  # made with one, whose links the record takes over
    live = LiveRun(replace(plan, plant=None), None)
    link = plant_transport(plan.plant)
    live.player = Player(record, link, ReadingPublisher(link, plan.network, plan.sensor, epoch=new_epoch()), live.clock)
    return live


@contextmanager
def ended_by_signals() -> Iterator[threading.Event]:
    """An event that SIGINT, SIGTERM and SIGHUP (a terminal that closes) set, instead of ending the program."""
    ended = threading.Event()

    def end(_: int, __: FrameType | None) -> None:
        ended.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield ended
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def facts_of(live: LiveRun, last: Snapshot, observer: AssembledObserver) -> dict[str, Any]:
    """The JSON object of ``run``."""
    plan = live.plan
    heard = last.age[: len(plan.names)]  # of the run's own nodes: nobody here started those that joined it
    statuses = [status for status in last.status[: len(plan.names)] if status is not None]
    run = live.recorder.run()
    usage = live.supervisor.usage()
    lasted = max(last.time, 1e-9)
    limit = 1.0 + 5.0 * plan.nodes[0].period
    norms = None if run is None else run.error_norm
    size = None if run is None else float(np.linalg.norm(run.truth[-1]))
    return {
        "nodes": len(plan.names),
        "processes": len(plan.groups),
        "rate": 1.0 / plan.nodes[0].period,
        "seconds": last.time,
        **(live.rates or rates_of(live, run, observer)),
        "decay_rate": plan.nodes[0].decay_rate,
        "initial_error": None if norms is None else float(norms[0]),
        "final_error": None if norms is None else float(norms[-1]),
        "relative_error": None if norms is None or not size else float(norms[-1]) / size,
        "heard": int(np.isfinite(heard).sum()),
        "anchored": sum(status.anchored for status in statuses),
        "covered": sum(status.covered for status in statuses),
        "dead": list(live.supervisor.dead_before_the_end),
        "silent": [name for name, age in zip(plan.names, heard, strict=True) if not age < limit],
        "joined": live.supervisor.joined,
        "restarts": live.supervisor.restarts,
        "acts": sum(status.acts for status in statuses),
        "missed": sum(status.missed for status in statuses),
        "step_us": float(np.mean([status.step_us for status in statuses])) if statuses else None,
        "readings": None if live.player is None else live.player.count,
        "frames": live.monitor.received,
        "bytes": live.monitor.received_bytes,
        "cpu_per_node": _nodes_cpu(usage, plan) / len(plan.names) / lasted,
        "memory_per_process": float(np.mean([one.memory for one in usage[: len(plan.groups)]])),
        "memory": float(sum(one.memory for one in usage)),
        "warnings": [status.warning for status in statuses if status.warning],
    }


def ages(live: LiveRun, window: tuple[float, float] | None) -> tuple[float, float]:
    """Age of a message and of a reading when it is used [s], in this ``window`` of the run (None: in all of it).

    Messages: as the nodes say themselves, which holds whatever keeps them or the monitor waiting; before they have,
    half a period more than the monitor sees. Readings: that, as the mean over the phases of the nodes.
    """
    monitor, half = live.monitor, 0.5 * live.plan.nodes[0].period
    since, until = (-np.inf, np.inf) if window is None else (monitor.began + window[0], monitor.began + window[1])
    said = monitor.link_age(since, until)
    seen = half + monitor.lateness(Kind.ESTIMATE, since, until) if said is None else said
    return seen, half + monitor.lateness(Kind.READING, since, until)


def rates_of(live: LiveRun, run: Run | None, observer: AssembledObserver) -> dict[str, float | None]:
    """The measured rate, the one expected of the same samples from the same first error, and that of the long run.

    Both for the ages in the time of these samples, which come with them. None for a measured rate over less than a time
    constant: the error has not even fallen by a factor e meanwhile.
    """
    window = None if run is None else run.decay_window()
    known = ages(live, window)
    predicted = _predicted(live, observer, known)
    found = {"decay_rate_measured": None, "decay_rate_expected": None, "decay_rate_predicted": predicted,
             "message_age": known[0], "reading_age": known[1]}  # fmt: skip
    if run is None or window is None or (predicted is not None and (window[1] - window[0]) * predicted < 1.0):
        return found
    expected = _expected(live, run, observer, window) if predicted is not None else None
    return {**found, "decay_rate_measured": run.measured_decay_rate(), "decay_rate_expected": expected}


def _expected(live: LiveRun, run: Run, observer: AssembledObserver, window: tuple[float, float]) -> float | None:
    """The slope over the ``window`` of what follows from the first sample.

    None for very long runs, and where the estimate is not what a node exchanges.
    """
    node = live.plan.nodes[0]
    first, steps = (round((moment - run.times[0]) / node.period) for moment in window)
    plain = all(one.readout is None and not one.feedthrough for one in observer.nodes)
    if node.old != "propagate" or not plain or steps > _MOST_STEPS:
        return None
    norms = aged_error_norms(observer, node.period, *ages(live, window), run.error[0], steps)[first:]
    if norms.shape[0] < 3 or not norms.all():
        return None
    return float(-np.polyfit(node.period * np.arange(norms.shape[0]), np.log(norms), 1)[0])


def _predicted(live: LiveRun, observer: AssembledObserver, known: tuple[float, float]) -> float | None:
    """The rate with these ages; taken as they are, old values leave a floor instead (policy ``use``)."""
    node = live.plan.nodes[0]
    age, reading_age = known
    if max(age, reading_age) > 16.0 * node.period:
        return None
    return aged_decay_rate(observer, node.period, age, reading_age if node.old == "propagate" else 0.0)


def _nodes_cpu(usage: tuple[Usage, ...], plan: LivePlan) -> float:
    return sum(one.cpu for one in usage[: len(plan.groups)])


def holds(facts: dict[str, Any]) -> bool:
    """Whether every node ran, was heard and was anchored at the end."""
    return not facts["dead"] and not facts["silent"] and facts["anchored"] == facts["nodes"]


def log_of(plan: LivePlan, path: Path) -> LogWriter:
    """The log of a run, with what describes it."""
    attributes = {
        "anchor_timeout": plan.nodes[0].anchor_timeout,
        "period": plan.nodes[0].period,
        "guaranteed_rate": plan.nodes[0].decay_rate,
        "stale": plan.nodes[0].stale,
        "hears": {node.name: list(node.program.hears) for node in plan.nodes},
        "anchors": [node.name for node in plan.nodes if any(not arc.heard for arc in node.program.arcs)],
    }
    return LogWriter(path, network=plan.network, names=plan.names, attributes=attributes)
