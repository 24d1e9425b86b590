"""What a live node's protocol costs without its transport (CPU time, one thread).

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/node.py [side of the grid]
"""

import sys
import time

import numpy as np

import trigpoint as tp
from trigpoint.runtime import SENSOR, LinearPlant, MemoryNetwork, NodeSettings, run_virtual

PERIOD = 0.02
SECONDS = 4.0


def main(side):
    agent = tp.LinearAgent([[0.0, 1.0], [-1.0, 0.0]], [[1.0, 0.0]])
    graph = tp.graphs.grid(side, side, anchors=[0])
    observer = tp.design(tp.NetworkedAgents(graph, agent), tp.methods.LocalKalman())
    programs = [observer.local(node) for node in range(graph.n_nodes)]
    settings = [NodeSettings("net", program, PERIOD, guests={SENSOR: "sensor"}) for program in programs]
    links = [(name, program.name) for program in programs for name in program.hears]
    network = MemoryNetwork([*links, *((SENSOR, program.name) for program in programs)], delay=0.003, calm=[SENSOR])
    last = {}
    begun = time.process_time()
    plant = LinearPlant.of(programs, [np.ones(2)] * len(programs))
    run_virtual(settings, plant, np.array([SECONDS]), network, watch=lambda _, machines: last.update(machines))
    spent = time.process_time() - begun
    acts = sum(machine.status.acts for machine in last.values())
    frames = sum(machine.counters.accepted for machine in last.values())
    microseconds = 1e6 * spent / acts
    bytes_each = 32 + len(programs[-1].name) + 8 * (4 + agent.n_states)
    print(f"{len(programs)} nodes, {len(links) / len(programs):.1f} neighbours each, {frames / acts:.1f} frames an act")
    print(f"{microseconds:.0f} microseconds an act, with its frames, its plant and the memory network")
    print(f"agents a core at 10 Hz: {1e5 / microseconds:.0f}; at 50 Hz: {2e4 / microseconds:.0f}")
    print(f"bytes of one estimate: {bytes_each}; a second over one link at 50 Hz: {50 * bytes_each}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8)
