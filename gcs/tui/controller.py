"""Controller: gains designed on the fitted TPP, pushed as one verified set, and back again."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import VerticalScroll
from textual.widget import Widget

from gcs.link.decode import sanitise
from gcs.tui import words
from gcs.tui.base import Page
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines


class ControllerScreen(Page):
    """K, observer, prefilter, poles and margins; what the vehicle holds."""

    NAME = "Controller"
    KEYS = "D design  P push (asks)  V revert (asks)  up/down scroll  F12/space abort"
    BINDINGS = [
        ("d,D", "app.work('design')", "design"),
        ("p,P", "app.push", "push"),
        ("v,V", "app.revert", "revert"),
        ("down", "scroll(1)", "down"),
        ("up", "scroll(-1)", "up"),
    ]

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "bank")
        with VerticalScroll(id="gains", can_focus=False):
            yield Lines(self.style, "text")

    def action_scroll(self, lines: int) -> None:
        """Move the tables."""
        self.query_one("#gains", VerticalScroll).scroll_relative(y=lines, animate=False)

    def show_body(self, state: State, width: int) -> None:
        self.query_one("#bank", Lines).show([(words.fitted(f" {words.bank_line(state.bank)}", width), "bold")])
        lines = [piece for line in self._lines(state) for piece in words.wrapped(line, width - 2)]
        text = self.query_one("#text", Lines)
        text.styles.height = len(lines)
        text.show(lines)

    def _lines(self, state: State) -> list[str]:
        if state.designed is None:
            return ["", " no gains are designed yet"]
        lines = ["", *(f" {line}" for line in state.designed.text.splitlines())]
        if state.designed.note:
            lines += ["", f" {state.designed.note}"]
        lines += ["", f" checksum {state.designed.crc:06x}, kept in {sanitise(str(state.designed.path))}"]
        return [*lines, "", " the same in a shell:", *(f"   {command}" for command in state.commands[-4:])]
