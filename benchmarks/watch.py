"""Frames a second of the live page in headless Chromium (software rendering), by number of nodes.

A grid with an absolute reading in a corner; every node's error changes with every snapshot, ten snapshots a second, so
that ten frames a second are the most. "server" is the time to take in one snapshot and encode its frame, once.
Run: python benchmarks/watch.py [SIDE ...]     (nodes a side; default 10 30 50)
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from tests.dashboard.chromium import Chromium
from tests.dashboard.feeds import Nodes, named, snapshot
from trigpoint import graphs
from trigpoint.dashboard import LiveFeed, Scene, live_app, serving

SECONDS = 10.0


class Noisy(Nodes):
    """Statuses are made once, so that the source itself costs nothing."""

    def __init__(self, graph):
        super().__init__(graph)
        self.status = super().__call__().status
        self.rng = np.random.default_rng(0)

    def __call__(self):
        self.clock += 0.1
        made = snapshot(self.graph.names, self.clock, status=self.status)
        made.error[:] = 10.0 ** self.rng.uniform(-3.0, 1.0, self.graph.n_nodes)
        return made


def measure(side):
    graph = graphs.grid(side, side, anchors=(0,))
    graph = named(graph, graph.names)
    places = [[k % side, k // side] for k in range(graph.n_nodes)]
    feed = LiveFeed(Noisy(graph), Scene(graph, positions=places), period=0.1)
    began = time.perf_counter()
    for _ in range(10):
        feed.absorb(feed._source())
        size = len(feed.frame(feed.count))
    server = (time.perf_counter() - began) / 10
    with serving(live_app(feed)) as url, Chromium() as browser:
        page = browser.open(url).ready()
        time.sleep(2.0)
        before, began = page.state(), time.perf_counter()
        time.sleep(SECONDS)
        after, lasted = page.state(), time.perf_counter() - began
        assert page.complaints() == []
    shown, drawn = ((after[name] - before[name]) / lasted for name in ("received", "draws"))
    print(f"{graph.n_nodes:6d} nodes {size:8d} bytes a frame {1e3 * server:7.1f} ms server", end="")
    print(f" {shown:6.1f} frames/s received {drawn:6.1f} frames/s drawn", flush=True)


if __name__ == "__main__":
    for side in [int(word) for word in sys.argv[1:]] or [10, 30, 50]:
        measure(side)
