"""Horizontal bars: what candidates explain, the ladder's rungs, the error by band."""

from __future__ import annotations

from gcs.tui.plot import BarPlot, Style, bars
from gcs.tui.widgets.canvas import Canvas


class Bars(Canvas):
    """Shows a `BarPlot`: one row for each bar; how many do not fit is said in the last row."""

    def __init__(self, style: Style, id: str) -> None:
        super().__init__(style, id)
        self._plot: BarPlot | None = None

    def show(self, plot: BarPlot) -> None:
        """Show this."""
        if plot is not self._plot:
            self._plot = plot
            self.redraw()

    def redraw(self) -> None:
        if self._plot is not None and self.size:
            self.put(bars(self._plot.worded(self.said), self.size.width, self.size.height, self._style))
