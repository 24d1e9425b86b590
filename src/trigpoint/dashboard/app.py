"""The application and its server, bound to this machine only."""

from __future__ import annotations

import importlib
import secrets
import sys
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from numpy.typing import ArrayLike

from trigpoint.dashboard.frames import topology_message
from trigpoint.dashboard.playback import Playback
from trigpoint.errors import ArgumentError, MissingExtraError
from trigpoint.graphs import MeasurementGraph

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from trigpoint.observers.run import Run

_HOST = "127.0.0.1"


def replay_app(
    run: Run,
    graph: MeasurementGraph,
    positions: ArrayLike | None = None,
    token: str | None = None,
    speed: float = 1.0,
) -> Starlette:
    """Return the application that replays ``run``: ``GET /?token=...`` the page, ``/static/...``, WebSocket ``/ws``.

    Args:
        run: the recorded run, at least one sample.
        graph: its network.
        positions: (N, 2) or (N, 3) places of the nodes; None: placed by the hops between them.
        token: what the address must carry; None draws a random one (``app.state.token``).
        speed: seconds of the run a second; the page can change it.

    The page and the socket answer 403 (close code 4403) without the token; the socket also when the browser's
    Origin is not this host. Samples closer than a thirtieth of a second are skipped while playing.

    Raises:
        ShapeError: the graph has another number of nodes than the run.
        ArgumentError: a run without samples, an empty token, a speed that is not positive.
        MissingExtraError: starlette is not installed.
    """
    server = _loaded("trigpoint.dashboard._server", "starlette", "the dashboard")
    topology = topology_message(run, graph, positions)
    if token == "":
        raise ArgumentError("token must not be empty; leave it out to get a random one")
    chosen = secrets.token_urlsafe(24) if token is None else token
    app: Starlette = server.build(run, topology, Playback.start(run.times, speed), chosen)
    return app


def page_url(app: Starlette, port: int) -> str:
    """Return the address of ``app`` on ``port`` to open in a browser on this machine, token included."""
    return f"http://{_HOST}:{port}/?token={quote(app.state.token, safe='')}"


def serve(app: Starlette, port: int = 8765) -> None:
    """Serve ``app`` on 127.0.0.1 until interrupted; the address goes to standard error.

    Raises ``ArgumentError`` for a port outside 1..65535, ``MissingExtraError`` without uvicorn and websockets.
    """
    if isinstance(port, bool) or not isinstance(port, int) or not 1 <= port <= 65535:
        raise ArgumentError(f"port must be a whole number from 1 to 65535; got {port!r}")
    uvicorn = _loaded("uvicorn", "uvicorn", "serving the dashboard")
    _loaded("websockets", "websockets", "serving the dashboard")
    print(f"Open {page_url(app, port)}  (Ctrl-C ends)", file=sys.stderr, flush=True)
    # The access log would hold the token.
    uvicorn.run(app, host=_HOST, port=port, log_level="warning", access_log=False, ws="auto")


def _loaded(module: str, package: str, purpose: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(package, "dashboard", purpose) from error
