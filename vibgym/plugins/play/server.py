"""The server: a page, a socket and a world for every visitor; other requests are refused."""

from __future__ import annotations

import asyncio
import contextlib
import json
import mimetypes
import secrets
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from vibgym.plugins.play.choices import Settings, settings_of
from vibgym.plugins.play.session import Session

PAGE = Path(__file__).parent / "page"
"""Served files."""

MAX_WORLDS = 16
"""Most visitors at a time, including those whose connection was lost."""

WAIT = 600.0
"""s that a world waits for a visitor whose connection was lost."""

POLICY_VIOLATION, TAKEN_OVER, NO_ROOM = 1008, 4000, 4001
"""Codes with which sockets are closed."""

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


class Visitor:
    """A session and its socket; None while disconnected."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.token = secrets.token_urlsafe(18)
        self.socket: WebSocket | None = None
        self.left = 0.0  # when the socket was lost, by the loop's clock
        self.changed = asyncio.Event()

    async def send(self, answers: Sequence[dict[str, Any]]) -> None:
        """Send answers in order; they are dropped while disconnected."""
        socket = self.socket
        if socket is None:
            return
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the connection was lost; the receiver handles it
            for answer in answers:
                await socket.send_text(json.dumps(answer, separators=(",", ":")))

    async def run(self) -> None:
        """Step the world while connected."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            self.changed.clear()
            if not self.session.running:
                await self.changed.wait()
                due = loop.time()
                continue
            await self.send(await asyncio.to_thread(self.session.step))
            due = max(due + self.session.step_time, loop.time() - self.session.step_time)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._paced(), due - loop.time())

    async def _paced(self) -> None:
        """Wait for a step, or for a change of pace."""
        pace = self.session.running, self.session.speed
        while (self.session.running, self.session.speed) == pace:
            self.changed.clear()
            await self.changed.wait()


class Server:
    """Server of the worlds of visitors.

    Args:
        first: initial settings of a world.
        output: directory for recordings.
    """

    def __init__(self, first: Settings, output: Path) -> None:
        self.first, self.output = first, output
        self.visitors = dict[str, Visitor]()

    def app(self, hosts: Sequence[str]) -> ASGIApp:
        """Return the application; ``hosts``: accepted host names, ``"*"`` for all."""
        mimetypes.add_type("text/javascript", ".js")  # Windows may have another type
        routes = [
            Route("/kept/{name}", self._kept),
            WebSocketRoute("/world", self._world),
            Mount("/", StaticFiles(directory=PAGE, html=True)),
        ]
        return Guard(Starlette(routes=routes), hosts)

    async def _kept(self, request: Request) -> Response:
        name = request.path_params["name"]
        path = next(
            (visitor.session.kept[name] for visitor in self.visitors.values() if name in visitor.session.kept), None
        )
        if path is None or not path.is_file():
            return PlainTextResponse("not found\n", 404)
        return FileResponse(path, media_type="image/gif", filename=name)

    async def _world(self, socket: WebSocket) -> None:
        await socket.accept()
        try:
            visitor = await self._visitor(socket)
        except ValueError as error:
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                await socket.send_text(json.dumps({"kind": "refused", "text": " ".join(str(error).split())}))
                await socket.close(NO_ROOM)
            return
        before, visitor.socket = visitor.socket, socket
        if before is not None:
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                await before.close(TAKEN_OVER)
        session = visitor.session
        welcome = {"kind": "welcome", "token": visitor.token, "ack": session.acknowledged}
        await visitor.send([welcome, *await asyncio.to_thread(session.shown)])
        clock = asyncio.create_task(visitor.run())
        try:
            while True:
                answers = await asyncio.to_thread(session.do, await _text(socket))
                visitor.changed.set()
                await visitor.send(answers)
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            clock.cancel()
            if visitor.socket is socket:
                visitor.socket, visitor.left = None, asyncio.get_running_loop().time()

    async def _visitor(self, socket: WebSocket) -> Visitor:
        """Return the visitor with this token, or a new one.

        Raises:
            ValueError: no room, or an invalid environment or start.
        """
        known = self.visitors.get(socket.query_params.get("token", ""))
        if known is not None:
            return known
        self._see_off()
        if len(self.visitors) >= MAX_WORLDS:
            raise ValueError(f"no room: {MAX_WORLDS} worlds are in use; try again later")
        first, start = socket.query_params.get("id"), socket.query_params.get("start")
        settings = self.first if first is None else settings_of(first)
        session = await asyncio.to_thread(Session, settings, self.output, start)
        visitor = Visitor(session)
        self.visitors[visitor.token] = visitor
        return visitor

    def _see_off(self) -> None:
        """Delete worlds of visitors that have not reconnected."""
        now = asyncio.get_running_loop().time()
        for token, visitor in list(self.visitors.items()):
            if visitor.socket is None and now - visitor.left > WAIT:
                del self.visitors[token]


async def _text(socket: WebSocket) -> str | bytes:
    """Return the next message."""
    message = await socket.receive()
    if message["type"] != "websocket.receive":
        raise WebSocketDisconnect(message.get("code", 1000))
    return message.get("text") or message.get("bytes") or b""


class Guard:
    """Refuses requests with another host name, such as those of other sites' pages (DNS rebinding); adds :data:`HEADERS`."""

    def __init__(self, app: ASGIApp, hosts: Sequence[str]) -> None:
        self._app, self._hosts = app, tuple(hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
            host, origin = headers.get("host", ""), headers.get("origin")
            same = origin is None or origin.partition("://")[2] == host
            if not same or not ("*" in self._hosts or _name(host) in self._hosts):
                await self._refuse(scope, receive, send)
                return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await self._app(scope, receive, with_headers)

    async def _refuse(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})
            return
        answer: Callable[[Scope, Receive, Send], Awaitable[None]] = PlainTextResponse("unknown host\n", 403)
        await answer(scope, receive, send)


def _name(host: str) -> str:
    """Return a host without its port."""
    return host[: host.rindex("]") + 1] if host.startswith("[") else host.partition(":")[0]
