"""Where a model fails, as one picture: a row for each axis, a cell for each band of frequency.

A cell is told by its shade, by its colour and by its letters, so that none of the three is needed to read the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from rich.cells import cell_len

from gcs.tui.plot.draw import CharArray, Style
from gcs.tui.plot.layout import shares
from gcs.tui.plot.model import Row
from gcs.tui.plot.rows import CURSOR, HEAT, MARK, TEXT, CodeArray, cut, fit, headed, runs

LEVELS = (0.02, 0.1, 0.25, 0.45)
"""Shares of an axis's error from which on a cell has the next darker shade."""
_SHADES: dict[Style, str] = {"braille": " ░▒▓█", "block": " ░▒▓█", "ascii": " .:+@"}
_FRAME: dict[Style, str] = {"braille": "┏━┓┃┗┛", "block": "┏━┓┃┗┛", "ascii": "#=#|##"}
_POINTS: dict[Style, str] = {"braille": "▶◀", "block": "▶◀", "ascii": "><"}
LEAST_CELL = 6
FIRST_BAND = 1.6
"""As wide as this factor in frequency is a band drawn that begins at zero."""
TALLEST = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One axis in one band."""

    beyond: float
    """Share of the axis's error that sits here and is not noise, 0..1."""
    words: tuple[str, ...]
    """Inside the cell, the most important first; as many as there is room for."""
    said: str
    """All of it, as a sentence, for the cell under the cursor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeatRow:
    """One axis."""

    output: str
    axis: str
    names: tuple[str, ...]
    """Beside its cells, the name first; as many as there is room for."""
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeatPlot:
    """Axes above each other, the worst first."""

    rows: tuple[HeatRow, ...]
    edges_hz: tuple[float, ...]
    """(cells + 1,), of the bands; the first may be zero."""
    outlined: tuple[int, int, int] | None = None
    """Row, first and last cell of what the finding names."""
    title: str = ""

    def worded(self, change: Callable[[str], str]) -> HeatPlot:
        """With every text changed: made harmless, or ASCII."""
        rows = tuple(
            replace(
                row,
                names=tuple(map(change, row.names)),
                cells=tuple(
                    replace(one, words=tuple(map(change, one.words)), said=change(one.said)) for one in row.cells
                ),
            )
            for row in self.rows
        )
        return replace(self, rows=rows, title=change(self.title))

    @property
    def darkest(self) -> tuple[int, int]:
        """Row and cell with the most error beyond noise: of what is outlined, else of all."""
        places = [(i, k) for i, row in enumerate(self.rows) for k in range(len(row.cells))]
        if self.outlined is not None:
            row, first, last = self.outlined
            places = [(row, k) for k in range(first, last + 1)]
        return max(places, key=lambda at: self.rows[at[0]].cells[at[1]].beyond, default=(0, 0))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    """How a box is divided, in cells."""

    left: int
    head: bool
    tall: int
    """Rows of an axis."""
    gap: int
    """Blank rows between two axes."""
    shown: int
    """Axes that there is room for."""
    starts: tuple[int, ...]
    """(cells + 1,), first column of each cell, and the end of the last."""
    edges: bool
    said: bool

    @property
    def top(self) -> int:
        return int(self.head)

    def row_at(self, i: int) -> int:
        """The first row of an axis."""
        return self.top + i * (self.tall + self.gap)


@lru_cache(maxsize=32)
def _plan(edges_hz: tuple[float, ...], count: int, width: int, height: int) -> _Plan:
    left = 13 if width >= 70 else 6 if width >= 40 else 0
    rest = height - count
    edges, said, head = rest >= 1, rest >= 2, rest >= 3
    rows = max(height - edges - said - head, 0)
    shown = min(count, rows)
    tall = min(TALLEST, rows // shown) if shown else 0
    gap = int(tall >= 3 and rows - tall * shown >= shown - 1)
    if not gap and tall > 3:
        tall, gap = (rows - shown + 1) // shown, 1
    number = len(edges_hz) - 1
    columns = width - left
    low = edges_hz[0] if edges_hz[0] > 0 else edges_hz[1] / FIRST_BAND
    octaves = np.diff(np.log([low, *edges_hz[1:]])).tolist()
    least = min(LEAST_CELL, max(columns // number, 1))
    widths = [one + least - 1 for one in shares(columns - number * (least - 1), octaves)]
    starts = tuple(int(one) for one in left + np.concatenate([[0], np.cumsum(widths)]))
    return _Plan(left=left, head=head, tall=tall, gap=gap, shown=shown, starts=starts, edges=edges, said=said)


def cell_at(plot: HeatPlot, width: int, height: int, x: int, y: int) -> tuple[int, int] | None:
    """Row and cell that a place of the picture belongs to; None beside the cells."""
    plan = _plan(plot.edges_hz, len(plot.rows), width, height)
    cells = [k for k in range(len(plan.starts) - 1) if plan.starts[k] <= x < plan.starts[k + 1]]
    rows = [i for i in range(plan.shown) if plan.row_at(i) <= y < plan.row_at(i) + plan.tall]
    return (rows[0], cells[0]) if rows and cells else None


def heat(plot: HeatPlot, width: int, height: int, style: Style, at: tuple[int, int]) -> tuple[Row, ...]:
    """`height` rows of exactly `width` cells; `at` is the row and the cell under the cursor."""
    if width < 1 or height < 1:
        return ()
    blank: Row = ((" " * width, "text"),)
    if not plot.rows or width < len(plot.edges_hz):
        return (blank,) * height
    plan = _plan(plot.edges_hz, len(plot.rows), width, height)
    chars, codes = np.full((height, width), " "), np.full((height, width), TEXT, dtype=np.uint8)
    for i, row in enumerate(plot.rows[: plan.shown]):
        top = plan.row_at(i)
        for line, name in enumerate(row.names[: plan.tall]):
            _write(chars, top + line, 1, name, plan.left - 2)
        for k, one in enumerate(row.cells):
            _cell(plan, one, chars[:, plan.starts[k] :], codes[:, plan.starts[k] :], top, k, style, at == (i, k))
    if plot.outlined is not None and plot.outlined[0] < plan.shown:
        _outline(plan, plot.outlined, chars, codes, style)
    if plan.edges:
        _edges(plan, plot.edges_hz, chars[height - 1 - plan.said])
    rows = [runs(chars[y], codes[y]) for y in range(height)]
    if plan.head:
        rows[0] = _head(plot, width, style)
    if plan.said:
        said = plot.rows[at[0]].cells[at[1]].said
        rows[-1] = ((cut(f" {said}", width, style), "title"),)
    return tuple(rows)


def _write(chars: CharArray, row: int, column: int, text: str, room: int) -> None:
    """A text in its cells, as much of it as there is room for; one of wide characters is left out."""
    text = text[: max(room, 0)]
    if cell_len(text) == len(text):
        chars[row, column : column + len(text)] = list(text)


def _cell(
    plan: _Plan, one: Cell, chars: CharArray, codes: CodeArray, top: int, k: int, style: Style, here: bool
) -> None:
    """Shade and letters; a column to the right stays free, so that neighbours are told apart."""
    wide = plan.starts[k + 1] - plan.starts[k] - 1
    level = int(np.searchsorted(LEVELS, one.beyond, side="right"))
    box = slice(top, top + plan.tall), slice(0, wide)
    chars[box] = _SHADES[style][level]
    codes[box] = HEAT + level - 1 if level else TEXT
    inside = plan.tall - 2 if plan.tall >= 3 else plan.tall
    fitting = [text for text in one.words if cell_len(text) == len(text) <= wide - 2][:inside]
    first = top + (plan.tall - len(fitting)) // 2
    for line, text in enumerate(fitting):
        padded = f" {text} "
        if here and line == 0:
            padded = _POINTS[style][0] + text + _POINTS[style][1]
        begin = max((wide - len(padded)) // 2, 0)
        chars[first + line, begin : begin + len(padded)] = list(padded)
        codes[first + line, begin : begin + len(padded)] = CURSOR if here and line == 0 else TEXT


def _outline(plan: _Plan, outlined: tuple[int, int, int], chars: CharArray, codes: CodeArray, style: Style) -> None:
    """A frame on the outermost characters of some cells; on one row only its sides."""
    row, first, last = outlined
    left, right = plan.starts[first], plan.starts[last + 1] - 2
    top, bottom = plan.row_at(row), plan.row_at(row) + plan.tall - 1
    corner, across, corner_right, side, below, below_right = list(_FRAME[style])
    for y in range(top, bottom + 1):
        chars[y, [left, right]], codes[y, [left, right]] = side, MARK
    if bottom - top < 2:
        return
    for y, ends in ((top, corner + corner_right), (bottom, below + below_right)):
        chars[y, left : right + 1], codes[y, left : right + 1] = across, MARK
        chars[y, [left, right]] = list(ends)


def _edges(plan: _Plan, edges_hz: tuple[float, ...], chars: CharArray) -> None:
    """The bands' edges under the cells' own."""
    if plan.left:
        chars[plan.left - 3 : plan.left - 1] = list("Hz")
    *starts, end = plan.starts
    free = 0
    for start, edge in zip([*starts, end - 1], edges_hz, strict=True):
        text = f"{edge:.2g}"
        begin = min(start, chars.size - len(text))
        if begin >= free:
            chars[begin : begin + len(text)] = list(text)
            free = begin + len(text) + 1


def _head(plot: HeatPlot, width: int, style: Style) -> Row:
    """The title, and what the shades are."""
    shades = [(_SHADES[style][i] * 2, f" {100 * least:.0f}  ", HEAT + i - 1) for i, least in enumerate(LEVELS, 1)]
    words = "% of its error "
    room = sum(len(sample) + len(text) for sample, text, _ in shades) + len(words)
    title = min(cell_len(plot.title) + 2, max(width - room, 0))
    if width - room < 20:
        return headed(plot.title, width, style)
    legend = "".join(sample + text for sample, text, _ in shades) + words
    chars = np.array(list(fit(f"{'':{width - room - title}}{legend}", width - title)))
    codes = np.full(chars.size, TEXT, dtype=np.uint8)
    at = width - room - title
    for sample, text, code in shades:
        codes[at : at + len(sample)] = code
        at += len(sample) + len(text)
    return (*headed(plot.title, title, style), *runs(chars, codes))
