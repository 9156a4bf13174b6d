"""Diagnose: which effect is missing, how sure that is, why, what could hide; candidates ranked as they are asked."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.tui import desk_words, ranking_words
from gcs.tui.actions import Act
from gcs.tui.base import VIEW, Split
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Line, Lines


class DiagnoseScreen(Split):
    """The verdict on the top rung of the ladder, and the table of candidates."""

    NAME = "Diagnose"
    VIEWS = ("verdict", "candidates")
    NO_PLOT = "no candidates yet: D diagnoses"
    ACTS = (
        Act("d,D", "app.work('diagnose')", "diagnose", "ask what the top rung lacks"),
        Act("a,A", "add", "add", "add the effect that is missing; where none is, the marked one (asks first)"),
        Act("u,U", "app.undo", "undo", "take the top rung back"),
        VIEW,
        Act("enter", "about", "about", "what the marked candidate is, and what it would do", "enter"),
        Act("e,E", "explain", "why", "all reasons, or the answer in brief"),
        Act("w,W", "app.write_card", "card", "write the maneuver that would tell as a test card"),
        Act("i,I", "app.own_effect", "choose", "add an effect that you choose, or one of your own by its file"),
        Act("escape", "back", "", "the answer again"),
        Act("up", "move(-1)", "", "mark the candidate above, or scroll up", "up"),
        Act("down", "move(1)", "", "mark the candidate below, or scroll down", "down"),
        Act("pagedown", "scroll(10)", "", "scroll down by a page", "page down"),
        Act("pageup", "scroll(-10)", "", "scroll up by a page", "page up"),
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.full = False
        self.about = False
        self.at = 0
        self._asked = False

    def drawn(self) -> Iterable[Widget]:
        yield Lines(self.style, "board")

    def lay_out(self, drawable: bool) -> None:
        """The text, the table, or both; while it is asked the table, which says so."""
        self._drawable = drawable
        table = self._table
        self.query_one("#tables").display = not table or (self.roomy and (self.about or not self._asked))
        self.query_one("#drawn").display = table

    @property
    def _table(self) -> bool:
        """Whether the table is shown, or will be at the next look: keys may come faster."""
        return self._drawable and (self.roomy or self.view > 0)

    def action_move(self, lines: int) -> None:
        """The mark in the table; without one the text."""
        if not self._table:
            self.action_scroll(lines)
            return
        self.at += lines
        self.app.run_look()  # type: ignore[attr-defined]

    def action_add(self) -> None:
        """What is missing, or else what is marked: of two together the first."""
        rows = ranking_words.candidates_of(self.app.worker.desk.state())  # type: ignore[attr-defined]
        marked = rows[self.at].effects[0] if self._table and self.at < len(rows) else ""
        self.app.add_winner_or(marked)  # type: ignore[attr-defined]

    def action_mark(self, number: int) -> None:
        """The candidate that was pressed, and what it is."""
        self.at = number
        self._turn(about=True)

    def action_about(self) -> None:
        """What the marked candidate is, and back."""
        self._turn(about=not self.about)

    def action_explain(self) -> None:
        """All reasons, and back."""
        self.full = not self.full
        self._turn(about=False)

    def action_back(self) -> None:
        """The answer again; where it is shown, work under way is called off."""
        if self.about:
            self._turn(about=False)
            self.view = 1
        else:
            self.app.action_cancel()  # type: ignore[attr-defined]

    def _turn(self, *, about: bool) -> None:
        """Show the text, from its beginning."""
        self.about, self.view = about, 0
        self.query_one("#tables").scroll_to(y=0, animate=False)
        self.app.run_look()  # type: ignore[attr-defined]

    def begin(self) -> None:
        """The verdict."""
        super().begin()
        self.full, self.about, self.at = False, False, 0

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        rung = desk.current
        rows = ranking_words.candidates_of(desk)
        asked = desk.ranking is not None
        if asked != self._asked:  # the table while it is asked, then the answer
            self._asked, self.about, self.view = asked, False, int(asked)
        self.at = max(0, min(self.at, len(rows) - 1))
        self.lay_out(bool(rows) or asked)
        table = self.query_one("#board", Lines)
        size = width, self.size.height, self.text_width, table.size
        if not self.changed(desk, self.full, self.about, self.at, self.view, size):
            return
        title = desk_words.ladder_title(desk, width) if rung is not None else desk_words.flight_line(state, width)
        self.query_one("#title", Lines).show([title])
        lines: list[Line]
        if self.about and rows:
            lines = [*desk_words.broken(ranking_words.about_lines(desk, self.at), self.text_width)]
        elif self.full and rung is not None and rung.answer is not None:
            lines = [*desk_words.explained_lines(rung, self.text_width)]
        else:
            lines = [*desk_words.verdict_lines(desk, self.text_width)]
        self.put_text(lines)
        if table.size.width:
            table.show(ranking_words.board(desk, self.at, (table.size.width, table.size.height), self.style))
