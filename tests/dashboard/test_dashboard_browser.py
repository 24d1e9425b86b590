"""The page in a real Chromium: it draws, answers mouse and keyboard, asks for nothing outside, and lets nobody in."""

import io
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from matplotlib.image import imread

from tests.dashboard.chromium import Chromium
from tests.dashboard.feeds import Nodes, live, named, recorded
from tests.machine import PATIENCE, unit
from trigpoint import graphs
from trigpoint.dashboard import LiveFeed, Scene, live_app, replay_app, serving

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser():
    with Chromium() as running:
        yield running


@contextmanager
def shown(browser, app, words=""):
    with serving(app) as url:
        page = browser.open(url + words).ready()
        yield page
        assert page.complaints() == []
        port = url.split(":")[2].split("/")[0]
        assert all(asked.split("//")[1].startswith(f"127.0.0.1:{port}/") for asked in page.requests()), page.requests()
        page.close()


def replayed(samples=200, step=1.0, **options):
    return replay_app(recorded(9, samples, step), Scene(graphs.grid(3, 3, anchors=(0,)), title="run.npz"), **options)


def pixel(page, place):
    picture = imread(io.BytesIO(page.screenshot()))
    return (255 * picture[round(place["y"]), round(place["x"]), :3]).round().astype(int)


def test_nodes_are_drawn_in_the_colours_of_their_states(browser):
    feed, nodes = live("abcdef", period=0.05)
    nodes.dead.add("c")
    with shown(browser, live_app(feed), "#colour=state") as page:
        page.until("trigpoint.state().colours === 2")
        state = page.state()
        assert (state["mode"], state["nodes"], state["links"], state["layer"]) == ("live", 6, 5, "state")
        page.painted()
        for node in (1, 2, 5):
            colour = state["colourOf"][node]
            wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
            np.testing.assert_allclose(pixel(page, page.run(f"trigpoint.at({node})")), wanted, atol=3)
        page.until("document.querySelector('#tile-anchored').textContent === '5 of 6'")
        page.until("document.querySelector('#legend').textContent.startsWith('anchored 5relative 0silent 1')")
        page.until("document.querySelector('#pill').textContent === 'Live'")
        assert page.run("trigpoint.sources.length") == 64


def test_a_click_on_a_node_shows_its_traces(browser):
    feed, _ = live("abcd", period=0.05)
    with shown(browser, live_app(feed)) as page:
        page.click_node(2)
        page.until("trigpoint.state().selected === 2 && trigpoint.state().plots.estimate.points > 3")
        plots = page.state()["plots"]
        assert plots["estimate"]["labels"] == ["estimate 1", "estimate 2", "true 1", "true 2"]
        assert plots["error"]["labels"] == ["error", "stated uncertainty"]
        assert plots["norm"]["labels"] == ["error norm", "guaranteed rate 0.3 /s"]
        before = plots["estimate"]["points"]
        page.until(f"trigpoint.state().plots.estimate.points > {before}")
        page.until("document.querySelector('#chosen').textContent === 'Node c'")
        cells = page.run(
            "[...document.querySelectorAll('#links tbody tr')].map(r => [...r.cells].map(c => c.textContent))"
        )
        assert [row[:3] for row in cells] == [["b", "live", "20 ms"], ["d", "live", "20 ms"]]
        assert page.run("document.querySelectorAll('#estimate-plot canvas').length") == 1


def test_orders_go_out_by_buttons(browser):
    feed, nodes = live("abcd", period=0.05)
    with shown(browser, live_app(feed), "#node=b") as page:
        page.until("!document.querySelector('#orders').hidden")
        page.click_element("#order-kill")
        page.until("document.querySelector('#badge').textContent === 'silent'")
        assert nodes.orders == [("kill", "b")]
        page.click_element("#order-kill")
        page.until("document.querySelector('#answer').textContent === 'kill was refused: b is dead already'")
        page.click_element("#order-revive")
        page.until("document.querySelector('#badge').textContent === 'anchored'")
        page.click_element("#order-pause")
        page.click_element("#order-go")
        page.until("document.querySelector('#answer').textContent === 'go: done'")
        assert [order for order, _ in nodes.orders] == ["kill", "revive", "pause", "go"]
        page.until("document.querySelector('#events').textContent.includes('b: silent (was anchored)')")


def test_who_can_only_look_has_no_buttons(browser):
    feed, _ = live("abcd", controls=False, period=0.05)
    with shown(browser, live_app(feed), "#node=b") as page:
        page.until("trigpoint.state().selected === 1")
        assert page.run("document.querySelector('#orders').hidden")
        assert page.run("document.querySelectorAll('#orders button').length") == 0


def test_the_pointer_and_the_keyboard_find_nodes(browser):
    feed, _ = live("abcd", period=0.05)
    with shown(browser, live_app(feed)) as page:
        place = page.run("trigpoint.at(3)")
        page.point(place["x"], place["y"])
        page.until("!document.querySelector('#tip').hidden")
        page.until("document.querySelector('#tip').textContent.startsWith('dstateanchorederror')")
        page.run("document.querySelector('#network').focus()")
        page.press("ArrowRight", 39)
        page.until("trigpoint.state().selected === 0")
        way = "ArrowRight" if page.run("trigpoint.at(1).x > trigpoint.at(0).x") else "ArrowLeft"
        page.press(way, {"ArrowRight": 39, "ArrowLeft": 37}[way])
        page.until("trigpoint.state().selected === 1")
        page.until("location.hash.includes('node=b')")
        page.press("Escape", 27)
        page.until("trigpoint.state().selected === -1")


def test_layers_are_switched(browser):
    feed, nodes = live("abcd", period=0.05)
    nodes.lost = 0.25
    with shown(browser, live_app(feed)) as page:
        for layer, text in (
            ("uncertainty", "stated uncertainty"),
            ("age", "last heard"),
            ("error", "error of"),
        ):
            page.click_element(f"input[name=layer][value={layer}]")
            page.until(f"trigpoint.state().layer === '{layer}'")
            page.until(f"document.querySelector('#legend').textContent.includes('{text}')")
        page.run("document.querySelector('#link-layer').value = 'age'")
        page.run("document.querySelector('#link-layer').dispatchEvent(new Event('change'))")
        page.until("document.querySelector('#legend').textContent.includes('link: last message')")
        page.until("location.hash === '#colour=error&links=age'")


def test_a_replay_pauses_seeks_and_runs_faster(browser):
    with shown(browser, replayed(), "#node=<b>4") as page:
        assert page.state()["mode"] == "replay"
        page.until("trigpoint.state().plots.norm.points === 200")
        page.until("document.querySelector('#chosen').textContent === 'Node <b>4'")  # text, never markup
        page.click_element("#play")
        page.until("document.querySelector('#play').textContent === 'Play'")
        seek = "document.querySelector('#seek')"
        page.run(f"{seek}.value = 150; {seek}.dispatchEvent(new Event('input'))")
        page.until("trigpoint.state().time === 150")
        page.run(f"{seek}.focus()")
        page.press("ArrowRight", 39)
        page.until("trigpoint.state().time === 151")
        page.run("document.querySelector('#speed').value = '100'")
        page.run("document.querySelector('#speed').dispatchEvent(new Event('change'))")
        page.run("document.activeElement.blur()")
        page.press(" ", 32)
        page.until("trigpoint.state().time === 199 && document.querySelector('#play').textContent === 'Play'")


def test_the_end_of_the_connection_is_said(browser):
    with serving(replayed()) as url:
        page = browser.open(url).ready()
    page.until("trigpoint.state().ended !== ''")
    page.until("document.querySelector('#banner').textContent.includes('has stopped')")
    page.until("document.querySelector('#play').disabled")
    page.until("document.querySelector('#pill').textContent === 'Ended'")
    page.close()


def test_a_wrong_token_shows_nothing(browser):
    with serving(replayed(token="secret")) as url:
        page = browser.open(url.replace("secret", "wrong"))
        page.until("document.body !== null && document.body.textContent.includes('lacks its token')")
        assert page.run("typeof trigpoint") == "undefined"
        page.close()


class Elsewhere(BaseHTTPRequestHandler):
    """Somebody else's page, without any policy of its own."""

    def do_GET(self):
        body = b"<!DOCTYPE html><title>elsewhere</title>"
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


def test_a_page_of_another_origin_is_refused(browser):
    other = ThreadingHTTPServer(("127.0.0.1", 0), Elsewhere)
    thread = threading.Thread(target=other.serve_forever)
    thread.start()
    try:
        with serving(replayed(token="secret")) as url:
            page = browser.open(f"http://127.0.0.1:{other.server_port}/")
            page.until("document.title === 'elsewhere'")
            address = url.replace("http", "ws").replace("/?", "/ws?")
            opened = page.run(
                f"new Promise(done => {{ const s = new WebSocket('{address}');"
                " s.onopen = () => done(true); s.onclose = () => done(false); })"
            )
            assert opened is False
            page.close()
    finally:
        other.shutdown()
        other.server_close()
        thread.join()


def test_dark_paper_has_dark_colours():
    with Chromium(dark=True) as dark, shown(dark, replayed()) as page:
        page.painted()
        red, green, blue = pixel(page, {"x": 4, "y": 795})
        assert max(red, green, blue) < 60
        assert page.run("getComputedStyle(document.body).color") == "rgb(230, 235, 240)"


@pytest.mark.slow
def test_2500_nodes_are_drawn_several_times_a_second():
    graph = graphs.grid(50, 50, anchors=(0,))
    feed = LiveFeed(Nodes(named(graph, graph.names)), Scene(graph), period=0.1)
    with Chromium() as fresh, shown(fresh, live_app(feed)) as page:
        assert (page.state()["nodes"], page.state()["links"]) == (2500, 4900)
        before, drawn, spent = unit(), page.state()["draws"], fresh.processor_seconds()
        page.until(f"trigpoint.state().draws >= {drawn + 20}", seconds=5.0 * PATIENCE)
        spent = (fresh.processor_seconds() - spent) / (page.state()["draws"] - drawn)
        units = spent / max(before, unit())
        assert units < 100.0, f"{units:.0f} units, {spent:.2f} s, a frame"  # a second where a unit takes 10 ms
        page.click_node(1275)
        page.until("trigpoint.state().selected === 1275 && trigpoint.state().plots.estimate.points > 3")
