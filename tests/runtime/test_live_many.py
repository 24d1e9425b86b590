"""Many nodes on one machine, and every kind of link between processes."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from tests.machine import with_time
from tests.runtime.living import CHAIN, anchored, everybody_heard, living, until
from trigpoint.runtime.plan import TRANSPORTS

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "live.py"


@pytest.mark.slow
def test_forty_nodes_at_10_hz_keep_their_deadlines_and_their_memory():
    """The benchmark, smaller: no missed deadline beyond 1 %, memory flat, everybody anchored."""
    found = importlib.util.spec_from_file_location("live", BENCHMARK)
    live = importlib.util.module_from_spec(found)
    found.loader.exec_module(live)
    with_time(lambda _: keeps_up(live.main(40, 10.0, 20.0, 20)))


def keeps_up(figures):
    assert figures["share of deadlines missed"] < 0.01
    assert figures["estimates a second and node"] == pytest.approx(10.0, rel=0.02)
    assert abs(figures["growth of memory"]) < 0.02
    assert figures["anchored"] == 40


@pytest.mark.slow
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_processes_over_every_kind_of_link(transport, tmp_path):
    """Certificates are made for the run; the network converges."""
    with living(CHAIN, tmp_path, transport=transport) as live:
        until(live, lambda: everybody_heard(live))
        until(live, lambda: live.monitor.snapshot().error.max() < 1e-3)
        until(live, lambda: anchored(live) == 3)
        assert live.supervisor.restarts == 0
