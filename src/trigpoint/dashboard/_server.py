"""Routes, headers and the socket; the one file that imports starlette."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from trigpoint.dashboard.commands import decode_command, ordered, selected
from trigpoint.dashboard.feed import ORDERS, Feed, View
from trigpoint.errors import ProtocolError, TrigpointError

STATIC = Path(__file__).parent / "static"
FORBIDDEN = 4403
_BAD_COMMAND = 1008
_TICK = 1.0 / 30.0
_INBOX = 64
_HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
        b"base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),  # the address holds the token
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
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
class _Site:
    feed: Feed
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
            await _Visit(self.feed, websocket, commands, self.feed.view()).stream()
        except WebSocketDisconnect:
            pass
        except ProtocolError as error:
            await websocket.close(_BAD_COMMAND, _short(error))
        finally:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)

    @contextlib.asynccontextmanager
    async def lifespan(self, _: Starlette) -> AsyncIterator[None]:
        following = asyncio.create_task(self.feed.follow())
        try:
            yield
        finally:
            following.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await following

    def _has_token(self, connection: HTTPConnection) -> bool:
        given = connection.query_params.get("token", "")
        return secrets.compare_digest(given.encode("utf-8", "replace"), self.token.encode("utf-8", "replace"))


@dataclass(eq=False)
class _Visit:
    """One page while it is connected."""

    feed: Feed
    websocket: WebSocket
    commands: asyncio.Queue[str | None]
    view: View
    shown: int = -1
    heard_events: int = 0
    chosen: int | None = None
    told: tuple[bool, float] | None = None
    edition: int = -1
    orders: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.orders = () if self.feed.controls is None else ORDERS

    async def stream(self) -> None:
        """Send the topology, then whatever is new, until the page goes away or nothing more will come."""
        clock = asyncio.get_running_loop().time
        before = clock()
        while True:
            await self._tell()
            if self.feed.ended is not None:
                await self._json({"type": "end", "text": self.feed.ended})
                await self.websocket.close(1000)
                return
            text = await _next(self.commands, max(_TICK, self.view.wait) if self.view.playing else None)
            now = clock()
            self.view, before = self.view.advanced(now - before), now
            if text is None:
                return
            if text:
                await self._obey(decode_command(text))

    async def _tell(self) -> None:
        if self.feed.edition != self.edition:
            self.edition = self.feed.edition
            await self._json(self.feed.topology())
        if self.view.index != self.shown:
            self.shown = self.view.index
            await self.websocket.send_bytes(self.feed.frame(self.shown))
            if self.chosen is not None:
                await self._json(self.feed.details(self.chosen, self.shown))
        count, fresh = self.feed.events(self.heard_events)
        if count != self.heard_events:
            self.heard_events = count
            await self._json({"type": "events", "events": [vars(event) for event in fresh]})
        if self.told != (self.view.playing, self.view.speed):
            self.told = (self.view.playing, self.view.speed)
            await self._json({"type": "state", "playing": self.view.playing, "speed": self.view.speed})

    async def _obey(self, command: dict[str, Any]) -> None:
        match command["type"]:
            case "select":
                self.chosen = selected(command, len(self.feed.names))
                if self.chosen is not None:
                    await self._json(self.feed.traces(self.chosen))
                    await self._json(self.feed.details(self.chosen, self.view.index))
            case "order":
                await self._order(*ordered(command, self.orders, len(self.feed.names)))
            case _:
                self.view = self.view.obeying(command)

    async def _order(self, order: str, node: int) -> None:
        try:
            # it may wait for a process to end
            await asyncio.to_thread(getattr(self.feed.controls, order), self.feed.names[node])
        except TrigpointError as error:
            await self._json({"type": "refused", "order": order, "node": node, "text": _short(error)})
            return
        self.feed.ordered(order, node)
        await self._json({"type": "done", "order": order, "node": node})

    async def _json(self, message: dict[str, Any]) -> None:
        await self.websocket.send_text(json.dumps(message, allow_nan=False))


def build(feed: Feed, token: str) -> Starlette:
    """Return the application around one feed."""
    site = _Site(feed, token)
    routes = [
        Route("/", site.page, methods=["GET"]),
        WebSocketRoute("/ws", site.socket),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    app = Starlette(routes=routes, middleware=[Middleware(_SafeHeaders)], lifespan=site.lifespan)
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


def _short(error: TrigpointError) -> str:
    """The message, at most the 123 bytes that the reason of a close may have."""
    return str(error).encode("utf-8")[:120].decode("utf-8", "ignore")
