"""Panels over an axis to rows of characters.

Every column of dots shows all samples of its slice. Where two signals share a cell their dots are joined, and the cell
is called `both`; the second signal is dotted (in braille every other column of dots, except where a peak is) or has
characters of its own, so that the two are told apart without colour.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len, set_cell_size

from gcs.tui.plot.draw import (
    DOTS,
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
from gcs.tui.plot.model import FrequencyPlot, Ink, Panel, Plot, Row, TimePlot, View
from gcs.tui.plot.ready import Layer, Prepared, ReadyPanel, nearest, reading

REFERENCE_EVERY = 4
"""A reference has a dot in every so many columns."""
TICK_CELLS = 9
"""Labels of the axis stand at least so far apart."""
INKS: tuple[Ink, ...] = (
    "blank", "measured", "model", "both", "reference", "measured", "model", "both", "grid", "residual", "cursor",
    "mark", "text",
)  # fmt: skip
"""The first eight are sums of: 1 the line, 2 the one over it, 4 the reference."""
GRID, RESIDUAL, CURSOR, MARK = 8, 9, 10, 11

CodeArray = NDArray[np.uint8]


# ------------------------------------------------------------------------------------------------ layout


@dataclass(frozen=True, slots=True)
class Layout:
    """How a box is divided, in cells."""

    left: int
    columns: int
    right: int
    head: bool
    rows: tuple[int, ...]
    """Of the panels that are shown: the first ones where not all fit."""
    marks: bool
    axis: bool


def layout(plot: Plot, width: int, height: int) -> Layout:
    """Names at the left, values at the right, a line above and below: as much of it as leaves room for the signals."""
    left = 9 if width >= 50 else 6 if width >= 18 else 0
    right = 15 if width >= 64 else 9 if width >= 40 else 0
    count = min(len(plot.panels), max(height, 0))
    rest = height - count
    axis = rest >= 1 and count > 0
    head = rest >= 2 + count and bool(plot.title or plot.words[0])
    marks = rest >= 3 + count and isinstance(plot, FrequencyPlot) and bool(plot.marked)
    weights = [max(one.weight, 0.1) for one in plot.panels[:count]]
    return Layout(left, width - left - right, right, head, _shares(height - axis - head - marks, weights), marks, axis)


def _shares(rows: int, weights: Sequence[float]) -> tuple[int, ...]:
    """Rows divided by weight, each at least one."""
    if not weights:
        return ()
    wanted = np.array(weights) / sum(weights) * rows
    given = np.maximum(1, np.floor(wanted)).astype(int)
    while given.sum() > rows:
        given[int(np.argmax(given))] -= 1
    for i in np.argsort(given - wanted, kind="stable")[: rows - int(given.sum())]:
        given[i] += 1
    return tuple(int(one) for one in given)


@dataclass(frozen=True, slots=True)
class Grid:
    """Where the dots of a row lie on the axis: slice i is from (first + i) * width to the next, seen from `origin`."""

    origin: float
    first: int
    width: float
    dots: int

    def dot(self, place: float) -> int | None:
        found = math.floor((place - self.origin) / self.width) - self.first
        return found if 0 <= found < self.dots else None

    def place(self, dot: float) -> float:
        return self.origin + (self.first + dot) * self.width


def _grid(ready: Prepared, view: View, dots: int) -> Grid:
    if isinstance(ready.plot, TimePlot) and ready.plot.span_s is not None and view == ready.first:
        # Slices on a fixed grid of time: the picture moves along and does not shimmer.
        width = view.span / dots
        return Grid(0.0, math.floor(view.high / width) - dots + 1, width, dots)
    return Grid(view.low, 0, view.span / dots * (1 + 1e-9), dots)


def cursor_at(ready: Prepared, view: View, width: int, height: int, x: int) -> float | None:
    """The sample nearest to column x of a picture; None beside the panels."""
    plan = layout(ready.plot, width, height)
    if not plan.left <= x < plan.left + plan.columns or not ready.places.size:
        return None
    grid = _grid(ready, view, plan.columns)
    return float(ready.places[nearest(ready.places, grid.place(x - plan.left + 0.5))])


# ------------------------------------------------------------------------------------------------ picture


def picture(
    ready: Prepared, view: View, width: int, height: int, style: Style, cursor: float | None = None
) -> tuple[Row, ...]:
    """`height` rows of exactly `width` cells. cursor: on the axis as drawn (s, log10 of Hz)."""
    if width < 1 or height < 1:
        return ()
    plan = layout(ready.plot, width, height)
    grid = _grid(ready, view, plan.columns * DOTS[style][1])
    at = None if cursor is None else grid.dot(cursor)
    column = None if at is None else at // DOTS[style][1]
    rows: list[Row] = []
    if plan.head:
        rows.append(_head(ready.plot, width, style))
    scales: list[tuple[float, float]] = []
    for one, height_rows in zip(ready.panels, plan.rows, strict=False):
        rows += _panel(ready, one, grid, plan, height_rows, style, scales, cursor if at is not None else None, column)
    if plan.marks:
        rows.append(_marks(ready.plot, grid, plan, style))
    if plan.axis:
        rows.append(_axis_row(ready, view, grid, plan, style, cursor if at is not None else None, column))
    blank: Row = ((" " * width, "text"),)
    return tuple(rows[:height]) + (blank,) * (height - len(rows))


def _panel(
    ready: Prepared,
    one: ReadyPanel,
    grid: Grid,
    plan: Layout,
    rows: int,
    style: Style,
    scales: list[tuple[float, float]],
    cursor: float | None,
    column: int | None,
) -> list[Row]:
    panel = one.panel

    def extent(layer: Layer) -> tuple[FloatArray, FloatArray]:
        u = layer.u - grid.origin if grid.origin else layer.u
        return slices(u, layer.values, grid.first, grid.width, grid.dots, layer.joined)

    line = extent(one.line)
    over = None if one.over is None else extent(one.over)
    references = [extent(layer) for layer in one.references]
    drawn = [line] if over is None else [line, over]
    bottom, top = _scale(panel, drawn if panel.centred else drawn + references, scales)
    scales.append((bottom, top))
    chars, codes = _canvas(line, over, references, rows, plan.columns, (bottom, top), panel, style)
    if panel.centred and bottom < 0 < top:
        row = zero_row(rows) if bottom == -top else round((rows - 1) * top / (top - bottom))
        every = np.arange(0, plan.columns, ZERO_EVERY)
        every = every[chars[row, every] == " "]
        chars[row, every], codes[row, every] = ZERO[style], GRID
    if not one.line.u.size and panel.absent:
        text = panel.absent[: plan.columns]
        middle = (rows - 1) // 2
        chars[middle, : len(text)] = list(text)
        codes[middle, : len(text)] = len(INKS) - 1
    _spread(chars, codes)
    if column is not None:
        bare = chars[:, column] == " "
        chars[bare, column] = "|" if style == "ascii" else "│"
        codes[:, column] = CURSOR
    left = _left(panel, (bottom, top), rows, plan.left, style)
    right = _right(ready.plot, one, drawn, (bottom, top), rows, plan.right, cursor)
    found: list[Row] = []
    for i in range(rows):
        middle_runs = runs(chars[i], codes[i])
        before: Row = ((fit(left[i], plan.left), "text"),) if plan.left else ()
        after: Row = ((fit(right[i], plan.right), "text"),) if plan.right else ()
        found.append(before + middle_runs + after)
    return found


def _canvas(
    line: tuple[FloatArray, FloatArray],
    over: tuple[FloatArray, FloatArray] | None,
    references: Sequence[tuple[FloatArray, FloatArray]],
    rows: int,
    columns: int,
    scale: tuple[float, float],
    panel: Panel,
    style: Style,
) -> tuple[CharArray, CodeArray]:
    """Characters and what each is a part of, (rows, columns)."""
    bottom, top = scale
    first = cells(raster(*line, rows, columns, bottom, top, style, wraps=panel.wraps), style)
    codes = (first > 0).astype(np.uint8)
    if over is None and not references:
        codes[codes > 0] = RESIDUAL if panel.residual else 1
        return glyphs(first, style), codes
    second = np.zeros_like(first)
    if over is not None:
        dots = raster(*over, rows, columns, bottom, top, style, wraps=panel.wraps)
        second = cells(dotted(dots) if style == "braille" else dots, style)
        codes += 2 * (second > 0).astype(np.uint8)
    third = np.zeros_like(first)
    for low, _ in references:
        # what lies outside the scale allows anything, and is not drawn at the edge
        inside = (low >= bottom) & (low <= top)
        inside[np.arange(inside.size) % REFERENCE_EVERY > 0] = False
        shown = np.where(inside, low, np.nan)
        dots = raster(shown, shown, rows, columns, bottom, top, style) & inside
        third |= cells(dots, style)
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


def _scale(
    panel: Panel, drawn: Sequence[tuple[FloatArray, FloatArray]], scales: Sequence[tuple[float, float]]
) -> tuple[float, float]:
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


def runs(chars: CharArray, codes: CodeArray) -> Row:
    text = "".join(chars.tolist())
    edges = [0, *(np.flatnonzero(codes[1:] != codes[:-1]) + 1).tolist(), len(text)]
    inks = codes[edges[:-1]].tolist() if text else []
    return tuple((text[a:b], INKS[ink]) for a, b, ink in zip(edges[:-1], edges[1:], inks, strict=True))


# ------------------------------------------------------------------------------------------------ words


def fit(text: str, width: int) -> str:
    """Exactly `width` cells."""
    return set_cell_size(text, width) if width > 0 else ""


def figure(value: float, largest: float, signed: bool = True) -> str:
    """A value with as many decimals as a scale up to `largest` is worth."""
    if not math.isfinite(value):
        return "?"
    value += 0.0
    sign = "+" if signed else ""
    if not 1e-3 <= largest < 1e5:
        return f"{value:{sign}.1e}"
    decimals = 2 if 0.1 <= largest <= 10 else min(max(1 - math.floor(math.log10(largest) + 1e-9), 0), 4)
    return f"{value:{sign}.{decimals}f}"


def _left(panel: Panel, scale: tuple[float, float], rows: int, width: int, style: Style) -> list[str]:
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


def _right(
    plot: Plot,
    one: ReadyPanel,
    drawn: Sequence[tuple[FloatArray, FloatArray]],
    scale: tuple[float, float],
    rows: int,
    width: int,
    cursor: float | None,
) -> list[str]:
    if width < 1 or not one.line.u.size:
        return [""] * rows
    panel = one.panel
    largest = max(abs(scale[0]), abs(scale[1]))
    if panel.logarithmic:
        largest = 10.0 ** min(scale[1], 90.0)
    low, high = drawn[0]
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


def _marks(plot: Plot, grid: Grid, plan: Layout, style: Style) -> Row:
    """Where the marked bands lie."""
    assert isinstance(plot, FrequencyPlot)
    chars = np.full(plan.columns, " ")
    across = grid.dots // plan.columns
    for low, high in plot.marked:
        if not 0 < low <= high < math.inf:
            continue
        begin, end = (math.floor((math.log10(f) - grid.origin) / grid.width / across) for f in (low, high))
        if end >= 0 and begin < plan.columns:
            chars[max(begin, 0) : end + 1] = "=" if style == "ascii" else "▀"
    row: list[tuple[str, Ink]] = [("".join(chars.tolist()), "mark")]
    if plan.left:
        row.insert(0, (fit(f" {plot.marked_is}", plan.left), "text"))
    if plan.right:
        row.append((fit(" than noise", plan.right) if plot.marked_is == "beyond" else " " * plan.right, "text"))
    return tuple(row)


def _axis_row(
    ready: Prepared, view: View, grid: Grid, plan: Layout, style: Style, cursor: float | None, column: int | None
) -> Row:
    """Ticks with labels, and where the cursor is."""
    plot = ready.plot
    chars = np.full(plan.columns, " ")
    codes = np.full(plan.columns, len(INKS) - 1, dtype=np.uint8)
    free = 0
    tick = "|" if style == "ascii" else "│"
    for place, label in _ticks(ready, view, plan.columns):
        dot = grid.dot(place)
        if dot is None and isinstance(plot, TimePlot) and plot.span_s is not None and place >= view.high - 1e-9:
            dot = grid.dots - 1
        if dot is None:
            continue
        at = dot * plan.columns // grid.dots
        text = tick + label
        if at < free:
            continue
        if at + len(text) > plan.columns:
            text = tick
        chars[at : at + len(text)] = list(text)
        free = at + len(text) + 1
    here = ""
    if cursor is not None:
        here = f"{10.0**cursor:.4g} Hz" if plot.logarithmic else f"{_seconds(ready, cursor, view, plan.columns)} s"
    if here and not plan.right:
        text = here[: plan.columns]
        begin = min(max((column or 0) - len(text) // 2, 0), plan.columns - len(text))
        chars[max(begin - 1, 0) : begin + len(text) + 1] = " "
        chars[begin : begin + len(text)] = list(text)
    if column is not None and plan.right:
        codes[column] = CURSOR
    row: list[tuple[str, Ink]] = list(runs(chars, codes))
    if plan.left:
        row.insert(0, (fit(f"{plot.unit:>{plan.left - 1}}", plan.left), "text"))
    if plan.right:
        said = f" at {here}" if here and len(here) + 4 <= plan.right else f" {here}"
        row.append((fit(said, plan.right), "cursor" if here else "text"))
    return tuple(row)


def _origin(ready: Prepared) -> float:
    plot = ready.plot
    if not isinstance(plot, TimePlot):
        return 0.0
    return ready.whole.high if plot.span_s is not None else plot.origin_s


def _seconds(ready: Prepared, place: float, view: View, columns: int) -> str:
    finest = max(min(view.span / max(columns, 1), 1.0), 1e-6)
    return f"{place - _origin(ready):.{min(max(math.ceil(-math.log10(finest)) + 1, 1), 6)}f}"


def _ticks(ready: Prepared, view: View, columns: int) -> Iterable[tuple[float, str]]:
    """Places on the axis and their labels, in order."""
    count = max(columns // TICK_CELLS, 1)
    if not ready.plot.logarithmic:
        origin = _origin(ready)
        for value, label in _even(view.low - origin, view.high - origin, count):
            yield value + origin, label
        return
    low, high = 10.0 ** max(view.low, -300.0), 10.0 ** min(view.high, 300.0)
    if view.span > 0.5:
        decades = range(math.floor(view.low), math.ceil(view.high) + 1)
        steps = (1.0, 2.0, 5.0) if columns / view.span >= 3 * 6 else (1.0,)
        every = max(1, math.ceil(len(decades) * 6 / max(columns, 1)))
        for power in decades[::every]:
            for step in steps:
                value = step * 10.0**power
                if low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
                    yield math.log10(value), f"{value:g}"
        return
    for value, label in _even(low, high, count):
        if value > 0:
            yield math.log10(value), label


def _even(low: float, high: float, count: int) -> Iterable[tuple[float, str]]:
    """Round values, about `count` of them."""
    span = high - low
    if not (math.isfinite(span) and span > 0):
        return
    step = round_limit(span / count, 1e-300)
    decimals = min(max(-math.floor(math.log10(step) + 1e-9), 0), 9)
    first = math.ceil(low / step - 1e-9)
    for i in range(first, first + count + 2):
        value = i * step
        if value > high + 1e-9 * step:
            return
        yield value, f"{value + 0.0:.{decimals}f}" if abs(value) < 1e6 else f"{value:g}"


def cut(text: str, width: int, style: Style) -> str:
    """Exactly `width` cells, with an ellipsis where something was cut."""
    if cell_len(text) <= width:
        return fit(text, width)
    return fit(text, max(width - 1, 0)) + ("~" if style == "ascii" else "…") * (width > 0)


def headed(title: str, width: int, style: Style) -> Row:
    """A title in exactly `width` cells, a blank at both sides."""
    said = cut(title, max(width - 2, 0), style).rstrip()
    return ((" ", "text"), (said, "title"), (" " * (width - 1 - cell_len(said)), "text"))
