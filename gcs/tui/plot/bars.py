"""Horizontal bars as rows of characters."""

from __future__ import annotations

import itertools
import math

import numpy as np
from rich.cells import cell_len

from gcs.tui.plot.draw import CharArray, Style
from gcs.tui.plot.model import Bar, BarPlot, Ink, Row
from gcs.tui.plot.rows import CodeArray, fit, headed

_PARTS: dict[Style, str] = {"braille": "█▓░", "block": "█▓░", "ascii": "#=."}
_PART_INKS: tuple[Ink, Ink, Ink] = ("full", "rest", "reference")


def bars(plot: BarPlot, width: int, height: int, style: Style) -> tuple[Row, ...]:
    """`height` rows of exactly `width` cells: title and legend where there is room, then a row for each bar."""
    if width < 1 or height < 1:
        return ()
    rows: list[Row] = []
    if height > len(plot.bars) and (plot.title or plot.words):
        rows.append(_bars_head(plot, width, style))
    room = height - len(rows)
    shown = plot.bars if len(plot.bars) <= room else plot.bars[: max(room - 1, 1)]
    left = min(max((cell_len(one.label) for one in plot.bars), default=0) + 2, max(width // 3, 4), width)
    right = min(max((cell_len(one.text) for one in plot.bars), default=0) + 1, max((width - left) // 2, 0))
    columns = width - left - right
    for one in shown:
        chars, codes = np.full(columns, " "), np.zeros(columns, dtype=np.uint8)
        _one_bar(plot, one, chars, codes, style)
        ink: Ink = "both" if one.chosen else "text"
        row: list[tuple[str, Ink]] = [(fit(f" {one.label}", left - 1) + " ", ink)] if left else []
        text = "".join(chars.tolist())
        edges = [0, *(np.flatnonzero(codes[1:] != codes[:-1]) + 1).tolist(), columns] if columns else [0]
        row += [(text[a:b], _BAR_INKS[codes[a]]) for a, b in itertools.pairwise(edges)]
        if right:
            row.append((fit(f" {one.text}", right), ink))
        rows.append(tuple(row))
    if len(shown) < len(plot.bars) and room > 1:
        rows.append(((fit(f" {len(plot.bars) - len(shown)} more", width), "text"),))
    blank: Row = ((" " * width, "text"),)
    return tuple(rows[:height]) + (blank,) * (height - len(rows))


_BAR_INKS: tuple[Ink, ...] = ("blank", *_PART_INKS, "grid", "mark")


def _one_bar(plot: BarPlot, one: Bar, chars: CharArray, codes: CodeArray, style: Style) -> None:
    columns = chars.size
    if not columns:
        return
    full = plot.full if plot.full > 0 and math.isfinite(plot.full) else 1.0

    def cell(value: float) -> int:
        """How many cells a length is."""
        share = value / full
        return 0 if not share > 0 else min(columns, max(1, round(share * columns))) if share < 1 else columns

    begin, total = 0, 0.0
    for part, (length, glyph) in enumerate(zip(one.parts, _PARTS[style], strict=False)):
        if not length > 0:
            continue
        total += length
        end = cell(total)
        chars[begin:end], codes[begin:end] = glyph, part + 1
        begin = max(begin, end)
    signs = {"ascii": ("|", "<", "-", ">", "o")}.get(style, ("│", "├", "─", "┤", "●"))
    for value, _ in plot.lines:
        if 0 <= value <= full * 1.001:
            at = min(cell(value), columns - 1)
            chars[at], codes[at] = signs[0], 4
    if one.least is not None and one.most is not None and one.least <= one.most:
        low, high = (min(cell(value), columns - 1) for value in (one.least, one.most))
        chars[low : high + 1], codes[low : high + 1] = signs[2], 4
        chars[low], chars[high] = signs[1], signs[3]
    if one.beside is not None and one.beside == one.beside:
        at = min(max(cell(one.beside) - 1, 0), columns - 1)
        chars[at], codes[at] = signs[4], 5


def _bars_head(plot: BarPlot, width: int, style: Style) -> Row:
    legend: list[tuple[str, Ink]] = []
    title = min(cell_len(plot.title), width // 2)
    room = width - 2 - title
    bar_words = [
        (word, glyph * 2, ink) for word, glyph, ink in zip(plot.words, _PARTS[style], _PART_INKS, strict=False)
    ]
    more: list[tuple[str, str, Ink]] = [(word, "|" if style == "ascii" else "│", "grid") for _, word in plot.lines]
    if plot.beside and any(one.beside is not None for one in plot.bars):
        more.insert(0, (plot.beside, "o" if style == "ascii" else "●", "mark"))
    for word, sample, ink in [*bar_words, *more]:
        needed = len(sample) + cell_len(word) + 3
        if word and needed <= room:
            legend += [(sample, ink), (f" {word}  ", "text")]
            room -= needed
    return (*headed(plot.title, room + title + 2, style), *legend)
