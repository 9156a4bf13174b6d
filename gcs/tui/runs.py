"""Runs: what was flown, whether it is healthy, and what each run is used for."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.desk.state import Choice
from gcs.tui import desk_words
from gcs.tui.actions import Act
from gcs.tui.base import Scrolled
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines


class RunsScreen(Scrolled):
    """The runs of the flight that is open."""

    NAME = "Runs"
    ACTS = (
        Act("up", "move(-1)", "", "mark the run above", "up"),
        Act("down", "move(1)", "", "mark the run below", "down"),
        Act("f,F", "choose('FIT')", "fit", "use the marked run to fit"),
        Act("v,V", "choose('VALIDATE')", "validate", "use the marked run to validate"),
        Act("x,X", "choose('OUT')", "leave out", "leave the marked run out"),
        Act("o,O", "app.open_flight", "open", "open another flight folder or log"),
        Act("m,M", "app.rename", "name", "name the flight"),
        Act("d,D", "app.keep_in", "", "keep results in another folder"),
        Act("pagedown", "scroll(5)", "", "scroll the reasons down", "page down"),
        Act("pageup", "scroll(-5)", "", "scroll the reasons up", "page up"),
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.at = 0

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        yield Lines(self.style, "head")
        yield Lines(self.style, "rows")
        yield self.scrolled()

    def action_move(self, lines: int) -> None:
        """The mark."""
        self.at += lines
        self.app.run_look()  # type: ignore[attr-defined]

    def action_mark(self, number: int) -> None:
        """The run that was pressed."""
        self.at = number
        self.app.run_look()  # type: ignore[attr-defined]

    def action_choose(self, choice: str) -> None:
        """Use the marked run so."""
        self.app.use_run(self.at, Choice[choice])  # type: ignore[attr-defined]

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        self.at = max(0, min(self.at, len(desk.runs) - 1))
        rows = self.query_one("#rows", Lines)
        rows.styles.height = min(max(1, len(desk.runs)), max(5, self.size.height - 14))
        if not self.changed(desk, self.at, width, rows.size.height, self.text_width):
            return
        self.query_one("#title", Lines).show([desk_words.flight_line(state, width)])
        self.query_one("#head", Lines).show([desk_words.run_head(width)])
        rows.show(desk_words.run_rows(desk, self.at, width, max(1, rows.size.height)))
        self.put_text(desk_words.run_details(desk, self.at, self.text_width))
