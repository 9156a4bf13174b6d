"""The app as a process of its own whose terminal are two pipes, as Textual's web driver speaks over them.

Each packet is a letter, four bytes of length, and so many bytes: D is what a terminal would get or type, M is JSON
about it (its size, that it shall end).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence

DRIVER = "gcs.browser.driver:ViewedWebDriver"
READY = b"__GANGLION__\n"
"""The driver's first line."""
MODES = re.compile(rb"\x1b\[\?([\d;]+)([hl])")
FRAME = b"2026"
"""Begins and ends a frame."""
ENDS_S = 60.0
"""A run that is under way is ended before the app is, settings and all; after that it is not asked any more."""
STDERR_BYTES = 20_000
MOST_BYTES = 16 << 20
"""Of a packet."""


class AppProcess:
    """One run of the app. `feed` is called with what it writes, `ended` once when it is over."""

    def __init__(self, feed: Callable[[bytes], None], ended: Callable[[int, str], None]) -> None:
        self._feed = feed
        self._ended = ended
        self._process: asyncio.subprocess.Process | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._modes: dict[bytes, bytes] = {}
        self._errors = b""
        self._writing = asyncio.Lock()

    @property
    def modes(self) -> bytes:
        """What a terminal that comes later must be told before it is painted."""
        return b"".join(b"\x1b[?%s%s" % mode for mode in self._modes.items())

    async def start(self, words: Sequence[str], size: tuple[int, int], environment: Mapping[str, str]) -> None:
        """Run the app in a terminal of so many columns and rows."""
        own = {
            **environment,
            "TEXTUAL_DRIVER": DRIVER,
            "TEXTUAL_COLOR_SYSTEM": "truecolor",
            "TERM_PROGRAM": "textual",
            "COLUMNS": str(size[0]),
            "ROWS": str(size[1]),
        }
        pipe = asyncio.subprocess.PIPE
        self._process = await asyncio.create_subprocess_exec(*words, stdin=pipe, stdout=pipe, stderr=pipe, env=own)
        self._tasks = [asyncio.create_task(self._read()), asyncio.create_task(self._read_errors())]

    async def type(self, text: str) -> None:
        """As if typed."""
        await self._send(b"D", text.encode())

    async def resize(self, size: tuple[int, int]) -> None:
        """The terminal's size."""
        await self._about({"type": "resize", "width": size[0], "height": size[1]})

    async def repaint(self) -> None:
        """All of the screen again, for whom it may be new."""
        await self._about({"type": "repaint"})

    async def stop(self) -> None:
        """Ask the app to end, and wait until it has: a run under way is ended by it."""
        if self._process is None:
            return
        await self._about({"type": "quit"})
        for insist in (self._process.terminate, self._process.kill):
            try:
                await asyncio.wait_for(self._process.wait(), ENDS_S)
                break
            except TimeoutError:
                with contextlib.suppress(ProcessLookupError):
                    insist()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _about(self, what: Mapping[str, str | int]) -> None:
        await self._send(b"M", json.dumps(what).encode())

    async def _send(self, kind: bytes, payload: bytes) -> None:
        stdin = None if self._process is None else self._process.stdin
        if stdin is None:
            return
        async with self._writing:
            with contextlib.suppress(ConnectionError, RuntimeError):  # it has ended: `ended` tells
                stdin.write(kind + len(payload).to_bytes(4, "big") + payload)
                await stdin.drain()

    async def _read(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        stream = self._process.stdout
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError, ValueError):
            while await stream.readuntil(b"\n") != READY:
                pass
            while True:
                kind, size = await stream.readexactly(1), int.from_bytes(await stream.readexactly(4), "big")
                if size > MOST_BYTES:
                    break
                payload = await stream.readexactly(size)
                if kind == b"D":
                    for number, state in MODES.findall(payload):
                        if number != FRAME:
                            self._modes[number] = state
                    self._feed(payload)
        self._ended(await self._process.wait(), self._errors.decode("utf-8", "replace"))

    async def _read_errors(self) -> None:
        assert self._process is not None
        assert self._process.stderr is not None
        while part := await self._process.stderr.read(4096):
            self._errors = (self._errors + part)[-STDERR_BYTES:]


def environment_without(secret: str) -> dict[str, str]:
    """This process's environment less a variable that the app need not know."""
    return {name: value for name, value in os.environ.items() if name != secret}


def app_words(words: Sequence[str]) -> list[str]:
    """The command line of `tippath fly` with these options."""
    return [sys.executable, "-m", "gcs.cli", "fly", *words]
