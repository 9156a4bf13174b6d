"""Below the signals the axis with its ticks, above it the marked bands."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from gcs.tui.plot.draw import CharArray, round_limit
from gcs.tui.plot.layout import Sheet
from gcs.tui.plot.model import FrequencyPlot, Ink, Row, TimePlot, View
from gcs.tui.plot.ready import Prepared
from gcs.tui.plot.rows import CURSOR, TEXT, fit, runs

TICK_CELLS = 9
"""Labels of the axis stand at least so far apart."""


def marks_row(sheet: Sheet) -> Row:
    """Where the marked bands lie."""
    plot, grid, plan = sheet.ready.plot, sheet.grid, sheet.plan
    assert isinstance(plot, FrequencyPlot)
    chars = np.full(plan.columns, " ")
    across = grid.dots // plan.columns
    for low, high in plot.marked:
        if not 0 < low <= high < math.inf:
            continue
        begin, end = (math.floor((math.log10(f) - grid.origin) / grid.width / across) for f in (low, high))
        if end >= 0 and begin < plan.columns:
            chars[max(begin, 0) : end + 1] = "=" if sheet.style == "ascii" else "▀"
    row: list[tuple[str, Ink]] = [("".join(chars.tolist()), "mark")]
    if plan.left:
        row.insert(0, (fit(f" {plot.marked_is}", plan.left), "text"))
    if plan.right:
        row.append((fit(" noise", plan.right) if plot.marked_is == "beyond" else " " * plan.right, "text"))
    return tuple(row)


def axis_row(sheet: Sheet) -> Row:
    """Ticks with labels, and where the cursor is."""
    plot, plan = sheet.ready.plot, sheet.plan
    chars = _labelled(sheet)
    codes = np.full(plan.columns, TEXT, dtype=np.uint8)
    here = _here(sheet)
    if here and not plan.right:
        text = here[: plan.columns]
        begin = min(max((sheet.column or 0) - len(text) // 2, 0), plan.columns - len(text))
        chars[max(begin - 1, 0) : begin + len(text) + 1] = " "
        chars[begin : begin + len(text)] = list(text)
    if sheet.column is not None and plan.right:
        codes[sheet.column] = CURSOR
    row: list[tuple[str, Ink]] = list(runs(chars, codes))
    if plan.left:
        row.insert(0, (fit(f"{plot.unit:>{plan.left - 1}}", plan.left), "text"))
    if plan.right:
        words = f" at {here}" if here and len(here) + 4 <= plan.right else f" {here}"
        row.append((fit(words, plan.right), "cursor" if here else "text"))
    return tuple(row)


def tick_columns(sheet: Sheet) -> list[int]:
    """Where the ticks stand."""
    dots = [_dot(sheet, place) for place, _ in _ticks(sheet.ready, sheet.view, sheet.plan.columns)]
    return [dot * sheet.plan.columns // sheet.grid.dots for dot in dots if dot is not None]


def _labelled(sheet: Sheet) -> CharArray:
    """Ticks, and labels where there is room behind them."""
    plan, grid = sheet.plan, sheet.grid
    chars = np.full(plan.columns, " ")
    tick = "|" if sheet.style == "ascii" else "│"
    free = 0
    for place, label in _ticks(sheet.ready, sheet.view, plan.columns):
        dot = _dot(sheet, place)
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
    return chars


def _dot(sheet: Sheet, place: float) -> int | None:
    """Where a tick stands; of what moves along, the newest moment at the edge."""
    plot, dot = sheet.ready.plot, sheet.grid.dot(place)
    moving = isinstance(plot, TimePlot) and plot.span_s is not None
    return sheet.grid.dots - 1 if dot is None and moving and place >= sheet.view.high - 1e-9 else dot


def _here(sheet: Sheet) -> str:
    """The cursor's place with its unit; empty without a cursor."""
    if sheet.cursor is None:
        return ""
    if sheet.ready.plot.logarithmic:
        return f"{10.0**sheet.cursor:.4g} Hz"
    return f"{_seconds(sheet.ready, sheet.cursor, sheet.view, sheet.plan.columns)} s"


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
