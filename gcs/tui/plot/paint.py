"""Panels over an axis to rows of characters.

Every column of dots shows all samples of its slice. Where two signals share a cell their dots are joined, and the cell
is called `both`; the second signal is dotted (in braille every other column of dots, except where a peak is) or has
characters of its own, so that the two are told apart without colour.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rich.cells import cell_len

from gcs.tui.plot.axis import axis_row, marks_row, tick_columns
from gcs.tui.plot.draw import (
    EDGE,
    ZERO,
    ZERO_EVERY,
    BoolArray,
    CharArray,
    FloatArray,
    Style,
    cells,
    glyphs,
    raster,
    round_limit,
    slices,
    zero_row,
)
from gcs.tui.plot.layout import Grid, Sheet, shaded_at, sheet_of
from gcs.tui.plot.model import Ink, Panel, Plot, Row, TimePlot, View
from gcs.tui.plot.ready import Layer, Prepared, ReadyPanel, reading
from gcs.tui.plot.rows import CURSOR, GRID, REFERENCE, RESIDUAL, TEXT, CodeArray, figure, fit, headed, runs

Scale = tuple[float, float]
"""Values at the bottom and at the top."""
Extent = tuple[FloatArray, FloatArray]
"""Least and largest value, (slices,)."""
ROOM_FOR_TICKS = 5
"""Rows from which on a panel has numbers beside it, and a grid."""
REFERENCE_EVERY = 4
"""A reference has a dot in every so many columns."""


def picture(
    ready: Prepared, view: View, width: int, height: int, style: Style, cursor: float | None = None
) -> tuple[Row, ...]:
    """`height` rows of exactly `width` cells. cursor: on the axis as drawn (s, log10 of Hz)."""
    if width < 1 or height < 1:
        return ()
    sheet = sheet_of(ready, view, width, height, style, cursor=cursor)
    rows: list[Row] = []
    if sheet.plan.head:
        rows.append(_head(ready.plot, width, style))
    for one, height_rows in zip(ready.panels, sheet.plan.rows, strict=False):
        rows += _panel(sheet, one, height_rows)
    if sheet.plan.marks:
        rows.append(marks_row(sheet))
    if sheet.plan.axis:
        rows.append(axis_row(sheet))
    blank: Row = ((" " * width, "text"),)
    return tuple(rows[:height]) + (blank,) * (height - len(rows))


@dataclass(frozen=True, eq=False, slots=True)
class _Extents:
    """Least and largest value of every signal of a panel in each slice of the axis."""

    line: Extent
    over: Extent | None
    references: tuple[Extent, ...]

    @property
    def signals(self) -> list[Extent]:
        """What is measured and what is modelled."""
        return [self.line] if self.over is None else [self.line, self.over]


def _extents(one: ReadyPanel, grid: Grid) -> _Extents:
    def extent(layer: Layer) -> Extent:
        u = layer.u - grid.origin if grid.origin else layer.u
        return slices(u, layer.values, grid.first, grid.width, grid.dots, joined=layer.joined)

    over = None if one.over is None else extent(one.over)
    return _Extents(extent(one.line), over, tuple(extent(layer) for layer in one.references))


def _panel(sheet: Sheet, one: ReadyPanel, rows: int) -> list[Row]:
    """A panel in its rows; its scale is appended to those of the panels above."""
    panel, plan = one.panel, sheet.plan
    extents = _extents(one, sheet.grid)
    scale = _scale(panel, extents.signals if panel.centred else [*extents.signals, *extents.references])
    chars, codes = _canvas(sheet, panel, extents, rows, scale)
    ticks = _ticks(panel, scale, rows)
    _grid(sheet, panel, ticks, scale, chars, codes)
    if not one.line.u.size and panel.absent:
        text = panel.absent[: plan.columns]
        middle = (rows - 1) // 2
        chars[middle, : len(text)] = list(text)
        codes[middle, : len(text)] = TEXT
    _spread(chars, codes)
    if sheet.column is not None:
        bare = chars[:, sheet.column] == " "
        chars[bare, sheet.column] = "|" if sheet.style == "ascii" else "│"
        codes[:, sheet.column] = CURSOR
    left = (
        _left(panel, scale, rows, plan.left, sheet.style) if len(ticks) < 2 else _ticked(panel, ticks, rows, plan.left)
    )
    right = _right(sheet, one, extents.line, rows, scale)
    painted: list[Row] = []
    for i in range(rows):
        before: Row = ((fit(left[i], plan.left), "text"),) if plan.left else ()
        after: Row = ((fit(right[i], plan.right), "text"),) if plan.right else ()
        painted.append(before + runs(chars[i], codes[i]) + after)
    return painted


def _grid(
    sheet: Sheet, panel: Panel, ticks: Mapping[int, str], scale: Scale, chars: CharArray, codes: CodeArray
) -> None:
    """Zero and ticks, sparse, where nothing else is; and the edges of what is shaded."""
    bottom, top = scale
    rows = chars.shape[0]
    across = set(ticks) - {0, rows - 1}
    if panel.centred and bottom < 0 < top:
        across.add(_row_of(0.0, scale, rows))
    every = np.arange(0, sheet.plan.columns, ZERO_EVERY)
    places = [(np.full(every.size, row), every, ZERO[sheet.style]) for row in across]
    down = np.arange(rows)
    if len(ticks) > 1 and sheet.style != "ascii":
        second = down[::2]
        places += [(second, np.full(second.size, column), ZERO[sheet.style]) for column in tick_columns(sheet)]
    edges = {column for ends in shaded_at(sheet) for column in ends}
    places += [(down, np.full(rows, column), EDGE[sheet.style]) for column in edges]
    for y, x, sign in places:
        bare = np.isin(chars[y, x], (" ", ZERO[sheet.style]))
        chars[y[bare], x[bare]], codes[y[bare], x[bare]] = sign, GRID


def _row_of(value: float, scale: Scale, rows: int) -> int:
    bottom, top = scale
    return zero_row(rows) if value == 0 and bottom == -top else round((rows - 1) * (top - value) / (top - bottom))


def _ticks(panel: Panel, scale: Scale, rows: int) -> dict[int, str]:
    """Row -> label of its value, where a panel is high enough for a scale."""
    if rows < ROOM_FOR_TICKS:
        return {}
    bottom, top = scale
    if panel.logarithmic:
        powers = range(math.ceil(bottom), math.floor(top) + 1)
        return {_row_of(power, scale, rows): f"1e{power}" for power in powers[:: max(1, math.ceil(len(powers) / rows))]}
    parts = 4 if rows >= 2 * ROOM_FOR_TICKS - 1 else 2
    values = [bottom + (top - bottom) * i / parts for i in range(parts + 1)]
    return {_row_of(value, scale, rows): f"{value + 0.0:.3g}" for value in values}


def _ticked(panel: Panel, ticks: Mapping[int, str], rows: int, width: int) -> list[str]:
    """The name, and every tick's label, right-aligned."""
    lines = []
    for row in range(rows):
        name, label = f" {panel.name}" if row == 0 else "", ticks.get(row, "")
        room = max(width - 1 - len(label), 0)
        lines.append(name if cell_len(name) >= room else name + " " * (room - cell_len(name)) + label)
    return lines


def _canvas(sheet: Sheet, panel: Panel, extents: _Extents, rows: int, scale: Scale) -> tuple[CharArray, CodeArray]:
    """Characters and what each is a part of, (rows, columns)."""
    style, (bottom, top) = sheet.style, scale

    def dots(extent: Extent, wraps: bool = panel.wraps) -> BoolArray:
        low, high = extent
        return raster(low, high, rows, sheet.plan.columns, bottom, top=top, style=style, wraps=wraps)

    first = cells(dots(extents.line), style)
    codes = (first > 0).astype(np.uint8)
    if extents.over is None and not extents.references:
        codes[codes > 0] = RESIDUAL if panel.residual else 1
        return glyphs(first, style), codes
    second = np.zeros_like(first)
    if extents.over is not None:
        second = cells(dots(extents.over), style)
        codes += 2 * (second > 0).astype(np.uint8)
    third = np.zeros_like(first)
    for level in (level for extent in extents.references for level in extent):
        # what lies outside the scale allows anything, and is not drawn at the edge
        inside = (level >= bottom) & (level <= top)
        inside[np.arange(inside.size) % REFERENCE_EVERY > 0] = False
        shown = np.where(inside, level, np.nan)
        third |= cells(dots((shown, shown), wraps=False) & inside, style)
    chars = glyphs(first, style)
    for numbers, kind, among in ((second, "over", codes == 2), (first | second, "both", codes == 3)):
        chars[among] = glyphs(numbers, style, kind)[among]  # type: ignore[arg-type]
    if panel.residual:
        codes[codes == 1] = RESIDUAL
    # dashed, before all else: the noise stays in sight where a residual comes down to it
    chars[third > 0], codes[third > 0] = glyphs(third, style, "reference")[third > 0], REFERENCE
    return chars, codes


def _scale(panel: Panel, drawn: Sequence[Extent]) -> Scale:
    if panel.fixed is not None and math.isfinite(panel.fixed[1] - panel.fixed[0]) and panel.fixed[1] > panel.fixed[0]:
        return panel.fixed
    low = min((float(np.fmin.reduce(one[0])) for one in drawn if one[0].size), default=math.nan, key=_number_first)
    high = max((float(np.fmax.reduce(one[1])) for one in drawn if one[1].size), default=math.nan, key=_nan_last)
    if panel.centred:
        peak = max(abs(low), abs(high)) if low == low else 0.0
        limit = round_limit(peak, panel.least)
        limit = limit if panel.most is None else min(limit, panel.most)
        return -limit, limit
    if low != low:
        low = high = 0.0
    if panel.logarithmic:
        top = float(math.ceil(high - 1e-9))
        bottom = float(math.floor(low + 1e-9))
        if panel.most is not None:
            bottom = max(bottom, top - panel.most)
        return min(bottom, top - panel.least), top
    step = round_limit((high - low) / 4, panel.least / 4)
    bottom, top = math.floor(low / step) * step, math.ceil(high / step) * step
    if not top - bottom >= panel.least:
        bottom, top = bottom - step, top + step
    return (bottom, top) if top > bottom else (bottom - abs(bottom) - 1, top + abs(top) + 1)


def _number_first(x: float) -> float:
    return math.inf if x != x else x


def _nan_last(x: float) -> float:
    return -math.inf if x != x else x


def _spread(chars: CharArray, codes: CodeArray) -> None:
    """Blanks join the run at their left: fewer runs, the same picture."""
    place = np.where(chars == " ", 0, np.arange(codes.shape[1]))
    codes[:] = np.take_along_axis(codes, np.maximum.accumulate(place, axis=1), axis=1)


def _left(panel: Panel, scale: Scale, rows: int, width: int, style: Style) -> list[str]:
    bottom, top = scale
    if bottom == -top:
        ends = ("", f"{'+-' if style == 'ascii' else '±'}{top:.4g}")
    elif panel.logarithmic:
        ends = (f"1e{top:.0f}", f"1e{bottom:.0f}")
    else:
        ends = (f"{top:.4g}", f"{bottom:.4g}")
    name = f" {panel.name}"
    if rows == 1:
        both = f"{name} {ends[1]}"
        return [both if cell_len(both) < width else name]
    first = f"{name} {ends[0]}" if ends[0] else name
    if ends[0] and cell_len(first) < width:
        first = name + " " * (width - 1 - cell_len(name) - len(ends[0])) + ends[0]
    else:
        first = name
    last = f" {ends[1]}" if bottom == -top else f"{ends[1]:>{max(width - 1, 0)}}"
    return [first, *[""] * (rows - 2), last]


def _right(sheet: Sheet, one: ReadyPanel, line: Extent, rows: int, scale: Scale) -> list[str]:
    plot, width, cursor = sheet.ready.plot, sheet.plan.right, sheet.cursor
    if width < 1 or not one.line.u.size:
        return [""] * rows
    panel = one.panel
    largest = max(abs(scale[0]), abs(scale[1]))
    if panel.logarithmic:
        largest = 10.0 ** min(scale[1], 90.0)
    low, high = line
    peak = np.fmax.reduce(np.fmax(np.abs(low), np.abs(high)), initial=np.nan)
    lines: list[str]
    if cursor is not None:
        found = reading(one, cursor)
        lines = [_with_unit(figure(found.line, largest), panel.unit, width)]
        if found.over is not None:
            lines.append(f" {figure(found.over, largest)} {plot.words[1]}")
        if found.reference is not None:
            lines.append(f" {figure(found.reference, largest, False)} {plot.words[2]}")
        if rows == 1 and found.over is not None:
            lines = [f" {figure(found.line, largest)}/{figure(found.over, largest)}"]
    elif isinstance(plot, TimePlot) and plot.span_s is not None:
        now = plot.stale or _with_unit(figure(_newest(one), largest), panel.unit, width).strip()
        told = f"{peak:.2f}" if 0.01 <= largest < 1e4 else figure(float(peak), largest, False)
        lines = [f" {now[:7].rstrip()} ^{told}"] if rows == 1 else [f" {now}", f" peak {told}"]
    elif panel.centred:
        lines = [_with_unit(f"peak {figure(float(peak), largest, False)}", panel.unit, width)]
    else:
        lines = [f" {panel.unit}" if cell_len(panel.unit) < width else ""]
    return (lines + [""] * rows)[:rows]


def _with_unit(text: str, unit: str, width: int) -> str:
    return f" {text} {unit}" if cell_len(text) + cell_len(unit) + 2 <= width else f" {text}"


def _newest(one: ReadyPanel) -> float:
    """The newest value; NaN where the newest sample has none."""
    if not one.u.size or not one.line.u.size or one.line.u[-1] != one.u[-1]:
        return math.nan
    return float(one.line.values[-1])


SAMPLES: dict[Style, tuple[str, str, str]] = {
    "braille": ("⠒⠒", "▞▚", "─ ─"),
    "block": ("▀▄", "¯_", "· ·"),
    "ascii": ("'.|", "^_!", "~ ~"),
}
BOTH: dict[Style, str] = {"braille": "⠶⠶", "block": "▘▖", "ascii": "*o#"}
"""Where the first two stand in one cell."""


def _head(plot: Plot, width: int, style: Style) -> Row:
    """The title, and at the right what is drawn how."""
    first: Ink = "residual" if plot.panels and plot.panels[0].residual else "measured"
    inks: tuple[Ink, Ink, Ink] = (first, "model", "reference")
    legend: list[tuple[str, Ink]] = []
    title = min(cell_len(plot.title), width // 2)
    room = width - 2 - title
    for word, sample, ink in zip(plot.words, SAMPLES[style], inks, strict=True):
        needed = len(sample) + cell_len(word) + 3
        if word and needed <= room:
            legend += [(sample, ink), (f" {word}  ", "text")]
            room -= needed
    if plot.words[1] and room >= 10:
        legend += [(BOTH[style], "both"), (" both  ", "text")]
        room -= len(BOTH[style]) + 7
    return (*headed(plot.title, room + title + 2, style), *legend)
