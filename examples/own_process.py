"""One process a node: each gets its own settings and nothing else, messages travel between neighbours only."""

import tempfile
import time
from pathlib import Path

import numpy as np

import trigpoint as tp
from trigpoint.runtime import (
    Instrument,
    LivePlan,
    Monitor,
    NodeSettings,
    Part,
    PlantSettings,
    Supervisor,
    SystemClock,
    ZenohTransport,
    free_addresses,
    linked,
)  # fmt: skip

PERIOD = 0.02
problem = tp.NetworkedAgents(tp.graphs.cycle(4, anchors=[0]), tp.LinearAgent.static())
observer = tp.design(problem, tp.methods.LocalKalman())
truth, graph = np.array([1.0, 4.0, 2.0, 3.0]), problem.graph

# What each node is told: its program, its neighbours' addresses, who else may speak to it.
with tempfile.TemporaryDirectory() as folder:
    addresses = free_addresses("unixsock", [*graph.names, "watcher"], Path(folder))
    guests = {"plant": "sensor", "watcher": "supervisor"}
    nodes = [NodeSettings("ring", observer.local(k), PERIOD, coverage="every", guests=guests) for k in range(4)]

    # A process that plays the world: constants, and one instrument an arc.
    parts = tuple(Part(np.zeros((1, 1)), np.array([value])) for value in truth)
    rows = graph.incidence().toarray().T
    instruments = tuple(
        Instrument(arc, tuple((node, np.array([[rows[arc, node]]])) for node in np.flatnonzero(rows[arc])))
        for arc in range(graph.n_arcs)
    )
    shows = tuple((name, node) for node, name in enumerate(graph.names))
    plant = PlantSettings("ring", "plant", PERIOD, parts, instruments, shows, peers=addresses)

    plan = LivePlan(
        "ring", linked(nodes, addresses), plant, Path(folder), "watcher", addresses["watcher"], None, 1, {}
    )  # fmt: skip
    clock = SystemClock()
    links = ZenohTransport(plan.listen, [node.listen for node in plan.nodes])
    monitor = Monitor(links, plan.network, [node.program for node in nodes], clock)
    supervisor = Supervisor(plan, clock, links)
    supervisor.start()
    limit = clock.now() + 60.0
    try:
        while not monitor.snapshot().error.max() < 1e-2 and clock.now() < limit:  # NaN: somebody is not heard yet
            monitor.poll()
            supervisor.tick()
            time.sleep(0.02)
        snapshot, pids = monitor.snapshot(), set(supervisor.pids.values())
    finally:
        supervisor.stop()
        links.close()

print(f"after {snapshot.time:.1f} s four processes believe {np.concatenate(snapshot.estimate)}")
assert len(pids) == 4
assert snapshot.error.max() < 1e-2
