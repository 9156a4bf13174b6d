"""Help: the order of the work, the keys of every screen, and what the lines mean."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.tui.actions import Act
from gcs.tui.base import READ, Scrolled
from gcs.tui.glossary import glossary, glossary_lines
from gcs.tui.pages import PAGES
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.words import wrapped

_TEXT = """\
in a pilot's words
  A sweep (a chirp) is a sine on one stick axis that grows faster. It is
  added on board to what the pilot commands; the rates answer, and from both
  a model is made. The pilot flies, always: this app asks for a sweep and can
  end it.

on the flight line
  R              the next run is made ready: nothing moves
  S              it starts; hold position, and do not fight the sweep
  F12            abort, from anywhere: back to the mode before. So does a
                 press on F12 ABORT, and space where no text is being typed
  the pilot      ends it as well: with any other mode on the transmitter, and
                 then nothing here commands anything
  N              a note, with the time of flight
  H              the card's checklist, where it has one

the bell         one: it starts, and each of the last three seconds. Two: half.
                 Three: it is over. Five, fast: a limit. Long, in pairs: aborted,
                 or the link is lost or late. --say speaks as well

the order of the work
  1 Connect      where to begin, and what is heard there
  2 Fly          the pilot hovers; R makes a run ready, S starts it
  3 Runs         what each run is used for: fit, validate, leave out
  4 Fit          TPP and CD, beside the paper's numbers
  5 Compare      where the model fails, and how much of that is noise
  6 Diagnose     which physical effect is missing; A adds it
  7 Ladder       the error falling, effect by effect
  8 Controller   D designs the LQR; on the ground P pushes it, R goes back
  9 Report       a page to keep, and the commands that do the same

keys everywhere, none of them with two at once
  F12            abort, as above
  1 ... 9  ?     the screens; F1 is help, too; escape leaves it
  N              a note     F3  the guide     Z  a hidden effect's sealed answer
  F2             every action of every screen, by name     F4  a replay
  K, escape      call off a fit, a diagnosis, whatever is worked on
  F9             other colours: black on white for the sun, high contrast
  q              quit; during a run it asks, and aborts first
  mouse, finger  F12 ABORT, a screen's name, a key on the lines below, a row of
                 a list, an answer: pressed, they do what their key does

plots
  left, right    the cursor; comma and full stop ten columns; home and end
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
  LQR ON         the pilot's switch selects the controller that was pushed
  ARMED 3:12     armed, and minutes and seconds in the air; > where it flew
                 before it was heard
  RPM +0.1 %     rotor speed, and its deviation since the run was made ready
  BAT            bar, volts and what is left; LOW below a quarter

abort is repeated only while the heartbeat shows the excitation mode: any
other mode means that the pilot has taken over, and nothing is commanded.

between two runs up and down, or a click, choose the next one: what was aborted,
met a limit or is to be flown again waits for R and S like any other. After the
last one come those that were not kept; E ends the card.

percentages are the run's peaks against the card's limits; beyond 100 the run
is aborted.

the bar of a chirp is its frequencies, each as high as the rate has followed
there so far (coherence); of other runs it is time.

the strips show 20 s; each column holds the least and the largest sample of
its time, so no peak is lost. Before R they show telemetry, from R on the log.
"""


class HelpScreen(Scrolled):
    """Says what the keys do, and what the words mean."""

    NAME = "help"
    ACTS = (
        Act("escape", "app.leave_help", "back", "leave help, back to where you were", "escape"),
        Act("w,W", "words", "words", "what the words mean, or the keys again"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self._words = False

    def body(self) -> Iterable[Widget]:
        yield self.scrolled()

    @property
    def keys(self) -> str:
        return f"up/down scroll  {super().keys}"

    def action_words(self) -> None:
        """The glossary, or the keys."""
        self._words = not self._words
        self.query_one("#tables").scroll_home(animate=False)
        self.app.run_look()  # type: ignore[attr-defined]

    def show_body(self, state: State, width: int) -> None:
        if not self.changed(state.simulated, width, self.text_width, self._words):
            return
        if self._words:
            self.put_text(glossary_lines(glossary(), self.text_width))
            return
        lines = (_TEXT + (_PILOT if state.simulated else "") + _LINES).splitlines()
        for page in PAGES:
            lines += ["", f"on {page.NAME}", *(f"  {act.key:<13}  {act.name}" for act in page.ACTS)]
        self.put_text([piece for line in _joined(lines) for piece in wrapped(f" {line}", self.text_width, _hang(line))])


_KEYS = 17
"""Columns that a key and the space behind it take."""


def _joined(lines: Iterable[str]) -> list[str]:
    """Each entry and paragraph on one line, so that it can be set as wide as the screen is."""
    whole: list[str] = []
    for line in lines:
        goes_on = line.startswith(" " * _KEYS)
        before = whole[-1] if whole else ""
        same = line.strip() and before.strip() and _indent(line) == _indent(before)
        if goes_on or (same and not _has_key(line) and not _has_key(before)):
            whole[-1] += " " + line.strip()
        else:
            whole.append(line)
    return whole


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _has_key(line: str) -> bool:
    return "  " in line.strip()


def _hang(line: str) -> int:
    return _KEYS - _indent(line) if _has_key(line) else 0
