"""Plots that a screen shows each tick: strips over time, responses over frequency; cursor, zoom and pan by keys."""

from __future__ import annotations

import math
from typing import Literal

from textual.binding import Binding
from textual.events import Click
from textual.geometry import Region

from gcs.tui.plot import Plot, Prepared, Reading, Style, View, picture, prepared
from gcs.tui.plot.layout import cursor_at, layout, shaded_at, sheet_of
from gcs.tui.plot.ready import clamped, holding, moved, readings, zoomed
from gcs.tui.widgets.canvas import Canvas

ZOOM = 0.5
FAR = 10
"""How many columns a far step of the cursor is."""


class Traces(Canvas, can_focus=True):
    """Shows a `Plot` (TimePlot or FrequencyPlot). Give it one each tick; only what changed is drawn again.

    Keys, where focused: left/right the cursor by a column, but at least by a sample; comma and full stop (or
    shift+left/right) ten columns; home/end to the first and last sample; + and - zoom around the cursor; [ and ] pan
    by half a view; 0 shows everything again, without cursor. A click puts the cursor. The actions `cursor(columns)`,
    `ends(which)`, `zoom(steps)`, `pan(halves)` and `reset` can be bound to other keys, or called.

    A live plot (span_s) moves along until it is zoomed or panned; a cursor that its view has left behind goes.
    """

    KEYS = "left/right cursor  + - zoom  [ ] pan  0 all"
    """For a screen's line of keys."""
    BINDINGS = [
        Binding("left", "cursor(-1)", "cursor", show=False),
        Binding("right", "cursor(1)", "cursor", show=False),
        Binding("shift+left,comma", f"cursor({-FAR})", "cursor", show=False),
        Binding("shift+right,full_stop", f"cursor({FAR})", "cursor", show=False),
        Binding("home", "ends('first')", "first sample", show=False),
        Binding("end", "ends('last')", "last sample", show=False),
        Binding("plus,equals_sign", "zoom(1)", "zoom in", show=False),
        Binding("minus", "zoom(-1)", "zoom out", show=False),
        Binding("left_square_bracket", "pan(-1)", "pan", show=False),
        Binding("right_square_bracket", "pan(1)", "pan", show=False),
        Binding("0", "reset", "all", show=False),
    ]

    def __init__(self, style: Style, id: str) -> None:
        super().__init__(style, id)
        self._given: Plot | None = None
        self._ready: Prepared | None = None
        self._view: View | None = None
        """None: the plot's own, which moves along where it is live."""
        self._cursor: float | None = None
        """On the axis as drawn."""

    def show(self, plot: Plot) -> None:
        """Show this. View and cursor stay as long as they lie inside; call `action_reset` for another run."""
        if plot is self._given:
            return
        self._given = plot
        self._ready = prepared(plot.worded(self.said))
        self.redraw()

    def redraw(self) -> None:
        ready = self._ready
        width, height = self.size.width, self.size.height
        if ready is None or width < 1 or height < 1:
            return
        if self._view is not None:
            self._view = clamped(ready, self._view)
        view = self._shown(ready)
        if self._cursor is not None and not view.low <= self._cursor <= view.high:
            self._cursor = None
        sheet = sheet_of(ready, view, width, height, self._style, cursor=self._cursor)
        top, left, high = int(sheet.plan.head), sheet.plan.left, sum(sheet.plan.rows)
        shaded = tuple(Region(left + first, top, last - first + 1, high) for first, last in shaded_at(sheet))
        self.put(picture(ready, view, width, height, self._style, cursor=self._cursor), shaded)

    @property
    def cursor(self) -> float | None:
        """Where the cursor is: s of the data's own time, or Hz."""
        if self._ready is None or self._cursor is None:
            return None
        return 10.0**self._cursor if self._ready.plot.logarithmic else self._cursor

    @property
    def view(self) -> View | None:
        """The part of the axis that is shown: s, or Hz."""
        if self._ready is None:
            return None
        view = self._shown(self._ready)
        return View(10.0**view.low, 10.0**view.high) if self._ready.plot.logarithmic else view

    def readings(self) -> tuple[Reading, ...]:
        """Every panel's values at the cursor; empty without one."""
        return () if self._ready is None else readings(self._ready, self._cursor)

    def look_at(self, low: float, high: float) -> None:
        """Show a part of the axis, in s or Hz, with the cursor in its middle: where the error is."""
        ready = self._ready
        if ready is None or not high > low:
            return
        if ready.plot.logarithmic:
            if not low > 0:
                return
            low, high = math.log10(low), math.log10(high)
        self._view = clamped(ready, View(low, high))
        self._cursor = moved(ready, self._view, None, 0.0)
        self.redraw()

    # Keys.

    def action_cursor(self, columns: int) -> None:
        """Move the cursor; the first time it appears in the middle."""
        ready = self._ready
        if ready is None:
            return
        view = self._shown(ready)
        across = max(layout(ready.plot, self.size.width, self.size.height).columns, 1)
        self._put_cursor(moved(ready, view, self._cursor, columns * view.span / across))

    def action_ends(self, which: Literal["first", "last"]) -> None:
        """The cursor to the first or the last sample there is."""
        if self._ready is not None and self._ready.places.size:
            self._put_cursor(float(self._ready.places[0 if which == "first" else -1]))

    def action_zoom(self, steps: int) -> None:
        """Half or twice as much, the cursor staying where it is; as far as everything, or a few samples."""
        ready = self._ready
        if ready is None:
            return
        view = zoomed(ready, self._shown(ready), ZOOM**steps, self._cursor)
        self._view = None if view.span >= ready.whole.span or self._is_first(ready, view) else view
        self.redraw()

    def action_pan(self, halves: int) -> None:
        """Along the axis by halves of what is shown; the cursor goes along where it would be left behind."""
        ready = self._ready
        if ready is None:
            return
        before = self._shown(ready)
        view = clamped(ready, View(before.low + halves * before.span / 2, before.high + halves * before.span / 2))
        self._view = None if self._is_first(ready, view) else view
        if self._cursor is not None and not view.low <= self._cursor <= view.high:
            self._cursor = moved(ready, view, self._cursor, view.low - before.low)
        self.redraw()

    def action_reset(self) -> None:
        """Everything, or the newest seconds, and no cursor."""
        self._view = self._cursor = None
        self.redraw()

    def on_click(self, event: Click) -> None:
        ready = self._ready
        if ready is None:
            return
        place = cursor_at(ready, self._shown(ready), self.size.width, self.size.height, event.x)
        if place is not None:
            self._put_cursor(place)

    def _put_cursor(self, place: float | None) -> None:
        ready = self._ready
        if ready is None or place is None:
            return
        view = self._shown(ready)
        held = holding(ready, view, place)
        if held != view:
            self._view = None if self._is_first(ready, held) else held
        self._cursor = place
        self.redraw()

    def _shown(self, ready: Prepared) -> View:
        return ready.first if self._view is None else self._view

    def _is_first(self, ready: Prepared, view: View) -> bool:
        apart = max(abs(view.low - ready.first.low), abs(view.high - ready.first.high))
        return apart < 1e-9 * max(view.span, 1e-12)


class Response(Traces):
    """The same over frequency."""
