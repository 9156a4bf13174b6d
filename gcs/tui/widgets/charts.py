"""Live strip charts of p, q and the two commands: one strip for each, because overlaid traces hide each other."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.flight.live import LiveWindow
from gcs.tui.plot import Panel, TimePlot
from gcs.tui.widgets.traces import Traces


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


class Charts(Traces, can_focus=False):
    """Draws a window of samples, each strip on the round scale that holds what the window shows.

    It takes no keys of its own; a screen may bind the actions of `Traces`.
    """

    def draw(self, window: LiveWindow, span_s: float, stale: bool = False) -> None:
        """Draw the last `span_s` seconds before the newest sample; `stale`: nothing newer comes, so no value is now."""
        self.show(live_plot(window, span_s, stale))


def live_plot(window: LiveWindow, span_s: float, stale: bool = False) -> TimePlot:
    """The strips of a window."""
    panels = tuple(
        Panel(
            name=one.name,
            x=window.t,
            line=getattr(window, one.field),
            unit=one.unit,
            least=one.least,
            absent="shown once recording starts (R)" if one.field.startswith("delta") else "no samples yet",
        )
        for one in SIGNALS
    )
    return TimePlot(panels=panels, span_s=span_s, stale="no link" if stale else "")
