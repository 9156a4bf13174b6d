"""Help: the order of the work, the keys of every screen, and what the lines mean."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.tui.actions import Act
from gcs.tui.base import READ, Scrolled
from gcs.tui.pages import PAGES
from gcs.tui.state import State
from gcs.tui.words import wrapped

_TEXT = """\
the order of the work
  1 Connect      where to, and what is heard there
  2 Fly          the pilot hovers; R makes a run ready, S starts it
  3 Runs         what each run is used for: fit, validate, leave out
  4 Fit          TPP and CD, beside the paper's numbers
  5 Compare      where the model fails, and how much of that is noise
  6 Diagnose     which physical effect is missing; A adds it
  7 Ladder       the error falling, effect by effect
  8 Controller   D designs the LQR; on the ground P pushes it, R goes back
  9 Report       a page to keep, and the commands that do the same

keys everywhere
  F12            abort: back to the mode before the run; also while typing
  space          the same, where no text is being typed
  1 ... 9  ?     the screens; escape leaves help
  ctrl+p         every action of every screen, by name
  K, escape      call off a fit, a diagnosis, whatever is worked on
  F9             other colours: black on white for the sun, high contrast
  q              quit; during a run it asks, and aborts first
  mouse, finger  F12 ABORT, a screen's name, a key on the lines below, a row of
                 a list, an answer: pressed, they do what their key does

plots
  left, right    the cursor; with shift ten columns; home and end
  + and -        zoom in and out around the cursor; [ and ] go along
  0              all of it again, without cursor
"""

_PILOT = """\

the simulated pilot (on hardware there are no such keys)
  T take off     L land     B bank switch: the LQR, or the autopilot
"""

_LINES = """\

the line at the top
  LINK           since anything was heard; LINK LOST after 3.5 s, and then
                 nothing restarts by itself
  lag, or |      how late the link is, the worse way; above 0.5 s nothing is
                 started, and for a second of it a run is ended. NO ANSWER: the
                 vehicle is heard, and does not answer
  (pilot)        who commands the mode: pilot, autopilot, tippath (a run of
                 this app), excitation (somebody else's run)
  RPM +0.1 %     rotor speed, and its deviation since the run was made ready

abort is repeated only while the heartbeat shows the excitation mode: any
other mode means that the pilot has taken over, and nothing is commanded.

between two runs up and down, or a click, choose the next one: what was aborted,
met a limit or is to be flown again waits for R and S like any other. After the
last one come those that were not kept; E ends the card.

percentages are the run's peaks against the card's limits; beyond 100 the run
is aborted. The bell rings at the start, halfway, at 3, 2, 1, at the end, at a
limit, when the vehicle's log stops, and when the link is lost or too late.

the strips show 20 s; each column holds the least and the largest sample of
its time, so no peak is lost. Before R they show telemetry, from R on the log.
"""


class HelpScreen(Scrolled):
    """Says what the keys do."""

    NAME = "help"
    ACTS = (Act("escape", "app.screen('fly')", "back to Fly", "leave help", "escape"), *READ)

    def body(self) -> Iterable[Widget]:
        yield self.scrolled()

    @property
    def keys(self) -> str:
        return f"up/down scroll  {super().keys}"

    def show_body(self, state: State, width: int) -> None:
        if not self.changed(state.simulated, width, self.text_width):
            return
        lines = (_TEXT + (_PILOT if state.simulated else "") + _LINES).splitlines()
        for page in PAGES:
            lines += ["", f"on {page.NAME}", *(f"  {act.key:<13}  {act.name}" for act in page.ACTS)]
        self.put_text([piece for line in lines for piece in wrapped(f" {line}", self.text_width, 0)])
