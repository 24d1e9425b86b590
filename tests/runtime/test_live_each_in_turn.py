"""Each of nine processes is killed from outside in turn: what the others do meanwhile, and when the network is back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.living import GRID, anchored, designed, everybody_heard, killed, living, runs, status_of, until
from trigpoint.cli.live import ages
from trigpoint.observers.aged import aged_error_norms
from trigpoint.runtime import LINK_FIELDS, STATUS_FIELDS, Kind, State

DOWN = 4.0
SETTLED = 0.5  # s after a kill; the neighbours use the last word of the dead for as long as it is not stale


class Observed:
    """Samples of all errors, and who called itself anchored when, while a run goes on."""

    def __init__(self, live, programs) -> None:
        self.live, self.programs = live, programs
        self.times: list[float] = []
        self.errors: list[np.ndarray] = []
        self.claims: list[tuple[float, str, bool]] = []
        self.links: list[tuple[float, list[bool]]] = []
        live.monitor.hooks.append(self._hear)

    def _hear(self, frame, _) -> None:
        if frame.kind is Kind.STATUS:
            self.claims.append((frame.time, frame.sender, bool(frame.values[0])))
            rows = frame.values[len(STATUS_FIELDS) :].reshape(-1, len(LINK_FIELDS))
            self.links.append((frame.time, [row[0] == State.LIVE for row in rows]))

    def until(self, what) -> float:
        """Go on until ``what`` holds of the latest errors; when that was."""

        def reached() -> bool:
            snapshot = self.live.monitor.snapshot()
            self.times.append(self.live.clock.now())
            self.errors.append(np.array(snapshot.estimate) - np.array(snapshot.truth))
            return bool(what(self.errors[-1]))

        until(self.live, reached)
        return self.times[-1]

    def since(self, moment: float) -> tuple[float, np.ndarray]:
        """The first sample from ``moment`` on."""
        k = int(np.searchsorted(self.times, moment))
        return self.times[k], self.errors[k]

    def share_at_work(self, begin: float, end: float) -> float:
        """Of all links and the time from ``begin`` to ``end``, as the nodes say: 1 unless the machine is held up."""
        told = [live for time, links in self.links if begin <= time <= end for live in links]
        return float(np.mean(told))

    def expected(self, error, begin: float, end: float, without: str | None = None) -> np.ndarray:
        """Norms of the errors from ``begin`` to ``end``, by theory, with the ages that messages had meanwhile."""
        period, began = self.live.plan.nodes[0].period, self.live.monitor.began
        known = ages(self.live, (begin - began, end - began))
        nodes = tuple(
            replace(node, _memo={}, arcs=tuple(arc for arc in node.arcs if without not in (node.name, arc.neighbour)))
            for node in self.programs.nodes
        )
        programs = self.programs if without is None else replace(self.programs, nodes=nodes)
        return aged_error_norms(programs, period, *known, error, round((end - begin) / period))


def the_others_go_on(seen: Observed, victim: str, moment: float, back: float) -> None:
    """They converge as a network without it does; where it had the only anchor, to each other, and say relative."""
    names = list(seen.live.plan.names)
    others, alone = [k for k, name in enumerate(names) if name != victim], victim == names[0]

    def part(error: np.ndarray) -> np.ndarray:
        """Errors of the others; less their mean where nothing is left that could correct that."""
        kept = np.zeros_like(error)
        kept[others] = error[others] - (error[others].mean(axis=0) if alone else 0.0)
        return kept

    begin, first = seen.since(moment + SETTLED)
    end, last = seen.since(moment + DOWN - 0.1)
    measured = np.linalg.norm(part(last)) / np.linalg.norm(part(first))
    norms = seen.expected(part(first), begin, end, without=victim)
    assert measured < 1.0, victim
    assert measured == pytest.approx(norms[-1] / norms[0], rel=0.3), victim
    timeout = seen.live.plan.nodes[0].anchor_timeout
    claims = {name: [] for name in names}
    for told, name, claimed in seen.claims:
        if moment + timeout < told < moment + DOWN:  # evidence from before the kill is too old for a claim now
            claims[name].append(claimed)
    assert not claims.pop(victim)
    for name, claimed in claims.items():
        assert claimed, name
        assert not any(claimed) if alone else any(claimed), (victim, name)
    assert back - moment > DOWN


def the_network_is_back(seen: Observed, victim: str, back: float) -> tuple[float, float]:
    """The error that the new process brings has fallen to an e^2-th, and by another fifth, within the predicted time.

    Near the level the norm may be all but flat for a second, as modes that turn pass each other: hence the fifth.
    """
    begin, first = seen.since(back)
    level = np.linalg.norm(first) / np.e**2
    end = seen.until(lambda error: np.linalg.norm(error) <= level)
    norms = seen.expected(first, begin, end + 10.0)
    assert norms[-1] <= 0.8 * level
    predicted = seen.live.plan.nodes[0].period * int(np.argmax(norms <= 0.8 * level)) / seen.share_at_work(begin, end)
    assert end - begin < 1.15 * predicted, (victim, end - begin, predicted)
    return end - begin, predicted


@pytest.mark.slow
def test_each_of_nine_processes_is_killed_in_turn_and_the_network_comes_back(tmp_path, monkeypatch):
    """SIGKILL from outside; the supervisor starts a new process 4 s later, whose estimates go on."""
    monkeypatch.setattr("trigpoint.runtime.supervisor.FIRST_WAIT", DOWN)
    with living(GRID, tmp_path) as live:
        seen = Observed(live, designed(tmp_path / "scenario.toml").programs)
        until(live, lambda: everybody_heard(live) and anchored(live) == 9)
        for victim in live.plan.names:
            pids = {name: one["pid"] for name, one in status_of(live)["nodes"].items()}
            killed(pids[victim])
            while runs(pids[victim]):
                pass
            moment = live.clock.now()
            back = seen.until(lambda _, name=victim, at=moment: live.monitor.epoch(name) > 1e9 * at)
            fresh = {name: one["pid"] for name, one in status_of(live)["nodes"].items()}
            assert [name for name in pids if fresh[name] != pids[name]] == [victim]
            the_others_go_on(seen, victim, moment, back)
            took, predicted = the_network_is_back(seen, victim, back)
            print(f"{victim}: down {back - moment:.2f} s, back in {took:.2f} s, predicted {predicted:.2f} s")
            until(live, lambda: anchored(live) == 9)
        assert live.supervisor.restarts == 9
