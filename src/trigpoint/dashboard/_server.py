"""Routes, headers and the socket; the one file that imports starlette."""

from __future__ import annotations

import asyncio
import json
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from trigpoint.dashboard.frames import frame, trace_message
from trigpoint.dashboard.playback import Playback, decode_command, traced_node
from trigpoint.errors import ProtocolError

if TYPE_CHECKING:
    from trigpoint.observers.run import Run

STATIC = Path(__file__).parent / "static"
FORBIDDEN = 4403
_BAD_COMMAND = 1008
_TICK = 1.0 / 30.0
_INBOX = 64
_HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        b"base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),  # the address holds the token
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


class _SafeHeaders:
    """Adds the security headers to every answer."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                kept = [pair for pair in message["headers"] if pair[0] != b"cache-control"]
                message = {**message, "headers": [*kept, *_HEADERS]}
            await send(message)

        await self._app(scope, receive, send_with_headers)


@dataclass(frozen=True, eq=False)
class _Replay:
    run: Run
    topology: str
    start: Playback
    token: str

    async def page(self, request: Request) -> Response:
        if not self._has_token(request):
            text = "This address lacks its token. Open the whole address that trigpoint printed.\n"
            return PlainTextResponse(text, status_code=403)
        return FileResponse(STATIC / "index.html")

    async def socket(self, websocket: WebSocket) -> None:
        if not self._has_token(websocket) or not _same_origin(websocket):
            await websocket.close(FORBIDDEN)  # before accept: the handshake is answered with 403
            return
        await websocket.accept()
        commands: asyncio.Queue[str | None] = asyncio.Queue(_INBOX)
        reader = asyncio.create_task(_read(websocket, commands))
        try:
            await self._stream(websocket, commands)
        except WebSocketDisconnect:
            pass
        except ProtocolError as error:
            await websocket.close(_BAD_COMMAND, str(error)[:120])
        finally:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)

    async def _stream(self, websocket: WebSocket, commands: asyncio.Queue[str | None]) -> None:
        """Send the topology, then a frame whenever the sample changes, until the page goes away."""
        await websocket.send_text(self.topology)
        clock = asyncio.get_running_loop().time
        state, before, shown = self.start, clock(), -1
        told: tuple[bool, float] | None = None
        while True:
            if state.index != shown:
                shown = state.index
                await websocket.send_bytes(frame(self.run, shown))
            if told != (state.playing, state.speed):
                told = (state.playing, state.speed)
                await websocket.send_json({"type": "state", "playing": state.playing, "speed": state.speed})
            text = await _next(commands, max(_TICK, state.wait) if state.playing else None)
            now = clock()
            state, before = state.advanced(now - before), now
            if text is None:
                return
            if text:
                state = await self._obey(websocket, state, decode_command(text))

    async def _obey(self, websocket: WebSocket, state: Playback, command: dict[str, Any]) -> Playback:
        if command["type"] == "trace":
            node = traced_node(command, len(self.run.names))
            await websocket.send_json(trace_message(self.run, node))
        return state.obeying(command)

    def _has_token(self, connection: HTTPConnection) -> bool:
        given = connection.query_params.get("token", "")
        return secrets.compare_digest(given.encode("utf-8", "replace"), self.token.encode("utf-8", "replace"))


def build(run: Run, topology: dict[str, Any], start: Playback, token: str) -> Starlette:
    """Return the application around one recorded run."""
    replay = _Replay(run, json.dumps(topology, allow_nan=False), start, token)
    routes = [
        Route("/", replay.page, methods=["GET"]),
        WebSocketRoute("/ws", replay.socket),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    app = Starlette(routes=routes, middleware=[Middleware(_SafeHeaders)])
    app.state.token = token
    return app


def _same_origin(connection: HTTPConnection) -> bool:
    """Tell whether the browser's page came from this very host: another site's page names itself as Origin."""
    host = connection.headers.get("host")
    return bool(host) and connection.headers.get("origin") in (f"http://{host}", f"https://{host}")


async def _read(websocket: WebSocket, commands: asyncio.Queue[str | None]) -> None:
    """Queue the page's commands; None tells that it went away, an empty command is never queued."""
    while True:
        message = await websocket.receive()
        if message["type"] == "websocket.disconnect":
            await commands.put(None)
            return
        await commands.put(message.get("text") or "null")


async def _next(commands: asyncio.Queue[str | None], seconds: float | None) -> str | None:
    """Return the next command, or an empty text when none came in time."""
    try:
        return await asyncio.wait_for(commands.get(), seconds)
    except TimeoutError:
        return ""
