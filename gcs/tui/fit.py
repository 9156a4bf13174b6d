"""Fit: the recorded flight, fitted by the functions that the command line uses, beside the paper's numbers."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import VerticalScroll
from textual.widget import Widget

from gcs.link.decode import sanitise
from gcs.tui import words
from gcs.tui.base import Page
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines


class FitScreen(Page):
    """TPP, CD and the CD that the TPP reduces to, on the flight's chirps."""

    NAME = "Fit"
    KEYS = "F fit this flight  O open another flight  up/down scroll  F12/space abort"
    BINDINGS = [
        ("f,F", "app.work('fit')", "fit"),
        ("o,O", "app.open_flight", "open"),
        ("down", "scroll(1)", "down"),
        ("up", "scroll(-1)", "up"),
        ("pagedown", "scroll(10)", "down"),
        ("pageup", "scroll(-10)", "up"),
    ]

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "flight")
        with VerticalScroll(id="tables", can_focus=False):
            yield Lines(self.style, "text")

    def action_scroll(self, lines: int) -> None:
        """Move the tables."""
        self.query_one("#tables", VerticalScroll).scroll_relative(y=lines, animate=False)

    def show_body(self, state: State, width: int) -> None:
        flight = "no flight yet" if state.flight is None else f"flight {sanitise(str(state.flight))}"
        if state.fitted is not None and state.fitted.flight != state.flight:
            flight += f" · shown is the fit of {sanitise(str(state.fitted.flight))}"
        self.query_one("#flight", Lines).show([(words.fitted(f" {flight}", width), "bold")])
        lines = self._lines(state, width)
        text = self.query_one("#text", Lines)
        text.styles.height = len(lines)
        text.show(lines)

    def _lines(self, state: State, width: int) -> list[str]:
        found = state.fitted
        if found is None:
            return ["", " nothing is fitted yet"]
        lines = [
            f" fitted on {', '.join(map(sanitise, found.runs))}",
            f" judged on {', '.join(map(sanitise, found.validation)) or 'the same runs: no doublet was flown'}",
            "",
            *(f" {line}" for line in found.tables.splitlines()),
        ]
        if found.warnings:
            lines += ["", *(f" warning: {sanitise(text)}" for text in found.warnings)]
        lines += ["", " the same in a shell:", *(f"   {command}" for command in found.commands)]
        return [piece for line in lines for piece in words.wrapped(line, width - 2)]
