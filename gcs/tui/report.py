"""Report: the page of the flight, and the commands that do the same in a shell."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.tui import desk_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, Scrolled
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines


class ReportScreen(Scrolled):
    """Writes the page; lists what was done."""

    NAME = "Report"
    ACTS = (
        Act("w,W", "app.work('report')", "write the page", "write the report page"),
        Act("p,P", "app.work('PDF')", "as PDF too", "write the page, and the same as PDF for paper"),
        Act("m,M", "app.rename", "name", "name the flight"),
        Act("d,D", "app.keep_in", "other folder", "keep results in another folder"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.audit: tuple[str, ...] = ()

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        yield self.scrolled()

    def audited(self, lines: tuple[str, ...]) -> None:
        """The flight's audit, newest first."""
        self.audit = lines

    def show_body(self, state: State, width: int) -> None:
        if not self.changed(state.desk, state.commands, self.audit, width, self.text_width):
            return
        self.query_one("#title", Lines).show([desk_words.flight_line(state, width)])
        self.put_text(desk_words.report_lines(state, self.audit, self.text_width))
