"""The screens on a recorded flight as PNGs, to be looked at and for the README.

python tests/gcs/tui/draw_screens.py FLIGHT DIR [WIDTHxHEIGHT]
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from gcs.tui.app import TippathApp
from gcs.tui.reconnect import Reconnecting

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


async def draw_all(flight: Path, folder: Path, size: tuple[int, int]) -> None:
    engine = Reconnecting(folder=folder)
    app = TippathApp(engine, bell=False, connections=engine, first="runs")
    try:
        engine.desk.open(str(flight))
        if engine.desk.state().current is not None:
            engine.desk.compare()
        async with app.run_test(size=size) as pilot:
            for name, key in SCREENS.items():
                await pilot.press(key)
                await pilot.pause(0.8)
                draw(app, folder / f"{name}.png")
    finally:
        engine.close()


if __name__ == "__main__":
    flight, folder, *rest = sys.argv[1:]
    width, height = (int(word) for word in (rest or ["120x40"])[0].split("x"))
    Path(folder).mkdir(parents=True, exist_ok=True)
    asyncio.run(draw_all(Path(flight), Path(folder), (width, height)))
