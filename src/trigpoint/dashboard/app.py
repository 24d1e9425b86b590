"""The application and its server, bound to this machine only."""

from __future__ import annotations

import importlib
import secrets
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from trigpoint.dashboard.commands import LONGEST
from trigpoint.dashboard.feed import Feed
from trigpoint.dashboard.frames import Scene
from trigpoint.dashboard.replay import ReplayFeed
from trigpoint.errors import ArgumentError, MissingExtraError

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from trigpoint.observers.run import Run

_HOST = "127.0.0.1"
_STARTS_WITHIN = 20.0


def live_app(feed: Feed, token: str | None = None) -> Starlette:
    """Return the application that shows ``feed``: ``GET /?token=...`` the page, ``/static/...``, WebSocket ``/ws``.

    Args:
        feed: where frames, traces, events and controls come from: a ``LiveFeed``, a ``ReplayFeed``, or another one.
        token: what the address must carry; None draws a random one (``app.state.token``).

    The page and the socket answer 403 (close code 4403) without the token; the socket also when the browser's
    Origin is not this host. A command that ``commands`` does not list closes the socket with 1008 and the reason.

    Raises:
        ArgumentError: an empty token.
        MissingExtraError: starlette is not installed.
    """
    server = _loaded("trigpoint.dashboard._server", "starlette", "the dashboard")
    if token == "":
        raise ArgumentError("token must not be empty; leave it out to get a random one")
    app: Starlette = server.build(feed, secrets.token_urlsafe(24) if token is None else token)
    return app


def replay_app(run: Run, scene: Scene, token: str | None = None, speed: float = 1.0) -> Starlette:
    """Return the application that replays ``run``; ``live_app`` says how it answers.

    Args:
        run: the recorded run, at least one sample.
        scene: its network and how to show it.
        token: what the address must carry; None draws a random one (``app.state.token``).
        speed: seconds of the run a second; the page can change it.

    Samples closer than a thirtieth of a second are skipped while playing.

    Raises:
        ShapeError: the graph has another number of nodes than the run.
        ArgumentError: a run without samples, an empty token, a speed that is not positive.
        MissingExtraError: starlette is not installed.
    """
    _loaded("trigpoint.dashboard._server", "starlette", "the dashboard")
    return live_app(ReplayFeed(run, scene, speed), token)


def page_url(app: Starlette, port: int) -> str:
    """Return the address of ``app`` on ``port`` to open in a browser on this machine, token included."""
    return f"http://{_HOST}:{port}/?token={quote(app.state.token, safe='')}"


def serve(app: Starlette, port: int = 8765) -> None:
    """Serve ``app`` on 127.0.0.1 until interrupted; the address goes to standard error.

    Raises ``ArgumentError`` for a port outside 1..65535 or one that cannot be had, ``MissingExtraError`` without
    uvicorn and websockets.
    """
    if isinstance(port, bool) or not isinstance(port, int) or not 1 <= port <= 65535:
        raise ArgumentError(f"port must be a whole number from 1 to 65535; got {port!r}")
    uvicorn = _uvicorn()
    with _listening(port) as listener, suppress(KeyboardInterrupt):
        print(f"Open {page_url(app, port)}  (Ctrl-C ends)", file=sys.stderr, flush=True)
        uvicorn.Server(uvicorn.Config(app, **_options())).run([listener])


@contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((_HOST, port))
        except (OSError, OverflowError) as error:
            raise ArgumentError(f"port {port} on {_HOST} cannot be had ({error}); choose another one") from error
        yield listener


@contextmanager
def serving(app: Starlette, port: int = 0) -> Iterator[str]:
    """Serve ``app`` on 127.0.0.1 in a thread for as long as the context lasts, and give its address.

    Args:
        app: of ``live_app`` or ``replay_app``.
        port: from 1 to 65535, or 0 for any free one.

    Raises ``ArgumentError`` where the port cannot be had, ``MissingExtraError`` without uvicorn and websockets.
    """
    uvicorn = _uvicorn()
    with _listening(port) as listener:
        server = uvicorn.Server(uvicorn.Config(app, **_options()))
        thread = threading.Thread(target=server.run, args=([listener],), name="trigpoint-page", daemon=True)
        thread.start()
        try:
            until = time.monotonic() + _STARTS_WITHIN
            while not server.started and thread.is_alive() and time.monotonic() < until:
                time.sleep(0.005)
            yield page_url(app, listener.getsockname()[1])
        finally:
            server.should_exit = True
            thread.join(_STARTS_WITHIN)


def _options() -> dict[str, Any]:
    """Settings of the server: no access log, which would hold the token; no message longer than a command."""
    return {
        "log_level": "warning",
        "access_log": False,
        "ws": "websockets-sansio",
        "ws_max_size": 4 * LONGEST,
        "timeout_graceful_shutdown": 2,
    }


def _uvicorn() -> Any:
    uvicorn = _loaded("uvicorn", "uvicorn", "serving the dashboard")
    _loaded("websockets", "websockets", "serving the dashboard")
    return uvicorn


def _loaded(module: str, package: str, purpose: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(package, "dashboard", purpose) from error
