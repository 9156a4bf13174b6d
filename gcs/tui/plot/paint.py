"""Panels over an axis to rows of characters.

Every column of dots shows all samples of its slice. Where two signals share a cell their dots are joined, and the cell
is called `both`; the second signal is dotted (in braille every other column of dots, except where a peak is) or has
characters of its own, so that the two are told apart without colour.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.cells import cell_len

from gcs.tui.plot.axis import axis_row, marks_row
from gcs.tui.plot.draw import (
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
from gcs.tui.plot.layout import Grid, Sheet, sheet_of
from gcs.tui.plot.model import Ink, Panel, Plot, Row, TimePlot, View
from gcs.tui.plot.ready import Layer, Prepared, ReadyPanel, reading
from gcs.tui.plot.rows import CURSOR, GRID, RESIDUAL, TEXT, CodeArray, figure, fit, headed, runs

Scale = tuple[float, float]
"""Values at the bottom and at the top."""
Extent = tuple[FloatArray, FloatArray]
"""Least and largest value, (slices,)."""
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
    scales: list[Scale] = []
    for one, height_rows in zip(ready.panels, sheet.plan.rows, strict=False):
        rows += _panel(sheet, one, height_rows, scales)
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


def _panel(sheet: Sheet, one: ReadyPanel, rows: int, scales: list[Scale]) -> list[Row]:
    """A panel in its rows; its scale is appended to those of the panels above."""
    panel, plan = one.panel, sheet.plan
    extents = _extents(one, sheet.grid)
    scale = _scale(panel, extents.signals if panel.centred else [*extents.signals, *extents.references], scales)
    scales.append(scale)
    chars, codes = _canvas(sheet, panel, extents, rows, scale)
    _zero_line(sheet, panel, scale, chars, codes)
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
    left = _left(panel, scale, rows, plan.left, sheet.style)
    right = _right(sheet, one, extents.line, rows, scale)
    painted: list[Row] = []
    for i in range(rows):
        before: Row = ((fit(left[i], plan.left), "text"),) if plan.left else ()
        after: Row = ((fit(right[i], plan.right), "text"),) if plan.right else ()
        painted.append(before + runs(chars[i], codes[i]) + after)
    return painted


def _zero_line(sheet: Sheet, panel: Panel, scale: Scale, chars: CharArray, codes: CodeArray) -> None:
    """Zero, sparse, where nothing else is."""
    bottom, top = scale
    if not (panel.centred and bottom < 0 < top):
        return
    rows = chars.shape[0]
    row = zero_row(rows) if bottom == -top else round((rows - 1) * top / (top - bottom))
    every = np.arange(0, sheet.plan.columns, ZERO_EVERY)
    every = every[chars[row, every] == " "]
    chars[row, every], codes[row, every] = ZERO[sheet.style], GRID


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
        over = dots(extents.over)
        second = cells(dotted(over) if style == "braille" else over, style)
        codes += 2 * (second > 0).astype(np.uint8)
    third = np.zeros_like(first)
    for low, _ in extents.references:
        # what lies outside the scale allows anything, and is not drawn at the edge
        inside = (low >= bottom) & (low <= top)
        inside[np.arange(inside.size) % REFERENCE_EVERY > 0] = False
        shown = np.where(inside, low, np.nan)
        third |= cells(dots((shown, shown), wraps=False) & inside, style)
    codes += 4 * (third > 0).astype(np.uint8)
    if style == "braille":
        chars = glyphs(first | second | third, style)
    else:
        chars = glyphs(third, style, "reference")
        for numbers, kind, among in (
            (first, "line", codes & 3 == 1),
            (second, "over", codes & 3 == 2),
            (first | second, "both", codes & 3 == 3),
        ):
            chars[among] = glyphs(numbers, style, kind)[among]  # type: ignore[arg-type]
    if panel.residual:
        codes[codes & 3 == 1] = RESIDUAL
    return chars, codes


def dotted(dots: BoolArray) -> BoolArray:
    """Every second column left out, except what no column beside it shows: no peak goes."""
    found = dots.copy()
    beside = dots[:, 0::2].copy()
    beside[:, :-1] |= dots[:, 2::2]
    found[:, 1::2] &= ~beside
    return found


def _scale(panel: Panel, drawn: Sequence[Extent], scales: Sequence[Scale]) -> Scale:
    if panel.fixed is not None and math.isfinite(panel.fixed[1] - panel.fixed[0]) and panel.fixed[1] > panel.fixed[0]:
        return panel.fixed
    if panel.scale_of is not None and 0 <= panel.scale_of < len(scales):
        return scales[panel.scale_of]
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
    "braille": ("⠒⠒", "⠂⠂", "⠂ ⠂"),
    "block": ("▀▄", "¯_", "· ·"),
    "ascii": ("'.|", "^_!", "~ ~"),
}


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
    if style == "ascii" and plot.words[1] and room >= 10:
        legend += [("*o#", "both"), (" both  ", "text")]
        room -= 10
    return (*headed(plot.title, room + title + 2, style), *legend)
