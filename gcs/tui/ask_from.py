"""A question whose likely answers are listed: up and down put one into the field, where more can be typed."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from textual.containers import Vertical
from textual.suggester import Suggester
from textual.widget import Widget
from textual.widgets import Input

from gcs.link.decode import sanitise
from gcs.tui.dialogs import Ask
from gcs.tui.plot import Style
from gcs.tui.pressing import pressed
from gcs.tui.widgets.lines import Line, Lines
from gcs.tui.words import fitted

ROWS = 12


def quoted(path: object) -> str:
    """A folder or log as `flights_in` takes it."""
    return f'"{path}"' if " " in str(path) else str(path)


def flights_in(text: str) -> list[str]:
    """The folders and logs that somebody typed, with blanks between; in quotes where a name has one itself."""
    if Path(text).expanduser().exists():
        return [text]
    try:
        pieces = shlex.split(text, posix=False)  # a backslash parts folders in Windows
    except ValueError:
        return [text]
    return [piece[1:-1] if piece[0] == piece[-1] and piece[0] in "\"'" else piece for piece in pieces]


class Paths(Suggester):
    """Completes the last folder or file that is typed; the right arrow takes it."""

    def __init__(self) -> None:
        super().__init__(use_cache=False, case_sensitive=True)

    async def get_suggestion(self, value: str) -> str | None:
        """The first name in that folder that begins so; None where there is none."""
        return _completed(value) or _completed(value.rpartition(" ")[2], value)


def _completed(last: str, value: str = "") -> str | None:
    """`value`, or what it ends with, behind which the rest of a name stands."""
    typed = Path(last).expanduser()
    if not last or last.endswith(("/", "\\")):
        folder, begin = typed, ""
    else:
        folder, begin = typed.parent, typed.name
    try:
        names = sorted(one.name for one in folder.iterdir() if one.name.startswith(begin))
    except OSError:
        return None
    shown = [name for name in names if begin or not name.startswith(".")]
    return (value or last) + shown[0][len(begin) :] if last and shown else None


class AskFrom(Ask):
    """Gives what stands in the field, or the answer that was pressed."""

    BINDINGS = [("down", "move(1)", "down"), ("up", "move(-1)", "up")]

    def __init__(
        self,
        style: Style,
        question: str,
        hint: str,
        value: str = "",
        offers: Sequence[tuple[str, str]] = (),
        *,
        suggester: Suggester | None = None,
        several: bool = False,
    ) -> None:
        """`offers`: words, each with what it is; `suggester` completes what is typed. Of `several` words, with blanks
        between, the arrows give the last."""
        super().__init__(style, question, hint, value)
        self._suggester = suggester
        self._offers = offers
        self._several = several
        self._at = next((number for number, (word, _) in enumerate(offers) if word == value), -1)

    def body(self) -> Iterable[Widget]:
        with Vertical(classes="box"):
            yield Lines(self.style, "question")
            yield Input(self._value, id="answer", suggester=self._suggester)
            yield Lines(self.style, "offers")
            yield Lines(self.style, "hint")

    def on_mount(self) -> None:
        super().on_mount()
        self._list()

    def on_resize(self) -> None:
        """The lines are cut anew."""
        self._list()

    def action_move(self, lines: int) -> None:
        """Put the answer above or below into the field."""
        if self._offers:
            was, self._at = self._at, max(0, min(self._at + lines, len(self._offers) - 1))
            field = self.query_one("#answer", Input)
            field.value = self._before(field.value, was) + self._offers[self._at][0]
            field.cursor_position = len(field.value)
            self._list()

    def _before(self, typed: str, was: int) -> str:
        """What was typed before the answer that an arrow put there, or before a blank at the end."""
        if not self._several:
            return ""
        if typed.endswith(" "):
            return typed
        put = self._offers[was][0] if was >= 0 else ""
        return typed.removesuffix(put) if put and typed.endswith(f" {put}") else ""

    def action_choose(self, number: int) -> None:
        """The answer that was pressed."""
        typed = self.query_one("#answer", Input).value
        self.dismiss(self._before(typed, self._at) + self._offers[number][0])

    def _list(self) -> None:
        width = max(20, self.app.size.width - 8)
        rows = min(ROWS, len(self._offers), max(1, self.app.size.height - 16 - len(self.hint_lines)))
        first = max(0, min(self._at - rows // 2, len(self._offers) - rows))
        names = max((len(word) for word, _ in self._offers), default=0)
        names = min(names, width // 2)
        lines: list[Line] = []
        for number, (word, what) in enumerate(self._offers[first : first + rows], first):
            mark = "▶" if number == self._at else " "
            text = fitted(f" {mark} {fitted(sanitise(word), names):<{names}}  {sanitise(what)}", width)
            lines.append(pressed(text, f"screen.choose({number})", "reverse" if number == self._at else ""))
        shown = self.query_one("#offers", Lines)
        shown.styles.height = max(1, len(lines))
        shown.show(lines)
