"""Ladder: the error falling, rung by rung, down to the noise; and what may be the next."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import Horizontal
from textual.widget import Widget

from gcs.tui import desk_words, ladder_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, TALL, Scrolled
from gcs.tui.draw_desk import fallen, waterfall
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.bars import Bars
from gcs.tui.widgets.lines import Lines
from gcs.tui.widgets.traces import Traces

HINT = "escape, or the same key, shows the ladder again"
LEAST = 4
"""Rows that bars and spectra have at least; rungs between the lowest and the highest are left out before."""
STATUS, STATUS_TALL = 4, 7
"""Rows of the lines below, with their border."""


class LadderScreen(Scrolled):
    """Error by axis and rung, residual spectra before and after, next candidates; three texts in their place."""

    NAME = "Ladder"
    ACTS = (
        Act("d,D", "app.work('diagnose')", "diagnose", "diagnose what the top rung lacks"),
        Act("a,A", "app.add_winner", "add", "add the effect that is missing"),
        Act("u,U", "app.undo", "undo", "take the top rung back"),
        Act("c,C", "app.work('compare')", "compare", "compare the top rung with its runs"),
        Act("p,P", "panel('placebo')", "placebo", "what was added, its signs and its placebo"),
        Act("w,W", "panel('which')", "maneuver", "which maneuver would tell more"),
        Act("e,E", "panel('explain')", "explain", "why, in full"),
        Act("i,I", "app.own_effect", "", "add an effect that you choose, or one of your own by its file"),
        Act("escape", "back", "", "the ladder again"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.panel = ""

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        yield Bars(self.style, "fall")
        yield Traces(self.style, "plot")
        with Horizontal(id="lower"):
            yield Lines(self.style, "rungs")
            yield Lines(self.style, "candidates")
        yield self.scrolled()

    def begin(self) -> None:
        """The ladder."""
        self.panel = ""

    def action_panel(self, which: str) -> None:
        """A text in place of the ladder, and back."""
        self.panel = "" if self.panel == which else which
        self.query_one("#tables").scroll_to(y=0, animate=False)

    def action_back(self) -> None:
        """The ladder again; where it is shown, work under way is called off."""
        if self.panel:
            self.panel = ""
        else:
            self.app.action_cancel()  # type: ignore[attr-defined]

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        rung = desk.current
        texts = bool(self.panel) and rung is not None
        self.query_one("#tables").display = texts
        lower, fall, plot = self.query_one("#lower"), self.query_one("#fall", Bars), self.query_one("#plot", Traces)
        lower.display = not texts
        fall.display = plot.display = rung is not None and not texts
        rungs, others = self.query_one("#rungs", Lines), self.query_one("#candidates", Lines)
        height = self.size.height
        lower.styles.height = STATUS_TALL if height >= TALL else STATUS
        key = (desk, self.panel, width, height, rungs.size, others.size, self.text_width)
        if not self.changed(*key):
            return
        self.query_one("#title", Lines).show([desk_words.ladder_title(desk, width)])
        rungs.show(ladder_words.status_lines(desk, rungs.size.width)[: rungs.size.height])
        others.show(ladder_words.next_candidates(desk, others.size.width, others.size.height)[: others.size.height])
        if rung is None:
            return
        room = height - 7 - (STATUS_TALL if height >= TALL else STATUS) - LEAST
        bars = waterfall(desk, room - 1)
        fall.styles.height = min(max(len(bars.bars) + 1, LEAST), room)
        fall.show(bars)
        spectra = fallen(desk)
        if spectra is not None:
            plot.show(spectra)
        if texts:
            lines = {
                "placebo": lambda: ladder_words.sign_lines(rung, self.text_width),
                "which": lambda: ladder_words.teller_lines(rung, desk, self.text_width),
                "explain": lambda: desk_words.explained_lines(rung, self.text_width),
            }[self.panel]()
            self.put_text([*lines, "", f" {HINT}"])
