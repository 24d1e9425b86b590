"""The application: the page, its headers, and a socket that only its own page with the token may open."""

import re
import subprocess
import sys
import urllib.request
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

import trigpoint.dashboard
from tests.dashboard.feeds import BASE, connect, receive, receive_all, receive_until, recorded
from tests.machine import free_port, listening
from trigpoint import graphs
from trigpoint.dashboard import Scene, decode_moment, page_url, replay_app, serve, serving
from trigpoint.errors import ArgumentError, MissingExtraError, ShapeError

FOLDER = Path(trigpoint.dashboard.__file__).parent
STATIC = FOLDER / "static"
CHAIN = Scene(graphs.chain(4))


def client_of(run, **options):
    return TestClient(replay_app(run, CHAIN, token="secret", **options), base_url=BASE)


def test_frames_decode_to_the_numbers_of_the_run():
    run = recorded()
    with client_of(run) as client, connect(client) as session:
        topology = receive(session)
        assert topology["type"] == "topology"
        assert topology["names"] == list(run.names)
        seen = []
        while len(seen) == 0 or seen[-1] < 5:
            message = receive(session)
            if isinstance(message, dict):
                assert message["type"] == "state"
                continue
            shown = decode_moment(message)
            k = shown.index
            assert shown.time == run.times[k]
            np.testing.assert_allclose(shown.error, np.linalg.norm(run["error"][k], axis=1), rtol=1e-6)
            seen.append(k)
        assert seen == sorted(set(seen))
        assert seen[0] == 0
        assert receive_until(session, "state")["playing"] is False


def test_the_page_pauses_seeks_and_traces():
    run = recorded(samples=50, step=10.0)
    with client_of(run) as client, connect(client) as session:
        receive_until(session, bytes)
        session.send_json({"type": "pause"})
        while receive_until(session, "state")["playing"]:
            pass
        session.send_json({"type": "seek", "frame": 42})
        assert decode_moment(receive_until(session, bytes)).time == pytest.approx(420.0)
        session.send_json({"type": "select", "node": 2})
        trace = receive_until(session, "trace")
        assert receive_until(session, "node")["time"] == pytest.approx(420.0)
        assert trace["error"] == pytest.approx(np.linalg.norm(run["error"][:, 2], axis=1).tolist())
        session.send_json({"type": "speed", "value": 100})
        assert receive_until(session, "state")["speed"] == 100


@pytest.mark.parametrize(
    "text",
    ["{", "null", '{"type": "seek", "frame": 6}', '{"type": "select", "node": -1}', '{"type": "speed", "value": 0}'],
)
def test_a_bad_command_closes_the_socket_with_a_reason(text):
    with client_of(recorded()) as client, connect(client) as session:
        session.send_text(text)
        with pytest.raises(WebSocketDisconnect) as closed:
            receive_all(session)
        assert closed.value.code == 1008
        assert closed.value.reason


def test_binary_from_the_page_is_no_command():
    with client_of(recorded()) as client, connect(client) as session:
        session.send_bytes(b"\x00")
        with pytest.raises(WebSocketDisconnect) as closed:
            receive_all(session)
        assert closed.value.code == 1008


@pytest.mark.parametrize(
    ("token", "origin"),
    [
        ("wrong", BASE),
        ("", BASE),
        ("%F0%9F%98%80", BASE),
        ("secret", "http://evil.example"),
        ("secret", "http://testserver:1"),
        ("secret", "http://testserver.evil.example"),
        ("secret", "null"),
        ("secret", "http://[broken"),
        ("secret", None),
    ],
)
def test_the_socket_refuses_strangers(token, origin):
    with client_of(recorded()) as client, pytest.raises(WebSocketDisconnect) as closed, connect(client, token, origin):
        pass
    assert closed.value.code == 4403


def test_the_page_needs_its_token_and_carries_a_strict_policy():
    with client_of(recorded()) as client:
        for query in ("", "?token=", "?token=wrong"):
            refused = client.get(f"/{query}")
            assert refused.status_code == 403
            assert "token" in refused.text
        for path in ("/?token=secret", "/static/app.js", "/static/page.css", "/?token=wrong"):
            headers = client.get(path).headers
            policy = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
            assert headers["content-security-policy"].startswith(policy)
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["referrer-policy"] == "no-referrer"
            assert headers["cache-control"] == "no-store"
        assert client.get("/?token=secret").status_code == 200
        assert client.get("/static/../app.py").status_code == 404
        assert client.get("/static/%2e%2e/app.py").status_code == 404
        assert client.post("/?token=secret").status_code == 405


def test_the_page_asks_nothing_of_any_other_host():
    class Reader(HTMLParser):
        def handle_starttag(self, _, attrs):
            for name, value in attrs:
                assert not name.startswith("on")
                assert name != "style"
                if name in {"src", "href"}:
                    assert value.startswith("/static/")
                    assert (STATIC / value.removeprefix("/static/")).is_file()

    Reader().feed((STATIC / "index.html").read_text("utf-8"))
    for source in (FOLDER / "web" / "src").iterdir():
        text = source.read_text("utf-8").replace('xmlns="http://www.w3.org/2000/svg"', "")
        assert not re.search(r"https?://|innerHTML|insertAdjacent|eval\(|fetch\(|url\(|import\(", text), source.name


def test_a_random_token_stands_in_the_address():
    run = recorded()
    first, second = (replay_app(run, CHAIN) for _ in range(2))
    assert first.state.token != second.state.token
    assert len(first.state.token) >= 32
    assert page_url(first, 80) == f"http://127.0.0.1:80/?token={first.state.token}"
    assert page_url(replay_app(run, CHAIN, token="a&b"), 80).endswith("?token=a%26b")


def test_serve_binds_this_machine_only(monkeypatch, capsys):
    import uvicorn

    called = {}

    def run(server, sockets):
        called.update(config=server.config, places=[one.getsockname() for one in sockets])
        raise KeyboardInterrupt  # as it does once it has ended in order

    monkeypatch.setattr(uvicorn.Server, "run", run)
    app, port = replay_app(recorded(), CHAIN, token="secret"), free_port()
    serve(app, port)
    assert called["places"] == [("127.0.0.1", port)]
    assert (called["config"].app, called["config"].access_log) == (app, False)
    assert called["config"].ws_max_size <= 16384
    printed = capsys.readouterr()
    assert printed.out == ""
    assert f"http://127.0.0.1:{port}/?token=secret" in printed.err


def test_serve_says_nothing_of_an_address_that_another_has(capsys):
    app = replay_app(recorded(), CHAIN)
    with serving(app) as url:
        port = int(url.split(":")[2].split("/")[0])
        with pytest.raises(ArgumentError, match=f"port {port} on 127.0.0.1 cannot be had"):
            serve(app, port)
    assert capsys.readouterr().err == ""


def test_serving_in_a_thread_answers_and_ends():
    app = replay_app(recorded(), CHAIN, token="secret")
    with serving(app) as url:
        assert url.startswith("http://127.0.0.1:")
        port = int(url.split(":")[2].split("/")[0])
        with urllib.request.urlopen(url) as answer:
            assert answer.status == 200
        with pytest.raises(ArgumentError, match=f"port {port} on 127.0.0.1 cannot be had"), serving(app, port):
            pass
        assert {host for host, known in listening() if known == port} == {"0100007F"}  # no address but 127.0.0.1
    assert port not in {known for _, known in listening()}


@pytest.mark.parametrize("port", [0, 65536, "80", True])
def test_serve_refuses_what_is_no_port(port):
    with pytest.raises(ArgumentError, match="port must be a whole number"):
        serve(replay_app(recorded(), CHAIN), port)


def test_misuse():
    with pytest.raises(ShapeError, match="graph has 3 nodes"):
        replay_app(recorded(), Scene(graphs.chain(3)))
    with pytest.raises(ArgumentError, match="token must not be empty"):
        replay_app(recorded(), CHAIN, token="")
    with pytest.raises(ArgumentError, match="speed must be positive"):
        replay_app(recorded(), CHAIN, speed=0.0)


def test_importing_the_package_loads_no_server():
    code = "import sys, trigpoint.dashboard; print({'starlette', 'uvicorn', 'websockets'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_missing_packages_are_named_at_use(monkeypatch):
    app = replay_app(recorded(), CHAIN)
    for package in ("uvicorn", "websockets"):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, package, None)
            with pytest.raises(MissingExtraError, match=rf"'{package}'.*trigpoint\[dashboard\]"):
                serve(app, 8123)
    monkeypatch.delitem(sys.modules, "trigpoint.dashboard._server")
    monkeypatch.setitem(sys.modules, "starlette.applications", None)
    with pytest.raises(MissingExtraError, match=r"'starlette'.*trigpoint\[dashboard\]"):
        replay_app(recorded(), CHAIN)
