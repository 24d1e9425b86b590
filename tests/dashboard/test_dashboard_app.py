"""The application: the page, its headers, and a socket that only its own page with the token may open."""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

import trigpoint.dashboard
from trigpoint import graphs
from trigpoint.dashboard import decode_frame, page_url, replay_app, serve
from trigpoint.errors import ArgumentError, MissingExtraError, ShapeError
from trigpoint.observers.run import Run

BASE = "http://testserver"
STATIC = Path(trigpoint.dashboard.__file__).parent / "static"


def recorded(samples=6, step=0.05):
    truth, estimate = np.random.default_rng(1).normal(size=(2, samples, 4, 2))
    status = np.full((samples, 4), "anchored")
    times = step * np.arange(samples)
    return Run(times, truth, estimate, np.zeros((samples, 4), np.int64), status, tuple("abcd"), "stacked")


def client_of(run, **options):
    return TestClient(replay_app(run, graphs.chain(4), token="secret", **options), base_url=BASE)


def connect(client, token="secret", origin=BASE):
    headers = {} if origin is None else {"origin": origin}
    return client.websocket_connect(f"/ws?token={token}", headers=headers)


def receive(session):
    message = session.receive()
    return json.loads(message["text"]) if message.get("text") is not None else message["bytes"]


def receive_until(session, kind):
    """The next frame (kind ``bytes``), or the next JSON message of the type ``kind``."""
    while True:
        message = receive(session)
        if (isinstance(message, bytes) and kind is bytes) or (isinstance(message, dict) and message["type"] == kind):
            return message


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
            time, errors = decode_frame(message)
            k = int(np.argmin(np.abs(run.times - time)))
            assert time == pytest.approx(run.times[k], rel=1e-6)
            np.testing.assert_allclose(errors, np.linalg.norm(run["error"][k], axis=1), rtol=1e-6)
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
        assert decode_frame(receive_until(session, bytes))[0] == pytest.approx(420.0)
        session.send_json({"type": "trace", "node": 2})
        trace = receive_until(session, "trace")
        assert trace["errors"] == pytest.approx(np.linalg.norm(run["error"][:, 2], axis=1).tolist())
        session.send_json({"type": "speed", "value": 100})
        assert receive_until(session, "state")["speed"] == 100


@pytest.mark.parametrize(
    "text",
    ["{", "null", '{"type": "seek", "frame": 6}', '{"type": "trace", "node": -1}', '{"type": "speed", "value": 0}'],
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


def receive_all(session):
    for _ in range(1000):
        message = session.receive()
        session._raise_on_close(message)


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
        for path in ("/?token=secret", "/static/app.js", "/static/style.css", "/?token=wrong"):
            headers = client.get(path).headers
            policy = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'"
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
    script = (STATIC / "app.js").read_text("utf-8")
    assert not re.search(r"https?://|innerHTML|insertAdjacent|eval\(|fetch\(|import\b", script)
    assert not re.search(r"https?://|@import|url\(", (STATIC / "style.css").read_text("utf-8"))


def test_a_random_token_stands_in_the_address():
    run = recorded()
    first, second = (replay_app(run, graphs.chain(4)) for _ in range(2))
    assert first.state.token != second.state.token
    assert len(first.state.token) >= 32
    assert page_url(first, 80) == f"http://127.0.0.1:80/?token={first.state.token}"
    assert page_url(replay_app(run, graphs.chain(4), token="a&b"), 80).endswith("?token=a%26b")


def test_serve_binds_this_machine_only(monkeypatch, capsys):
    import uvicorn

    called = {}
    monkeypatch.setattr(uvicorn, "run", lambda app, **options: called.update(options, app=app))
    app = replay_app(recorded(), graphs.chain(4), token="secret")
    serve(app, 8123)
    assert (called["app"], called["host"], called["port"], called["access_log"]) == (app, "127.0.0.1", 8123, False)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "http://127.0.0.1:8123/?token=secret" in printed.err


@pytest.mark.parametrize("port", [0, 65536, "80", True])
def test_serve_refuses_what_is_no_port(port):
    with pytest.raises(ArgumentError, match="port must be a whole number"):
        serve(replay_app(recorded(), graphs.chain(4)), port)


def test_misuse():
    with pytest.raises(ShapeError, match="graph has 3 nodes"):
        replay_app(recorded(), graphs.chain(3))
    with pytest.raises(ArgumentError, match="token must not be empty"):
        replay_app(recorded(), graphs.chain(4), token="")
    with pytest.raises(ArgumentError, match="speed must be positive"):
        replay_app(recorded(), graphs.chain(4), speed=0.0)


def test_importing_the_package_loads_no_server():
    code = "import sys, trigpoint.dashboard; print({'starlette', 'uvicorn', 'websockets'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_missing_packages_are_named_at_use(monkeypatch):
    app = replay_app(recorded(), graphs.chain(4))
    for package in ("uvicorn", "websockets"):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, package, None)
            with pytest.raises(MissingExtraError, match=rf"'{package}'.*trigpoint\[dashboard\]"):
                serve(app, 8123)
    monkeypatch.delitem(sys.modules, "trigpoint.dashboard._server")
    monkeypatch.setitem(sys.modules, "starlette.applications", None)
    with pytest.raises(MissingExtraError, match=r"'starlette'.*trigpoint\[dashboard\]"):
        replay_app(recorded(), graphs.chain(4))
