"""Connect: where to begin, and what is heard there."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.tui import connect_words
from gcs.tui.actions import Act
from gcs.tui.base import Scrolled
from gcs.tui.connections import Connection, first_marked
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines


class ConnectScreen(Scrolled):
    """The first screen."""

    NAME = "Connect"
    ACTS = (
        Act("up", "move(-1)", "", "mark the line above", "up"),
        Act("down", "move(1)", "", "mark the line below", "down"),
        Act("enter", "go", "begin", "begin with the marked line", "enter"),
        Act("a,A", "app.type_link", "link", "type a link"),
        Act("g,G", "app.look_for_connections", "look", "look again for serial ports"),
        Act("c,C", "check", "check", "what to set before flying, and back"),
        Act("t,T", "app.take_over", "", "take another address that speaks as the vehicle for it"),
        Act("o,O", "app.open_flight", "open", "open a flight folder or a log"),
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.at = 0
        self.offered: tuple[Connection, ...] = ()
        self.here = ""
        self.checking = False
        """Readiness is shown in the place of the links."""

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        yield Lines(self.style, "connections")
        yield Lines(self.style, "heard-title")
        yield self.scrolled()

    def offer(self, connections: tuple[Connection, ...], here: str) -> None:
        """What there is to connect to, and where we are; the mark stays on its line."""
        marked = self.offered[self.at].name if self.at < len(self.offered) else ""
        if connections and not self.offered:
            marked = connections[first_marked(connections)].name
        names = [one.name for one in connections]
        self.offered, self.here = connections, here
        self.at = names.index(marked) if marked in names else 0

    def action_move(self, lines: int) -> None:
        """The mark; or the text, where readiness is shown."""
        if self.checking:
            self.action_scroll(lines)
            return
        self.at = max(0, min(self.at + lines, len(self.offered) - 1))
        self.app.run_look()  # type: ignore[attr-defined]

    def action_mark(self, number: int) -> None:
        """The line that was pressed; pressed again, it connects."""
        if self.at == number:
            self.action_go()
            return
        self.at = number
        self.app.run_look()  # type: ignore[attr-defined]

    def action_go(self) -> None:
        """Connect to the marked line."""
        if self.at < len(self.offered) and not self.checking:
            self.app.connect_to(self.offered[self.at])  # type: ignore[attr-defined]

    def action_check(self) -> None:
        """Look at the vehicle and show what was found; or back to the links."""
        self.checking = not self.checking
        if self.checking:
            self.app.check_vehicle()  # type: ignore[attr-defined]
        self.app.run_look()  # type: ignore[attr-defined]

    def show_body(self, state: State, width: int) -> None:
        for name in ("#connections", "#heard-title"):
            self.query_one(name).display = not self.checking
        if self.checking:
            self.query_one("#title", Lines).show([(" can this card be flown?", "bold")])
            self.put_text(connect_words.readiness_lines(state, self.text_width))
            return
        self.query_one("#title", Lines).show([(" where to begin: up/down and enter, or a click", "bold")])
        self.query_one("#heard-title", Lines).show([(" what is heard", "bold")])
        box = self.query_one("#connections", Lines)
        heard = connect_words.heard_lines(state, self.text_width)
        room = self.size.height - 9 - min(8, len(heard))
        box.styles.height = min(connect_words.list_height(self.offered), max(6, room))
        height = max(1, box.size.height)
        box.show(connect_words.connection_lines(self.offered, self.at, self.here, width, height))
        self.put_text(heard)
