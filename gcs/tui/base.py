"""What every screen has: the line that is always visible, the line of screens, and the two lines at the bottom."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Container, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen, Screen
from textual.widget import Widget

from gcs.tui import words
from gcs.tui.actions import ANYWHERE, GUIDE, PILOT, SCROLL, Act, bindings, footer
from gcs.tui.guide import LINES as GUIDE_LINES
from gcs.tui.guide import guide_words
from gcs.tui.next_step import next_words
from gcs.tui.plot import Plot, Style
from gcs.tui.pressing import pressed, pressing_keys
from gcs.tui.state import State
from gcs.tui.top_line import top_line
from gcs.tui.widgets.lines import Line, Lines
from gcs.tui.widgets.traces import Traces

NOTICE_LINES = 3
SMALLEST = (80, 24)
"""Columns and rows; below, lines would hide each other."""
TALL, WIDE = 34, 160
"""From so many rows text and plot stand above each other, from so many columns beside each other."""


class Page(Screen[None]):
    """A screen that shows a `State`. It keeps none of it, only where its user looks: a cursor, a view."""

    VERTICAL_BREAKPOINTS = [(0, "-short"), (TALL, "-tall")]
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (WIDE, "-wide")]
    NAME = ""
    ACTS: ClassVar[tuple[Act, ...]] = ()
    """What the keys do here; general ones are added."""

    def __init_subclass__(cls) -> None:
        if "ACTS" in cls.__dict__:
            cls.BINDINGS = bindings(cls.ACTS)
        super().__init_subclass__()

    def __init__(self, style: Style) -> None:
        super().__init__(classes=f"page {style}")
        self.style: Style = style
        self._there = False
        self._small = False
        self._shown_key: tuple[object, ...] = ()
        self._flight: object = None

    def on_mount(self) -> None:
        """All widgets are there."""
        self._there = True

    def compose(self) -> ComposeResult:
        yield Lines(self.style, "top")
        yield Lines(self.style, "screens")
        yield from self.body()
        yield Lines(self.style, "guide")
        yield Lines(self.style, "notice")
        yield Lines(self.style, "next")
        yield Lines(self.style, "keys")
        yield Lines(self.style, "pilot")

    def body(self) -> Iterable[Widget]:
        """The widgets between the two lines above and the three below."""
        return ()

    @property
    def keys(self) -> str:
        """The footer."""
        return footer(self.ACTS)

    def show(self, state: State, problem: str = "", *, guided: bool = False) -> None:
        """Show this moment, and why the last thing asked for was not done; `guided`: and explain what is seen."""
        width = self.size.width
        if width < 1 or not self._there or not self.query("#pilot"):
            return  # not there yet, or being taken down
        self.query_one("#top", Lines).show([top_line(state, width)])
        if self._too_small():
            text = words.too_small((width, self.size.height), SMALLEST)
            self.query_one("#screens", Lines).show([(text, "bold")])
            return
        self.query_one("#screens", Lines).show([words.screens_line(state, self.NAME, width)])
        notice = self.query_one("#notice", Lines)
        text = problem or words.notice(state, self.NAME, width)
        lines = words.notice_lines(text, width, 1 if guided else NOTICE_LINES)
        notice.styles.height = len(lines)
        notice.display = bool(lines)
        notice.show(lines)
        self._show_guide(guide_lines(state, self.NAME, width) if guided else [])
        self.query_one("#next", Lines).show([next_line(state, self.NAME, width)])
        keys = words.fitted(words.with_general(self.keys, width), width)
        self.query_one("#keys", Lines).show([pressing_keys(keys, (*self.ACTS, *ANYWHERE))])
        self.query_one("#pilot").display = state.simulated
        self.query_one("#pilot", Lines).show([pressing_keys(words.pilot_line(state, width), PILOT)])
        if state.desk.path != self._flight:
            self._flight = state.desk.path
            self.begin()
        self.show_body(state, width)

    def begin(self) -> None:
        """Another flight is looked at from the first view, whatever was left open of the one before."""

    def _show_guide(self, lines: Sequence[Line]) -> None:
        guide = self.query_one("#guide", Lines)
        guide.styles.height = len(lines)
        guide.display = bool(lines)
        guide.show(lines)

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

    def changed(self, *key: object) -> bool:
        """Whether anything of this is another than at the last look; values, or objects that are never changed."""
        before, self._shown_key = self._shown_key, key
        return len(before) != len(key) or any(a is not b and a != b for a, b in zip(before, key, strict=True))


class Scrolled(Page):
    """A page with a text that may be longer than the screen, in `tables`."""

    def scrolled(self) -> Widget:
        """The box of the text."""
        return VerticalScroll(Lines(self.style, "text"), id="tables", can_focus=False)

    def action_scroll(self, lines: int) -> None:
        """Move the text."""
        self.query_one("#tables", VerticalScroll).scroll_relative(y=lines, animate=False)

    def put_text(self, lines: Sequence[Line]) -> None:
        """The text."""
        text = self.query_one("#text", Lines)
        text.styles.height = max(1, len(lines))
        text.show(lines)

    @property
    def text_width(self) -> int:
        """Columns that the text has."""
        return max(40, self.query_one("#tables").size.width - 1)


class Split(Scrolled):
    """Text and a plot: both where there is room, else the one that was chosen with V."""

    VIEWS: ClassVar[tuple[str, ...]] = ("text", "plot")
    """The first is the text; the others are plots."""
    NO_PLOT = "nothing to draw yet"

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.view = 0
        self._kind = ""
        self._drawable = False

    @property
    def roomy(self) -> bool:
        return self.size.height >= TALL or self.size.width >= WIDE

    @property
    def keys(self) -> str:
        """The footer, without the key for the next view where there is none."""
        return footer([act for act in self.ACTS if act is not VIEW or self._views > 1])

    @property
    def _views(self) -> int:
        """How many there are to go through."""
        return len(self.VIEWS) - (1 if self.roomy else 0)

    @property
    def plotted(self) -> str:
        """The plot that is shown, or would be."""
        return self.VIEWS[max(1, self.view)]

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        with Container(id="split"):
            yield self.scrolled()
            with Container(id="drawn"):
                yield from self.drawn()

    def drawn(self) -> Iterable[Widget]:
        """The plots."""
        yield Traces(self.style, "plot")

    def begin(self) -> None:
        """The first view."""
        self.view = 0

    def action_view(self) -> None:
        """The next view."""
        if not self._drawable:
            self.app.notice(self.NO_PLOT)  # type: ignore[attr-defined]
            return
        if self._views < 2:
            self.app.notice("both views stand here already")  # type: ignore[attr-defined]
            return
        first = 1 if self.roomy else 0
        shown = max(self.view, first)
        self.view = shown + 1 if shown + 1 < len(self.VIEWS) else first

    def lay_out(self, drawable: bool) -> None:
        """Show text, plot or both."""
        self._drawable = drawable
        plot_too, text_too = self.view > 0 or self.roomy, self.view == 0 or self.roomy
        if not drawable:
            plot_too, text_too = False, True
        self.query_one("#tables").display = text_too
        self.query_one("#drawn").display = plot_too
        if plot_too and self.focused is None:
            plot = self.query_one("#plot")
            if plot.display:
                self.set_focus(plot, scroll_visible=False)
        if not plot_too and self.focused is not None:
            self.set_focus(None)

    def put_plot(self, plot: Plot, kind: str) -> None:
        """A plot; what is of another kind is looked at from its beginning."""
        traces = self.query_one("#plot", Traces)
        if kind != self._kind:
            self._kind = kind
            traces.action_reset()
        traces.show(plot)


VIEW = Act("v,V", "view", "view", "next view: text or plot")
READ = SCROLL
"""Keys of a page with text."""


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
            self.query_one("#top", Lines).show([top_line(state, self.size.width)])


def guide_lines(state: State, name: str, width: int) -> list[Line]:
    """What the guide says, and the word that ends it, which can be pressed."""
    leave = f"{GUIDE.key} leaves"
    lines = words.notice_lines(guide_words(state, name), width - len(leave) - 2, GUIDE_LINES)
    first = words.justified(lines[0], leave, width - 1)
    return [
        Content.assemble((first[: -len(leave)], "italic"), pressed(leave, GUIDE.action, "italic")),
        *((line, "italic") for line in lines[1:]),
    ]


def next_line(state: State, name: str, width: int) -> Content:
    """`next: ...`"""
    return Content.styled(words.fitted(f" next: {next_words(state, name)}", width), "bold")
