"""Many nodes on one virtual clock over a network in memory: the machines that live processes run, and their trouble."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError
from trigpoint.observers.run import Run
from trigpoint.runtime.codec import Frame, Kind, encode_frame
from trigpoint.runtime.machine import NodeMachine, Outgoing
from trigpoint.runtime.memory import MemoryNetwork, MemoryTransport
from trigpoint.runtime.settings import NodeSettings
from trigpoint.runtime.topics import reading_key
from trigpoint.runtime.truth import Plant

SENSOR = "plant"
"""Name under which the plant publishes readings; settings list it among their guests as ``sensor``."""

_SNAP = 1e-9

Watch = Callable[[float, Mapping[str, NodeMachine]], None]


@dataclass(frozen=True)
class Down:
    """The process of the node ``name`` is gone from ``start`` to before ``stop`` [s], killed unless ``orderly``."""

    name: str
    start: float
    stop: float = math.inf
    orderly: bool = False


@dataclass(frozen=True)
class Mute:
    """The sensor of the arc ``label`` says nothing from ``start`` to before ``stop`` [s]."""

    label: int
    start: float
    stop: float = math.inf


@dataclass(frozen=True, eq=False)
class Trouble:
    """What goes wrong, or changes, in a virtual run.

    Attributes:
        downs: processes that are killed or stopped; each that comes back is a new one.
        mutes: sensors that are silent.
        offsets: seconds by which the clocks of nodes are ahead, by name.
        reloads: pairs (time, settings): a node that goes on with other settings.
        meddle: called with the time before every act: attackers, who have ends of the network themselves.
    """

    downs: Sequence[Down] = ()
    mutes: Sequence[Mute] = ()
    offsets: Mapping[str, float] = field(default_factory=dict)
    reloads: Sequence[tuple[float, NodeSettings]] = ()
    meddle: Callable[[float], None] | None = None


def run_virtual(
    settings: Sequence[NodeSettings],
    plant: Plant,
    times: FloatArray,
    network: MemoryNetwork,
    trouble: Trouble | None = None,
    watch: Watch | None = None,
) -> Run:
    """Run the nodes with these ``settings`` and record truth and estimates at ``times`` (T,) [s].

    All clocks begin at 0; each node acts at 0, period, 2 period, ... At one instant all steps come first, then what is
    told without delay is heard, then everybody decides what the next step uses: the order of ``simulate`` with the path
    ``reference``, whose estimates come out to the last bit where the network and the readings are as there.

    Args:
        settings: one a node; each lists ``SENSOR`` among its guests.
        plant: the truth; its readings are published when a node that uses them acts.
        times: ascending; between two acts an estimate is moved on freely.
        network: with links between the nodes' names, and from ``SENSOR`` to them.
        trouble: what goes wrong; None for nothing.
        watch: called at each of the times with the machines that are there.

    Raises:
        ArgumentError: times that do not ascend.
    """
    instants = np.asarray(times, dtype=np.float64)
    if instants.ndim != 1 or not instants.size or instants[0] < 0.0 or (np.diff(instants) <= 0.0).any():
        raise ArgumentError("times must be ascending numbers of at least 0, at least one of them")
    return _Rehearsal(settings, plant, network, trouble or Trouble(), watch).run(instants)


class _Rehearsal:
    def __init__(
        self,
        settings: Sequence[NodeSettings],
        plant: Plant,
        network: MemoryNetwork,
        trouble: Trouble,
        watch: Watch | None,
    ) -> None:
        self._settings = {one.name: one for one in settings}
        self._plant, self._network, self._trouble, self._watch = plant, network, trouble, watch
        self._sensor = network.transport(SENSOR)
        self._machines: dict[str, NodeMachine] = {}
        self._ends: dict[str, MemoryTransport] = {}
        self._readings = self._told = 0
        self._sent = dict.fromkeys(self._settings, 0)
        self._truths: list[list[FloatArray]] = []
        self._estimates: list[list[FloatArray]] = []
        self._counts: list[list[int]] = []
        self._statuses: list[list[str]] = []
        self._reloads = sorted(trouble.reloads, key=lambda pair: pair[0])

    def run(self, times: FloatArray) -> Run:
        """Go through all acts and outputs in order."""
        agenda = [(0.0, k, 0, name) for k, name in enumerate(self._settings)]
        heapq.heapify(agenda)
        pending = list(times.tolist())
        while pending:
            due = agenda[0][0]
            slack = _SNAP * self._settings[agenda[0][3]].period
            while pending and pending[0] < due - slack:
                self._pass(pending[0])
                self._record(pending.pop(0))
            acting = []
            while agenda and agenda[0][0] <= due + slack * 1e-3:
                _, place, number, name = heapq.heappop(agenda)
                acting.append(name)
                heapq.heappush(agenda, ((number + 1) * self._settings[name].period, place, number + 1, name))
            self._instant(due, acting)
            while pending and pending[0] <= due + slack:
                self._record(pending.pop(0))
        return self._result(times)

    def _pass(self, time: float) -> None:
        self._network.deliver(time)
        self._plant.move(time)

    def _instant(self, now: float, acting: Sequence[str]) -> None:
        """All steps, then everything that is heard at once, then what the next steps use."""
        self._pass(now)
        self._come_and_go(now)
        if self._trouble.meddle is not None:
            self._trouble.meddle(now)
        there = [name for name in acting if name in self._machines]
        for name in there:
            self._publish(name, self._machines[name].act(self._clock(name)))
        self._read(now, there)
        self._network.deliver(now)
        for name in there:
            self._machines[name].latch(self._clock(name))

    def _come_and_go(self, now: float) -> None:
        for name, settings in self._settings.items():
            down = next((one for one in self._trouble.downs if one.name == name and one.start <= now < one.stop), None)
            if down is not None and name in self._machines:
                machine = self._machines.pop(name)
                if down.orderly:
                    self._publish(name, machine.stop(self._clock(name)))
                self._ends.pop(name).close()
            elif down is None and name not in self._machines:
                self._begin(settings)
        while self._reloads and self._reloads[0][0] <= now:
            settings = self._reloads.pop(0)[1]
            self._settings[settings.name] = settings
            if settings.name in self._machines:
                self._machines[settings.name].reload(settings, self._clock(settings.name))
                self._listen(settings.name)

    def _begin(self, settings: NodeSettings) -> None:
        name = settings.name
        self._ends[name] = self._network.transport(name)
        now = self._clock(name)
        self._machines[name] = NodeMachine(settings, epoch=1 + round(1e9 * max(0.0, now)), now=now)
        self._listen(name)
        self._publish(name, self._machines[name].start(now))

    def _listen(self, name: str) -> None:
        end, machine = self._ends[name], self._machines[name]

        def sink(key: str, data: bytes) -> None:
            self._publish(name, machine.receive(self._clock(name), key, data))

        end.subscribe_anew(machine.subscriptions(), sink)

    def _clock(self, name: str) -> float:
        return self._network.now + self._trouble.offsets.get(name, 0.0)

    def _publish(self, name: str, frames: Sequence[Outgoing]) -> None:
        end = self._ends.get(name)
        if end is None:
            return
        for frame in frames:
            self._sent[name] += frame.key.endswith("/estimate")
            end.publish(frame.key, frame.data)

    def _read(self, now: float, acting: Sequence[str]) -> None:
        wanted = {
            (label, self._settings[name].network) for name in acting for label in self._settings[name].program.reads
        }
        silent = {one.label for one in self._trouble.mutes if one.start <= now < one.stop}
        values = self._plant.readings()
        for label, network in sorted(wanted):
            if label in silent or label not in values:
                continue
            frame = Frame(Kind.READING, SENSOR, 1, self._readings, now, (float(label),), values[label])
            self._sensor.publish(reading_key(network, label), encode_frame(frame))
        self._readings += 1

    def _record(self, time: float) -> None:
        truth, estimates, statuses = list(self._plant.truth()), [], []
        for name, true in zip(self._settings, truth, strict=True):
            machine = self._machines.get(name)
            if machine is None:
                estimates.append(np.full(true.shape, np.nan))
                statuses.append("away")
                continue
            estimates.append(machine.estimate_at(time + self._trouble.offsets.get(name, 0.0)))
            statuses.append("anchored" if machine.anchored else "relative")
        self._truths.append(truth)
        self._estimates.append(estimates)
        self._counts.append(list(self._sent.values()))
        self._statuses.append(statuses)
        if self._watch is not None:
            self._watch(time, self._machines)

    def _result(self, times: FloatArray) -> Run:
        return Run(
            times,
            _table(self._truths),
            _table(self._estimates),
            np.array(self._counts, dtype=np.int64),
            np.array(self._statuses),
            tuple(self._settings),
            "virtual",
            {"lost": self._network.lost},
        )


def _table(rows: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """(T, N, n), filled up with zeros."""
    longest = max(part.shape[0] for part in rows[0])
    return np.array([[np.pad(part, (0, longest - part.shape[0])) for part in row] for row in rows])
