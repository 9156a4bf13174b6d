"""The questions the app asks: a word to type, and a yes to something that cannot be taken back by a key."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import Vertical
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Input

from gcs.link.decode import sanitise
from gcs.tui.base import Dialog
from gcs.tui.plot import Style
from gcs.tui.pressing import pressed
from gcs.tui.widgets.lines import Lines
from gcs.tui.words import sanitise_line, wrapped

NO = "screen.dismiss(None)"
ANSWERS = Content.assemble(
    " ", pressed("enter takes it", "screen.take"), ", ", pressed("escape leaves", NO), ", F12 aborts"
)
YES_OR_NO = Content.assemble(
    (" ", "bold"),
    pressed("Y yes", "screen.dismiss('yes')", "bold"),
    ("   ", "bold"),
    pressed("N no (also escape)", NO, "bold"),
)


class Ask(Dialog):
    """Asks for a word. Gives it, or None."""

    def __init__(self, style: Style, question: str, hint: str, value: str = "") -> None:
        super().__init__(style)
        self._question = question
        self._hint = hint
        self._value = value

    def body(self) -> Iterable[Widget]:
        with Vertical(classes="box"):
            yield Lines(self.style, "question")
            yield Input(self._value, id="answer")
            yield Lines(self.style, "hint")

    def on_mount(self) -> None:
        self.query_one("#question", Lines).show([(f" {self._question}", "bold")])
        self.break_text()

    def on_resize(self) -> None:
        """The hint is broken anew."""
        self.break_text()

    def break_text(self) -> None:
        """Break the hint to the box."""
        lines = self.hint_lines
        hint = self.query_one("#hint", Lines)
        hint.styles.height = len(lines) + 1
        hint.show([*lines, ANSWERS])

    @property
    def hint_lines(self) -> list[str]:
        """The hint, broken to the box."""
        return wrapped(f" {sanitise(self._hint)}", max(20, self.app.size.width - 8), 0)

    def action_take(self) -> None:
        """As enter."""
        self.dismiss(self.query_one("#answer", Input).value.strip() or None)

    def on_input_submitted(self) -> None:
        """Enter."""
        self.action_take()


class Text(Dialog):
    """A title and a text below it, broken anew to every width."""

    def __init__(self, style: Style, title: str, lines: tuple[str, ...]) -> None:
        super().__init__(style)
        self._title = title
        self._lines = lines

    def body(self) -> Iterable[Widget]:
        with Vertical(classes="box"):
            yield Lines(self.style, "question")
            yield Lines(self.style, "hint")

    def on_mount(self) -> None:
        self.query_one("#question", Lines).show([(f" {self._title}", "bold")])
        self.break_text()

    def on_resize(self) -> None:
        """The text is broken anew."""
        self.break_text()

    def break_text(self) -> None:
        """Break the text to the box."""
        raise NotImplementedError


class Confirm(Text):
    """Asks for a yes. Gives "yes", or None; every other key than Y is a no."""

    BINDINGS = [("y,Y", "dismiss('yes')", "yes"), ("n,N", "dismiss(None)", "no")]

    def break_text(self) -> None:
        """Break the text to the box."""
        width = max(20, self.app.size.width - 8)
        lines = [piece for line in self._lines for piece in wrapped(f" {sanitise(line)}", width, 0)]
        hint = self.query_one("#hint", Lines)
        hint.styles.height = len(lines) + 1
        hint.show([*lines, YES_OR_NO])


class Told(Text):
    """A text to be read; enter, escape or a press leaves it."""

    BINDINGS = [("enter", "dismiss(None)", "leave")]

    def break_text(self) -> None:
        """Break the text to the box, and cut it at the screen's end."""
        width, height = max(20, self.app.size.width - 8), max(3, self.app.size.height - 10)
        lines = [piece for line in self._lines for piece in wrapped(f" {sanitise_line(line)}", width)]
        if len(lines) > height:
            lines = [*lines[: height - 1], " ..."]
        hint = self.query_one("#hint", Lines)
        hint.styles.height = len(lines) + 1
        hint.show([*lines, pressed(" enter or escape leaves", NO, "bold")])
