"""One app process and its viewers, over HTTP and websockets: all see the same screen, one types, anybody aborts.

A websocket carries the terminal's bytes as they are, and JSON both ways: the page says who it is (`viewer`, `size`),
what is typed (`keys`), `abort`, `take`; it hears its `role`, the app's `size`, whether the seat is `free`, and when the
app has `ended`. Nothing is asked of any other place: the page, its script and the terminal are served from here.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aiohttp import WSCloseCode, WSMsgType, web

from gcs.browser.app_process import AppProcess
from gcs.browser.guard import Guard
from gcs.browser.seats import Seats

PAGE = Path(__file__).parent / "page"
FILES = {
    "/": ("index.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    **{f"/{name}.js": (f"{name}.js", "text/javascript") for name in ("page", "screen", "grid", "glyphs", "keys")},
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
ABORT = "\x1b[24~"
"""F12."""
TICK_S = 0.5
HEARTBEAT_S = 4.0
"""A viewer whose network went away is known to be gone after one and a half of these."""
WRONG_TOKEN_S = 1.0
"""Nobody guesses fast."""
MOST_WAITING = 400
"""Parts of the screen that a slow viewer has not taken yet; beyond it is painted anew."""
MOST_KEYS = 4096
"""Characters in a message: what people type or paste."""
SMALLEST, LARGEST = (40, 15), (400, 200)
"""Columns and rows."""
SEAT_TAKEN, APP_ENDED = 4001, 4002
"""Why a websocket was closed, for the page."""
Size = tuple[int, int]


@dataclass(eq=False)
class Viewer:
    """One page."""

    name: str
    socket: web.WebSocketResponse
    waiting: asyncio.Queue[bytes | str] = field(default_factory=lambda: asyncio.Queue(MOST_WAITING))
    stale: bool = False
    """Parts of the screen were dropped."""


class Served:
    """The app and who looks at it; all of it in one event loop."""

    def __init__(
        self,
        words: Sequence[str],
        environment: Mapping[str, str],
        *,
        say: Callable[[str], None] = lambda _: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """words: the command that runs the app."""
        self._words = words
        self._environment = environment
        self._say = say
        self._clock = clock
        self._seats = Seats()
        self._viewers: dict[str, Viewer] = {}
        self._app: AppProcess | None = None
        self._size: Size = (80, 24)
        self._starting = asyncio.Lock()
        self._told: tuple[Any, ...] = ()

    # ------------------------------------------------------------------------------------------- the app

    async def _ensure_app(self, size: Size) -> None:
        """Start the app where none runs."""
        async with self._starting:
            if self._app is None:
                self._size = size
                self._app = AppProcess(self._painted, self._ended)
                await self._app.start(self._words, size, self._environment)

    def _painted(self, part: bytes) -> None:
        for viewer in self._viewers.values():
            _put(viewer, part)

    def _ended(self, status: int, errors: str) -> None:
        self._app, self._seats = None, Seats()
        if status and errors:
            self._say(errors.rstrip())
        for viewer in self._viewers.values():
            _put(viewer, json.dumps({"ended": status}))

    async def close(self) -> None:
        """End the app, and a run under way with it."""
        async with self._starting:
            if self._app is not None:
                await self._app.stop()
                self._app = None

    async def watch(self) -> None:
        """Close the app when nobody was there for too long; tell viewers when the seat becomes free."""
        while True:
            await asyncio.sleep(TICK_S)
            if self._app is not None and self._seats.closes(self._clock()):
                self._say("nobody is looking any more: the app is closed, and a run under way with it")
                await self.close()
                self._seats = Seats()
            self._tell()

    # ------------------------------------------------------------------------------------------- viewers

    async def view(self, socket: web.WebSocketResponse) -> None:
        """Serve one page until it is gone."""
        hello = await _message(socket)
        name, size = (hello or {}).get("viewer"), _size((hello or {}).get("size"))
        if not isinstance(name, str) or not 8 <= len(name) <= 64 or size is None:
            await socket.close(code=WSCloseCode.POLICY_VIOLATION)
            return
        await self._ensure_app(size)
        before = self._viewers.pop(name, None)
        if before is not None:  # the same tab, reloaded before its old connection was missed, or copied
            await before.socket.close(code=SEAT_TAKEN)
        viewer = self._viewers[name] = Viewer(name, socket)
        flies = self._seats.join(name) == "flies"
        sending = asyncio.create_task(self._send(viewer))
        self._tell(anyway=True)
        try:
            await self._repaint(viewer, size if flies else self._size)
            while (message := await _message(socket)) is not None:
                await self._heard(viewer, message)
        finally:
            sending.cancel()
            if self._viewers.get(name) is viewer:
                del self._viewers[name]
                self._seats.leave(name, self._clock())
            self._tell()

    async def _heard(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        """What a page says. Only the one who flies types; anybody aborts, which can only end our own mode."""
        app, flies = self._app, self._seats.role(viewer.name) == "flies"
        if app is None:
            return
        match message:
            case {"abort": True}:
                await app.type(ABORT)
            case {"take": True} if self._seats.take(viewer.name, self._clock()):
                self._tell()
            case {"keys": str(keys)} if flies and len(keys) <= MOST_KEYS:
                await app.type(keys)
            case {"size": wanted} if flies and (size := _size(wanted)) is not None and size != self._size:
                self._size = size
                self._tell(anyway=True)
                await app.resize(size)

    async def _repaint(self, viewer: Viewer, size: Size) -> None:
        """A terminal that knows nothing yet gets the modes; the app paints all of it for everybody."""
        if self._app is None:  # it could not begin, and has said why
            _put(viewer, json.dumps({"ended": 1}))
        else:
            self._size = size
            self._tell(anyway=True)
            _put(viewer, b"\x1bc" + self._app.modes)
            await self._app.resize(size)
            await self._app.repaint()

    async def _send(self, viewer: Viewer) -> None:
        """What waits for a viewer, in order."""
        with contextlib.suppress(ConnectionError, RuntimeError):
            while True:
                part = await viewer.waiting.get()
                await (viewer.socket.send_bytes(part) if isinstance(part, bytes) else viewer.socket.send_str(part))
                if isinstance(part, str) and part.startswith('{"ended"'):
                    await viewer.socket.close(code=APP_ENDED)
                if viewer.stale and viewer.waiting.empty():
                    viewer.stale = False
                    await self._repaint(viewer, self._size)

    def _tell(self, *, anyway: bool = False) -> None:
        """Each viewer its role and what it may do, where that has changed."""
        free = self._seats.free(self._clock())
        now = (self._seats.flying, free, self._seats.gone_s is None, self._size, len(self._viewers))
        if now == self._told and not anyway:
            return
        self._told = now
        for viewer in self._viewers.values():
            _put(
                viewer,
                json.dumps(
                    {
                        "role": self._seats.role(viewer.name),
                        "size": self._size,
                        "free": free,
                        "gone": self._seats.gone_s is not None,
                        "viewers": len(self._viewers),
                    }
                ),
            )


def _put(viewer: Viewer, part: bytes | str) -> None:
    """To be sent. Of a viewer that does not keep up, what waits is dropped: it will be painted anew."""
    if viewer.waiting.full():
        viewer.stale = True
        kept = [one for one in _drained(viewer.waiting) if isinstance(one, str)]
        for one in kept[-MOST_WAITING // 2 :]:
            viewer.waiting.put_nowait(one)
    if not (viewer.stale and isinstance(part, bytes)) or viewer.waiting.empty():
        viewer.waiting.put_nowait(part)


def _drained(queue: asyncio.Queue[bytes | str]) -> list[bytes | str]:
    found = []
    while not queue.empty():
        found.append(queue.get_nowait())
    return found


async def _message(socket: web.WebSocketResponse) -> dict[str, Any] | None:
    """The next one; empty where it is no object, None where the page is gone."""
    message = await socket.receive()
    if message.type in (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED, WSMsgType.ERROR):
        return None
    try:
        found = json.loads(message.data) if message.type is WSMsgType.TEXT else {}
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _size(wanted: Any) -> Size | None:
    """Columns and rows that a terminal may have; None of what is no size."""
    match wanted:
        case [int(columns), int(rows)]:
            low, high = SMALLEST, LARGEST
            return min(max(columns, low[0]), high[0]), min(max(rows, low[1]), high[1])
    return None


# ------------------------------------------------------------------------------------------------ HTTP


def application(served: Served, guard: Guard) -> web.Application:
    """The routes, behind the guard."""

    async def websocket(request: web.Request) -> web.StreamResponse:
        if not guard.own_page(request.headers):
            raise web.HTTPForbidden(text="opened by another page\n")
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=1 << 16)
        await socket.prepare(request)
        await served.view(socket)
        return socket

    async def file(request: web.Request) -> web.StreamResponse:
        name, kind = FILES[request.path]
        return web.Response(body=(PAGE / name).read_bytes(), content_type=kind, charset="utf-8", headers=HEADERS)

    async def background(_: web.Application) -> Any:
        watching = asyncio.create_task(served.watch())
        yield
        watching.cancel()
        await served.close()

    app = web.Application(middlewares=[_guarded(guard)])
    app.add_routes([web.get("/screen", websocket), *(web.get(path, file) for path in FILES)])
    app.cleanup_ctx.append(background)
    return app


def _guarded(guard: Guard) -> Any:
    """Middleware: the address first, then the token, which an address may carry once."""

    @web.middleware
    async def checked(
        request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        if not guard.own_address(request.headers):
            raise web.HTTPForbidden(text="open it by its number, such as http://127.0.0.1:8000\n")
        given = request.query.get("token")
        if guard.token is not None and given is not None and guard.knows(given):
            answer = web.HTTPSeeOther("/", headers=HEADERS)  # so that the address bar does not keep it
            answer.set_cookie(guard.cookie, given, httponly=True, samesite="Strict")
            raise answer
        if not guard.knows(request.cookies.get(guard.cookie)):
            await asyncio.sleep(WRONG_TOKEN_S)
            raise web.HTTPUnauthorized(text="open it with its token: http://HOST:PORT/?token=TOKEN\n")
        return await handler(request)

    return checked
