"""Diagnose: which effect is missing, how sure that is, why, and what could hide."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.tui import desk_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, VIEW, Split
from gcs.tui.plot import Style, candidate_bars
from gcs.tui.state import State
from gcs.tui.widgets.bars import Bars
from gcs.tui.widgets.lines import Lines


class DiagnoseScreen(Split):
    """The verdict on the top rung of the ladder."""

    NAME = "Diagnose"
    VIEWS = ("verdict", "bars")
    ACTS = (
        Act("d,D", "app.work('diagnose')", "ask", "ask what the top rung lacks"),
        Act("a,A", "app.add_winner", "add", "add the effect that is missing"),
        Act("u,U", "app.undo", "undo", "take the top rung back"),
        VIEW,
        Act("e,E", "explain", "explain", "all reasons, or the answer in brief"),
        Act("w,W", "app.write_card", "card", "write the maneuver that would tell as a test card"),
        Act("i,I", "app.own_effect", "own effect", "add an effect of your own, by its file"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.full = False

    def drawn(self) -> Iterable[Widget]:
        yield Bars(self.style, "bars")

    def lay_out(self, drawable: bool) -> None:
        """As elsewhere; bars take no keys."""
        self._drawable = drawable
        self.query_one("#tables").display = self.roomy or self.view == 0 or not drawable
        self.query_one("#drawn").display = drawable and (self.roomy or self.view > 0)

    def action_explain(self) -> None:
        """All reasons, and back."""
        self.full = not self.full
        self.view = 0

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        rung = desk.current
        rows = [] if rung is None else desk_words.candidates(rung.diagnosis)
        self.lay_out(bool(rows))
        size = width, self.size.height, self.text_width
        if not self.changed(desk, self.full, self.view, size):
            return
        title = desk_words.ladder_title(desk, width) if rung is not None else desk_words.flight_line(state, width)
        self.query_one("#title", Lines).show([title])
        full = self.full and rung is not None and rung.diagnosis is not None
        lines = (
            desk_words.explained_lines(rung, self.text_width)
            if full and rung is not None
            else desk_words.verdict_lines(desk, self.text_width)
        )
        self.put_text(lines)
        self.query_one("#bars", Bars).show(candidate_bars(rows, "explained share of what can be explained"))
