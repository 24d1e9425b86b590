"""Runs and snapshots for the tests of the page: small, exact, without a network."""

import json
from dataclasses import dataclass, field

import numpy as np

from trigpoint import graphs
from trigpoint.dashboard import LiveFeed, Scene
from trigpoint.errors import ArgumentError
from trigpoint.graphs import MeasurementGraph
from trigpoint.observers.run import Run
from trigpoint.runtime import REASONS, Counters, LinkStatus, NodeStatus, Snapshot, State

BASE = "http://testserver"


def recorded(nodes=4, samples=6, step=0.05, seed=1, **tables):
    truth, estimate = np.random.default_rng(seed).normal(size=(2, samples, nodes, 2))
    status = np.full((samples, nodes), "anchored")
    names = tuple(f"<b>{k}" for k in range(nodes))
    messages = np.cumsum(np.full((samples, nodes), 2), axis=0)
    return Run(step * np.arange(samples), truth, estimate, messages, status, names, "stacked", **tables)


def link(neighbour, received=100, lost=0, age=0.02, round_trip=1e-3, offset=1e-6):
    return LinkStatus(neighbour, State.LIVE, age, received, lost, round_trip, offset)


def status_of(name="", **told):
    known = {
        "time": 0.0, "anchored": True, "covered": True, "paused": False, "hops": 1, "uncertainty": 0.25,
        "evidence_age": 0.1, "acts": 10, "missed": 1, "step_us": 120.0, "resets": 0, "innovation": 0.0,
        "clock_offset": 0.0, "floor": 0.0, "magnitude": 1.0, "links": (),
    }  # fmt: skip
    rejected = dict.fromkeys(REASONS, 0) | {"old": told.pop("rejected", 0)}
    return NodeStatus(name, **{**known, **told}, counters=Counters(100, rejected))


def named(graph, names):
    return MeasurementGraph(graph.n_nodes, graph.tail, graph.head, names=names)


def snapshot(names, time=0.0, *, status=None, age=None, offset=0.5, known=True):
    """Every node two numbers beside the truth (1, 2)."""
    n = len(names)
    truth = tuple(np.array([1.0, 2.0]) if known else None for _ in names)
    estimate = tuple(np.array([1.0 + offset, 2.0]) for _ in names)
    error = np.full(n, abs(offset) if known else np.nan)
    status = (status_of(),) * n if status is None else status
    return Snapshot(time, tuple(names), estimate, truth, status, np.zeros(n) if age is None else np.array(age), error)


@dataclass
class Nodes:
    """A network in which orders work: what the page's controls are tried on. Its clock is counted, not read."""

    graph: MeasurementGraph
    clock: float = 0.0
    orders: list = field(default_factory=list)
    dead: set = field(default_factory=set)
    lost: float = 0.0

    def __call__(self):
        self.clock += 0.1
        sent = 50.0 * self.clock
        heard = {name: [] for name in self.graph.names}
        for i, j in zip(self.graph.tail, self.graph.head, strict=True):
            if i >= 0:
                heard[self.graph.names[i]].append(self.graph.names[j])
                heard[self.graph.names[j]].append(self.graph.names[i])
        status = tuple(
            status_of(name, links=tuple(link(other, (1 - self.lost) * sent, self.lost * sent) for other in heard[name]))
            for name in self.graph.names
        )
        age = [9.0 if name in self.dead else 0.01 for name in self.graph.names]
        return snapshot(self.graph.names, self.clock, status=status, age=age, offset=np.exp(-0.3 * self.clock))

    def _order(self, order, name):
        self.orders.append((order, name))

    def pause(self, name):
        self._order("pause", name)

    def go(self, name):
        self._order("go", name)

    def kill(self, name):
        if name in self.dead:
            raise ArgumentError(f"{name} is dead already")
        self._order("kill", name)
        self.dead.add(name)

    def revive(self, name):
        self._order("revive", name)
        self.dead.discard(name)


def live(names="abcd", *, controls=True, **options):
    """A live feed of a chain whose first node has an absolute reading, and the nodes behind it."""
    graph = named(graphs.chain(len(names), anchors=(0,)), tuple(names))
    nodes = Nodes(graph)
    return LiveFeed(nodes, Scene(graph, title="chain", rate=0.3), nodes if controls else None, **options), nodes


def connect(client, token="secret", origin=BASE):
    headers = {} if origin is None else {"origin": origin}
    return client.websocket_connect(f"/ws?token={token}", headers=headers)


def receive(session):
    message = session.receive()
    session._raise_on_close(message)
    return json.loads(message["text"]) if message.get("text") is not None else message["bytes"]


def receive_until(session, kind):
    """The next frame (kind ``bytes``), or the next JSON message of the type ``kind``."""
    while True:
        message = receive(session)
        if (isinstance(message, bytes) and kind is bytes) or (isinstance(message, dict) and message["type"] == kind):
            return message


def receive_all(session):
    for _ in range(1000):
        receive(session)
    raise AssertionError("the socket stayed open")
