"""The app in a real browser: keys without a click, a second viewer, reload, fingers, sound; and a flight."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from aiohttp import web
from browser import Page, running_browser

from gcs.browser import seats
from gcs.browser.guard import Guard
from gcs.browser.server import Served, application

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.realtime


@contextlib.asynccontextmanager
async def serving(*words: str, token: str | None = None) -> AsyncIterator[str]:
    """A command's app, served; the address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    served = Served([sys.executable, *words], {**os.environ, "PYTHONPATH": str(ROOT)})
    runner = web.AppRunner(application(served, Guard("127.0.0.1", port, token)))
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        await runner.cleanup()


async def role(page: Page) -> str:
    return str(await page.value("document.getElementById('role').textContent"))


async def test_one_flies_others_watch_and_anybody_aborts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seats, "RETURNS_S", 1.5)
    token = "twenty-letters-of-it"
    async with (
        serving(str(ROOT / "tests" / "served_app.py"), token=token) as address,
        running_browser() as browser,
    ):
        pilot = await browser.page(f"{address}/?token={token}")
        await pilot.until("ready")
        assert token not in await pilot.value("location.href")
        await pilot.press("a")  # nothing was clicked
        await pilot.until("<a>")
        wide, high = (await pilot.text()).split("size ")[1].split()[0].split("x")
        assert int(wide) > 100
        assert int(high) >= 24
        await pilot.press("b")
        await pilot.until_true("document.body.dataset.bells === '1'")

        watcher = await browser.page(address)
        await watcher.until("<ab>", f"size {wide}x{high}")  # painted anew for who came late
        assert (await role(pilot)).startswith("you fly, 1 more")
        assert (await role(watcher)).startswith("you watch")
        await watcher.press("x")
        await watcher.touch("#abort")
        await pilot.until("<ab> aborted 1")  # the key was not taken, the abort was
        await watcher.press("F12")
        await pilot.until("aborted 2")

        await pilot.call("Page.reload")
        await pilot.until("aborted 2")
        await pilot.press("c")
        await watcher.until("<abc>")
        assert (await role(pilot)).startswith("you fly")

        await pilot.call("Page.navigate", url="about:blank")
        await watcher.until_true("document.getElementById('role').textContent.includes('is gone')")
        assert await watcher.value("document.getElementById('take').hidden")
        await watcher.until_true("!document.getElementById('take').hidden")
        await watcher.touch("#take")
        await watcher.until_true("document.getElementById('role').textContent.startsWith('you fly')")
        await watcher.press("d")
        await watcher.until("<abcd>")
        await pilot.call("Page.navigate", url=address)
        await pilot.until("<abcd>")
        assert (await role(pilot)).startswith("you watch")

        await watcher.press("q")
        await watcher.until_true("!document.getElementById('again').hidden")
        own = (address, address.replace("http", "ws", 1), "data:", "about:blank")
        assert [one for page in (pilot, watcher) for one in page.asked if not one.startswith(own)] == []
        assert len([one for one in pilot.asked if one.endswith("screen.js")]) >= 1
        assert (pilot.errors, watcher.errors) == ([], [])


async def test_a_tablet_presses_with_a_finger() -> None:
    async with serving(str(ROOT / "tests" / "served_app.py")) as address, running_browser() as browser:
        page = await browser.page("about:blank")
        await page.call("Emulation.setTouchEmulationEnabled", enabled=True)
        await page.call("Emulation.setDeviceMetricsOverride", width=800, height=1100, deviceScaleFactor=1, mobile=True)
        await page.open(address)
        await page.until("ready", "press me")
        await page.until_true("getComputedStyle(document.querySelector('.keys')).display !== 'none'")
        before, shown = "", await page.until("press me")
        while before != shown:  # until its size is told and painted
            await asyncio.sleep(0.3)
            before, shown = shown, await page.until("press me")
        row = next(number for number, line in enumerate(shown.splitlines()) if "press me" in line)
        line = f"document.querySelectorAll('.rows > div')[{row}].getBoundingClientRect()"
        x, y = await page.value(f"(b => [b.x + 60, b.y + b.height / 2])({line})")
        await page.tap(x, y)
        await page.until("(pressed)")
        wide = int((await page.text()).split("size ")[1].split("x")[0])
        assert wide >= 80
        await page.touch(".keys button")
        await page.until("escape")
        assert page.errors == []


@pytest.mark.thorough
async def test_a_flight_in_a_browser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Connect, fly, abort with a finger, look again after a reload; when everybody is gone the vehicle is let go."""
    monkeypatch.setattr(seats, "CLOSES_S", 2.0)
    words = ("-m", "gcs.cli", "fly", "--sim", "hover-ideal", "--card", "quick", "-o", str(tmp_path))
    about = tmp_path / "flight-0001" / "flight.json"
    async with serving(*words) as address, running_browser() as browser:
        page = await browser.page(address)
        await page.until("R makes", within_s=60)
        await page.press("r")
        await page.until("S starts", within_s=60)
        await page.press("s")
        await page.until("MODE SystemID", within_s=60)
        await page.touch("#abort")
        await page.until("MODE Stabilize", "aborted")
        await page.press("r")
        await page.until("S starts", within_s=60)
        await page.press("s")
        await page.until("MODE SystemID", within_s=60)
        await page.call("Page.reload")
        await page.until("MODE SystemID")
        assert (await role(page)).startswith("you fly")
        assert page.errors == []
        await page.call("Page.navigate", url="about:blank")
        async with asyncio.timeout(30):
            while [run["ending"] for run in json.loads(about.read_text())["runs"]] != ["aborted", "aborted"]:
                await asyncio.sleep(0.2)
