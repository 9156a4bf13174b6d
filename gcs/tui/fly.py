"""Fly: what the vehicle does, what the card asks for next, and what became of each run."""

from __future__ import annotations

import math
from collections.abc import Iterable

from textual.containers import Vertical
from textual.widget import Widget

from gcs.flight.live import LiveWindow
from gcs.tui import words
from gcs.tui.actions import Act, footer
from gcs.tui.base import Page
from gcs.tui.plot import Style
from gcs.tui.state import State, as_flown
from gcs.tui.swept_so_far import coherence_so_far
from gcs.tui.widgets.charts import Charts
from gcs.tui.widgets.lines import Lines

FOLLOWED_EVERY_S = 0.5
SPAN_S = 20.0
"""How much of the past the strips show."""

FLY = (
    Act("r,R", "app.wish('ready')", "ready", "make the next run ready: nothing moves"),
    Act("s,S", "app.wish('start')", "start", "start the run that is ready"),
    Act("e,E", "app.wish('end_card')", "end card", "end the card between two runs"),
    Act("c,C", "app.choose_card", "card", "choose a card"),
    Act("h,H", "app.checklist", "", "the card's checklist: ask it, or show how it was answered"),
    Act("up", "choose(-1)", "", "between two runs: the run above is the next", "up"),
    Act("down", "choose(1)", "", "between two runs: the run below is the next", "down"),
)
"""Keys of a flight that is flown."""
REPLAY = (
    Act("p,P", "replay('pause')", "pause", "replay: pause, or go on"),
    Act("left", "replay('back')", "5 s back", "replay: 5 s back", "left"),
    Act("right", "replay('forward')", "5 s on", "replay: 5 s on", "right"),
    Act("plus,equals_sign", "replay('faster')", "faster", "replay: faster", "+"),
    Act("minus", "replay('slower')", "slower", "replay: slower", "-"),
)
"""Keys of a flight that is watched again; up and down go to the run before and the next."""


class FlyScreen(Page):
    """The screen for the flight."""

    NAME = "Fly"
    ACTS = (*FLY, *REPLAY)

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self._state: State | None = None
        self._followed: tuple[float | None, ...] = ()
        self._followed_s = -math.inf
        """Of the run, when that was looked at."""

    @property
    def keys(self) -> str:
        """The footer: of a flight, or of one that is watched again."""
        replayed = self._state is not None and self._state.replay is not None
        return footer(REPLAY if replayed else FLY)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """A replay's keys work in a replay only."""
        return self._state is not None and self._state.replay is not None if action == "replay" else True

    def action_replay(self, wish: str) -> None:
        """Move in the flight that is watched again."""
        self.app.action_replay(wish)  # type: ignore[attr-defined]

    def action_choose(self, by: int) -> None:
        """Another run is the next; of a replay the one that is watched."""
        if self._state is not None and self._state.replay is not None:
            self.action_replay("before" if by < 0 else "after")
            return
        if self._state is None or not self._state.runs:
            return
        numbers = [run.number for run in self._state.runs]
        at = numbers.index(self._state.current) + by if self._state.current in numbers else 0
        self.app.action_choose_run(numbers[max(0, min(at, len(numbers) - 1))])  # type: ignore[attr-defined]

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "card")
        yield Charts(self.style, "charts")
        with Vertical(id="facts"):
            yield Lines(self.style, "progress")
            yield Lines(self.style, "limits")
            yield Lines(self.style, "recording")
        yield Lines(self.style, "runs")
        yield Lines(self.style, "said")

    def draw(self, window: LiveWindow, stale: bool) -> None:
        """The strips."""
        self._follow()
        if self.query("#charts"):
            self.query_one("#charts", Charts).draw(window, SPAN_S, stale)

    def _follow(self) -> None:
        """How well the rate follows the sweep so far, looked at now and then."""
        progress = None if self._state is None else self._state.progress
        if progress is None or progress.swept is None:
            self._followed, self._followed_s = (), -math.inf
        elif not 0.0 <= progress.elapsed_s - self._followed_s < FOLLOWED_EVERY_S:
            self._followed_s = progress.elapsed_s
            window = self.app.worker.window(max(progress.elapsed_s, 0.0))  # type: ignore[attr-defined]
            self._followed = coherence_so_far(window, progress.swept)

    def show_body(self, state: State, width: int) -> None:
        self._state = state
        state = as_flown(state)
        self.query_one("#card", Lines).show([(words.card_line(state, width), "bold")])
        self.query_one("#progress", Lines).show([words.progress_line(state, width, self.style, self._followed)])
        self.query_one("#limits", Lines).show([words.limits_line(state, width, self.style)])
        self.query_one("#recording", Lines).show([words.recording_line(state, width)])
        runs = self.query_one("#runs", Lines)
        runs.show(words.run_lines(state, width, runs.size.height))
        said = self.query_one("#said", Lines)
        said.show(words.said_lines(state, width, max(1, said.size.height)))
