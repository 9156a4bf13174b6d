"""Strip charts of p, q and the two commands: one strip for each, because overlaid traces hide each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from textual.content import Content

from gcs.logs.live import FloatArray, LiveWindow
from gcs.tui.plot import Style, chart, dots_across, envelope, round_limit
from gcs.tui.widgets.lines import Lines

LEFT, RIGHT = 8, 15
"""Columns for the name and scale on the left, the value and peak on the right."""


@dataclass(frozen=True, slots=True)
class Signal:
    """One strip."""

    name: str
    field: str
    """Of `LiveWindow`."""
    unit: str
    least: float
    """The smallest scale: noise must look like noise."""


SIGNALS = (
    Signal("p", "p", "rad/s", 0.1),
    Signal("q", "q", "rad/s", 0.1),
    Signal("δx", "delta_x", "", 0.1),
    Signal("δy", "delta_y", "", 0.1),
)


class Charts(Lines):
    """Draws a window of samples, each strip on the round scale that holds what the window shows."""

    def draw(self, window: LiveWindow, span_s: float, stale: bool = False) -> None:
        """Draw the last `span_s` seconds before the newest sample; `stale`: nothing newer comes, so no value is now."""
        width, height = self.size.width, self.size.height
        if width < LEFT + RIGHT + 8 or height < 1:
            return
        shown = SIGNALS[: max(1, min(len(SIGNALS), height))]
        heights = [height // len(shown)] * len(shown)
        columns = width - LEFT - RIGHT
        end_s = float(window.t[-1]) if window.t.size else 0.0
        lines: list[Content | str | tuple[str, str]] = []
        for signal, rows in zip(shown, heights, strict=True):
            lines += strip(signal, window, rows, columns, span_s, end_s, self._style, stale)
        self.show(lines)


def strip(
    signal: Signal,
    window: LiveWindow,
    rows: int,
    columns: int,
    span_s: float,
    end_s: float,
    style: Style,
    stale: bool = False,
) -> list[str]:
    """One strip as `rows` lines of LEFT + columns + RIGHT cells."""
    values: FloatArray = getattr(window, signal.field)
    known = values[np.isfinite(values)]
    if not known.size:
        texts = [f" {signal.name}", *[""] * (rows - 1)]
        return [f"{text:<{LEFT}}{_absent(i, rows, signal, columns):<{columns}}" for i, text in enumerate(texts)]
    peak = float(np.abs(known).max())
    limit = round_limit(peak, signal.least)
    low, high = envelope(window.t, values, dots_across(columns, style), span_s, end_s)
    drawn = chart(low, high, rows, columns, limit, style)
    scale = f"{'+-' if style == 'ascii' else '±'}{limit:g}"
    left = [f" {signal.name}", *[""] * (rows - 1)]
    left[-1] = f" {signal.name} {scale}" if rows == 1 else f" {scale}"
    now = f"{known[-1] + 0.0:+.2f} {signal.unit}" if np.isfinite(values[-1]) else f"  ?   {signal.unit}"
    if stale:
        now = "no link"
    right = [now, *[""] * (rows - 1)]
    right[min(1, rows - 1)] = f"{now[:7].rstrip()} ^{peak:.2f}" if rows == 1 else f"peak {peak:.2f}"
    return [f"{left[i]:<{LEFT}.{LEFT}}{drawn[i]} {right[i]:<{RIGHT - 1}.{RIGHT - 1}}" for i in range(rows)]


def _absent(row: int, rows: int, signal: Signal, columns: int) -> str:
    if row != (rows - 1) // 2:
        return ""
    text = "comes with the log: R" if signal.field.startswith("delta") else "no samples yet"
    return text[:columns]
