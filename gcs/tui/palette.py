"""The palette: every action of every screen, found by typing parts of its name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from textual.containers import Vertical
from textual.widget import Widget
from textual.widgets import Input

from gcs.tui.base import Dialog
from gcs.tui.plot import Style
from gcs.tui.pressing import pressed
from gcs.tui.widgets.lines import Line, Lines
from gcs.tui.words import fitted

ROWS = 10


@dataclass(frozen=True, slots=True)
class Entry:
    """One action."""

    screen: str
    """Where it is; empty where everywhere."""
    key: str
    name: str
    action: str

    @property
    def words(self) -> str:
        return f"{self.screen}: {self.name}" if self.screen else self.name


def matching(entries: Sequence[Entry], text: str) -> list[int]:
    """Numbers of the entries that hold all words of the text; those that begin with it first."""
    wanted = text.lower().split()
    found = [i for i, one in enumerate(entries) if all(word in one.words.lower() for word in wanted)]
    return sorted(found, key=lambda i: not (wanted and entries[i].name.lower().startswith(wanted[0])))


class Palette(Dialog):
    """Gives the number of an entry, or None."""

    BINDINGS = [("down", "move(1)", "down"), ("up", "move(-1)", "up")]

    def __init__(self, style: Style, entries: Sequence[Entry]) -> None:
        super().__init__(style)
        self._entries = entries
        self._found: list[int] = list(range(len(entries)))
        self._at = 0

    def body(self) -> Iterable[Widget]:
        with Vertical(classes="box"):
            yield Input("", placeholder="type parts of a name", id="answer")
            yield Lines(self.style, "found")
            yield Lines(self.style, "hint")

    def on_mount(self) -> None:
        self.query_one("#found").styles.height = ROWS
        self.query_one("#hint", Lines).show([" up/down, enter does it, escape leaves, F12 aborts"])
        self._list()

    def on_resize(self) -> None:
        """The lines are cut anew."""
        self._list()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Find."""
        self._found = matching(self._entries, event.value)
        self._at = 0
        self._list()

    def on_input_submitted(self) -> None:
        """Enter."""
        self.dismiss(str(self._found[self._at]) if self._found else None)

    def action_move(self, lines: int) -> None:
        """The mark."""
        self._at = max(0, min(self._at + lines, len(self._found) - 1))
        self._list()

    def action_take(self, place: int) -> None:
        """The entry that was pressed."""
        self.dismiss(str(self._found[place]))

    def _list(self) -> None:
        width = max(20, self.app.size.width - 8)
        first = max(0, min(self._at - ROWS // 2, len(self._found) - ROWS))
        lines: list[Line] = []
        for place, number in enumerate(self._found[first : first + ROWS], first):
            one = self._entries[number]
            text = fitted(f" {'▶' if place == self._at else ' '} {one.key:>9}  {one.words}", width)
            lines.append(pressed(text, f"screen.take({place})", "reverse" if place == self._at else ""))
        self.query_one("#found", Lines).show(lines or [" nothing has that in its name"])
