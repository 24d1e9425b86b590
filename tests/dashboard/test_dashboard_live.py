"""The live feed: states, events, link quality, bounded memory, and the socket that it is told through."""

import asyncio
import json
import math

import numpy as np
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from tests.dashboard.feeds import (
    BASE,
    Nodes,
    connect,
    link,
    live,
    named,
    receive_all,
    receive_until,
    snapshot,
    status_of,
)
from trigpoint import graphs
from trigpoint.dashboard import STATES, LiveFeed, Scene, decode_moment, live_app
from trigpoint.dashboard.history import History
from trigpoint.dashboard.links import LinkBook
from trigpoint.errors import ArgumentError, ProtocolError, ShapeError, TrigpointError

NAMES = tuple("abcd")


def moment(feed):
    return decode_moment(feed.frame(feed.view().index))


def states(feed):
    return [STATES[int(code)] for code in moment(feed).state]


def test_before_the_first_snapshot_nothing_is_known():
    feed, _ = live()
    assert states(feed) == ["unknown"] * 4
    assert np.isnan(moment(feed).error).all()
    assert np.isinf(moment(feed).age).all()
    topology = feed.topology()
    assert json.loads(json.dumps(topology, allow_nan=False)) == topology
    assert (topology["mode"], topology["rate"], topology["norm"]) == ("live", 0.3, {"times": [], "values": []})
    assert topology["controls"] == ["pause", "go", "kill", "revive"]
    assert feed.traces(0)["times"] == []
    assert feed.details(0, 0)["estimate"] == []
    assert live(controls=False)[0].topology()["controls"] == []


def test_a_frame_is_the_snapshot():
    feed, _ = live()
    status = (status_of(uncertainty=0.1), status_of(missed=2.0, rejected=3.0), None, status_of())
    feed.absorb(snapshot(NAMES, 1.5, status=status, age=[0.1, 0.2, 0.3, 0.4], offset=0.5))
    shown = moment(feed)
    assert (shown.index, shown.time, shown.missed, shown.rejected) == (1, 1.5, 4.0, 3.0)
    np.testing.assert_allclose(shown.error, 0.5)
    assert shown.norm == pytest.approx(1.0)
    np.testing.assert_allclose(shown.age, [0.1, 0.2, 0.3, 0.4], rtol=1e-6)
    np.testing.assert_allclose(shown.uncertainty, [0.1, 0.25, np.nan, 0.25], rtol=1e-6)


@pytest.mark.parametrize(
    ("status", "age", "state"),
    [
        (status_of(), 0.0, "anchored"),
        (status_of(covered=False), 0.0, "uncovered"),
        (status_of(anchored=False), 0.0, "relative"),
        (status_of(anchored=False, covered=False), 0.0, "relative"),
        (status_of(), 0.51, "silent"),
        (status_of(paused=True), 0.51, "paused"),
        (None, 0.51, "silent"),
        (None, 0.0, "unknown"),
        (None, math.inf, "unknown"),
    ],
)
def test_what_a_node_is(status, age, state):
    feed, _ = live("a")
    feed.absorb(snapshot("a", status=(status,), age=[age]))
    assert states(feed) == [state]


def test_a_node_is_never_called_anchored_when_it_is_not_heard():
    feed, _ = live()
    feed.absorb(snapshot(NAMES, 1.0))
    feed.absorb(snapshot(NAMES, 2.0, age=[0.0, 9.0, math.inf, 0.0]))
    assert states(feed) == ["anchored", "silent", "unknown", "anchored"]


def test_the_last_estimate_of_a_silent_node_is_no_present_one():
    feed, _ = live()
    feed.absorb(snapshot(NAMES, 1.0, offset=0.5))
    feed.absorb(snapshot(NAMES, 2.0, offset=0.5, age=[0.0, 9.0, 0.0, 0.0]))
    shown = moment(feed)
    np.testing.assert_allclose(shown.error, [0.5, np.nan, 0.5, 0.5])
    np.testing.assert_allclose(shown.uncertainty, [0.25, np.nan, 0.25, 0.25])
    assert shown.norm == pytest.approx(0.5 * math.sqrt(3.0))
    trace = feed.traces(1)
    assert (trace["error"], trace["estimate"][0]) == ([0.5, None], [1.5, None])
    details = feed.details(1, 0)
    assert (details["estimate"], details["error"], details["truth"]) == ([], None, [1.0, 2.0])


def test_the_norm_waits_for_everybody():
    feed, _ = live()
    feed.absorb(snapshot(NAMES, 1.0, age=[0.0, math.inf, 0.0, 0.0]))
    assert math.isnan(moment(feed).norm)
    feed.absorb(snapshot(NAMES, 2.0))
    assert moment(feed).norm == pytest.approx(1.0)


@pytest.mark.parametrize("ordered", [False, True])
def test_a_paused_node_that_dies_is_silent(ordered):
    """Its last word was that it is paused; a paused node goes on to say so, every 0.5 s here."""
    feed, _ = live()
    said = [status_of(paused=not ordered) for _ in range(4)]
    for k in range(20):
        status = (said[k // 5], status_of(), status_of(), status_of())
        feed.absorb(snapshot(NAMES, 0.1 * k, status=status, age=[0.1 * k, 0.0, 0.0, 0.0]))
        if ordered and k == 0:
            feed.ordered("pause", 0)
    assert states(feed)[0] == "paused"
    for k in range(20, 45):
        status = (said[-1], status_of(), status_of(), status_of())
        feed.absorb(snapshot(NAMES, 0.1 * k, status=status, age=[0.1 * k, 0.0, 0.0, 0.0]))
    assert states(feed) == ["silent", "anchored", "anchored", "anchored"]


def test_an_order_to_pause_explains_the_silence():
    feed, _ = live()
    feed.absorb(snapshot(NAMES, 1.0))
    feed.ordered("pause", 1)
    feed.absorb(snapshot(NAMES, 2.0, age=[0.0, 9.0, 9.0, 0.0]))
    assert states(feed) == ["anchored", "paused", "silent", "anchored"]
    feed.ordered("go", 1)
    feed.absorb(snapshot(NAMES, 3.0, age=[0.0, 9.0, 9.0, 0.0]))
    assert states(feed)[1] == "silent"


def test_events_tell_what_changed_and_are_bounded():
    feed, _ = live()
    feed.absorb(snapshot(NAMES, 1.0))
    feed.absorb(snapshot(NAMES, 2.0, age=[0.0, 9.0, 0.0, 0.0]))
    feed.absorb(snapshot(NAMES, 2.5, status=(status_of(acts=3),) * 4, age=[0.0, 9.0, 0.0, 0.0]))
    feed.note("the plant stopped")
    count, events = feed.events(0)
    assert [(event.time, event.text, event.node) for event in events] == [
        (1.0, "4 nodes: anchored", None),
        (2.0, "b: silent (was anchored)", 1),
        *((2.5, f"{name}: started again", k) for k, name in enumerate(NAMES)),
        (2.5, "the plant stopped", None),
    ]
    assert feed.events(6) == (7, [events[6]])
    for k in range(600):
        feed.note(str(k))
    count, events = feed.events(0)
    assert (count, len(events), events[-1].text) == (607, 500, "599")
    assert feed.events(count)[1] == []


def test_link_quality_is_that_of_the_worse_direction():
    feed, _ = live("ab")

    def told(time, to_a, to_b):
        return snapshot("ab", time, status=(status_of(links=(link("b", *to_a),)), status_of(links=(link("a", *to_b),))))

    feed.absorb(told(0.0, (90.0, 10.0, 0.1), (100.0, 0.0, 0.2)))
    assert moment(feed).loss == pytest.approx([0.1])
    assert moment(feed).link_age == pytest.approx([0.2])
    feed.absorb(told(1.0, (10090.0, 10.0), (5100.0, 5000.0)))  # by far more than the memory: the last ones count
    assert moment(feed).loss == pytest.approx([0.5], rel=1e-3)
    assert moment(feed).traffic == pytest.approx(15000.0)


def test_a_restarted_node_counts_from_zero():
    book = LinkBook([[0, 1]], "ab")
    book.update(0, [link("b", 1000.0, 0.0)])
    book.update(0, [link("b", 50.0, 50.0)])
    assert book.total == 1050.0
    weight = 1.0 - math.exp(-1.0)
    assert book.loss == pytest.approx([0.5 * weight])
    book.update(0, [link("stranger", 1e9, 1e9)])
    assert book.total == 1050.0
    assert np.isnan(LinkBook([[0, 1]], "ab").loss).all()


def test_history_is_bounded_and_spans_the_whole_run():
    history = History(3, 2, budget=0)
    assert history.capacity == 100
    for k in range(1000):
        row = np.full(3, float(k))
        table = np.full((3, 2), float(k))
        history.append(time=k, norm=k, estimate=table, truth=table, error=row, uncertainty=row)
        times = history.column("time")
        assert len(times) <= 100
        assert len(times) >= min(k + 1, 50)
        assert set(np.diff(times)) <= {history.stride}
        assert times[0] == 0.0
        assert times[-1] > k - history.stride
    np.testing.assert_array_equal(history.of_node("error", 1), history.column("time"))
    assert history.of_node("estimate", 1).shape == (len(history.column("time")), 2)


def test_history_stays_within_its_budget():
    assert History(2500, 4, budget=2**26).capacity * 2500 * (2 * 4 + 2) * 4 <= 2**26
    assert History(1, 1).capacity == 4000


def test_traces_are_what_was_absorbed():
    feed, _ = live()
    for k in range(5):
        feed.absorb(snapshot(NAMES, 0.5 * k, offset=1.0 / (1 + k)))
    trace = feed.traces(2)
    assert trace["times"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert trace["error"] == pytest.approx([1.0, 1 / 2, 1 / 3, 1 / 4, 1 / 5])
    assert trace["estimate"][0] == pytest.approx([2.0, 1 + 1 / 2, 1 + 1 / 3, 1 + 1 / 4, 1 + 1 / 5])
    assert trace["truth"] == [[1.0] * 5, [2.0] * 5]
    assert trace["uncertainty"] == [0.25] * 5
    assert feed.topology()["norm"]["values"] == pytest.approx([2 / (1 + k) for k in range(5)])


def test_without_a_truth_no_error_is_claimed():
    feed, _ = live()
    feed.absorb(snapshot(NAMES, 0.0, known=False))
    assert np.isnan(moment(feed).error).all()
    assert math.isnan(moment(feed).norm)
    assert feed.traces(0)["truth"] == [[None], [None]]
    assert feed.details(0, 0)["truth"] == []


def test_details_are_the_nodes_own_words():
    feed, _ = live()
    links = (link("a", 90, 10, None), link("c", round_trip=None))
    feed.absorb(snapshot(NAMES, status=(None, status_of(links=links, hops=None, covered=False), None, None)))
    details = feed.details(1, 0)
    assert json.loads(json.dumps(details, allow_nan=False)) == details
    facts = dict(map(tuple, details["facts"]))
    assert facts["hops to an anchor"] is None
    assert facts["guarantee covers its links"] == "no"
    assert details["links"][0] == {
        "neighbour": "a", "state": "live", "age": None,
        "received": 90, "lost": 10, "round_trip": 1e-3, "offset": 1e-6,
    }  # fmt: skip
    assert details["links"][1]["round_trip"] is None
    assert "warning" not in facts
    late = status_of("b", clock_offset=0.1, floor=0.5)
    feed.absorb(snapshot(NAMES, status=(None, late, None, None)))
    assert feed.details(1, 0)["facts"][-1] == ["warning", late.warning]
    assert feed.details(0, 0)["facts"] == []
    for ask in (feed.traces, lambda node: feed.details(node, 0)):
        with pytest.raises(ProtocolError, match="node 4 is not in the network"):
            ask(4)


def test_misuse():
    graph = named(graphs.chain(4), NAMES)
    feed = LiveFeed(Nodes(graph), Scene(graph))
    with pytest.raises(ShapeError, match="3 nodes that are not the 4 watched"):
        feed.absorb(snapshot("abc"))
    for option in ("stale", "period"):
        with pytest.raises(ArgumentError, match=f"{option} must be a positive number of seconds"):
            LiveFeed(Nodes(graph), Scene(graph), **{option: 0.0})


# -- over the socket -------------------------------------------------------------------------------------------------


def client_of(feed):
    return TestClient(live_app(feed, token="secret"), base_url=BASE)


def test_a_page_follows():
    feed, _ = live(period=0.01)
    with client_of(feed) as client, connect(client) as session:
        assert receive_until(session, "topology")["names"] == list("abcd")
        assert receive_until(session, "state") == {"type": "state", "playing": True, "speed": 1.0}
        seen = [decode_moment(receive_until(session, bytes)) for _ in range(5)]
        indices = [shown.index for shown in seen]
        assert indices == sorted(set(indices))
        assert seen[-1].norm == pytest.approx(2 * math.exp(-0.3 * seen[-1].time), rel=1e-6)


def test_orders_reach_the_nodes_and_are_told():
    feed, nodes = live(period=0.01)
    with client_of(feed) as client, connect(client) as session:
        for order in ("pause", "go", "kill", "revive"):
            session.send_json({"type": "order", "order": order, "node": 2})
            assert receive_until(session, "done") == {"type": "done", "order": order, "node": 2}
        assert nodes.orders == [(order, "c") for order in ("pause", "go", "kill", "revive")]
        session.send_json({"type": "order", "order": "kill", "node": 1})
        receive_until(session, "done")
        session.send_json({"type": "order", "order": "kill", "node": 1})
        refused = receive_until(session, "refused")
        assert (refused["order"], refused["node"], refused["text"]) == ("kill", 1, "b is dead already")
        while states(feed)[1] != "silent":
            receive_until(session, bytes)
    texts = [event.text for event in feed.events(0)[1]]
    assert "c: kill ordered from the page" in texts


def test_a_chosen_node_is_told_of_with_every_frame():
    feed, _ = live(period=0.01)
    with client_of(feed) as client, connect(client) as session:
        session.send_json({"type": "select", "node": 1})
        assert receive_until(session, "trace")["node"] == 1
        times = [receive_until(session, "node")["time"] for _ in range(4)]
        assert times == sorted(times)
        assert times[0] < times[-1]
        session.send_json({"type": "select", "node": None})


@pytest.mark.parametrize(
    "command",
    [
        {"type": "play"},
        {"type": "seek", "frame": 0},
        {"type": "speed", "value": 1},
        {"type": "select", "node": 4},
        {"type": "select", "node": "a"},
        {"type": "order", "order": "kill", "node": 4},
        {"type": "order", "order": "kill", "node": True},
        {"type": "order", "order": "controls", "node": 0},
        {"type": "order", "order": "kill", "node": 0, "all": True},
        {"type": "select", "node": None, "text": "x" * 5000},
    ],
)
def test_what_cannot_be_done_closes_the_socket_and_touches_nothing(command):
    feed, nodes = live()
    with client_of(feed) as client, connect(client) as session:
        session.send_json(command)
        with pytest.raises(WebSocketDisconnect) as closed:
            receive_all(session)
        assert closed.value.code == 1008
        assert closed.value.reason
    assert nodes.orders == []


def test_a_page_that_can_only_look():
    feed, _ = live(controls=False)
    with client_of(feed) as client, connect(client) as session:
        session.send_json({"type": "order", "order": "kill", "node": 0})
        with pytest.raises(WebSocketDisconnect) as closed:
            receive_all(session)
    assert (closed.value.code, closed.value.reason[:29]) == (1008, "an order must be one of none:")


def test_the_end_is_told():
    feed, _ = live(period=0.01)
    with client_of(feed) as client, connect(client) as session:
        receive_until(session, bytes)
        feed.end("the run is over: 20 s")
        assert receive_until(session, "end")["text"] == "the run is over: 20 s"
        with pytest.raises(WebSocketDisconnect) as closed:
            receive_all(session)
        assert closed.value.code == 1000


def test_a_source_that_ends_the_feed_adds_no_frame():
    feed, nodes = live(period=0.01)

    def source():
        if nodes.clock > 0.25:
            feed.end("over")
        return nodes()

    feed._source = source
    with client_of(feed) as client, connect(client) as session:
        assert receive_until(session, "end")["text"] == "over"
    assert feed.count == 3


def test_a_source_that_fails_ends_the_feed():
    class Failing(Nodes):
        def __call__(self):
            if self.clock > 0.25:
                raise TrigpointError("the monitor lost its link")
            return super().__call__()

    graph = named(graphs.chain(4), NAMES)
    feed = LiveFeed(Failing(graph), Scene(graph), period=0.01)
    with client_of(feed) as client, connect(client) as session:
        assert "the monitor lost its link" in receive_until(session, "end")["text"]


@pytest.mark.parametrize("wrong", [tuple("abcx"), None])
def test_a_feed_that_cannot_go_on_says_so(wrong):
    """Snapshots of another network, or none: not a page that shows its last moment for ever."""

    def source():
        if wrong is None:
            raise ArgumentError("gone")
        return snapshot(wrong)

    feed = LiveFeed(source, Scene(named(graphs.chain(4), NAMES)), period=0.001)
    asyncio.run(asyncio.wait_for(feed.follow(), 60.0))
    assert feed.ended.startswith("The run cannot be followed any longer: ")
