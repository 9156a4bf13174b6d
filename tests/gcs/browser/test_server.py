"""The server without a browser: who is let in, what is served, who is heard."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import AsyncIterator, Sequence
from typing import Any

import pytest
import pytest_asyncio
from aiohttp import ClientSession, CookieJar, WSMsgType
from aiohttp.test_utils import TestServer

import gcs.browser.server
from gcs.browser.guard import Guard, is_loopback
from gcs.browser.server import FILES, MOST_WAITING, Served, Viewer, _put, _size, application

TOKEN = "twenty-letters-of-it"


class FakeApp:
    """Writes down what it is told, and says it."""

    made: list[FakeApp] = []
    modes = b"\x1b[?1049h"

    def __init__(self, feed: Any, ended: Any) -> None:
        self.feed, self.ended = feed, ended
        self.told: list[Any] = []
        FakeApp.made.append(self)

    async def start(self, words: Sequence[str], size: tuple[int, int], environment: Any) -> None:
        self.told.append(("start", size))

    async def type(self, text: str) -> None:
        self.told.append(text)
        self.feed(text.encode())

    async def resize(self, size: tuple[int, int]) -> None:
        self.told.append(size)

    async def repaint(self) -> None:
        self.feed(b"all of it")

    async def stop(self) -> None:
        self.told.append("stop")


@pytest.fixture(autouse=True)
def _fake_app(monkeypatch: pytest.MonkeyPatch) -> None:
    FakeApp.made = []
    monkeypatch.setattr(gcs.browser.server, "AppProcess", FakeApp)
    monkeypatch.setattr(gcs.browser.server, "WRONG_TOKEN_S", 0.0)


@pytest_asyncio.fixture
async def address() -> AsyncIterator[str]:
    async with served(None) as where:
        yield where


class served:
    def __init__(self, token: str | None) -> None:
        self.token = token

    async def __aenter__(self) -> str:
        guard = Guard("127.0.0.1", 0, self.token)
        self.server = TestServer(application(Served(["app"], {}), guard))
        await self.server.start_server()
        object.__setattr__(guard, "port", self.server.port)
        return f"http://127.0.0.1:{self.server.port}"

    async def __aexit__(self, *_: object) -> None:
        await self.server.close()


async def test_only_what_is_ours_is_served_and_nothing_else_is_asked_for(address: str) -> None:
    async with ClientSession() as session:
        for path in FILES:
            async with session.get(address + path) as answer:
                text = await answer.text()
                assert answer.status == 200
                assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
            assert not re.search(r"https?://|//[a-z]+\.", re.sub(r"^//.*|\s//.*|http:\" \? |\$\{.*?\}", "", text))
        async with session.get(f"{address}/../pyproject.toml") as answer:
            assert answer.status == 404


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "localhost:1", "[::1", "10.0.0.1:{port}"]
)
async def test_a_strangers_name_for_this_computer_is_refused(address: str, host: str) -> None:
    port = address.rsplit(":", 1)[1]
    async with ClientSession() as session, session.get(address, headers={"Host": host.format(port=port)}) as answer:
        assert answer.status == 403


async def test_a_websocket_of_another_page_is_refused(address: str) -> None:
    async with ClientSession() as session:
        for origin in ("http://evil.example", "null", address.replace("http", "ftp"), None):
            headers = {} if origin is None else {"Origin": origin}
            async with session.get(f"{address}/screen", headers=headers) as answer:
                assert answer.status == 403
    assert FakeApp.made == []


async def test_a_token_is_asked_for_once() -> None:
    async with served(TOKEN) as address, ClientSession(cookie_jar=CookieJar(unsafe=True)) as session:
        for path in ("/", "/page.js", "/screen", f"/?token={TOKEN[:-1]}", "/?token=", "/?token=%00é"):
            async with session.get(address + path, headers={"Origin": address}) as answer:
                assert answer.status == 401, path
        async with session.get(f"{address}/?token={TOKEN}", allow_redirects=False) as answer:
            assert (answer.status, answer.headers["Location"]) == (303, "/")
            assert re.search("HttpOnly.*SameSite=Strict", answer.headers["Set-Cookie"])
        async with session.get(f"{address}/page.js") as answer:
            assert answer.status == 200


async def hello(session: ClientSession, address: str, name: str, size: Any = (100, 30)) -> Any:
    socket = await session.ws_connect(f"{address}/screen", headers={"Origin": address})
    await socket.send_json({"viewer": name, "size": size})
    return socket


async def heard(socket: Any, wanted: Any) -> Any:
    """Read until a message is so."""
    async with asyncio.timeout(5):
        while True:
            message = await socket.receive()
            assert message.type in (WSMsgType.TEXT, WSMsgType.BINARY), message
            found = json.loads(message.data) if message.type is WSMsgType.TEXT else message.data
            if wanted(found):
                return found


def role(name: str) -> Any:
    return lambda found: isinstance(found, dict) and found.get("role") == name


async def test_one_types_all_see_and_anybody_aborts(address: str) -> None:
    async with ClientSession() as session:
        pilot = await hello(session, address, "pilot-1234")
        await heard(pilot, role("flies"))
        await heard(pilot, lambda found: found == b"all of it")
        watcher = await hello(session, address, "watcher-1234", [400, 900])
        assert (await heard(watcher, role("watches")))["size"] == [100, 30]
        assert (await heard(watcher, lambda found: isinstance(found, bytes))).startswith(b"\x1bc\x1b[?1049h")
        for message in ({"keys": "no"}, {"size": [50, 20]}, {"take": True}, {"keys": 5}, [1], {"abort": 1}):
            await watcher.send_json(message)
        await watcher.send_str("{{")
        await watcher.send_json({"abort": True})
        await heard(pilot, lambda found: found == b"\x1b[24~")
        for message in ({"keys": "x" * 5000}, {"size": [1, 10**9]}, {"keys": "r"}):
            await pilot.send_json(message)
        await heard(watcher, lambda found: found == b"r")
        (app,) = FakeApp.made
        assert [one for one in app.told if one != (100, 30)] == [("start", (100, 30)), "\x1b[24~", (40, 200), "r"]


async def test_a_tab_that_comes_twice_is_served_once(address: str) -> None:
    async with ClientSession() as session:
        first = await hello(session, address, "pilot-1234")
        await heard(first, role("flies"))
        second = await hello(session, address, "pilot-1234")
        assert (await heard(second, role("flies")))["viewers"] == 1
        while (message := await first.receive()).type in (WSMsgType.TEXT, WSMsgType.BINARY):
            pass
        assert message.data == gcs.browser.server.SEAT_TAKEN


@pytest.mark.parametrize(
    "greeting", [{}, {"viewer": "pilot-1234"}, {"viewer": 5, "size": [80, 24]}, {"viewer": "x", "size": [80, 24]}]
)
async def test_a_page_that_does_not_say_who_it_is_is_not_served(address: str, greeting: Any) -> None:
    async with ClientSession() as session:
        socket = await session.ws_connect(f"{address}/screen", headers={"Origin": address})
        await socket.send_json(greeting)
        assert (await socket.receive()).type is WSMsgType.CLOSE
    assert FakeApp.made == []


async def test_an_app_that_ends_is_told_and_begins_again_with_the_next_page(address: str) -> None:
    async with ClientSession() as session:
        pilot = await hello(session, address, "pilot-1234")
        await heard(pilot, role("flies"))
        FakeApp.made[0].ended(0, "")
        await heard(pilot, lambda found: found == {"ended": 0})
        again = await hello(session, address, "other-1234")
        await heard(again, role("flies"))
    assert len(FakeApp.made) == 2


async def test_the_app_is_closed_when_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gcs.browser.server, "TICK_S", 0.01)
    now = 0.0
    said: list[str] = []
    server = Served(["app"], {}, say=said.append, clock=lambda: now)
    await server._ensure_app((80, 24))
    server._seats.join("pilot-1234")
    watching = asyncio.create_task(server.watch())
    server._seats.leave("pilot-1234", now)
    await asyncio.sleep(0.03)
    assert said == []
    now = 60.0
    await asyncio.sleep(0.05)
    watching.cancel()
    assert FakeApp.made[0].told[-1] == "stop"
    assert "nobody is looking" in said[0]


def test_a_viewer_that_does_not_keep_up_is_painted_anew() -> None:
    viewer = Viewer("slow", None)  # type: ignore[arg-type]
    _put(viewer, json.dumps({"role": "watches"}))
    for number in range(3 * MOST_WAITING):
        _put(viewer, b"%d" % number)
    assert viewer.stale
    assert viewer.waiting.qsize() < MOST_WAITING
    assert isinstance(viewer.waiting.get_nowait(), str)  # what it must know is not dropped


@pytest.mark.parametrize(
    ("wanted", "size"),
    [([80, 24], (80, 24)), ([0, -5], (40, 15)), ([1e3, 5], None), ("80x24", None), (None, None), ([80], None)],
)
def test_sizes(wanted: Any, size: Any) -> None:
    assert _size(wanted) == size


@pytest.mark.parametrize(
    ("host", "asked", "own"),
    [
        ("0.0.0.0", "192.168.1.5:8000", True),
        ("0.0.0.0", "evil.example:8000", False),
        ("tablet.lan", "tablet.lan:8000", True),
        ("127.0.0.1", "192.168.1.5:8000", False),
        ("127.0.0.1", "[::1]:8000", True),
        ("127.0.0.1", "LOCALHOST:8000", True),
    ],
)
def test_addresses(host: str, asked: str, own: bool) -> None:
    assert Guard(host, 8000).own_address({"Host": asked}) is own
    assert is_loopback(host) is (host == "127.0.0.1")
