"""What every screen has: the line that is always visible, the line of screens, and the two lines at the bottom."""

from __future__ import annotations

from collections.abc import Iterable

from textual.app import ComposeResult
from textual.content import Content
from textual.screen import ModalScreen, Screen
from textual.widget import Widget

from gcs.tui import words
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines

PILOT_KEYS = " simulated pilot: T take off  L land  B bank switch (LQR / autopilot)"

NOTICE_LINES = 3
SMALLEST = (80, 24)
"""Columns and rows; below, lines would hide each other."""


class Page(Screen[None]):
    """A screen that shows a `State`. It keeps none of it."""

    VERTICAL_BREAKPOINTS = [(0, "-short"), (34, "-tall")]
    NAME = ""
    KEYS = ""
    """What the keys do here; general ones are added."""

    def __init__(self, style: Style) -> None:
        super().__init__(classes=f"page {style}")
        self.style: Style = style
        self._small = False

    def compose(self) -> ComposeResult:
        yield Lines(self.style, "top")
        yield Lines(self.style, "screens")
        yield from self.body()
        yield Lines(self.style, "notice")
        yield Lines(self.style, "next")
        yield Lines(self.style, "keys")
        yield Lines(self.style, "pilot")

    def body(self) -> Iterable[Widget]:
        """The widgets between the two lines above and the three below."""
        return ()

    def show(self, state: State, problem: str = "") -> None:
        """Show this moment, and why the last thing asked for was not done."""
        width = self.size.width
        if width < 1 or not self.query("#pilot"):
            return  # not there yet, or being taken down
        self.query_one("#top", Lines).show([words.top_line(state, width)])
        if self._too_small():
            text = words.too_small((width, self.size.height), SMALLEST)
            self.query_one("#screens", Lines).show([(text, "bold")])
            return
        self.query_one("#screens", Lines).show([words.screens_line(state, self.NAME, width)])
        notice = self.query_one("#notice", Lines)
        trouble = state.trouble if state.vehicle is None and state.trouble else ""
        lines = words.notice_lines(problem or trouble or words.caution(state, width) or state.said, width, NOTICE_LINES)
        notice.styles.height = len(lines)
        notice.display = bool(lines)
        notice.show(lines)
        self.query_one("#next", Lines).show([next_line(state, self.NAME, width)])
        self.query_one("#keys", Lines).show([words.fitted(f" {self.KEYS}", width)])
        self.query_one("#pilot").display = state.simulated
        self.query_one("#pilot", Lines).show([words.fitted(PILOT_KEYS, width) if state.simulated else ""])
        self.show_body(state, width)

    def _too_small(self) -> bool:
        """Whether the terminal is too small for this screen: then only the line with the abort key is left."""
        small = self.size.width < SMALLEST[0] or self.size.height < SMALLEST[1]
        if small != self._small:
            self._small = small
            for child in self.children:
                child.display = not small or child.id in ("top", "screens")
        return small

    def show_body(self, state: State, width: int) -> None:
        """Show what is this screen's own."""


class Dialog(ModalScreen[str | None]):
    """A question over a screen. The line that is always visible stays, and so does F12; space aborts unless typed."""

    BINDINGS = [("escape", "dismiss(None)", "leave"), ("space", "app.abort", "abort")]

    def __init__(self, style: Style) -> None:
        super().__init__(classes=f"dialog {style}")
        self.style: Style = style

    def compose(self) -> ComposeResult:
        yield Lines(self.style, "top")
        yield from self.body()

    def body(self) -> Iterable[Widget]:
        """The question."""
        return ()

    def show(self, state: State) -> None:
        """Keep the line that is always visible up to date."""
        if self.size.width and self.query("#top"):
            self.query_one("#top", Lines).show([words.top_line(state, self.size.width)])


def next_line(state: State, name: str, width: int) -> Content:
    """`next: ...`"""
    return Content.styled(words.fitted(f" next: {words.next_words(state, name)}", width), "bold")
