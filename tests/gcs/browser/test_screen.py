"""The page's terminal beside Textual: what its compositor writes, cut at every byte, and what its parser hears."""

from __future__ import annotations

import base64
import io
import json
from typing import Any

from aiohttp.test_utils import TestServer
from browser import running_browser
from fake_app import FLYING, app_on, settle
from rich.console import Console
from textual._compositor import LayoutUpdate
from textual._xterm_parser import XTermParser
from textual.geometry import Region

from gcs.browser.guard import Guard
from gcs.browser.server import Served, application

SIZE = (100, 30)
SEQUENCES = (
    "\x1b[?1049h\x1b[?2026$p\x1b[?2026h\x1b]0;a title\x07\x1b]8;id=1;https://x\x1b\\\x07"
    "\x1b[2J\x1b[1;1Hé漢\x1b[38;5;196;1mred\x1b[0m\x1b[3;5H\x1b[31;47;7mx\x1b[0m\x1b[3G\x1b[2Ke\u0301\r\nlow\x1b[2A\x1bPq\x1b\\"
    "\x1b[1;7Hx\x1b[1;2H😀\x1b[?2026l"
)
KEYS = {
    "r": {"key": "r"},
    "R": {"key": "R", "shiftKey": True},
    "enter": {"key": "Enter"},
    "tab": {"key": "Tab"},
    "shift+tab": {"key": "Tab", "shiftKey": True},
    "backspace": {"key": "Backspace"},
    "delete": {"key": "Delete"},
    "up": {"key": "ArrowUp"},
    "ctrl+right": {"key": "ArrowRight", "ctrlKey": True},
    "shift+home": {"key": "Home", "shiftKey": True},
    "pagedown": {"key": "PageDown"},
    "f1": {"key": "F1"},
    "f5": {"key": "F5"},
    "f12": {"key": "F12"},
    "ctrl+p": {"key": "p", "ctrlKey": True},
}


async def textual_writes() -> tuple[bytes, list[list[tuple[str, int | None, int | None]]]]:
    """The Fly screen as a driver would get it, and each cell's text and colours as they should be."""
    app, _ = app_on(FLYING)
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("2")
        await settle(app)
        strips = app.screen._compositor.render_strips()
    update = LayoutUpdate([[strip] for strip in strips], Region(0, 0, *SIZE))  # type: ignore[arg-type]
    console = Console(file=io.StringIO(), color_system="truecolor", force_terminal=True)
    cells: list[list[tuple[str, int | None, int | None]]] = [[] for _ in strips]
    for row, strip in zip(cells, strips, strict=True):
        for segment in strip:
            style = segment.style
            colours = [
                None if one is None or one.is_default else int.from_bytes(bytes(one.get_truecolor()), "big")
                for one in ((style.color, style.bgcolor) if style else (None, None))
            ]
            row += [(sign, colours[0], colours[1]) for sign in segment.text]
    return update.render_segments(console).encode(), cells


def heard(sequence: str) -> list[Any]:
    return list(XTermParser().feed(sequence))


async def test_the_terminal_shows_what_textual_writes_and_types_what_it_hears() -> None:
    written, cells = await textual_writes()
    guard = Guard("127.0.0.1", 0)
    server = TestServer(application(Served(["never started"], {}), guard))
    await server.start_server()
    object.__setattr__(guard, "port", server.port)
    try:
        async with running_browser() as browser:
            page = await browser.page(f"http://127.0.0.1:{server.port}/keys.js")  # a page without a script of its own
            await page.until_true("document.readyState === 'complete'")

            async def run(script: str) -> Any:
                return await page.value(f"(async () => {{ {script} }})()")

            feed = """const {Grid} = await import('/grid.js'), replies = [], bells = [];
                const grid = new Grid(COLS, ROWS);
                grid.onReply = (text) => replies.push(text); grid.onBell = () => bells.push(1);
                for (const letter of atob('BYTES')) grid.write(new Uint8Array([letter.charCodeAt(0)]));
                const held = (row) => [row.text, [...row.fg], [...row.bg], [...row.flags]];
                return [grid.rows.map(held), replies, bells.length]
            """

            def fed(data: bytes, cols: int, rows: int) -> str:
                text = feed.replace("COLS", str(cols)).replace("ROWS", str(rows))
                return text.replace("BYTES", base64.b64encode(data).decode())

            rows, _, _ = await run(fed(written, *SIZE))
            assert ["".join(row[0]) for row in rows] == ["".join(cell[0] for cell in row) for row in cells]
            for (_, fg, bg, _), row in zip(rows, cells, strict=True):
                for x, (_, ink, paper) in enumerate(row):
                    assert ink in (None, fg[x])
                    assert paper in (None, bg[x])
            reversed_cells = {(x, y) for y, row in enumerate(rows) for x, flags in enumerate(row[3]) if flags & 16}
            assert len({colour for row in rows for colour in row[1]}) > 3

            rows, replies, bells = await run(fed(SEQUENCES.encode(), 12, 4))
            assert replies == ["\x1b[?2026;2$y"]
            assert bells == 1  # the title's end is none
            assert rows[0][0] == ["é", "😀", "", "r", "e", "d", "x", *" " * 5]
            assert rows[0][1][3] == 0xFF0000
            assert rows[0][3][3] == 1
            assert rows[2][0][:4] == [" ", " ", "é", " "]
            assert "".join(rows[3][0]).strip() == "low"

            for name, event in KEYS.items():
                keys = await run(f"return (await import('/keys.js')).sequence({json.dumps(event)})")
                assert [one.key for one in heard(keys)] == [name], name
            assert await run("return (await import('/keys.js')).sequence({key: 'Escape'})") == "\x1b"

            painted = await run(f"""const {{Screen}} = await import('/screen.js'), screen = new Screen('monospace', 16);
                document.body.textContent = ''; screen.open(document.body); screen.resize({SIZE[0]}, {SIZE[1]});
                screen.write(Uint8Array.from(atob('{base64.b64encode(written).decode()}'), (one) => one.charCodeAt(0)));
                await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
                const canvas = document.querySelector('canvas'), {{wide, high}} = screen;
                const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
                const at = (x, y) => 4 * ((y * high + (high >> 1)) * canvas.width + x * wide + (wide >> 1));
                return [[...document.querySelectorAll('.rows > div')].map((row, y) => Array.from({{length: {SIZE[0]}}},
                    (_, x) => (pixels[at(x, y)] << 16) | (pixels[at(x, y) + 1] << 8) | pixels[at(x, y) + 2])),
                    [...document.querySelectorAll('.rows > div')].map((row) => row.textContent)]""")
            colours, shown = painted
            assert shown == ["".join(cell[0] for cell in row) for row in cells]
            for y, row in enumerate(cells):
                for x, (sign, ink, paper) in enumerate(row):
                    ground = ink if (x, y) in reversed_cells else paper
                    assert sign != " " or ground in (None, colours[y][x])
            assert page.errors == []
    finally:
        await server.close()
