"""Axes over bands of frequency, with a cursor on the cells."""

from __future__ import annotations

from textual.binding import Binding
from textual.events import Click
from textual.message import Message

from gcs.tui.plot import HeatPlot, Style, cell_at, heat
from gcs.tui.widgets.canvas import Canvas


class Heat(Canvas, can_focus=True):
    """Shows a `HeatPlot`. Arrow keys move the cursor, a click puts it, and one on the cursor's cell looks closer."""

    KEYS = "arrows cell"
    """For a screen's line of keys."""
    BINDINGS = [
        Binding("left", "move(0, -1)", "cell", show=False),
        Binding("right", "move(0, 1)", "cell", show=False),
        Binding("up", "move(-1, 0)", "axis", show=False),
        Binding("down", "move(1, 0)", "axis", show=False),
    ]

    class Moved(Message):
        """The cursor stands elsewhere."""

    class Chosen(Message):
        """The cell under the cursor was pressed."""

    def __init__(self, style: Style, id: str) -> None:
        super().__init__(style, id)
        self._plot: HeatPlot | None = None
        self._given: HeatPlot | None = None
        self._at = (0, 0)

    @property
    def at(self) -> tuple[int, int]:
        """Row and cell under the cursor."""
        return self._at

    def show(self, plot: HeatPlot) -> None:
        """Show this; the cursor goes to the darkest cell of what it has not shown before."""
        if plot is self._given:
            return
        self._given, self._plot = plot, plot.worded(self.said)
        self._at = plot.darkest
        self.redraw()

    def redraw(self) -> None:
        if self._plot is not None and self.size:
            self.put(heat(self._plot, self.size.width, self.size.height, self._style, self._at))

    def action_move(self, rows: int, cells: int) -> None:
        """The cursor, as far as there are cells."""
        plot = self._plot
        if plot is None or not plot.rows:
            return
        row = min(max(self._at[0] + rows, 0), len(plot.rows) - 1)
        self._put_cursor((row, min(max(self._at[1] + cells, 0), len(plot.rows[row].cells) - 1)))

    def action_next_row(self) -> None:
        """The same band of the next axis, and after the last of the first."""
        plot = self._plot
        if plot is not None and plot.rows:
            self._put_cursor(((self._at[0] + 1) % len(plot.rows), self._at[1]))

    def on_click(self, event: Click) -> None:
        plot = self._plot
        at = None if plot is None else cell_at(plot, self.size.width, self.size.height, event.x, event.y)
        if at is None:
            return
        if at == self._at:
            self.post_message(self.Chosen())
        self._put_cursor(at)

    def _put_cursor(self, at: tuple[int, int]) -> None:
        if at != self._at:
            self._at = at
            self.redraw()
            self.post_message(self.Moved())
