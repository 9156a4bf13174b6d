"""The screens as PNGs, to be looked at and for the README: `make pictures` draws all of the snapshots' moments in every
theme and size; with a flight, what the app shows of that.

make pictures DIR=DIR [FLIGHT=FLIGHT] [SIZES=120x40] [THEMES=dark]
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Sequence
from pathlib import Path

from fake_app import app_on, settle
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont
from test_snapshots import FLOWN, SHOTS, Connections

from gcs.tui.app import TippathApp
from gcs.tui.reconnect import Reconnecting
from gcs.tui.themes import THEMES

Size = tuple[int, int]
"""Columns and rows."""
CELL = (10, 20)
DOTS = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1))
"""Row and column of braille's dots, in the order of its bits."""
SCREENS = {"runs": "3", "fit": "4", "compare": "5", "diagnose": "6", "ladder": "7", "controller": "8", "report": "9"}


def font(weight: str) -> ImageFont.FreeTypeFont:
    found = font_manager.findfont(font_manager.FontProperties(family="DejaVu Sans Mono", weight=weight))
    return ImageFont.truetype(found, 16)


def draw(app: TippathApp, path: Path) -> None:
    """What a terminal would show. Braille is drawn dot by dot, because few fonts have it."""
    plain, bold = font("normal"), font("bold")
    (w, h), size = CELL, app.size
    image = Image.new("RGB", (size.width * w, size.height * h))
    pen = ImageDraw.Draw(image)
    for row, strip in enumerate(app.screen._compositor.render_strips()):
        x, y = 0, row * h
        for segment in strip:
            style = segment.style
            ink, paper = (255, 255, 255), (0, 0, 0)
            if style is not None:
                ink = tuple(style.color.get_truecolor()) if style.color else ink
                paper = tuple(style.bgcolor.get_truecolor()) if style.bgcolor else paper
                if style.reverse:
                    ink, paper = paper, ink
            for sign in segment.text:
                pen.rectangle((x, y, x + w, y + h), fill=paper)
                bits = ord(sign) - 0x2800
                if 0 <= bits < 256:
                    for bit, (down, across) in enumerate(DOTS):
                        if bits >> bit & 1:
                            left, top = x + 1 + 5 * across, y + 1 + 5 * down
                            pen.ellipse((left, top, left + 3, top + 3), fill=ink)
                else:
                    pen.text((x, y), sign, font=bold if style is not None and style.bold else plain, fill=ink)
                x += w
    image.save(path)


async def draw_moments(folder: Path, size: Size, theme: str) -> None:
    """Each moment that the snapshots keep as text."""
    app, engine = app_on(FLOWN)
    app.theme, app.connections = theme, Connections()
    async with app.run_test(size=size) as pilot:
        await app.workers.wait_for_complete()
        for name, (key, state, more) in SHOTS.items():
            engine.now = state
            await pilot.press(key, *more)
            await settle(app)
            draw(app, folder / f"{name}-{size[0]}x{size[1]}-{theme}.png")


async def draw_flight(flight: Path, folder: Path, size: Size, theme: str) -> None:
    """A recorded flight, compared as far as it was fitted."""
    engine = Reconnecting(folder=folder)
    app = TippathApp(engine, bell=False, theme=theme, connections=engine, first="runs")
    try:
        engine.desk.open(str(flight))
        if engine.desk.state().current is not None:
            engine.desk.compare()
        async with app.run_test(size=size) as pilot:
            for name, key in SCREENS.items():
                await pilot.press(key)
                await pilot.pause(0.8)
                draw(app, folder / f"{name}-{size[0]}x{size[1]}-{theme}.png")
    finally:
        engine.close()


def main(words: Sequence[str]) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--flight", type=Path)
    parser.add_argument("--sizes", nargs="*", default=["80x24", "120x40", "200x50"])
    parser.add_argument("--themes", nargs="*", default=[one.name for one in THEMES])
    asked = parser.parse_args(words)
    asked.folder.mkdir(parents=True, exist_ok=True)
    for word in asked.sizes:
        width, height = (int(part) for part in word.split("x"))
        for theme in asked.themes:
            if asked.flight is None:
                asyncio.run(draw_moments(asked.folder, (width, height), theme))
            else:
                asyncio.run(draw_flight(asked.flight, asked.folder, (width, height), theme))


if __name__ == "__main__":
    main(sys.argv[1:])
