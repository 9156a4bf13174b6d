"""Help: the keys, the order of the work, and what the lines mean."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import VerticalScroll
from textual.widget import Widget

from gcs.tui.base import Page
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines
from gcs.tui.words import wrapped

_TEXT = """\
the order of the work
  1 Fly          the pilot hovers; R makes a run ready, S starts it
  2 Fit          F fits TPP and CD to the flight, beside the paper's numbers
  3 Controller   D designs the LQR; on the ground P pushes it, V goes back

keys everywhere
  F12            abort: back to the mode before the run; also while typing
  space          the same, where no text is being typed
  1 2 3 ?        the screens; escape leaves help
  q              quit; during a run it asks, and aborts first
"""

_PILOT = """\

the simulated pilot (on hardware there are no such keys)
  T take off     L land     B bank switch: the LQR, or the autopilot
"""

_LINES = """\

the line at the top
  LINK           since anything was heard; LINK LOST after 3.5 s, and then
                 nothing restarts by itself
  (pilot)        who commands the mode: pilot, autopilot, tippath (a run of
                 this app), excitation (somebody else's run)
  RPM +0.1 %     rotor speed, and its deviation since the run was made ready

abort is repeated only while the heartbeat shows the excitation mode: any
other mode means that the pilot has taken over, and nothing is commanded.

percentages are the run's peaks against the card's limits; beyond 100 the run
is aborted.

the strips show 20 s; each column holds the least and the largest sample of
its time, so no peak is lost. Before R they show telemetry, from R on the log.
"""


class HelpScreen(Page):
    """Says what the keys do."""

    NAME = "help"
    KEYS = "escape back  up/down scroll"
    BINDINGS = [
        ("escape", "app.screen('fly')", "back"),
        ("down", "scroll(1)", "down"),
        ("up", "scroll(-1)", "up"),
        ("pagedown", "scroll(10)", "down"),
        ("pageup", "scroll(-10)", "up"),
    ]

    def body(self) -> Iterable[Widget]:
        with VerticalScroll(id="words", can_focus=False):
            yield Lines(self.style, "text")

    def action_scroll(self, lines: int) -> None:
        """Move the text."""
        self.query_one("#words", VerticalScroll).scroll_relative(y=lines, animate=False)

    def show_body(self, state: State, width: int) -> None:
        text = _TEXT + (_PILOT if state.simulated else "") + _LINES
        lines = [piece for line in text.splitlines() for piece in wrapped(f" {line}", width - 2, 0)]
        box = self.query_one("#text", Lines)
        box.styles.height = len(lines)
        box.show(lines)
