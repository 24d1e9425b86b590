"""A network that grows while a page shows it: nodes that join come last, everything else stays."""

import numpy as np
import pytest
from starlette.testclient import TestClient

from tests.dashboard.chromium import Chromium
from tests.dashboard.feeds import BASE, Nodes, connect, live, named, receive, receive_until, snapshot
from trigpoint import graphs
from trigpoint.dashboard import LiveFeed, Scene, decode_moment, live_app, serving
from trigpoint.dashboard.history import History
from trigpoint.dashboard.told import places_beside
from trigpoint.errors import ShapeError
from trigpoint.graphs import EXTERNAL, MeasurementGraph


def larger(count=4):
    """The chain of ``live`` and a newcomer beside its second and last node."""
    chain = graphs.chain(count, anchors=(0,))
    names = (*"abcdefgh"[:count], "new")
    graph = MeasurementGraph(count + 1, [*chain.tail, 1, count - 1], [*chain.head, count, count], names=names)
    return Scene(graph, title="chain", rate=0.3, joined=(count,))


def grown(feed, nodes, count=4):
    """What the source does when a node has joined."""
    scene = larger(count)
    nodes.graph = scene.graph
    feed.extend(scene)


def test_a_newcomer_comes_last_and_the_rest_stays():
    feed, nodes = live()
    for _ in range(5):
        feed.absorb(nodes())
    before, edition = feed.topology(), feed.edition
    grown(feed, nodes)
    assert feed.topology() == {**before, "norm": feed.topology()["norm"]}  # not before its first snapshot
    feed.absorb(nodes())
    after = feed.topology()
    assert feed.edition == edition + 1
    assert (feed.names, after["names"]) == ((*"abcd", "new"), [*"abcd", "new"])
    assert after["joined"] == [4]
    assert (after["x"][:4], after["y"][:4]) == (before["x"], before["y"])
    assert sorted(map(tuple, after["arcs"])) == [(0, 1), (1, 2), (1, 4), (2, 3), (3, 4)]
    moment = decode_moment(feed.frame(0))
    assert (moment.error.shape[0], moment.loss.shape[0]) == (5, 5)
    assert np.isfinite(moment.norm)
    traces = feed.traces(4)
    assert len(traces["times"]) == 6
    assert traces["error"][:5] == [None] * 5
    assert traces["error"][5] is not None
    assert len(feed.traces(0)["error"]) == 6
    assert None not in feed.traces(0)["error"]
    assert ["joined the run while it went on", "yes"] in feed.details(4, 0)["facts"]
    assert ["joined the run while it went on", "yes"] not in feed.details(3, 0)["facts"]
    assert [link["neighbour"] for link in feed.details(1, 0)["links"]] == ["a", "c", "new"]


def test_the_norm_does_not_wait_for_a_newcomer_without_a_truth():
    feed, nodes = live()
    feed.absorb(nodes())
    grown(feed, nodes)
    told = nodes()
    blind = type(told)(told.time, told.names, told.estimate, (*told.truth[:4], None), told.status, told.age,
                       np.array([*told.error[:4], np.nan]))  # fmt: skip
    feed.absorb(blind)
    moment = decode_moment(feed.frame(0))
    assert moment.norm == pytest.approx(np.linalg.norm(told.error[:4]))
    assert np.isnan(moment.error[4])


def test_other_names_than_those_told_of_are_refused():
    for names in ((*"abcd", "other"), (*"abc", "new"), ("new", *"abcd")):
        feed, nodes = live()
        feed.absorb(nodes())
        with pytest.raises(ShapeError, match="are not the 4 watched"):
            feed.absorb(snapshot(names))
        feed.extend(larger())
        with pytest.raises(ShapeError, match="are not the 4 watched"):
            feed.absorb(snapshot(names))


def test_history_grows_with_the_nodes_and_goes_on():
    history = History(2, 3, 0)

    def sample(k, nodes):
        table, each = np.full((nodes, 3), float(k)), np.arange(nodes) + float(k)
        return {"time": k, "norm": 1.0, "estimate": table, "truth": table, "error": each, "uncertainty": each}

    for k in range(150):
        history.append(**sample(k, 2))
    more = history.grown(3)
    assert (more.capacity, more.stride) == (history.capacity, history.stride)
    np.testing.assert_array_equal(more.column("time"), history.column("time"))
    np.testing.assert_array_equal(more.of_node("error", 1), history.of_node("error", 1))
    assert np.isnan(more.of_node("estimate", 2)).all()
    for k in range(150, 300):
        more.append(**sample(k, 3))
    times = more.column("time")
    assert np.ptp(np.diff(times)) == 0.0
    assert times[-1] >= 296.0
    assert more.of_node("error", 2)[-1] == times[-1] + 2.0


def test_a_newcomer_lies_beside_its_neighbours_and_on_nobody():
    graph = graphs.grid(3, 3, anchors=(4,))
    places = np.array([[k % 3, k // 3] for k in range(9)], dtype=float)
    tail, head = [*graph.tail, 4, EXTERNAL, 9, 2], [*graph.head, 9, 10, 11, 12]
    found = places_beside(places, MeasurementGraph(13, tail, head))
    np.testing.assert_array_equal(found[:9], places)
    apart = np.linalg.norm(found[:, None] - found[None], axis=2) + 9.0 * np.eye(13)
    assert apart.min() > 0.1
    assert np.linalg.norm(found[12] - places[2]) < 0.5


def test_a_page_is_told_before_the_larger_frames_come():
    feed, nodes = live(period=0.02)
    with TestClient(live_app(feed, token="secret"), base_url=BASE) as client, connect(client) as session:
        assert receive(session)["names"] == list("abcd")
        receive_until(session, bytes)
        session.send_json({"type": "select", "node": 3})
        grown(feed, nodes)
        size = 4
        while size == 4:
            message = receive(session)
            if isinstance(message, bytes):
                assert decode_moment(message).error.shape[0] == size
            elif message["type"] == "topology":
                size = len(message["names"])
        assert decode_moment(receive_until(session, bytes)).error.shape[0] == 5
        session.send_json({"type": "select", "node": 4})
        while receive_until(session, "trace")["node"] != 4:
            pass


@pytest.mark.browser
def test_the_page_draws_a_newcomer_and_keeps_what_was_chosen():
    feed, nodes = live(period=0.05)
    with Chromium() as browser, serving(live_app(feed)) as url:
        page = browser.open(url + "#colour=state&links=age&node=c").ready()
        page.until("trigpoint.state().selected === 2 && trigpoint.state().plots.norm.points > 2")
        before = page.state()
        grown(feed, nodes)
        page.until("trigpoint.state().nodes === 5")
        page.until(f"trigpoint.state().received > {before['received'] + 5}")
        state = page.state()
        assert (state["joined"], state["links"], state["layer"], state["selected"]) == ([4], 5, "state", 2)
        assert state["plots"]["norm"]["points"] > before["plots"]["norm"]["points"]
        assert page.run("document.querySelector('#title').textContent").endswith("5 nodes, 5 links")
        assert page.run("[...document.querySelectorAll('#names option')].map(o => o.value)") == [*"abcd", "new"]
        assert page.run("document.querySelectorAll('#layers input').length") == 4
        page.click_node(4)
        page.until("document.querySelector('#chosen').textContent === 'Node new'")
        page.until("document.querySelector('#facts').textContent.includes('joined the run while it went on')")
        place = page.run("trigpoint.at(4)")
        page.point(place["x"], place["y"])
        page.until("document.querySelector('#tip').textContent.includes('joinedwhile the run went on')")
        page.run("document.querySelector('#network').focus()")
        page.press("Escape", 27)
        page.until("trigpoint.state().selected === -1")
        assert page.complaints() == []
        page.close()


def test_a_scene_without_newcomers_says_so():
    assert live()[0].topology()["joined"] == []
    graph = named(graphs.chain(2), ("a", "b"))
    assert LiveFeed(Nodes(graph), Scene(graph, joined=(1,))).topology()["joined"] == [1]
