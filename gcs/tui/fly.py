"""Fly: what the vehicle does, what the card asks for next, and what became of each run."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import Vertical
from textual.widget import Widget

from gcs.flight.live import LiveWindow
from gcs.tui import words
from gcs.tui.actions import Act
from gcs.tui.base import Page
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.charts import Charts
from gcs.tui.widgets.lines import Lines

SPAN_S = 20.0
"""How much of the past the strips show."""


class FlyScreen(Page):
    """The screen for the flight."""

    NAME = "Fly"
    ACTS = (
        Act("r,R", "app.wish('ready')", "ready", "make the next run ready: nothing moves"),
        Act("s,S", "app.wish('start')", "start", "start the run that is ready"),
        Act("e,E", "app.wish('end_card')", "end card", "end the card between two runs"),
        Act("c,C", "app.choose_card", "card", "choose a card"),
        Act("h,H", "app.checklist", "", "the card's checklist: ask it, or show how it was answered"),
        Act("up", "choose(-1)", "", "between two runs: the run above is the next", "up"),
        Act("down", "choose(1)", "", "between two runs: the run below is the next", "down"),
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self._state: State | None = None

    def action_choose(self, by: int) -> None:
        """Another run is the next."""
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
        if self.query("#charts"):
            self.query_one("#charts", Charts).draw(window, SPAN_S, stale)

    def show_body(self, state: State, width: int) -> None:
        self._state = state
        self.query_one("#card", Lines).show([(words.card_line(state, width), "bold")])
        self.query_one("#progress", Lines).show([words.progress_line(state, width, self.style)])
        self.query_one("#limits", Lines).show([words.limits_line(state, width, self.style)])
        self.query_one("#recording", Lines).show([words.recording_line(state, width)])
        runs = self.query_one("#runs", Lines)
        runs.show(words.run_lines(state, width, runs.size.height))
        said = self.query_one("#said", Lines)
        said.show(words.said_lines(state, width, max(1, said.size.height)))
