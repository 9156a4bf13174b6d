"""How a box is divided, and where on it a place of the axis lies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.tui.plot.draw import DOTS, Style
from gcs.tui.plot.model import FrequencyPlot, Plot, TimePlot, View
from gcs.tui.plot.ready import Prepared, nearest


@dataclass(frozen=True, slots=True, kw_only=True)
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
    return Layout(
        left=left,
        columns=width - left - right,
        right=right,
        head=head,
        rows=shares(height - axis - head - marks, weights),
        marks=marks,
        axis=axis,
    )


def shares(rows: int, weights: Sequence[float]) -> tuple[int, ...]:
    """Rows, or columns, divided by weight, each at least one."""
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


def grid_of(ready: Prepared, view: View, dots: int) -> Grid:
    """The dots of a row over the part of the axis that is shown."""
    if isinstance(ready.plot, TimePlot) and ready.plot.span_s is not None and view == ready.first:
        # Slices on a fixed grid of time: the picture moves along and does not shimmer.
        width = view.span / dots
        return Grid(0.0, math.floor(view.high / width) - dots + 1, width, dots)
    return Grid(view.low, 0, view.span / dots * (1 + 1e-9), dots)


def shaded_at(sheet: Sheet) -> tuple[tuple[int, int], ...]:
    """First and last column of signals of every shaded part that is in sight."""
    plot, view, columns = sheet.ready.plot, sheet.view, sheet.plan.columns
    found = []
    for ends in plot.shaded:
        low, high = (math.log10(one) if one > 0 else -math.inf for one in ends) if plot.logarithmic else ends
        if high <= view.low or low >= view.high:
            continue
        first, last = (
            math.floor((min(max(one, view.low), view.high) - view.low) / view.span * columns) for one in (low, high)
        )
        found.append((first, max(min(last, columns - 1), first)))
    return tuple(found)


def cursor_at(ready: Prepared, view: View, width: int, height: int, x: int) -> float | None:
    """The sample nearest to column x of a picture; None beside the panels."""
    plan = layout(ready.plot, width, height)
    if not plan.left <= x < plan.left + plan.columns or not ready.places.size:
        return None
    grid = grid_of(ready, view, plan.columns)
    return float(ready.places[nearest(ready.places, grid.place(x - plan.left + 0.5))])


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """What the rows of one picture have in common."""

    ready: Prepared
    view: View
    plan: Layout
    grid: Grid
    style: Style
    cursor: float | None
    """On the axis as drawn; None where it is not in sight."""
    column: int | None
    """The cell that it is in."""


def sheet_of(ready: Prepared, view: View, width: int, height: int, style: Style, cursor: float | None) -> Sheet:
    """A box of width by height cells, divided."""
    plan = layout(ready.plot, width, height)
    grid = grid_of(ready, view, plan.columns * DOTS[style][1])
    dot = None if cursor is None else grid.dot(cursor)
    return Sheet(
        ready=ready,
        view=view,
        plan=plan,
        grid=grid,
        style=style,
        cursor=None if dot is None else cursor,
        column=None if dot is None else dot // DOTS[style][1],
    )
