"""A browser without a window, driven over the DevTools protocol: pages, keys, fingers, and what it asked the network.

Any Chromium will do (chromium, Google Chrome, Edge); a test that finds none says so and is skipped.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest

NAMES = (
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge", "microsoft-edge"),
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)
OPTIONS = (
    *("--headless=new", "--remote-debugging-port=0", "--disable-gpu", "--no-first-run", "--disable-extensions"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--mute-audio"),
    *("--disable-backgrounding-occluded-windows", "--disable-renderer-backgrounding", "--window-size=1200,800"),
)
PATIENCE_S = 20.0
KEY_CODES = {"F12": 123, "Enter": 13, "Escape": 27}


def find_browser() -> str:
    """Its program; skips the test where there is none."""
    for name in NAMES:
        found = shutil.which(name)
        if found:
            return found
    pytest.skip(
        "no Chromium, Chrome or Edge is installed: the app in a browser is not tried (apt-get install chromium)"
    )


class Page:
    """One tab."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._number = 0
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self.asked: list[str] = []
        """Addresses of all that it asked the network."""
        self.errors: list[str] = []
        """Exceptions of its script."""
        self._reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        async for message in self._socket:
            said = json.loads(message.data)
            if "id" in said:
                self._answers.pop(said["id"]).set_result(said)
            elif said["method"] == "Network.requestWillBeSent":
                self.asked.append(said["params"]["request"]["url"])
            elif said["method"] == "Network.webSocketCreated":
                self.asked.append(said["params"]["url"])
            elif said["method"] == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(said["params"]["exceptionDetails"])[:500])

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        answer = self._answers[self._number] = asyncio.get_running_loop().create_future()
        await self._socket.send_json({"id": self._number, "method": method, "params": parameters})
        said = await asyncio.wait_for(answer, PATIENCE_S)
        assert "error" not in said, said
        return dict(said["result"])

    async def open(self, address: str) -> None:
        for domain in ("Page", "Network", "Runtime"):
            await self.call(f"{domain}.enable")
        await self.call("Page.navigate", url=address)

    async def value(self, expression: str) -> Any:
        said = await self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        return said["result"].get("value")

    async def text(self) -> str:
        """What the terminal shows."""
        rows = "[...document.querySelectorAll('.rows > div')].map((row) => row.textContent).join('\\n')"
        return str(await self.value(rows))

    async def until(self, *words: str, within_s: float = PATIENCE_S) -> str:
        """Wait until the terminal shows all of these."""
        shown = ""
        await self.call("Page.bringToFront")  # what lies behind is not painted
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while True:
                    shown = await self.text()
                    if all(word in shown for word in words):
                        return shown
                    await asyncio.sleep(0.05)
        pytest.fail(f"not seen within {within_s:g} s: {words}; the screen was\n{shown}")

    async def until_true(self, expression: str, within_s: float = PATIENCE_S) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while not await self.value(expression):
                    await asyncio.sleep(0.05)
                return
        pytest.fail(f"not so within {within_s:g} s: {expression}")

    async def press(self, key: str) -> None:
        """A key, named as browsers do."""
        text = {"text": "\r" if key == "Enter" else key} if key == "Enter" or len(key) == 1 else {}
        code = KEY_CODES.get(key, ord(key.upper()[0]))
        about = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        await self.call("Input.dispatchKeyEvent", type="keyDown", **about, **text)
        await self.call("Input.dispatchKeyEvent", type="keyUp", **about)

    async def touch(self, selector: str) -> None:
        """A finger on the middle of an element."""
        box = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
        x, y = await self.value(f"(b => [b.x + b.width / 2, b.y + b.height / 2])({box})")
        await self.tap(x, y)

    async def tap(self, x: float, y: float) -> None:
        """A finger on a place of the page."""
        await self.call("Page.bringToFront")
        await self.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        await self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    async def close(self) -> None:
        with contextlib.suppress(Exception):
            await self.call("Page.close")
        self._reading.cancel()
        await self._socket.close()


class Browser:
    """Running."""

    def __init__(self, session: aiohttp.ClientSession, port: int) -> None:
        self._session = session
        self._port = port
        self.pages: list[Page] = []

    async def page(self, address: str) -> Page:
        """A new tab at an address."""
        async with self._session.put(f"http://127.0.0.1:{self._port}/json/new?about:blank") as answer:
            about = await answer.json()
        page = Page(await self._session.ws_connect(about["webSocketDebuggerUrl"], max_msg_size=1 << 26))
        self.pages.append(page)
        await page.open(address)
        return page


@contextlib.asynccontextmanager
async def running_browser() -> AsyncIterator[Browser]:
    """Start one with a profile of its own; ended and forgotten with the block."""
    program = find_browser()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        nowhere = asyncio.subprocess.DEVNULL
        process = await asyncio.create_subprocess_exec(
            program, *OPTIONS, *root, f"--user-data-dir={folder}", "about:blank", stdout=nowhere, stderr=nowhere
        )
        try:
            told = Path(folder) / "DevToolsActivePort"
            async with asyncio.timeout(PATIENCE_S):
                while not (told.exists() and told.read_text().count("\n")):
                    await asyncio.sleep(0.05)
            async with aiohttp.ClientSession() as session:
                browser = Browser(session, int(told.read_text().split("\n")[0]))
                try:
                    yield browser
                finally:
                    for page in browser.pages:
                        await page.close()
        finally:
            process.kill()
            await process.wait()
