"""How old the messages are that nodes use, by their own word: what follows from their phases, and no more."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import trigpoint as tp
from tests.runtime.given import STATIC, case
from trigpoint.runtime import Host, Kind, Member, MemoryNetwork, Monitor, NodeMachine, State

PERIOD = 0.04
GRID = PERIOD / 2048  # a state is for the nearest of the instants that are period / 1024 apart
BEGAN = 1.75e9
ROUNDING = 2.0**-22  # of one addition to such a time


class Time:
    """The network's time, which a test moves."""

    def __init__(self, network: MemoryNetwork) -> None:
        self._network = network

    def now(self) -> float:
        return self._network.now


class Line:
    """Nodes on a line, in processes of some of them each, whose processors come late; a monitor hears everybody."""

    def __init__(self, together, rng, *, delay: float, late: float) -> None:
        nodes = sum(together)
        one = case(STATIC, tp.graphs.chain(nodes, anchors=[0]))
        links = [*one.links(), *((name, "monitor") for name in one.names)]
        self.network = MemoryNetwork(links, delay=delay, jitter=delay, seed=int(rng.integers(2**31)))
        self.network.deliver(BEGAN)
        self.clock, self._rng, self._late = Time(self.network), rng, late
        self.monitor = Monitor(self.network.transport("monitor"), "net", one.programs, self.clock)
        self.ages: dict[tuple[str, str], list[float]] = {}
        self.monitor.hooks.append(self._listen)
        settings, self.hosts = one.settings(period=PERIOD), []
        for count in together:
            members = [Member(NodeMachine(s, epoch=1, now=self.clock.now()), self._end) for s in settings[:count]]
            del settings[:count]
            self.hosts.append(Host(members, self.clock))
            self.hosts[-1].start()
            self.network.deliver(self.clock.now() + rng.uniform(0.0, 3.0 * PERIOD))
        self.missed = 0

    def _end(self, settings):
        return self.network.transport(settings.name)

    def _listen(self, frame, _) -> None:
        if frame.kind is Kind.STATUS:
            status = self.monitor.snapshot().status[self.monitor.names.index(frame.sender)]
            self.missed = max(self.missed, status.missed)
            for link in status.links:
                if link.state is State.LIVE:
                    self.ages.setdefault((link.neighbour, frame.sender), []).append(link.age)

    def go_on(self, seconds: float) -> None:
        end = self.clock.now() + seconds
        while True:
            due, host = min(((one._agenda[0][0], one) for one in self.hosts), key=lambda pair: pair[0])
            if due > end:
                return
            stall = self._late * self._rng.exponential() if self._late else 0.0
            self.network.deliver(max(due + stall, self.clock.now()))
            while host._agenda[0][0] == due:
                host.turn()
            self.monitor.poll()

    def phase(self, name: str) -> float:
        found = {m.machine.settings.name: due for h in self.hosts for due, k in h._agenda for m in [h._members[k]]}
        return found[name] % PERIOD


def beside(value, whole):
    """How far from the next multiple of ``whole``."""
    return np.abs(np.asarray(value) - whole * np.round(np.asarray(value) / whole)).max()


@pytest.mark.parametrize(("delay", "late"), [(0.0, 0.0), (0.1, 0.0), (0.1, 0.3), (0.1, 3.0)])
@pytest.mark.parametrize("together", [(1, 1, 1, 1), (2, 1), (2, 2), (3, 1)])
@pytest.mark.parametrize("seed", range(3))
def test_an_age_is_the_difference_of_two_phases_and_whole_periods(together, delay, late, seed) -> None:
    """However late frames and processors are; so the ages of both directions of a link are whole periods together."""
    line = Line(together, np.random.default_rng(seed), delay=delay * PERIOD, late=late * PERIOD)
    line.go_on(6.0)
    near = GRID + ROUNDING * (10 + line.missed)
    names = line.monitor.names
    assert len(line.ages) == 2 * (len(names) - 1)
    for one, other in pairwise(names):
        there, back = np.array(line.ages[one, other]), np.array(line.ages[other, one])
        assert min(there.min(), back.min()) > -near
        assert beside(there - (line.phase(other) - line.phase(one)), PERIOD) < near
        assert beside(there[:, None] + back, PERIOD) < 2.0 * near
        assert (there[:, None] + back).min() > PERIOD - 2.0 * near
    age = line.monitor.link_age()
    assert age == pytest.approx(np.mean([np.median(said) for said in line.ages.values()]), abs=1e-15)
    assert age > 0.5 * PERIOD - near
    if not delay:  # nothing is late: half a period, whatever the phases
        assert age == pytest.approx(0.5 * PERIOD, abs=near)
